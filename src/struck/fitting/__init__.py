"""Recordings of an object in, its model out."""
