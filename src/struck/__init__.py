"""struck: the sounds of physical objects, computed from their shape and material.

1. A body and a material make a model: ``analyze`` a solid, a mesh or a file.
2. Whatever strikes it makes a sound: ``render`` a ``Strike``, and ``save`` the model.

>>> import struck
>>> from struck.solids import Tube
>>> chime = struck.analyze(
...     Tube(length=0.505, radius=0.0125, wall=0.001), "steel", accuracy="preview"
... )
>>> sound = struck.render(chime, struck.Strike(at="end", striker="wood", speed=1.0), seconds=1)
>>> sound.samples.shape
(1, 48000)
"""

import lazy_loader

_found, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name, or `__version__`, when it is first asked for."""
    if name != "__version__":
        return _found(name)
    from importlib.metadata import version

    return version(__name__)


# Rooms that are reached as attributes without an import of their own, and not by a `*`.
_ROOMS = {
    "analysis",
    "batch",
    "ears",
    "errors",
    "excitation",
    "explorer",
    "files",
    "live",
    "model",
    "perception",
    "radiation",
    "recordings",
    "report",
    "scene",
    "shapes",
    "solids",
    "synth",
}
__all__ = [name for name in _names if name not in _ROOMS]
