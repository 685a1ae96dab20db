"""Scenes: bodies in space, what happens to them, and the sound of it offline."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
