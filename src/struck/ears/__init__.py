"""Ears: the sound of bodies in space at a listener, in the open or in a room."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
