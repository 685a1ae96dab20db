"""Repair: from any surface to one that encloses a body, with a list of the changes.

First mending, which leaves faces where they are; where that cannot give the boundary of the
material, because faces cross, a new surface. Material is where the winding number exceeds one half
(Barill et al. 2018); the new surface is the boundary of tetrahedra that fill it (Labelle &
Shewchuk 2007), moved onto those old faces that part material from air.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import MeshError, OptionError, counted, require_choice, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh
from struck.model.mesh_topology import boxes_of, edges_of, pieces, submesh, turned_faces, volumes_of
from struck.solids.surface.closedness import (
    ONE_SIDED,
    THINNEST,
    Shells,
    apart,
    crossings,
    exposed,
    flipped,
    is_closed,
    open_faces,
    require_closed,
    without_fins,
)
from struck.solids.surface.welding import (
    Closed,
    closed,
    is_feature,
    lines,
    open_edges,
    sewn,
    single,
    without_lines,
)

# A surface bounds a body while what closes it is small against it. The cap of an open cup,
# of a dome or of a dish is above a sixth of its wall; holes of scans are a few hundredths.
LARGEST_OPENING = 0.1
_BURIED = 1e-3  # share of the area within the material from which on crossing faces matter
_LOST, _INVENTED = 0.05, 0.1  # share that a rebuilt surface may lose, or have in excess
_PATCH = 0.02  # share of the area below which pieces of an open surface are crumbs
MOST_FACES = 2_000_000
"""Largest number of faces of a surface that is repaired, which takes minutes."""


if TYPE_CHECKING:
    from struck.solids.surface.rebuilding import Rebuilt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repair:
    """A surface that encloses a body, with the changes that made it so.

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


def require_holes(holes: str | None, wall: float | None) -> None:
    """Refuse unknown values of `holes`, and all of them in a solid without a wall."""
    if holes is not None:
        require_choice("holes", holes, ("keep", "fill"))
    if holes is not None and wall is None:
        raise OptionError(
            f"holes={holes!r} without a wall: a surface with holes bounds no solid, and those of a "
            "solid are filled; give wall=, or leave it out"
        )


def repaired(mesh: Mesh, *, wall: float | None = None, holes: str | None = None) -> Repair:
    """Repair a surface, all tolerances relative to its extent; a clean mesh is returned itself."""
    # `wall`, m, is for a single-sided sheet; `holes` says whether its openings are meant: "keep",
    # "fill", or by their form. MeshError when there is no body to be told: a sheet without `wall`,
    # a one-sided or flat surface, faces that point every way.
    before = _volume(mesh)
    if _is_clean(mesh):
        return Repair(mesh=mesh, volume_before=before, volume_after=before)
    if len(mesh.faces) > MOST_FACES:
        raise MeshError(
            f"it is damaged and has {len(mesh.faces):,} faces, and at most {MOST_FACES:,} are "
            "repaired: decimate the surface, or export it again, closed"
        )
    record, (together, distance) = RepairLog(), sewn(mesh)
    if distance:
        merged = counted(len(mesh.points) - len(together.points), "vertex")
        record.note(
            f"Faces stand apart by up to {rounded(distance, 2)} m.",
            f"{merged} within {rounded(distance, 2)} m of others merged.",
        )
    result, sheet = _result(together, wall, holes, record)
    return Repair(
        mesh=result,
        found=tuple(record.found),
        changed=tuple(record.changed),
        volume_before=before,
        volume_after=float(result.areas.sum()) * (wall or 0.0) if sheet else result.volume,
        sheet=sheet,
    )


def _result(
    mesh: Mesh, wall: float | None, holes: str | None, record: RepairLog
) -> tuple[Mesh, bool]:
    """Return the body, or the sheet and True."""
    if wall is not None and _is_strip(mesh):
        record.note(
            "The surface has one side, as a Moebius strip has.",
            f"Taken as the middle of a wall of {wall:g} m.",
        )
        return mesh, True
    bare = open_faces(mesh)
    if bare is not None and is_closed(bare):
        hidden = counted(len(mesh.faces) - len(bare.faces), "face")
        record.note(f"{hidden} within the material or repeated.", f"{hidden} removed.")
        mesh = bare
    elif bare is not None and bare.areas.sum() < (1 - _BURIED) * mesh.areas.sum():
        pairs = crossings(mesh)
        record.found.append(
            f"Parts overlap and share edges; {counted(len(pairs), 'pair')} of faces cross."
        )
        return _rebuilt(mesh, exposed(mesh, pairs), record), False
    surface = mended(mesh, record)
    solid = surface.solid
    whole = bool(surface.areas[solid].sum() >= surface.areas.sum() / 2)
    if whole and (wall is None or not _openings_kept(surface, holes)):
        return _body(surface, solid, record), False
    joined = None if whole else _joined(surface, record)
    if joined is not None:
        return joined, False
    # Of a sheet that is open anyway the longest rim is its own, and others are left by default.
    kept = _openings_kept(surface, holes or (None if whole else "keep"))
    if not whole and holes == "fill":
        lines = [surface.open.points[rim] for rim in surface.closed.rims]
        lengths = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum() for p in lines]
        kept = [surface.closed.rims[int(np.argmax(lengths))]]
    return _sheet(surface, kept, wall, record), True


def _is_strip(mesh: Mesh) -> bool:
    """Return whether a surface is one-sided and open, and nowhere more than two faces meet."""
    edges = edges_of(mesh.faces)
    if edges.faces_at.max() > 2 or edges.shared.all():
        return False
    return turned_faces(edges, len(mesh.faces)) is None


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


def _body(surface: Mended, solid: Mask, record: RepairLog) -> Mesh:
    """Return the largest body that the `solid` pieces (P,) bound."""
    shells = solid_shells(surface, solid, record)
    shells = without_hidden(shells, crossings(shells.mesh), record)
    crossing = Crossing.of(shells)
    largest = largest_body(shells, crossing.pairs, record)
    if largest is not shells:
        shells, crossing = largest, Crossing.of(largest)
    if _matters(crossing, shells, record):
        from struck.solids.surface.rebuilding import united  # few surfaces need it

        whole = united(shells, crossing.pairs)
        if whole is None:
            return _rebuilt(shells.mesh, crossing.limits, record)
        record.changed.append("United, each part as it is.")
        return _one(whole, record)
    try:
        require_closed(shells.mesh)
    except MeshError as error:
        record.note(f"Mended, {error}.", "Rebuilt, as mending was not enough.")
        return _rebuilt(shells.mesh, crossing.limits, record)
    return shells.mesh


def largest_of(mesh: Mesh) -> Mesh:
    """Return the pieces of a closed surface of which `repaired` makes the body, as they are."""
    record, bare = RepairLog(), open_faces(mesh)
    if bare is not None and not is_closed(bare):
        return mesh  # parts that share edges, which are rebuilt together
    surface = mended(mesh if bare is None else bare, record)
    shells = solid_shells(surface, surface.solid, record)
    shells = without_hidden(shells, crossings(shells.mesh), record)
    return largest_body(shells, Crossing.of(shells).pairs, record).mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossing:
    """Pairs of faces that cross, and the size of the crossing."""

    pairs: Index  # (K, 2); of two pieces only where they overlap, not where they touch
    limits: Mesh | None  # what parts material from air
    buried: float  # share of the area within the material

    @classmethod
    def of(cls, shells: Shells) -> Crossing:
        """Find the faces that cross among closed pieces."""
        pairs = crossings(shells.mesh)
        if not len(pairs):
            return cls(pairs=pairs, limits=shells.mesh, buried=0.0)
        limits = exposed(shells.mesh, pairs)
        open_area = 0.0 if limits is None else float(limits.areas.sum())
        buried = max(0.0, 1 - open_area / float(shells.mesh.areas.sum()))
        first, second = shells.labels[pairs].T
        kept = pairs if buried > _BURIED else pairs[first == second]
        return cls(pairs=kept, limits=limits, buried=buried)


def _matters(crossing: Crossing, shells: Shells, record: RepairLog) -> bool:
    """Return whether crossing faces require a new surface; where not, record that they stay."""
    if not len(crossing.pairs):
        return False
    faces = counted(len(np.unique(crossing.pairs)), "face")
    within = f"{rounded(100 * crossing.buried, 2)} % of the area lies within the material."
    if crossing.buried <= _BURIED:
        record.note(f"{faces} cross a little.", f"Crossing faces left: {within}")
        return False
    pieces = len(np.unique(shells.labels[crossing.pairs]))
    overlap = f"{pieces} pieces overlap or touch, in {faces}" if pieces > 1 else f"{faces} cross"
    record.found.append(f"{overlap}; {within}")
    return True


def _rebuilt(mesh: Mesh, limits: Mesh | None, record: RepairLog) -> Mesh:
    from struck.solids.surface.rebuilding import rebuilt  # few surfaces need it

    new = rebuilt(mesh, limits)
    _say(new, record)
    return _one(new.mesh, record)


def _one(mesh: Mesh, record: RepairLog) -> Mesh:
    """Return the largest body of a rebuilt surface."""
    result = largest_body(Shells.of(mesh), np.empty((0, 2), np.int64), record).mesh
    try:
        require_closed(result)
    except MeshError as error:
        raise MeshError(
            f"its surface was rebuilt and encloses no body still ({error}): rebuild it in a mesh "
            "editor as the boundary of a solid"
        ) from error
    return result


def _say(new: Rebuilt, record: RepairLog) -> None:
    record.changed.append(
        f"Surface rebuilt on a lattice of {rounded(new.spacing, 3)} m, edges rounded by as much "
        f"(volume {rounded(100 * new.change, 2, sign=True)} % from the lattice before)."
    )


def _joined(surface: Mended, record: RepairLog) -> Mesh | None:
    """Return a body that patches bound together though they do not meet; None where none do."""
    patches = int(np.count_nonzero(surface.areas > _PATCH * surface.areas.sum()))
    box = np.ptp(surface.open.bounds, axis=0)
    if patches < 2 or box.min() <= THINNEST * box.max():
        return None
    from struck.solids.surface.rebuilding import invented_share, lost_share, rebuilt

    limits = exposed(surface.open, crossings(surface.open))
    try:
        new = rebuilt(surface.open, limits, roughly=True)
        if lost_share(surface.open, new) > _LOST or invented_share(surface.open, new) > _INVENTED:
            return None
        new = rebuilt(surface.open, limits)
    except MeshError:
        return None
    record.found.append(f"{counted(len(surface.areas), 'patch')} of the surface do not meet.")
    _say(new, record)
    return _one(new.mesh, record)


def _openings_kept(surface: Mended, holes: str | None) -> list[Index]:
    """Return the rims of openings that stay: all, none, or the round and the straight-edged."""
    if holes is not None:
        return list(surface.closed.rims) if holes == "keep" else []
    extent = surface.open.extent
    return [
        rim for rim in surface.closed.rims if is_feature(surface.open.points[rim], extent=extent)
    ]


def _say_of_holes(surface: Mended, kept: list[Index], record: RepairLog) -> None:
    """Say which openings of a sheet stay and which are filled, and how to have it otherwise."""
    filled = len(surface.closed.rims) - len(kept)
    if filled:
        record.note(
            f"{counted(filled, 'hole')} in the sheet.",
            f"{counted(filled, 'hole')} filled: holes='keep' leaves all open.",
        )
    across = [float(np.ptp(surface.open.points[rim], axis=0).max()) for rim in kept]
    if surface.solid.any() and across:
        record.note(
            f"{counted(len(kept), 'opening')} up to {rounded(max(across), 3)} m across.",
            "Left open, round or of straight edges or as asked for: holes='fill' closes them.",
        )


def _sheet(surface: Mended, kept: list[Index], wall: float | None, record: RepairLog) -> Mesh:
    if wall is not None:
        _say_of_holes(surface, kept, record)
    stay = {id(rim) for rim in kept}
    rest = [rim for rim in surface.closed.rims if id(rim) not in stay]
    whole = closed(surface.open, rest).mesh
    labels = pieces(whole)
    areas = np.bincount(labels, weights=whole.areas)
    sheet, others = submesh(whole, np.flatnonzero(labels == areas.argmax())), len(areas) - 1
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
        record.note(
            f"{counted(others + 1, 'sheet')} that do not meet.",
            f"The largest taken, {counted(others, 'other')} left out.",
        )
    record.note(
        "The surface is open: a sheet with one side.",
        f"Taken as the middle of a wall of {wall:g} m.",
    )
    return sheet


# Mending: a surface closed and turned outward with its faces left where they are.


@dataclass(slots=True)
class RepairLog:
    """Faults of a mesh and the changes made, a sentence each."""

    found: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)

    def note(self, found: str, changed: str) -> None:
        """Record a fault and the change that mends it."""
        self.found.append(found)
        self.changed.append(changed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mended:
    """A surface whose faces are oriented alike, before and after its openings are filled."""

    open: Mesh  # its openings as they are
    closed: Closed  # all of them filled
    labels: Index  # (F,): the piece of each face of the closed surface

    @property
    def mesh(self) -> Mesh:
        """The surface after repair, closed."""
        return self.closed.mesh

    @property
    def areas(self) -> Array:
        """Areas of the connected pieces of a surface, m^2 (P,)."""
        return np.bincount(self.labels, weights=self.mesh.areas).astype(np.float64)

    @property
    def filled(self) -> Array:
        """Areas of the faces that fill the openings of each piece, m^2 (P,)."""
        fresh = np.arange(len(self.labels)) >= len(self.open.faces)
        areas = np.where(fresh, self.mesh.areas, 0.0)
        return np.bincount(self.labels, weights=areas).astype(np.float64)

    @property
    def solid(self) -> Mask:
        """Which pieces bound a body (P,): closed but for small openings, and not empty."""
        extents = boxes_of(self.mesh, self.labels).extents
        empty = np.abs(volumes_of(self.mesh, self.labels)) <= THINNEST * self.areas * extents
        return ~empty & (self.filled <= LARGEST_OPENING * self.areas)

    def holes(self, chosen: Mask) -> int:
        """Return how many openings the `chosen` pieces (P,) had."""
        piece = np.empty(len(self.mesh.points), np.int64)
        piece[self.mesh.faces] = self.labels[:, None]
        return int(sum(chosen[piece[rim[0]]] for rim in self.closed.rims))


def mended(mesh: Mesh, record: RepairLog) -> Mended:
    """Drop faces that repeat or lean on others, turn the rest alike, fill openings."""
    mesh, repeated = single(mesh)
    if repeated:
        record.note(
            f"{counted(repeated, 'face')} {'repeats' if repeated == 1 else 'repeat'} others.",
            f"{counted(repeated, 'repeated face')} removed.",
        )
    mesh, leaning = without_fins(mesh)
    if leaning:
        meet = "meets" if leaning == 1 else "meet"
        record.note(
            f"{counted(leaning, 'face')} in fins or inner walls {meet} the surface.",
            f"{counted(leaning, 'face')} of fins and inner walls removed.",
        )
    crowded = int(np.count_nonzero(edges_of(mesh.faces).faces_at > 2))
    if crowded:
        mesh = apart(mesh)
        record.note(
            f"{counted(crowded, 'edge')} shared by more than two faces.",
            f"Pieces taken apart at {counted(crowded, 'edge')}.",
        )
    mesh = without_needles(_alike(mesh, record), record)
    filled = closed(mesh)
    return Mended(open=mesh, closed=filled, labels=pieces(filled.mesh))


def _alike(mesh: Mesh, record: RepairLog) -> Mesh:
    turned = turned_faces(edges_of(mesh.faces), len(mesh.faces))
    if turned is None:
        raise MeshError(ONE_SIDED)
    if turned.any():
        faces = counted(np.count_nonzero(turned), "face")
        record.note(
            f"{faces} of {len(mesh.faces)} flipped against their neighbours.",
            f"{faces} turned to agree with the others.",
        )
    return flipped(mesh, turned)


def without_needles(mesh: Mesh, record: RepairLog) -> Mesh:
    """Return the mesh without faces of no area, and say so."""
    mesh, flat = without_lines(mesh)
    if flat:
        record.note(
            f"{counted(flat, 'face')} without area.",
            f"{counted(flat, 'face')} without area removed, their neighbours split.",
        )
    return mesh


# Bodies among the pieces of a mended surface: what is loose, hidden or beside the largest.

DEBRIS = 0.01  # share of the largest body below which others are crumbs


def solid_shells(surface: Mended, solid: Mask, record: RepairLog) -> Shells:
    """Return the pieces that bound bodies, their normals outward."""
    loose = int(np.count_nonzero(~solid))
    if loose:
        share = surface.areas[~solid].sum() / surface.areas.sum()
        record.note(
            f"{counted(loose, 'loose piece')} of the surface without volume.",
            f"{counted(loose, 'loose piece')} removed ({rounded(100 * share, 2)} % of the area).",
        )
    holes = surface.holes(solid)
    if holes:
        share = surface.filled[solid].sum() / surface.areas[solid].sum()
        record.note(
            f"{counted(holes, 'hole')} in the surface.",
            f"{counted(holes, 'hole')} filled ({rounded(100 * share, 2)} % of the area).",
        )
    kept = submesh(surface.mesh, np.flatnonzero(solid[surface.labels]))
    shells, wrong = Shells.of(without_needles(kept, record)).outward()
    if wrong:
        record.note(f"{counted(wrong, 'piece')} inside out.", f"{counted(wrong, 'piece')} turned.")
    return shells


def without_hidden(shells: Shells, pairs: Index, record: RepairLog) -> Shells:
    """Drop the pieces that lie within the material and cross no other piece."""
    kept = shells.bounding()
    kept[shells.labels[pairs]] = True
    hidden = int(np.count_nonzero(~kept))
    if hidden:
        solid, inner = (float(shells.volumes[some].sum()) for some in (kept, ~kept))
        record.note(
            f"{counted(hidden, 'shell')} within the material.",
            f"{counted(hidden, 'inner shell')} removed: normals outward make no cavity (volume "
            f"{rounded(solid, 3)}; turned inward they would leave {rounded(solid - inner, 3)}).",
        )
    return shells.only(kept)


def largest_body(shells: Shells, pairs: Index, record: RepairLog) -> Shells:
    """Keep the largest body, and note the number and size of the others."""
    body = shells.bodies(pairs)
    volumes = np.bincount(body, weights=shells.volumes)
    largest = int(volumes.argmax())
    others = np.delete(volumes, largest) / volumes[largest]
    debris = int(np.count_nonzero(others < DEBRIS))
    if debris:
        record.note(
            f"{counted(debris, 'crumb')} beside the body, below {100 * DEBRIS:g} % of its volume.",
            f"{counted(debris, 'crumb')} removed.",
        )
    rest = others[others >= DEBRIS]
    if len(rest):
        record.note(
            f"{counted(len(rest) + 1, 'separate body')}.",
            f"The largest taken; {counted(len(rest), 'other')}, up to {100 * rest.max():.0f} % of "
            "its volume, left out: part= gives another.",
        )
    return shells.only(body == largest)
