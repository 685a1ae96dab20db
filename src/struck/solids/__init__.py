"""Bodies by finite elements: solids that mesh themselves, and what fills any closed surface."""

from struck.solids.primitives import Block, Extrusion, Revolution, Stem, Tube
from struck.solids.volume import VolumeMesh

__all__ = ["Block", "Extrusion", "Revolution", "Stem", "Tube", "VolumeMesh"]
