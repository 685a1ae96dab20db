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

from struck import errors
from struck._api import analyze, load, render, save, show, tune
from struck.damping import Damping, InternalFriction, Measured, Rayleigh
from struck.excitation.strike import Strike
from struck.material import Material, materials
from struck.mesh import Mesh
from struck.model import ModalModel
from struck.sound import Sound

__all__ = [
    "Damping",
    "InternalFriction",
    "Material",
    "Measured",
    "Mesh",
    "ModalModel",
    "Rayleigh",
    "Sound",
    "Strike",
    "analyze",
    "errors",
    "load",
    "materials",
    "render",
    "save",
    "show",
    "tune",
]
