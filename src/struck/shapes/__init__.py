"""Bodies whose modes are known in closed form, or nearly so (1998, sections 2 and 6)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
