"""A room of objects in the browser: a click strikes, and sounds at once where it hit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
