"""Bodies among the pieces of a mended surface: what is loose, hidden or beside the largest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh_topology import submesh
from struck.solids.repair.mending import Diary, Mended, counted, without_needles
from struck.solids.surface.shells import Shells

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Bodies below this share of the largest are debris.
_DEBRIS = 0.01


def solid_shells(surface: Mended, solid: Flags, diary: Diary) -> Shells:
    """Return the pieces that bound bodies, their normals outward."""
    loose = int(np.count_nonzero(~solid))
    if loose:
        share = surface.areas[~solid].sum() / surface.areas.sum()
        diary.note(
            f"{counted(loose, 'loose piece')} of the surface without volume.",
            f"{counted(loose, 'loose piece')} removed ({100 * share:.2g} % of the area).",
        )
    holes = surface.holes(solid)
    if holes:
        share = surface.filled[solid].sum() / surface.areas[solid].sum()
        diary.note(
            f"{counted(holes, 'hole')} in the surface.",
            f"{counted(holes, 'hole')} filled ({100 * share:.2g} % of the area).",
        )
    kept = submesh(surface.mesh, np.flatnonzero(solid[surface.labels]))
    shells, wrong = Shells.of(without_needles(kept, diary)).outward()
    if wrong:
        diary.note(f"{counted(wrong, 'piece')} inside out.", f"{counted(wrong, 'piece')} turned.")
    return shells


def without_hidden(shells: Shells, pairs: Index, diary: Diary) -> Shells:
    """Drop the pieces that lie within the material and cross nothing."""
    kept = shells.bounding()
    kept[shells.labels[pairs]] = True
    hidden = int(np.count_nonzero(~kept))
    if hidden:
        diary.note(
            f"{counted(hidden, 'shell')} within the material.",
            f"{counted(hidden, 'inner shell')} removed: normals outward make no cavity.",
        )
    return shells.only(kept)


def largest_body(shells: Shells, pairs: Index, diary: Diary) -> Shells:
    """Keep the largest body and say what else there was."""
    body = shells.bodies(pairs)
    volumes = np.bincount(body, weights=shells.volumes)
    largest = int(volumes.argmax())
    others = np.delete(volumes, largest) / volumes[largest]
    debris = int(np.count_nonzero(others < _DEBRIS))
    if debris:
        diary.note(
            f"{counted(debris, 'crumb')} beside the body, below {100 * _DEBRIS:g} % of its volume.",
            f"{counted(debris, 'crumb')} removed.",
        )
    rest = others[others >= _DEBRIS]
    if len(rest):
        diary.note(
            f"{counted(len(rest) + 1, 'separate body')}.",
            f"The largest taken; {counted(len(rest), 'other')}, up to {100 * rest.max():.0f} % of "
            "its volume, left out: part= gives another.",
        )
    return shells.only(body == largest)
