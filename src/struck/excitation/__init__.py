"""Excitation: what strikes, scrapes, rolls on, plucks or holds a body, as forces over time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
