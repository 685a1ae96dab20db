"""Ears: how a listener hears bodies in space. The only place where bodies are mixed."""
