"""Mesh files: surfaces (OBJ, STL, PLY, OFF, GLB, glTF) and volumes (vtk, vtu, msh, inp) in metres.

A surface becomes one closed body; the elements of a volume are taken as they are.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import (
    FileFormatError,
    MeshError,
    OptionError,
    counted,
    nearest,
    require_choice,
    rounded,
)
from struck.files.guard import Contents, read_contents, read_volume
from struck.files.mesh_repair import repair_in_time
from struck.files.messages import READERS, ElementBlocks, Part
from struck.model.arrays import UNITS, Array, Index, checked, numbers
from struck.model.mesh import MAX_COORDINATE, SHORTEST_EDGE, Arrays, Mesh, indices, part_mesh
from struck.model.mesh_topology import bodies, submesh
from struck.solids.elements import ELEMENTS
from struck.solids.surface.closedness import crossings, is_closed, require_closed, winding
from struck.solids.surface.repair import (
    DEBRIS_FRACTION,
    Repair,
    largest_of,
    require_holes,
)
from struck.solids.surface.welding import find_lines, sew
from struck.solids.volume_mesh import VolumeMesh

_UP = {"obj": "y", "gltf": "y", "glb": "y", "stl": "z", "ply": "z", "off": "z"}
_MAX_LISTED_NAMES = 12
SUFFIXES = frozenset(READERS)  # of volume mesh files
_ELEMENTS = {
    "tetra": "tet4",
    "tetra10": "tet10",
    "hexahedron": "hex8",
    "hexahedron20": "hex20",
    "wedge": "wedge6",
    "wedge15": "wedge15",
}
_FLAT_KINDS = ("vertex", "line", "triangle", "quad", "polygon")
# Parts that are left out may have set the scale: if it is off by this fraction, it is set again.
_SCALE_TOLERANCE = 0.01


def load_mesh(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
    repair: bool = True,  # make a closed body of any other surface
) -> Mesh:
    """Load one closed body with normals outward from a mesh file; see `load_body`."""
    if repair:
        return load_body(path, units=units, size=size, part=part, up=up).mesh
    path = Path(path)
    _require_options(units, size, up)
    with _named(path):
        contents = read_contents(path)
        body = _one_body(contents.parts, part)
        flat = find_lines(body)
        if flat.any() and is_closed(body):
            raise MeshError(
                f"{np.count_nonzero(flat)} of its {len(flat)} faces have no area and hold the "
                "surface together: remesh it, merge their vertices, or leave repair on"
            )
        require_closed(body)
        return _in_metres(body, units, size, up or _UP[contents.kind])


def mesh_of(
    body: Arrays, *, units: str | None = None, size: float | None = None, up: str | None = None
) -> Mesh:
    """Return the surface of another library's object in metres, by its own `units` if it has any.

    Arrays of vertices (V, 3) and faces (F, 3) in a pair, trimesh's, Open3D's and PyVista's objects.

    Raises
    ------
    OptionError
        Where `units` are not the object's own, or those are no length.
    """
    _require_options(units, size, up)
    unit = getattr(body, "units", None)
    points, faces = arrays_of(body) or ((), ())
    vertices, triangles = numbers("vertices", points, error=MeshError), _triangles(faces)
    if np.any(np.asarray(faces) % 1):
        raise MeshError(
            f"vertices have shape {vertices.shape}, and faces {triangles.shape} with fractions, "
            "which name no vertex: give (vertices, faces) in this order; these may be swapped"
        )
    mesh = Mesh(points=vertices, faces=triangles)
    if str(unit).lower() == "none" or size is not None:  # trimesh writes None as "none"
        return _in_metres(mesh, units, size, up or "z")
    factor = _metres(str(unit))
    if units is not None and not np.isclose(factor, UNITS[units], rtol=1e-3):
        raise OptionError(
            f"units={units!r}, but the body's own .units are {unit!r}: give one alone"
        )
    return Mesh(points=mesh.points * factor, faces=mesh.faces, up=up or "z")


def part_of(mesh: Mesh, part: str, size: float | None = None) -> Mesh:
    """Return the separate body of a surface that `part` names by its number, of a `size` in m."""
    chosen = _any_surface([Part(name="all", points=mesh.points, faces=mesh.faces)], str(part))
    return replace(chosen if size is None else chosen.scaled(size / chosen.extent), up=mesh.up)


def arrays_of(body: object) -> tuple[ArrayLike, ArrayLike] | None:
    """Return the vertices and faces of a pair or of another library's object, None of all else."""
    if isinstance(body, tuple | list) and len(body) == 2:
        return body[0], body[1]
    for points, faces in (("vertices", "faces"), ("vertices", "triangles"), ("points", "faces")):
        if hasattr(body, points) and hasattr(body, faces):
            return getattr(body, points), getattr(body, faces)
    return None


def _triangles(faces: ArrayLike) -> Index:
    """Return triangles (F, 3), also of PyVista's row of polygons, each after its count."""
    row = indices("faces", numbers("faces", faces, error=MeshError))
    if row.ndim != 1:
        return row
    triangles, position = [], 0
    while position < len(row):
        corners = row[position + 1 : position + 1 + row[position]]
        if not 3 <= len(corners) == row[position]:
            raise MeshError(
                f"faces are a row of {len(row)} numbers, and {row[position]} at {position} is no "
                "count of the corners that follow: give triangles (F, 3)"
            )
        triangles += [(corners[0], *corners[n : n + 2]) for n in range(1, len(corners) - 1)]
        position += 1 + len(corners)
    return np.array(triangles, np.int64).reshape(-1, 3)


def units_of(body: object, units: str | None, size: float | None) -> str:
    """Return in words how the numbers of a file or of another library's object became metres."""
    if size is not None:
        return f"scaled to a size of {rounded(size)} m"
    unit = getattr(body, "units", None)
    return units or (f"{unit}, its own" if unit else "m, as none were given")


def up_of(axis: str, given: str | None, *, of_file: bool) -> str:
    """Return in words which axis of a file or of another library's object was taken as up."""
    formats = ", ".join(kind.upper() for kind, default_axis in _UP.items() if default_axis == axis)
    reason = f"as usual in {formats} files" if of_file else "as none was given"
    return f"{axis}, {'as given' if given else reason}"


def _metres(unit: str) -> float:
    """Return how many metres one of a unit is, as trimesh names them."""
    from trimesh.units import unit_conversion

    try:
        return UNITS.get(unit) or float(unit_conversion(unit, "meters"))
    except ValueError as error:
        raise OptionError(
            f"the body's own .units are {unit!r}, no length that is known: set them to "
            f"{', '.join(UNITS)}, or to None"
        ) from error


@checked
def load_surface(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
) -> Mesh:
    """Read the surface of a mesh file as it is, closed or not.

    Equal vertices are merged (formats repeat them along seams, STL for each face), vertices without
    faces are removed, and polygons are cut into triangles. Faces without area are removed if the
    surface stays closed without them.

    Parameters
    ----------
    path : path
        The file.
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: metres.
    size : float, optional
        Scale the surface so that the longest edge of its bounding box has this length, m.
    part : str, optional
        Name of the body to read. Default: all bodies of the file.
    up : {"x", "y", "z"}, optional
        Axis that points up. Default: as the file format defines it.

    Returns
    -------
    Mesh
        The surface, m.

    Examples
    --------
    >>> import trimesh
    >>> _ = trimesh.creation.box((0.2, 0.1, 0.05)).export("box.stl")
    >>> struck.files.load_surface("box.stl", units="m").faces.shape
    (12, 3)
    """
    return _read_surface(Path(path), units, size, part, up)[0]


def _read_surface(
    path: Path, units: str | None, size: float | None, part: str | None, up: str | None
) -> tuple[Mesh, Contents]:
    """Return a surface in metres, and the contents of its file."""
    _require_options(units, size, up)
    with _named(path):
        contents = read_contents(path)
        surface = _any_surface(contents.parts, part)
        surface = _in_metres(surface, units, size, up or _UP[contents.kind])
    return surface, contents


@checked
def load_body(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
    wall: float | None = None,
    holes: str | None = None,
    repair_seconds: float | None = None,
) -> Repair:
    """Read one body from a mesh file, and repair its surface if it is not closed.

    Parameters
    ----------
    path : path
        A file of type OBJ, STL, PLY, OFF, GLB or glTF, also compressed by gz, bz2, xz or zip.
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: metres, as glTF defines them.
    size : float, optional
        Length of the longest edge of the bounding box after scaling, m, instead of `units`.
    part : str, optional
        One body of several: the name of an OBJ object or group, an STL solid or a glTF node, or the
        number of a separate body, "0", "1", ... in file order. Names come before numbers.
    up : {"x", "y", "z"}, optional
        Axis that points up. Default: y for OBJ, GLB and glTF, z for STL, PLY and OFF.
    wall : float, optional
        Thickness of a single-sided sheet, m.
    holes : {"keep", "fill"}, optional
        Openings of a surface with a wall: "keep" leaves them open, "fill" closes them, except the
        rim of an open sheet. Default: keep round and straight-edged ones, and fill ragged ones of a
        closed surface.
    repair_seconds : float, optional
        Processor time for the repair, s. Default: 10 s for reading and repair together.

    Returns
    -------
    Repair
        The closed surface with outward normals, or the sheet, m, with its repairs. Of several
        bodies it is the largest, unless `part` selects one.

    Raises
    ------
    OptionError
        If the unit or axis is unknown, the size is not positive, both `units` and `size` are given,
        or `holes` without a wall.
    MeshError
        If the file cannot be read, its content is not a body, or the repair takes longer.
    """
    require_holes(holes, wall)
    surface, contents = _read_surface(Path(path), units, size, part, up)
    options = {"wall": wall, "holes": holes, "seconds": repair_seconds}
    with _named(Path(path)):
        result, seconds = repair_in_time(surface, **options, time_spent=contents.seconds)
        if size is not None and abs(result.mesh.extent / size - 1) > _SCALE_TOLERANCE:
            # What was left out had set the scale.
            surface, time_spent = surface.scaled(size / result.mesh.extent), contents.seconds
            result, _ = repair_in_time(surface, **options, time_spent=time_spent + seconds)
    others = ", ".join(counted(count, kind) for kind, count in contents.beside.items() if count)
    if others:
        findings = (f"The file holds {others} beside its faces.", *result.faults)
        changes = (f"Left out: {others}, as faces alone bound a body.", *result.changes)
        result = replace(result, faults=findings, changes=changes)
    return result if size is None else result.scaled(size / result.mesh.extent)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshPart:
    """A part of a mesh file that `part=` may choose.

    Parameters
    ----------
    name : str
        To be given as `part=`.
    faces : int
        Triangles.
    size : tuple of float
        Edges of its bounding box, along x, y and z of the file, m.
    volume : float, optional
        What it encloses, m^3; None where its surface is open.
    taken : bool, optional
        Whether it belongs to the body that `load_body` makes of the file without `part`; None
        where the surface is open, so that it is not known before it is repaired.
    """

    name: str
    faces: int
    size: tuple[float, float, float]
    volume: float | None
    taken: bool | None = None


@checked
def list_parts(path: str | os.PathLike[str], *, units: str | None = None) -> tuple[MeshPart, ...]:
    """List the bodies of a mesh file, before any is analyzed.

    Parameters
    ----------
    path : path
        The file.
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: metres.

    Returns
    -------
    tuple of MeshPart
        In the order of the file: its named parts, and by number separate bodies without a name.

    Raises
    ------
    OptionError
        If the unit is unknown.
    MeshError
        If the file cannot be read.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    >>> other = ball.copy().apply_translation([0.2, 0.0, 0.0])
    >>> _ = trimesh.util.concatenate([ball, other]).export("two.stl")
    >>> [part.faces for part in struck.files.list_parts("two.stl")]
    [320, 320]
    """
    path = Path(path)
    _require_options(units, None, None)
    metre = UNITS[units or "m"]
    with _named(path):
        choices, is_taken = _choices(read_contents(path).parts)
    return tuple(
        MeshPart(
            name=name,
            faces=len(body.faces),
            size=tuple((np.ptp(body.bounds, axis=0) * metre).tolist()),
            volume=abs(body.volume) * metre**3 if is_closed(body) else None,
            taken=None if is_taken is None else is_taken(body),
        )
        for name, body in choices.items()
    )


def body_names(path: str | os.PathLike[str]) -> list[str]:
    """Return the names of the bodies of a surface mesh file for `part=`; none if it holds one.

    Pieces of an open surface, those that cross each other and crumbs are not separate bodies.
    """
    with _named(Path(path)):
        parts = read_contents(path).parts
        surfaces = _surfaces(parts)
        surface = _join_parts(parts, surfaces)
        if not is_closed(surface):
            return []
        bodies, names = _bodies(parts, surfaces, surface)
        volumes = np.array([abs(body.volume) for body in bodies])
        large_bodies = np.flatnonzero(volumes > DEBRIS_FRACTION * volumes.max())
        if len(large_bodies) < 2 or len(crossings(surface)):
            return []
    return [names[index] if names else str(index) for index in large_bodies]


@checked
def load_volume(path: str | os.PathLike[str], *, units: str | None = None) -> VolumeMesh:
    """Read a mesh of tetrahedra, hexahedra or wedges of another program.

    Linear and quadratic elements are kept. Points, lines, surface elements, and nodes without a
    volume element are left out.

    Parameters
    ----------
    path : path
        A file of VTK (vtk, vtu), Gmsh (msh), or Abaqus and CalculiX (inp).
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: metres.

    Returns
    -------
    VolumeMesh
        Elements of one kind, m.

    Raises
    ------
    OptionError
        If the unit is unknown.
    MissingDependencyError
        If meshio is not installed.
    MeshError
        If the file cannot be read, or has no volume elements, several kinds of them, inverted ones,
        or numbers that are not finite.
    """
    path = Path(path)
    _require_options(units, None, None)
    with _named(path):
        mesh = _volume_mesh(read_volume(path), UNITS[units or "m"])
        _require_upright(mesh)
    return mesh


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the file's name before the message of an error."""
    try:
        yield
    except (FileFormatError, MeshError) as error:
        raise type(error)(f"{path}: {error}") from error


def _in_metres(body: Mesh, units: str | None, size: float | None, up: str) -> Mesh:
    factor = size / body.extent if size is not None else UNITS[units or "m"]
    return Mesh(points=body.points * factor, faces=body.faces, up=up)


def _require_options(units: str | None, size: float | None, up: str | None) -> None:
    if units is not None and size is not None:
        raise OptionError(f"units={units!r} and size={size} both set the scale: give one of them")
    if units is not None:
        require_choice("units", units, UNITS)
    if size is not None and not (np.isfinite(size) and size > 0):
        raise OptionError(f"size is {size}: give the longest edge of the body in m, above 0")
    if up is not None:
        require_choice("up", up, ("x", "y", "z"))


def _one_body(parts: list[Part], part: str | None) -> Mesh:
    """Choose the body that `part` names, or the only one there is."""
    surfaces = _surfaces(parts)
    surface = _join_parts(parts, surfaces)
    bodies, names = _bodies(parts, surfaces, surface) if is_closed(surface) else ([surface], [])
    if part is None and len(bodies) > 1:
        choices = _list_names(names or [str(number) for number in range(len(bodies))])
        raise MeshError(f"it holds {len(bodies)} bodies: choose one with part=, of {choices}")
    return bodies[0] if part is None else _chosen(part, parts, surfaces, bodies, names)


def _any_surface(parts: list[Part], part: str | None) -> Mesh:
    """Choose the surface that `part` names, or all together."""
    surfaces = _surfaces(parts)
    whole = _join_parts(parts, surfaces)
    if part is None:
        return whole
    return _chosen(part, parts, surfaces, *_bodies(parts, surfaces, _close(whole)))


def _choices(parts: list[Part]) -> tuple[dict[str, Mesh], Callable[[Mesh], bool] | None]:
    """Return the choices of `part`, and which of them are taken where none is chosen.

    Choices are bodies by the names of their parts or by number, and parts. For an open surface it
    is unknown which are taken.
    """
    surfaces = _surfaces(parts)
    surface = _close(_join_parts(parts, surfaces))
    bodies, names = _bodies(parts, surfaces, surface)
    is_taken = _taken(surface) if is_closed(surface) else None
    if names:
        return dict(zip(names, bodies, strict=True)), is_taken
    surfaces_by_name = dict(zip((part.name for part in parts), surfaces, strict=True))
    return _numbered(bodies) | (surfaces_by_name if len(parts) > 1 else {}), is_taken


def _taken(whole: Mesh) -> Callable[[Mesh], bool]:
    """Return whether a part of a closed surface belongs to the body that is taken of it."""
    body = largest_of(whole)
    # The winding number is 0 outside, a half on the surface and 1 or more within.
    return lambda part: bool((winding(body, part.centroids) > 0.25).mean() > 0.5)


def _surfaces(parts: list[Part]) -> list[Mesh]:
    return [_clean(part_mesh(part.points, part.faces)) for part in parts]


def _close(whole: Mesh) -> Mesh:
    """Return a closed surface itself, and an open one sewn together."""
    return whole if is_closed(whole) else sew(whole)[0]


def _numbered(bodies: list[Mesh]) -> dict[str, Mesh]:
    return {str(number): body for number, body in enumerate(bodies)}


def _chosen(
    part: str, parts: list[Part], surfaces: list[Mesh], bodies: list[Mesh], names: list[str]
) -> Mesh:
    choices = _numbered(bodies)
    choices |= {item.name: surface for item, surface in zip(parts, surfaces, strict=True)}
    choices |= dict(zip(names, bodies, strict=bool(names)))
    if part not in choices:
        numbers = list(_numbered(bodies))
        part_names = [item.name for item in parts if len(parts) > 1]
        names_text = _list_names(names or [*numbers, *part_names])
        raise MeshError(
            f"it has no part {part!r}: {nearest(part, choices)}give one of {names_text}"
        )
    return choices[part]


def _are_bodies(surfaces: list[Mesh]) -> bool:
    """Return whether parts are closed bodies; else they are patches of one surface."""
    return len(surfaces) > 1 and all(is_closed(surface) for surface in surfaces)


def _join_parts(parts: list[Part], surfaces: list[Mesh]) -> Mesh:
    """Return separate bodies side by side, and patches of one surface welded together."""
    if _are_bodies(surfaces):
        return _join(surfaces)
    if len(parts) == 1:
        return surfaces[0]
    return _clean(_join([part_mesh(part.points, part.faces) for part in parts]))


def _bodies(parts: list[Part], surfaces: list[Mesh], whole: Mesh) -> tuple[list[Mesh], list[str]]:
    """Return the separate bodies and, where each comes from a separate part, their names."""
    groups = bodies(whole)
    names: list[str] = []
    if _are_bodies(surfaces):
        labels = np.repeat(np.arange(len(parts)), [len(surface.faces) for surface in surfaces])
        outermost = [faces[np.argmin(whole.centroids[faces, 0])] for faces in groups]
        names = [parts[labels[face]].name for face in outermost]
    is_unique = len(set(names)) == len(groups)
    return [submesh(whole, faces) for faces in groups], names if is_unique else []


def _join(surfaces: list[Mesh]) -> Mesh:
    """Return surfaces as one mesh, without welding."""
    starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    return Mesh(
        points=np.concatenate([surface.points for surface in surfaces]),
        faces=np.concatenate(
            [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
        ),
    )


def _clean(raw: Mesh) -> Mesh:
    if raw.extent <= SHORTEST_EDGE:  # of a part among larger ones
        raise MeshError(
            f"its longest edge is {rounded(raw.extent, 3)}, and volumes can be computed from "
            f"{rounded(SHORTEST_EDGE)} on alone: export it again"
        )
    return _drop_lines(_weld(raw))


def _weld(mesh: Mesh) -> Mesh:
    """Merge vertices at the very same place, and leave out faces that this collapses."""
    points = mesh.points + 0.0  # makes -0.0 and 0.0 one
    order = np.lexsort(points.T)
    is_first = np.append(True, np.any(np.diff(points[order], axis=0) != 0, axis=1))
    labels = np.empty(len(points), dtype=np.int64)
    labels[order] = order[is_first][np.cumsum(is_first) - 1]
    faces = labels[mesh.faces]
    whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    if not whole.any():
        raise MeshError(
            f"all of its {len(faces)} faces are lines or points: export the surface again"
        )
    return submesh(part_mesh(points, faces), np.flatnonzero(whole))


def _drop_lines(mesh: Mesh) -> Mesh:
    """Leave out faces whose corners lie on a line, where the surface is closed without them."""
    flat = find_lines(mesh)
    if not flat.any() or flat.all():
        return mesh
    rest = submesh(mesh, np.flatnonzero(~flat))
    return rest if is_closed(rest) else mesh


def _list_names(names: list[str]) -> str:
    names_text = ", ".join(repr(name) for name in names[:_MAX_LISTED_NAMES])
    more = len(names) - _MAX_LISTED_NAMES
    return f"{names_text} ... and {more} more" if more > 0 else names_text


def _volume_mesh(blocks: ElementBlocks, metre: float) -> VolumeMesh:
    """Return the volume elements of a file, which must be of one kind."""
    counts: Counter[str] = Counter()
    for kind, cells in blocks.cells:
        counts[kind] += len(cells)
    solid_kinds = [kind for kind in +counts if not kind.startswith(_FLAT_KINDS)]
    inventory = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "nothing"
    if not solid_kinds:
        raise MeshError(
            f"it holds no volume elements ({inventory}): export the volume mesh, or load a surface "
            "as obj, stl or ply"
        )
    if len(solid_kinds) > 1 or solid_kinds[0] not in _ELEMENTS:
        raise MeshError(
            f"its elements are {inventory}, and one kind of volume element is taken, of "
            f"{', '.join(_ELEMENTS)}: mesh it with one kind alone"
        )
    elements = np.concatenate([cells for kind, cells in blocks.cells if kind == solid_kinds[0]])
    return _compact(blocks.nodes * metre, elements, _ELEMENTS[solid_kinds[0]])


def _compact(nodes: Array, elements: Index, kind: str) -> VolumeMesh:
    """Return a volume mesh without the nodes that no element uses."""
    count = elements.shape[1]
    if count != len(ELEMENTS[kind].nodes):
        raise MeshError(f"its {kind} elements have {count} nodes each: export the mesh again")
    if elements.min() < 0 or elements.max() >= len(nodes):
        raise MeshError(
            f"elements name nodes {elements.min()} to {elements.max()} of {len(nodes)}: export the "
            "mesh again"
        )
    node_indices, renumbered = np.unique(elements, return_inverse=True)
    if nodes.shape[1] != 3 or not np.isfinite(nodes[node_indices]).all():
        raise MeshError("its nodes are not finite numbers x, y and z: export the mesh again")
    extent = np.abs(nodes[node_indices]).max()
    if extent > MAX_COORDINATE:
        raise MeshError(
            f"a node is {rounded(extent, 3)} m from the origin, and volumes can be computed "
            f"within {rounded(MAX_COORDINATE)} m alone: export the mesh again"
        )
    return VolumeMesh(
        nodes=nodes[node_indices], elements=renumbered.reshape(elements.shape), kind=kind
    )


def _require_upright(mesh: VolumeMesh) -> None:
    """Refuse elements that are turned inside out, or have no volume, at one of their corners."""
    element = ELEMENTS[mesh.kind]
    corners = element.gradients(element.corners)
    jacobians = np.einsum("eni,cnj->ecij", mesh.nodes[mesh.elements], corners)
    with np.errstate(all="ignore"):  # of elements too small for double precision
        inverted_count = np.count_nonzero(~(np.linalg.det(jacobians) > 0).all(axis=1))
    if inverted_count:
        raise MeshError(
            f"{inverted_count} of its {len(mesh.elements)} {mesh.kind} elements are inverted or "
            "without volume at a corner: smooth the mesh, or use the format's own order of nodes"
        )
