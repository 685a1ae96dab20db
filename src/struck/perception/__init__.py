"""Perception: how different impacts sound, which modes are heard, how many contacts to store."""
