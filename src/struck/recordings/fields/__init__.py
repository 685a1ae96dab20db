"""Timbre fields: gains over contact and listener."""
