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

from struck.errors import nearest

_load, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name, or `__version__`, when it is first asked for."""
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name in _names or name.startswith("_"):
        return _load(name)
    where = _ELSEWHERE.get(name) or " or ".join(_find_in_rooms(name)[:_MOST_OFFERED])
    offer = f"it is {where}" if where else nearest(name, _names, "struck.{}") or "see dir(struck)"
    raise AttributeError(f"struck has no {name!r}: {offer.strip()}")


def _find_in_rooms(name: str) -> list[str]:
    """Return where the rooms have a public name, or one of other case, or one that ends in it."""
    public = {
        f"struck.{item}" if item in _names else f"struck.{room}.{item}": item
        for room in sorted(_ROOMS & {*_names})
        for item in getattr(_load(room), "__all__", ())
    }
    for fits in (
        lambda item: item == name,
        lambda item: item.lower() == name.lower(),
        lambda item: name[:1].isupper() and item.endswith(name),
    ):
        if places := [place for place, item in public.items() if fits(item)]:
            return places
    return []


_MOST_OFFERED = 3


# What the shell's commands are called in Python, where that is another name.
_ELSEWHERE = {
    "calibrate": "struck.recordings.calibrated",
    "export": "struck.save, to a file that ends in .sofa or .vtu",
    "info": "repr(model)",
    "list": "struck.materials() of materials, dir(struck.solids) and dir(struck.shapes) of bodies",
    "radiate": "ModalModel.radiating",
}
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
