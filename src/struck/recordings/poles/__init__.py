"""Modes that all channels and hits share: found, refined, pruned, and how far they may be off."""
