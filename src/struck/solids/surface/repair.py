"""Repair: from any surface to one that encloses a body, and what that took.

First mending, which leaves faces where they are; where that cannot give the boundary of the
material, because faces cross, a new surface by signed distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.solids.repair.bodies import largest_body, solid_shells, without_hidden
from struck.solids.repair.exposure import bared, exposed
from struck.solids.repair.mending import (
    LARGEST_OPENING,
    THINNEST,
    Diary,
    Mended,
    counted,
    largest_piece,
    mended,
    sewn_up,
)
from struck.solids.repair.rebuilding import Rebuilt, invented_share, lost_share, rebuilt
from struck.solids.surface.closedness import is_closed, require_closed
from struck.solids.surface.shells import Shells, crossings
from struck.solids.surface.welding import lines, open_edges

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Crossing faces matter when more than this share of the area lies within the material.
_BURIED = 1e-3
# What a rebuilt surface may lose of the old one, or have where there was none.
_LOST, _INVENTED = 0.05, 0.1
# Smaller pieces of an open surface are crumbs and no patches of a body.
_PATCH = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repair:
    """A surface that encloses a body, and what it took.

    Parameters
    ----------
    mesh : Mesh
        Closed, normals outward; with `sheet` an open surface, its faces oriented alike.
    found : tuple of str
        What was wrong, a sentence each; empty for a clean mesh, which stays as it is.
    changed : tuple of str
        What was changed, a sentence each.
    volume_before, volume_after : float
        Enclosed by the mesh as given (from its middle, where it is open) and as it is now, m^3;
        of a sheet, area times wall.
    sheet : bool
        Whether the mesh is a single-sided sheet that takes a wall.
    """

    mesh: Mesh
    found: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    volume_before: float
    volume_after: float
    sheet: bool = False

    def scaled(self, factor: float) -> Repair:
        """Return a copy `factor` times as large; the sentences keep their figures."""
        return replace(
            self,
            mesh=self.mesh.scaled(factor),
            volume_before=self.volume_before * factor**3,
            volume_after=self.volume_after * factor**3,
        )


def repaired(mesh: Mesh, *, wall: float | None = None) -> Repair:
    """Repair a surface, with all tolerances relative to its extent.

    Parameters
    ----------
    mesh : Mesh
        Any triangles.
    wall : float, optional
        Thickness that a single-sided sheet shall have, m.

    Returns
    -------
    Repair
        The mesh itself where nothing is wrong with it.

    Raises
    ------
    MeshError
        When it encloses no body that could be told: a sheet without `wall`, a one-sided or flat
        surface, faces that point every way.
    """
    before = _volume(mesh)
    if _is_clean(mesh):
        return Repair(mesh=mesh, volume_before=before, volume_after=before)
    diary = Diary()
    result, sheet = _result(sewn_up(mesh, diary), wall, diary)
    return Repair(
        mesh=result,
        found=tuple(diary.found),
        changed=tuple(diary.changed),
        volume_before=before,
        volume_after=float(result.areas.sum()) * (wall or 0.0) if sheet else result.volume,
        sheet=sheet,
    )


def _result(mesh: Mesh, wall: float | None, diary: Diary) -> tuple[Mesh, bool]:
    """Return the body, or the sheet and True."""
    bare = bared(mesh)
    if bare is not None and is_closed(bare):
        hidden = counted(len(mesh.faces) - len(bare.faces), "face")
        diary.note(f"{hidden} within the material or repeated.", f"{hidden} removed.")
        mesh = bare
    elif bare is not None and bare.areas.sum() < (1 - _BURIED) * mesh.areas.sum():
        pairs = crossings(mesh)
        diary.found.append(f"Parts overlap and share edges; {len(pairs)} pairs of faces cross.")
        return _rebuilt(mesh, exposed(mesh, pairs), diary), False
    surface = mended(mesh, diary)
    solid = surface.solid
    if surface.areas[solid].sum() >= surface.areas.sum() / 2:
        return _body(surface, solid, diary), False
    joined = _joined(surface, diary)
    return (joined, False) if joined is not None else (_sheet(surface, wall, diary), True)


def _volume(mesh: Mesh) -> float:
    """Return the volume enclosed, seen from the middle of the bounding box, m^3."""
    offsets = mesh.centroids - mesh.bounds.mean(axis=0)
    return float(np.einsum("ij,ij->", offsets, mesh.area_vectors) / 3)


def _is_clean(mesh: Mesh) -> bool:
    try:
        require_closed(mesh)
    except MeshError:
        return False
    return not lines(mesh).any() and not len(crossings(mesh))


def _body(surface: Mended, solid: Flags, diary: Diary) -> Mesh:
    """Return the largest body that the `solid` pieces (P,) bound."""
    shells = solid_shells(surface, solid, diary)
    shells = without_hidden(shells, crossings(shells.mesh), diary)
    crossing = Crossing.of(shells)
    largest = largest_body(shells, crossing.pairs, diary)
    if largest is not shells:
        shells, crossing = largest, Crossing.of(largest)
    if _matters(crossing, shells, diary):
        return _rebuilt(shells.mesh, crossing.limits, diary)
    try:
        require_closed(shells.mesh)
    except MeshError as error:
        diary.note(f"Mended, {error}.", "Rebuilt, as mending was not enough.")
        return _rebuilt(shells.mesh, crossing.limits, diary)
    return shells.mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossing:
    """Where faces cross.

    Parameters
    ----------
    pairs : array (K, 2)
        Faces that do. Of different pieces only where these overlap, not where they touch in
        points and edges.
    limits : Mesh, optional
        What parts material from air.
    buried : float
        Share of the area that lies within the material.
    """

    pairs: Index
    limits: Mesh | None
    buried: float

    @classmethod
    def of(cls, shells: Shells) -> Crossing:
        """Look for it among closed pieces."""
        pairs = crossings(shells.mesh)
        if not len(pairs):
            return cls(pairs=pairs, limits=shells.mesh, buried=0.0)
        limits = exposed(shells.mesh, pairs)
        open_area = 0.0 if limits is None else float(limits.areas.sum())
        buried = max(0.0, 1 - open_area / float(shells.mesh.areas.sum()))
        first, second = shells.labels[pairs].T
        kept = pairs if buried > _BURIED else pairs[first == second]
        return cls(pairs=kept, limits=limits, buried=buried)


def _matters(crossing: Crossing, shells: Shells, diary: Diary) -> bool:
    """Tell whether crossing faces take a new surface; where not, say that they stay."""
    if not len(crossing.pairs):
        return False
    faces = counted(len(np.unique(crossing.pairs)), "face")
    within = f"{100 * crossing.buried:.2g} % of the area lies within the material."
    if crossing.buried <= _BURIED:
        diary.note(f"{faces} cross a little.", f"Crossing faces left: {within}")
        return False
    pieces = len(np.unique(shells.labels[crossing.pairs]))
    overlap = f"{pieces} pieces overlap or touch, in {faces}" if pieces > 1 else f"{faces} cross"
    diary.found.append(f"{overlap}; {within}")
    return True


def _rebuilt(mesh: Mesh, limits: Mesh | None, diary: Diary) -> Mesh:
    new = rebuilt(mesh, limits)
    _say(new, diary)
    return _one(new.mesh, diary)


def _one(mesh: Mesh, diary: Diary) -> Mesh:
    """Return the largest body of a rebuilt surface."""
    result = largest_body(Shells.of(mesh), np.empty((0, 2), np.int64), diary).mesh
    try:
        require_closed(result)
    except MeshError as error:
        raise MeshError(
            f"its surface was rebuilt and encloses no body still ({error}): rebuild it in a mesh "
            "editor as the boundary of a solid"
        ) from error
    return result


def _say(new: Rebuilt, diary: Diary) -> None:
    diary.changed.append(
        f"Surface rebuilt on a lattice of {new.spacing:.3g} m, edges rounded by as much (volume "
        f"{100 * new.change:+.2g} % from the lattice before)."
    )


def _joined(surface: Mended, diary: Diary) -> Mesh | None:
    """Return a body that patches bound together though they do not meet; None where none do."""
    patches = int(np.count_nonzero(surface.areas > _PATCH * surface.areas.sum()))
    box = np.ptp(surface.open.bounds, axis=0)
    if patches < 2 or box.min() <= THINNEST * box.max():
        return None
    limits = exposed(surface.open, crossings(surface.open))
    try:
        new = rebuilt(surface.open, limits, roughly=True)
        if lost_share(surface.open, new) > _LOST or invented_share(surface.open, new) > _INVENTED:
            return None
        new = rebuilt(surface.open, limits)
    except MeshError:
        return None
    diary.found.append(f"{counted(len(surface.areas), 'patch')} of the surface do not meet.")
    _say(new, diary)
    return _one(new.mesh, diary)


def _sheet(surface: Mended, wall: float | None, diary: Diary) -> Mesh:
    sheet, others = largest_piece(surface.open)
    if not open_edges(sheet):
        raise MeshError(
            "the mesh encloses no volume: its faces lie back to back; give the body a thickness, "
            "or one side of the sheet alone with wall="
        )
    share = surface.filled.sum() / surface.areas.sum()
    if wall is None:
        raise MeshError(
            f"the mesh is an open sheet: to close it would take {100 * share:.0f} % of its area, "
            f"and up to {100 * LARGEST_OPENING:.0f} % are filled as holes; give wall=, the "
            "thickness of the sheet in m"
        )
    if others:
        diary.note(
            f"{counted(others + 1, 'sheet')} that do not meet.",
            f"The largest taken, {counted(others, 'other')} left out.",
        )
    diary.note(
        "The surface is open: a sheet with one side.",
        f"Taken as the middle of a wall of {wall:g} m.",
    )
    return sheet
