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
    MIN_THICKNESS,
    ONE_SIDED_MESSAGE,
    Shells,
    crossings,
    expose_faces,
    find_open_faces,
    flip_faces,
    is_closed,
    remove_fins,
    require_closed,
    separate_pieces,
)
from struck.solids.surface.welding import (
    Closed,
    close_openings,
    count_open_edges,
    find_lines,
    is_feature,
    remove_lines,
    remove_repeated,
    sew,
)

# A surface bounds a body while what closes it is small against it. The cap of an open cup,
# of a dome or of a dish is above a sixth of its wall; holes of scans are a few hundredths.
MAX_OPENING_FRACTION = 0.1
_MIN_BURIED_FRACTION = 1e-3  # of the area, within the material, from which on crossings matter
# Fractions of the area that a rebuilt surface may lose, or have in excess.
_MAX_LOST_FRACTION, _MAX_INVENTED_FRACTION = 0.05, 0.1
_MIN_PATCH_FRACTION = 0.02  # fraction of the area below which pieces of an open surface are crumbs
MAX_FACES = 2_000_000
"""Largest number of faces of a surface that is repaired, which takes minutes."""


if TYPE_CHECKING:
    from struck.solids.surface.rebuilding import Rebuilt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repair:
    """A surface that encloses a body, with the changes that made it so.

    Parameters
    ----------
    mesh : Mesh
        Closed, normals outward; with `sheet` an open surface, its faces oriented consistently.
    faults : tuple of str
        Faults of the mesh, one sentence each; empty for a clean mesh, which stays as it is.
        Default: ().
    changes : tuple of str
        Changes made, one sentence each. Default: ().
    volume_before : float
        Volume enclosed by the mesh as given, m^3; of an open one, as seen from the centre of its
        box.
    volume_after : float
        Volume enclosed by the repaired mesh, m^3; of a sheet, area times wall.
    sheet : bool
        Whether the mesh is a single-sided sheet that takes a wall. Default: False.
    """

    mesh: Mesh
    faults: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
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


def repair_mesh(mesh: Mesh, *, wall: float | None = None, holes: str | None = None) -> Repair:
    """Repair a surface, all tolerances relative to its extent; a clean mesh is returned itself."""
    # `wall`, m, is for a single-sided sheet; `holes` selects whether its openings stay: "keep",
    # "fill", or by their form. MeshError if no body is recognised: a sheet without `wall`, a
    # one-sided or flat surface, faces that point in all directions.
    old_volume, clean = _volume(mesh), clean_repair(mesh)
    if clean is not None:
        return clean
    if len(mesh.faces) > MAX_FACES:
        raise MeshError(
            f"it is damaged and has {len(mesh.faces):,} faces, and at most {MAX_FACES:,} are "
            "repaired: decimate the surface, or export it again, closed"
        )
    record, (sewn_mesh, distance) = RepairLog(), sew(mesh)
    if distance:
        merged_vertices = counted(len(mesh.points) - len(sewn_mesh.points), "vertex")
        record.note(
            f"Faces have gaps of up to {rounded(distance, 2)} m.",
            f"{merged_vertices} within {rounded(distance, 2)} m of others merged.",
        )
    result, sheet = _repair_sewn(sewn_mesh, wall, holes, record)
    return Repair(
        mesh=result,
        faults=tuple(record.faults),
        changes=tuple(record.changes),
        volume_before=old_volume,
        volume_after=float(result.areas.sum()) * (wall or 0.0) if sheet else result.volume,
        sheet=sheet,
    )


def _repair_sewn(
    mesh: Mesh, wall: float | None, holes: str | None, record: RepairLog
) -> tuple[Mesh, bool]:
    """Return the body, or the sheet and True."""
    if wall is not None and _is_strip(mesh):
        record.note(
            "The surface has one side, as a Moebius strip has.",
            f"Taken as the middle of a wall of {rounded(wall)} m.",
        )
        return mesh, True
    bare_mesh = find_open_faces(mesh)
    if bare_mesh is not None and is_closed(bare_mesh):
        hidden_faces = counted(len(mesh.faces) - len(bare_mesh.faces), "face")
        record.note(f"{hidden_faces} within the material or repeated.", f"{hidden_faces} removed.")
        mesh = bare_mesh
    elif (
        bare_mesh is not None
        and bare_mesh.areas.sum() < (1 - _MIN_BURIED_FRACTION) * mesh.areas.sum()
    ):
        pairs = crossings(mesh)
        record.faults.append(
            f"Parts overlap and share edges; {counted(len(pairs), 'pair')} of faces cross."
        )
        return _rebuild(mesh, expose_faces(mesh, pairs), record), False
    surface = mend(mesh, record)
    is_solid = surface.solid
    is_mostly_solid = bool(surface.areas[is_solid].sum() >= surface.areas.sum() / 2)
    if is_mostly_solid and (wall is None or not _select_open_rims(surface, holes)):
        return _body(surface, is_solid, record), False
    joined_body = None if is_mostly_solid else _join_patches(surface, record)
    if joined_body is not None:
        return joined_body, False
    # The longest rim of a sheet is its border, and other rims are left open by default.
    open_rims = _select_open_rims(surface, holes or (None if is_mostly_solid else "keep"))
    if not is_mostly_solid and holes == "fill":
        lines = [surface.open.points[rim] for rim in surface.closed.rims]
        lengths = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum() for p in lines]
        open_rims = [surface.closed.rims[int(np.argmax(lengths))]]
    return _sheet(surface, open_rims, wall, record), True


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


def clean_repair(mesh: Mesh) -> Repair | None:
    """Return a clean surface as its own repair, None for a surface with faults."""
    try:
        require_closed(mesh)
    except MeshError:
        return None
    if find_lines(mesh).any() or len(crossings(mesh)):
        return None
    volume = _volume(mesh)
    return Repair(mesh=mesh, volume_before=volume, volume_after=volume)


def _body(surface: Mended, is_solid: Mask, record: RepairLog) -> Mesh:
    """Return the largest body that the solid pieces (P,) bound."""
    shells = make_solid_shells(surface, is_solid, record)
    shells = remove_hidden(shells, crossings(shells.mesh), record)
    crossing = Crossing.of(shells)
    largest_shells = select_largest_body(shells, crossing.pairs, record)
    if largest_shells is not shells:
        shells, crossing = largest_shells, Crossing.of(largest_shells)
    if _matters(crossing, shells, record):
        from struck.solids.surface.rebuilding import unite  # few surfaces need it

        union = unite(shells, crossing.pairs)
        if union is None:
            return _rebuild(shells.mesh, crossing.limits, record)
        record.changes.append("United, each part as it is.")
        return _select_body(union, record)
    try:
        require_closed(shells.mesh)
    except MeshError as error:
        record.note(f"Mended, {error}.", "Rebuilt, as mending was not enough.")
        return _rebuild(shells.mesh, crossing.limits, record)
    return shells.mesh


def largest_of(mesh: Mesh) -> Mesh:
    """Return the pieces of a closed surface of which `repair_mesh` makes the body, as they are."""
    record, bare_mesh = RepairLog(), find_open_faces(mesh)
    if bare_mesh is not None and not is_closed(bare_mesh):
        return mesh  # parts that share edges, which are rebuilt together
    surface = mend(mesh if bare_mesh is None else bare_mesh, record)
    shells = make_solid_shells(surface, surface.solid, record)
    shells = remove_hidden(shells, crossings(shells.mesh), record)
    return select_largest_body(shells, Crossing.of(shells).pairs, record).mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossing:
    """Pairs of faces that cross, and the size of the crossing."""

    pairs: Index  # (K, 2); of two pieces only where they overlap, not where they touch
    limits: Mesh | None  # the faces between material and air
    buried_fraction: float  # fraction of the area within the material

    @classmethod
    def of(cls, shells: Shells) -> Crossing:
        """Find the faces that cross among closed pieces."""
        pairs = crossings(shells.mesh)
        if not len(pairs):
            return cls(pairs=pairs, limits=shells.mesh, buried_fraction=0.0)
        limits = expose_faces(shells.mesh, pairs)
        open_area = 0.0 if limits is None else float(limits.areas.sum())
        buried = max(0.0, 1 - open_area / float(shells.mesh.areas.sum()))
        first, second = shells.labels[pairs].T
        crossing_pairs = pairs if buried > _MIN_BURIED_FRACTION else pairs[first == second]
        return cls(pairs=crossing_pairs, limits=limits, buried_fraction=buried)


def _matters(crossing: Crossing, shells: Shells, record: RepairLog) -> bool:
    """Return whether crossing faces require a new surface; where not, record that they stay."""
    if not len(crossing.pairs):
        return False
    faces = counted(len(np.unique(crossing.pairs)), "face")
    area_note = (
        f"{rounded(100 * crossing.buried_fraction, 2)} % of the area lies within the material."
    )
    if crossing.buried_fraction <= _MIN_BURIED_FRACTION:
        record.note(f"{faces} cross a little.", f"Crossing faces left: {area_note}")
        return False
    pieces = len(np.unique(shells.labels[crossing.pairs]))
    overlap = f"{pieces} pieces overlap or touch, in {faces}" if pieces > 1 else f"{faces} cross"
    record.faults.append(f"{overlap}; {area_note}")
    return True


def _rebuild(mesh: Mesh, limits: Mesh | None, record: RepairLog) -> Mesh:
    from struck.solids.surface.rebuilding import rebuild  # few surfaces need it

    new = rebuild(mesh, limits)
    _note_rebuilding(new, record)
    return _select_body(new.mesh, record)


def _select_body(mesh: Mesh, record: RepairLog) -> Mesh:
    """Return the largest body of a rebuilt surface."""
    result = select_largest_body(Shells.of(mesh), np.empty((0, 2), np.int64), record).mesh
    try:
        require_closed(result)
    except MeshError as error:
        raise MeshError(
            f"its surface was rebuilt and encloses no body still ({error}): rebuild it in a mesh "
            "editor as the boundary of a solid"
        ) from error
    return result


def _note_rebuilding(new: Rebuilt, record: RepairLog) -> None:
    record.changes.append(
        f"Surface rebuilt on a lattice of {rounded(new.spacing, 3)} m, edges rounded by as much "
        f"(volume {rounded(100 * new.change, 2, sign=True)} % from the lattice before)."
    )


def _join_patches(surface: Mended, record: RepairLog) -> Mesh | None:
    """Return a body that patches bound together though they do not meet; None where none do."""
    patches = int(np.count_nonzero(surface.areas > _MIN_PATCH_FRACTION * surface.areas.sum()))
    box = np.ptp(surface.open.bounds, axis=0)
    if patches < 2 or box.min() <= MIN_THICKNESS * box.max():
        return None
    from struck.solids.surface.rebuilding import measure_invented, measure_lost, rebuild

    boundary = expose_faces(surface.open, crossings(surface.open))
    try:
        new = rebuild(surface.open, boundary, coarse_only=True)
        if (
            measure_lost(surface.open, new) > _MAX_LOST_FRACTION
            or measure_invented(surface.open, new) > _MAX_INVENTED_FRACTION
        ):
            return None
        new = rebuild(surface.open, boundary)
    except MeshError:
        return None
    record.faults.append(f"{counted(len(surface.areas), 'patch')} of the surface do not meet.")
    _note_rebuilding(new, record)
    return _select_body(new.mesh, record)


def _select_open_rims(surface: Mended, holes: str | None) -> list[Index]:
    """Return the rims of openings that stay: all, none, or the round and the straight-edged."""
    if holes is not None:
        return list(surface.closed.rims) if holes == "keep" else []
    extent = surface.open.extent
    return [
        rim for rim in surface.closed.rims if is_feature(surface.open.points[rim], extent=extent)
    ]


def _note_holes(surface: Mended, open_rims: list[Index], record: RepairLog) -> None:
    """Say which openings of a sheet stay and which are filled, and how to have it otherwise."""
    filled_count = len(surface.closed.rims) - len(open_rims)
    if filled_count:
        record.note(
            f"{counted(filled_count, 'hole')} in the sheet.",
            f"{counted(filled_count, 'hole')} filled: holes='keep' leaves all open.",
        )
    widths = [float(np.ptp(surface.open.points[rim], axis=0).max()) for rim in open_rims]
    if surface.solid.any() and widths:
        record.note(
            f"{counted(len(open_rims), 'opening')} up to {rounded(max(widths), 3)} m across.",
            "Left open, round or of straight edges or as asked for: holes='fill' closes them.",
        )


def _sheet(surface: Mended, open_rims: list[Index], wall: float | None, record: RepairLog) -> Mesh:
    if wall is not None:
        _note_holes(surface, open_rims, record)
    open_ids = {id(rim) for rim in open_rims}
    filled_rims = [rim for rim in surface.closed.rims if id(rim) not in open_ids]
    closed_mesh = close_openings(surface.open, filled_rims).mesh
    labels = pieces(closed_mesh)
    areas = np.bincount(labels, weights=closed_mesh.areas)
    sheet, others = submesh(closed_mesh, np.flatnonzero(labels == areas.argmax())), len(areas) - 1
    if not count_open_edges(sheet):
        raise MeshError(
            "the mesh encloses no volume: its faces lie back to back; give the body a thickness, "
            "or one side of the sheet alone with wall="
        )
    fraction = surface.filled.sum() / surface.areas.sum()
    if wall is None:
        raise MeshError(
            f"the mesh is an open sheet: to close it would take {100 * fraction:.0f} % of its "
            f"area, and up to {100 * MAX_OPENING_FRACTION:.0f} % are filled as holes; give wall=, "
            "the "
            "thickness of the sheet in m"
        )
    if others:
        record.note(
            f"{counted(others + 1, 'sheet')} that do not meet.",
            f"The largest taken, {counted(others, 'other')} left out.",
        )
    record.note(
        "The surface is open: a sheet with one side.",
        f"Taken as the middle of a wall of {rounded(wall)} m.",
    )
    return sheet


# Mending: a surface closed and turned outward with its faces left where they are.


@dataclass(slots=True)
class RepairLog:
    """Faults of a mesh and the changes made, a sentence each."""

    faults: list[str] = field(default_factory=list)
    changes: list[str] = field(default_factory=list)

    def note(self, fault: str, change: str) -> None:
        """Record a fault and the change that mends it."""
        self.faults.append(fault)
        self.changes.append(change)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mended:
    """A surface whose faces are oriented consistently, before and after its openings are filled."""

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
        is_new = np.arange(len(self.labels)) >= len(self.open.faces)
        areas = np.where(is_new, self.mesh.areas, 0.0)
        return np.bincount(self.labels, weights=areas).astype(np.float64)

    @property
    def solid(self) -> Mask:
        """Which pieces bound a body (P,): closed, or with small openings, and not empty."""
        extents = boxes_of(self.mesh, self.labels).extents
        is_empty = (
            np.abs(volumes_of(self.mesh, self.labels)) <= MIN_THICKNESS * self.areas * extents
        )
        return ~is_empty & (self.filled <= MAX_OPENING_FRACTION * self.areas)

    def holes(self, chosen: Mask) -> int:
        """Return how many openings the `chosen` pieces (P,) had."""
        piece = np.empty(len(self.mesh.points), np.int64)
        piece[self.mesh.faces] = self.labels[:, None]
        return int(sum(chosen[piece[rim[0]]] for rim in self.closed.rims))


def mend(mesh: Mesh, record: RepairLog) -> Mended:
    """Drop repeated faces and fins, orient the others consistently, fill openings."""
    mesh, repeated_count = remove_repeated(mesh)
    if repeated_count:
        record.note(
            f"{counted(repeated_count, 'face')} {'repeats' if repeated_count == 1 else 'repeat'} "
            "others.",
            f"{counted(repeated_count, 'repeated face')} removed.",
        )
    mesh, fin_count = remove_fins(mesh)
    if fin_count:
        verb = "meets" if fin_count == 1 else "meet"
        record.note(
            f"{counted(fin_count, 'face')} in fins or inner walls {verb} the surface.",
            f"{counted(fin_count, 'face')} of fins and inner walls removed.",
        )
    branching_count = int(np.count_nonzero(edges_of(mesh.faces).faces_at > 2))
    if branching_count:
        mesh = separate_pieces(mesh)
        record.note(
            f"{counted(branching_count, 'edge')} shared by more than two faces.",
            f"Pieces taken apart at {counted(branching_count, 'edge')}.",
        )
    mesh = remove_needles(_orient_faces(mesh, record), record)
    closed_surface = close_openings(mesh)
    return Mended(open=mesh, closed=closed_surface, labels=pieces(closed_surface.mesh))


def _orient_faces(mesh: Mesh, record: RepairLog) -> Mesh:
    is_flipped = turned_faces(edges_of(mesh.faces), len(mesh.faces))
    if is_flipped is None:
        raise MeshError(ONE_SIDED_MESSAGE)
    if is_flipped.any():
        faces = counted(np.count_nonzero(is_flipped), "face")
        record.note(
            f"{faces} of {len(mesh.faces)} flipped against their neighbours.",
            f"{faces} turned to agree with the others.",
        )
    return flip_faces(mesh, is_flipped)


def remove_needles(mesh: Mesh, record: RepairLog) -> Mesh:
    """Return the mesh without faces of no area, and record them."""
    mesh, flat_count = remove_lines(mesh)
    if flat_count:
        record.note(
            f"{counted(flat_count, 'face')} without area.",
            f"{counted(flat_count, 'face')} without area removed, their neighbours split.",
        )
    return mesh


# Bodies among the pieces of a mended surface: loose, hidden and smaller ones are dropped.

DEBRIS_FRACTION = 0.01  # fraction of the largest body below which others are crumbs


def make_solid_shells(surface: Mended, is_solid: Mask, record: RepairLog) -> Shells:
    """Return the pieces that bound bodies, their normals outward."""
    loose_count = int(np.count_nonzero(~is_solid))
    if loose_count:
        fraction = surface.areas[~is_solid].sum() / surface.areas.sum()
        record.note(
            f"{counted(loose_count, 'loose piece')} of the surface without volume.",
            f"{counted(loose_count, 'loose piece')} removed ({rounded(100 * fraction, 2)} % of "
            "the area).",
        )
    holes = surface.holes(is_solid)
    if holes:
        fraction = surface.filled[is_solid].sum() / surface.areas[is_solid].sum()
        record.note(
            f"{counted(holes, 'hole')} in the surface.",
            f"{counted(holes, 'hole')} filled ({rounded(100 * fraction, 2)} % of the area).",
        )
    solid_mesh = submesh(surface.mesh, np.flatnonzero(is_solid[surface.labels]))
    shells, inverted_count = Shells.of(remove_needles(solid_mesh, record)).orient_outward()
    if inverted_count:
        record.note(
            f"{counted(inverted_count, 'piece')} inside out.",
            f"{counted(inverted_count, 'piece')} turned.",
        )
    return shells


def remove_hidden(shells: Shells, pairs: Index, record: RepairLog) -> Shells:
    """Drop the pieces that lie within the material and cross no other piece."""
    is_bounding = shells.bounding()
    is_bounding[shells.labels[pairs]] = True
    hidden_count = int(np.count_nonzero(~is_bounding))
    if hidden_count:
        solid_volume, inner_volume = (
            float(shells.volumes[mask].sum()) for mask in (is_bounding, ~is_bounding)
        )
        record.note(
            f"{counted(hidden_count, 'shell')} within the material.",
            f"{counted(hidden_count, 'inner shell')} removed: normals outward make no cavity "
            f"(volume {rounded(solid_volume, 3)}; turned inward they would leave "
            f"{rounded(solid_volume - inner_volume, 3)}).",
        )
    return shells.select(is_bounding)


def select_largest_body(shells: Shells, pairs: Index, record: RepairLog) -> Shells:
    """Keep the largest body, and note the number and size of the others."""
    body = shells.bodies(pairs)
    volumes = np.bincount(body, weights=shells.volumes)
    largest_number = int(volumes.argmax())
    others = np.delete(volumes, largest_number) / volumes[largest_number]
    debris_count = int(np.count_nonzero(others < DEBRIS_FRACTION))
    if debris_count:
        record.note(
            f"{counted(debris_count, 'crumb')} separate from the body, "
            f"below {100 * DEBRIS_FRACTION:g} % of its volume.",
            f"{counted(debris_count, 'crumb')} removed.",
        )
    large_others = others[others >= DEBRIS_FRACTION]
    if len(large_others):
        record.note(
            f"{counted(len(large_others) + 1, 'separate body')}.",
            f"The largest taken; {counted(len(large_others), 'other')}, up to "
            f"{100 * large_others.max():.0f} % of "
            "its volume, left out: part= gives another.",
        )
    return shells.select(body == largest_number)
