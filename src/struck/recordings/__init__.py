"""Recordings of real objects: taken, judged, fitted, and made into timbre fields."""
