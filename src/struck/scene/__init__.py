"""Scenes: bodies in space, strikes and contacts on them, and their sound offline."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
