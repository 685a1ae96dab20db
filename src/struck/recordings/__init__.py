"""Recordings of real objects: taken, judged, fitted, and made into timbre fields."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
