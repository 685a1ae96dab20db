"""Recordings made by a plan: prompted, struck, recorded, judged, and kept."""
