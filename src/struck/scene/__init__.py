"""Scenes: bodies, where they are and what happens to them."""
