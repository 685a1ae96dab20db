"""Fitted modes against computed ones: which pairs are one mode, and which material the body has."""
