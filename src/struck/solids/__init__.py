"""Bodies by finite elements: solids that mesh themselves, and meshers of closed surfaces."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
