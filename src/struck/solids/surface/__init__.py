"""Closed surfaces: tests, repair and signed distance."""
