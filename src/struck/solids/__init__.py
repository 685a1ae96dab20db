"""Bodies by finite elements: solids that mesh themselves, and what fills any closed surface."""

from struck.solids.bodies import Block, Extrusion, Tube
from struck.solids.revolution import Revolution, Stem
from struck.solids.volume_mesh import VolumeMesh

__all__ = ["Block", "Extrusion", "Revolution", "Stem", "Tube", "VolumeMesh"]
