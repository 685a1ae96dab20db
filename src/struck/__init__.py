"""struck: the sounds of physical objects, computed from what they are.

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

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from struck import errors
    from struck.analysis.analysis import analyze
    from struck.api import fit, load, play, save, show, tune
    from struck.ears.listeners import Binaural, Mono, Stereo
    from struck.ears.reverberation import Reverberation
    from struck.ears.room import Room
    from struck.excitation.force_track import ForceTrack
    from struck.excitation.hold import Hold
    from struck.excitation.pluck import Pluck, Release
    from struck.excitation.roughness import Roughness
    from struck.excitation.scrape import Roll, Scrape
    from struck.excitation.strike import Strike
    from struck.files.sound import Sound
    from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh
    from struck.model.material import Material, materials
    from struck.model.mesh import Mesh
    from struck.model.model import ModalModel
    from struck.perception.audibility import audible
    from struck.perception.sonic_distance import sonic_distance
    from struck.perception.sound_map import SoundMap, sound_map
    from struck.report.comparison import compare
    from struck.scene.body import Body
    from struck.scene.render import render

__all__ = [
    "Binaural",
    "Body",
    "Damping",
    "ForceTrack",
    "Hold",
    "InternalFriction",
    "Material",
    "Measured",
    "Mesh",
    "ModalModel",
    "Mono",
    "Pluck",
    "Rayleigh",
    "Release",
    "Reverberation",
    "Roll",
    "Room",
    "Roughness",
    "Scrape",
    "Sound",
    "SoundMap",
    "Stereo",
    "Strike",
    "analyze",
    "audible",
    "compare",
    "errors",
    "fit",
    "load",
    "materials",
    "play",
    "render",
    "save",
    "show",
    "sonic_distance",
    "sound_map",
    "tune",
]

# Where each public name lives: a name is imported when it is first used (PEP 562).
_HOMES = {
    "struck.api": ("fit", "load", "play", "save", "show", "tune"),
    "struck.analysis.analysis": ("analyze",),
    "struck.perception.audibility": ("audible",),
    "struck.perception.sonic_distance": ("sonic_distance",),
    "struck.perception.sound_map": ("SoundMap", "sound_map"),
    "struck.scene.render": ("render",),
    "struck.report.comparison": ("compare",),
    "struck.model.damping": ("Damping", "InternalFriction", "Measured", "Rayleigh"),
    "struck.ears.listeners": ("Binaural", "Mono", "Stereo"),
    "struck.ears.reverberation": ("Reverberation",),
    "struck.ears.room": ("Room",),
    "struck.excitation.hold": ("Hold",),
    "struck.excitation.pluck": ("Pluck", "Release"),
    "struck.excitation.roughness": ("Roughness",),
    "struck.excitation.scrape": ("Roll", "Scrape"),
    "struck.excitation.strike": ("Strike",),
    "struck.excitation.force_track": ("ForceTrack",),
    "struck.model.material": ("Material", "materials"),
    "struck.model.mesh": ("Mesh",),
    "struck.model.model": ("ModalModel",),
    "struck.scene.body": ("Body",),
    "struck.files.sound": ("Sound",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
# Modules that are reached as attributes without an import of their own.
_MODULES = {"errors", "shapes", "solids"}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for."""
    if name in _MODULES:
        return import_module(f"struck.{name}")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'struck' has no attribute {name!r}")
    found = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Return the public names, those not yet imported too."""
    return sorted({*globals(), *__all__, *_MODULES})
