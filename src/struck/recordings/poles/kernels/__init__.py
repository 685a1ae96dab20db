"""Compiled: groups of modes against the bins that hold them."""
