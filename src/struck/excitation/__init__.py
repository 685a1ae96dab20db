"""Excitation: strikes, scrapes, rolls, plucks and holds, as forces over time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
