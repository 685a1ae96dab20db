"""The one model that all doors make: modes, gains over contact and listener, material."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
