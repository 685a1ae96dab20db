"""Repair: from any surface to one that encloses a body, and what that took.

First mending, which leaves faces where they are; where that cannot give the boundary of the
material, because faces cross, a new surface. Material is where the winding number exceeds one half
(Barill et al. 2018); the new surface is the boundary of tetrahedra that fill it (Labelle &
Shewchuk 2007), moved onto those old faces that part material from air.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from struck.errors import MeshError
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh, Surface
from struck.model.mesh_topology import (
    boxes_of,
    edges_of,
    extremes,
    pieces,
    submesh,
    turned_faces,
    volumes_of,
)
from struck.solids.filling.stuffing import Cells, Lattice, warped
from struck.solids.surface.closedness import (
    INSIDE,
    ONE_SIDED,
    THINNEST,
    Shells,
    apart,
    bared,
    counted,
    crossings,
    exposed,
    flipped,
    halves,
    is_closed,
    require_closed,
    winding,
    without_fins,
)
from struck.solids.surface.welding import (
    Closed,
    closed,
    lines,
    open_edges,
    sewn,
    single,
    without_lines,
)
from struck.solids.volume_mesh import side_keys

# A surface bounds a body while what closes it is small against it. The cap of an open cup,
# of a dome or of a dish is above a sixth of its wall; holes of scans are a few hundredths.
LARGEST_OPENING = 0.1
_BURIED = 1e-3  # share of the area within the material from which on crossing faces matter
_LOST, _INVENTED = 0.05, 0.1  # share that a rebuilt surface may lose, or have in excess
_PATCH = 0.02  # share of the area below which pieces of an open surface are crumbs
MOST_FACES = 2_000_000
"""Faces of a surface that is repaired at most: of that many it takes minutes."""


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
    """Repair a surface, all tolerances relative to its extent; a clean mesh is returned itself."""
    # `wall`, m, is for a single-sided sheet. MeshError when there is no body to be told: a sheet
    # without `wall`, a one-sided or flat surface, faces that point every way.
    before = _volume(mesh)
    if _is_clean(mesh):
        return Repair(mesh=mesh, volume_before=before, volume_after=before)
    if len(mesh.faces) > MOST_FACES:
        raise MeshError(
            f"it is damaged and has {len(mesh.faces):,} faces, and at most {MOST_FACES:,} are "
            "repaired: decimate the surface, or export it again, closed"
        )
    diary, (together, distance) = Diary(), sewn(mesh)
    if distance:
        merged = counted(len(mesh.points) - len(together.points), "vertex")
        diary.note(
            f"Faces stand apart by up to {distance:.1e} m.",
            f"{merged} within {distance:.1e} m of others merged.",
        )
    result, sheet = _result(together, wall, diary)
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


def _body(surface: Mended, solid: Mask, diary: Diary) -> Mesh:
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
    """Where faces cross."""

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
    labels = pieces(surface.open)
    areas = np.bincount(labels, weights=surface.open.areas)
    sheet, others = submesh(surface.open, np.flatnonzero(labels == areas.argmax())), len(areas) - 1
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


# Mending: a surface closed and turned outward with its faces left where they are.


@dataclass(slots=True)
class Diary:
    """What was wrong with a mesh and what was changed, a sentence each."""

    found: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)

    def note(self, found: str, changed: str) -> None:
        """Write both down."""
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
        """The closed surface."""
        return self.closed.mesh

    @property
    def areas(self) -> Array:
        """Areas of the pieces, m^2 (P,)."""
        return np.bincount(self.labels, weights=self.mesh.areas).astype(np.float64)

    @property
    def filled(self) -> Array:
        """Areas of what fills the openings of each piece, m^2 (P,)."""
        fresh = np.arange(len(self.labels)) >= len(self.open.faces)
        areas = np.where(fresh, self.mesh.areas, 0.0)
        return np.bincount(self.labels, weights=areas).astype(np.float64)

    @property
    def solid(self) -> Mask:
        """Which pieces bound a body (P,): closed but for small openings, and not empty."""
        extents = boxes_of(self.mesh, self.labels).extents
        volumes = np.abs(volumes_of(self.mesh, self.labels))
        empty = volumes <= THINNEST * self.areas * extents
        return ~empty & (self.filled <= LARGEST_OPENING * self.areas)

    def holes(self, chosen: Mask) -> int:
        """Return how many openings the `chosen` pieces (P,) had."""
        piece = np.empty(len(self.mesh.points), np.int64)
        piece[self.mesh.faces] = self.labels[:, None]
        return int(sum(chosen[piece[rim[0]]] for rim in self.closed.rims))


def mended(mesh: Mesh, diary: Diary) -> Mended:
    """Drop faces that repeat or lean on others, turn the rest alike, fill openings."""
    mesh, repeated = single(mesh)
    if repeated:
        diary.note(
            f"{counted(repeated, 'face')} {'repeats' if repeated == 1 else 'repeat'} others.",
            f"{counted(repeated, 'repeated face')} removed.",
        )
    mesh, leaning = without_fins(mesh)
    if leaning:
        meet = "meets" if leaning == 1 else "meet"
        diary.note(
            f"{counted(leaning, 'face')} in fins or inner walls {meet} the surface.",
            f"{counted(leaning, 'face')} of fins and inner walls removed.",
        )
    crowded = int(np.count_nonzero(edges_of(mesh.faces).faces_at > 2))
    if crowded:
        mesh = apart(mesh)
        diary.note(
            f"{counted(crowded, 'edge')} shared by more than two faces.",
            f"Pieces taken apart at {counted(crowded, 'edge')}.",
        )
    mesh = without_needles(_alike(mesh, diary), diary)
    filled = closed(mesh)
    return Mended(open=mesh, closed=filled, labels=pieces(filled.mesh))


def _alike(mesh: Mesh, diary: Diary) -> Mesh:
    turned = turned_faces(edges_of(mesh.faces), len(mesh.faces))
    if turned is None:
        raise MeshError(ONE_SIDED)
    if turned.any():
        faces = counted(np.count_nonzero(turned), "face")
        diary.note(
            f"{faces} of {len(mesh.faces)} flipped against their neighbours.",
            f"{faces} turned to agree with the others.",
        )
    return flipped(mesh, turned)


def without_needles(mesh: Mesh, diary: Diary) -> Mesh:
    """Return the mesh without faces of no area, and say so."""
    mesh, flat = without_lines(mesh)
    if flat:
        diary.note(
            f"{counted(flat, 'face')} without area.",
            f"{counted(flat, 'face')} without area removed, their neighbours split.",
        )
    return mesh


# Bodies among the pieces of a mended surface: what is loose, hidden or beside the largest.

_DEBRIS = 0.01  # share of the largest body below which others are crumbs


def solid_shells(surface: Mended, solid: Mask, diary: Diary) -> Shells:
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


# Rebuilding: a new surface on a lattice, where the old one crosses itself.

_CELLS = (4_000, 9_000, 16_000)  # on the surface, from coarse to fine, until the volume stays
_MOST_CELLS, _MOST_CELLS_WITH_RIMS = 1_000_000, 100_000  # a long way through air takes more
_WIDER = 1.05
_MOST_LAYERS = 4  # area of all faces over that in the open from which on cells grow with it
_LARGEST_CHANGE = 0.003
_CRUMB = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """A new surface."""

    mesh: Mesh
    spacing: float  # of the lattice, m
    change: float  # of the volume since the lattice before, relative


def rebuilt(mesh: Mesh, bounding: Mesh | None, *, roughly: bool = False) -> Rebuilt:
    """Return the boundary of where the surface winds around more than half a time."""
    # `bounding`: the parts of faces that part material from air, see `exposed`; `roughly`: on the
    # coarsest lattice alone.
    if bounding is None or bounding.volume <= 0:
        raise MeshError(
            "the mesh encloses nothing that could be told from air: its faces point every way; "
            "make the normals consistent in a mesh editor"
        )
    area = max(float(bounding.areas.sum()), float(mesh.areas.sum()) / _MOST_LAYERS)
    most = _MOST_CELLS_WITH_RIMS if has_rims(mesh) else _MOST_CELLS
    spacings = [
        _affordable(float(np.sqrt(area / cells)), bounding.bounds, most)
        for cells in (_CELLS[:1] if roughly else _CELLS)
    ]
    limits = Surface(bounding)
    made = [_boundary(mesh, bounding.bounds, limits, spacings[0])]
    change = np.inf
    for spacing in spacings[1:]:
        made.append(_boundary(mesh, bounding.bounds, limits, spacing))
        before, after = (each.volume for each in made[-2:])
        change = after / before - 1
        if abs(change) <= _LARGEST_CHANGE:
            break
    return Rebuilt(mesh=made[-1], spacing=float(spacings[len(made) - 1]), change=float(change))


def _boundary(mesh: Mesh, bounds: Array, limits: Surface, spacing: float) -> Mesh:
    lattice = Lattice.over(bounds, spacing)
    within = inside(mesh, lattice)
    for moved in (True, False):
        found = isosurface(lattice, within, lambda at: limits.closest(at)[0], moved=moved)
        if found is not None and is_closed(found):
            points = limits.closest(found.points)[2]
            return _without_crumbs(Mesh(points=points, faces=found.faces, up=mesh.up))
    raise MeshError(
        f"the body is too thin for a lattice of {spacing:.3g} m: join its pieces in a mesh editor"
    )


def _affordable(spacing: float, bounds: Array, most: int) -> float:
    """Return `spacing`, or a wider one that takes no more than `most` cells to fill the box."""
    while (np.maximum((bounds[1] - bounds[0]) / spacing, 1) + 2).prod() > most:
        spacing *= _WIDER
    return spacing


def _without_crumbs(mesh: Mesh) -> Mesh:
    """Return the mesh without crumbs of the lattice."""
    labels = pieces(mesh)
    volumes = np.abs(volumes_of(mesh, labels))
    return submesh(mesh, np.flatnonzero((volumes > _CRUMB * volumes.max())[labels]))


def lost_share(old: Mesh, new: Rebuilt) -> float:
    """Return how much of the old faces' area lies outside the new surface, far from it."""
    length, _, _ = Surface(new.mesh).closest(old.centroids)
    far = length > 2 * new.spacing
    far[far] = winding(new.mesh, old.centroids[far]) < INSIDE
    return float(old.areas[far].sum() / old.areas.sum())


def invented_share(old: Mesh, new: Rebuilt) -> float:
    """Return how much of the new surface's area lies far from all old faces."""
    length, _, _ = Surface(old).closest(new.mesh.centroids)
    return float(new.mesh.areas[length > 2 * new.spacing].sum() / new.mesh.areas.sum())


Distances = Callable[[Array], Array]
_LEAST = 0.1  # depth of points that do not move, in cells


def isosurface(
    lattice: Lattice, inside: Mask, distances: Distances, *, moved: bool = True
) -> Mesh | None:
    """Return the surface around lattice points `inside` (N,), normals outward, or None."""
    # Distances of points (K, 3) from the surface, m (K,), are asked for beside it alone. Where it
    # grazes `moved` points, parts of it can meet in an edge; otherwise some triangles are needles.
    depths = np.where(inside, -1.0, 1.0)
    near = np.unique(_astride(lattice, depths))
    if not len(near):
        return None
    least = 0.0 if moved else _LEAST * float(lattice.cell.min())
    depths[near] *= np.maximum(distances(lattice.positions(near)), least)
    cells, numbers = _cells_astride(lattice, depths)
    if moved:
        warp = warped(cells, numbers >= np.prod(lattice.counts + 1))
        depths[numbers] = warp.depths[:, 0]
        cells, fresh = _cells_astride(lattice, depths)
        _, before, after = np.intersect1d(numbers, fresh, assume_unique=True, return_indices=True)
        cells.points[after] = warp.points[before]
    return _skin(cells.within(0))


def _astride(lattice: Lattice, depths: Array) -> Index:
    """Return the tetrahedra with points within and others on the surface or outside (T, 4)."""
    both = np.stack([depths, np.where(depths < 0, 1.0, -1.0)], axis=1)
    first = int(np.prod(lattice.counts + 1))
    corners, centres = both[:first], both[first:]
    return lattice.tetrahedra(
        corners.reshape(*(lattice.counts + 1), 2), centres.reshape(*lattice.counts, 2)
    )


def _cells_astride(lattice: Lattice, depths: Array) -> tuple[Cells, Index]:
    """Return the tetrahedra on the surface, and the lattice numbers of their points."""
    numbers, local = np.unique(_astride(lattice, depths), return_inverse=True)
    points, local = lattice.positions(numbers), local.reshape(-1, 4)
    return Cells(points=points, depths=depths[numbers, None], tetrahedra=local), numbers


def _skin(cells: Cells) -> Mesh | None:
    """Return the sides of tetrahedra on surface 0 that belong to one of them, turned outward."""
    on = (cells.depths[:, 0] == 0)[cells.tetrahedra]
    rows, within = np.nonzero(~on & (on.sum(axis=1) == 3)[:, None])
    faces = cells.tetrahedra[rows][on[rows]].reshape(-1, 3)
    # Triangles between two tetrahedra within come from both.
    _, first, times = np.unique(
        side_keys(faces, len(cells.points)), return_index=True, return_counts=True
    )
    first = first[times == 1]
    if not len(first):
        return None
    faces, apex = faces[first], cells.points[cells.tetrahedra[rows[first], within[first]]]
    a, b, c = cells.points[faces].transpose(1, 0, 2)
    inward = np.einsum("fd,fd->f", np.cross(b - a, c - a), a - apex) < 0
    used, local = np.unique(np.where(inward[:, None], faces[:, ::-1], faces), return_inverse=True)
    return Mesh(points=cells.points[used], faces=local.reshape(-1, 3))


# The winding number of a surface without rims only changes across faces: one value serves all
# lattice points that faces do not part.

_LONGEST = 1.99  # of pieces of faces, in voxels: their boxes reach into three along each axis
_STEPS = np.stack(np.meshgrid(*[range(3)] * 3), axis=-1).reshape(-1, 3)
_MOST = 1_000_000
_ROUNDING = 1e-9


def inside(mesh: Mesh, lattice: Lattice) -> Mask:
    """Tell which lattice points the surface winds around (N,): corners first, then centres."""
    region = _regions(mesh, lattice)
    asked, answer = np.arange(len(region)), np.arange(len(region))
    free = region > 0
    if free.any():
        _, first, inverse = np.unique(region[free], return_index=True, return_inverse=True)
        beside = np.flatnonzero(~free)
        asked = np.concatenate([np.flatnonzero(free)[first], beside])
        answer[free] = inverse
        answer[beside] = len(first) + np.arange(len(beside))
    return (winding(mesh, lattice.positions(asked)) > INSIDE)[answer]


def has_rims(mesh: Mesh) -> bool:
    """Tell whether faces do not cancel along some edge, so that the winding number drifts."""
    return bool(edges_of(mesh.faces).balance.any())


def _regions(mesh: Mesh, lattice: Lattice) -> Index:
    """Return the region of each lattice point (N,), from 1; 0 beside faces and where unknown."""
    # Voxels half as wide as cells, each around a point where corners or centres may be.
    shape = 2 * lattice.counts + 1
    points = int(np.prod(lattice.counts + 1) + np.prod(lattice.counts))
    origin, edge = lattice.origin - lattice.cell / 4, lattice.cell / 2
    triangles = ((mesh.points - origin) / edge)[mesh.faces]
    parts = None if has_rims(mesh) else _small(triangles, shape)
    if parts is None:
        return np.zeros(points, np.int64)
    free = np.ones(shape, bool)
    for voxels in _passed(parts):
        free[tuple(voxels[((voxels >= 0) & (voxels < shape)).all(axis=1)].T)] = False
    regions = np.asarray(ndimage.label(free)[0])  # pyright: ignore[reportIndexIssue]
    grids = regions[::2, ::2, ::2], regions[1::2, 1::2, 1::2]
    return np.concatenate([grid.ravel() for grid in grids]).astype(np.int64)


def _passed(triangles: Array) -> Iterator[Index]:
    """Yield the voxels (V, 3) that small triangles (T, 3, 3) pass through, and some beside."""
    lowest, highest = extremes(triangles)
    lowest, highest = np.floor(lowest - _ROUNDING), np.floor(highest + _ROUNDING)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    heights = np.einsum("td,td->t", normals, lowest + 0.5 - triangles[:, 0])
    reach = (0.5 + _ROUNDING) * np.abs(normals).sum(axis=1)
    x, y, z = (highest - lowest).T
    for step in _STEPS:
        in_box = np.flatnonzero((x >= step[0]) & (y >= step[1]) & (z >= step[2]))
        chosen = in_box[np.abs(heights[in_box] + normals[in_box] @ step) <= reach[in_box]]
        yield (lowest[chosen] + step).astype(np.int64)


def _small(triangles: Array, shape: Index) -> Array | None:
    """Halve triangles (T, 3, 3) down to the size of voxels; None where that takes too many."""
    done, count = [], 0
    while len(triangles):
        lowest, highest = extremes(triangles)
        near = (highest > -1) & (lowest < shape + 1)
        triangles = triangles[near.all(axis=1)]
        small, rest = halves(triangles, _LONGEST)
        done.append(small)
        count += len(small)
        if count + len(rest) > _MOST:
            return None
        triangles = rest
    return np.concatenate([np.empty((0, 3, 3)), *done])
