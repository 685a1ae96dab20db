"""Links of a MuJoCo model: which geoms move as one rigid body, and which shape of them sounds.

MuJoCo's bodies that are welded together are one link. What is fixed to the world is one for each of
its bodies, and one for each geom that is attached to the world directly: a floor and a shelf do not
ring together.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.solids import Block, Tube

if TYPE_CHECKING:
    import mujoco

Shape = Block | Tube | Mesh
PART = "|part "  # between a geom's name and the number of its convex part
_PLANE, _FIELD, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(8)
_SILENT = {_PLANE: "a plane has no end", _FIELD: "a height field has no end"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Where one system of coordinates is in another."""

    offset: Array  # (3,): its origin, m
    rotation: Rotation

    def within(self, outer: Placement) -> Placement:
        """Return this placement in the parent coordinates of the placement `outer`."""
        offset = outer.offset + outer.rotation.apply(self.offset)
        return Placement(offset=offset, rotation=outer.rotation * self.rotation)

    def carried(self, positions: Array, quaternions: Array) -> tuple[Array, Array]:
        """Return where this is in the world when its frame is there (T, 3), (T, 4)."""
        frames = Rotation.from_quat(quaternions, scalar_first=True)
        rotations = (frames * self.rotation).as_quat(scalar_first=True)
        return positions + frames.apply(self.offset), rotations

    def inverse(self) -> Placement:
        """Return where the other system is in this one."""
        back = self.rotation.inv()
        return Placement(offset=-back.apply(self.offset), rotation=back)

    def apply(self, points: Array) -> Array:
        """Return points (K, 3) of this system in the other's coordinates."""
        return self.rotation.apply(points) + self.offset


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Link:
    """A rigid part of a simulation: its geoms, and its sounding shape in its own coordinates."""

    name: str
    frame: int  # number of MuJoCo's body that carries it, or of a geom of the world
    frame_is_body: bool
    fixed: bool  # to the world
    geoms: Index
    shape: Shape | None  # None: silent
    placement: Placement  # of the shape's coordinates in the frame
    material: str  # the file's name for what it is made of
    why_silent: str = ""
    plane: bool = False  # whether it is a plane, that of z = 0 of its placement
    welded: tuple[str, ...] = ()  # names of the file's other bodies that are part of it


def links_of(model: mujoco.MjModel) -> list[Link]:
    """Return all links of a model that have a geom, each with a different name."""
    groups: dict[tuple[bool, int], list[int]] = {}
    for geom in range(model.ngeom):
        groups.setdefault(_group(model, geom), []).append(geom)
    name_counts: Counter[str] = Counter()
    links = []
    for (is_body, frame), geoms in groups.items():
        name = _name(model, frame, is_body=is_body)
        name_counts[name] += 1
        unique_name = name if name_counts[name] == 1 else f"{name} {name_counts[name]}"
        links.append(_link(model, unique_name, frame, np.array(geoms), is_body=is_body))
    return links


def owners(model: mujoco.MjModel, links: Sequence[Link]) -> Index:
    """Return the number of the link of each geom (geoms,)."""
    numbers = np.zeros(model.ngeom, np.int64)
    for number, link in enumerate(links):
        numbers[link.geoms] = number
    return numbers


def _group(model: mujoco.MjModel, geom: int) -> tuple[bool, int]:
    """Return the frame of a geom's link: whether that is a body, and its number."""
    body = int(model.geom_bodyid[geom])
    if body == 0:
        geom_name, part, _ = model.geom(geom).name.partition(PART)
        return False, model.geom(geom_name).id if part else geom
    return True, int(model.body_weldid[body]) or body


def _name(model: mujoco.MjModel, number: int, *, is_body: bool) -> str:
    name = model.body(number).name if is_body else model.geom(number).name
    return name or f"{'body' if is_body else 'geom'} {number}"


def _link(model: mujoco.MjModel, name: str, frame: int, geoms: Index, *, is_body: bool) -> Link:
    sounding = _sounding(model, geoms)
    placements = [_place_in_frame(model, geom, frame if is_body else None) for geom in sounding]
    material = next((m for m in (_material(model, g) for g in (*sounding, *geoms)) if m), "")
    shape, placement, reason = _shape(model, sounding, placements)
    parts = {int(model.geom_bodyid[geom]) for geom in geoms} - {frame} if is_body else set()
    return Link(
        name=name,
        frame=frame,
        frame_is_body=is_body,
        fixed=not is_body or (model.body_weldid[frame] == 0 and model.body_mocapid[frame] < 0),
        geoms=geoms,
        shape=shape,
        placement=placement,
        material=material,
        why_silent=reason,
        plane=len(sounding) == 1 and model.geom_type[sounding[0]] == _PLANE,
        welded=tuple(_name(model, part, is_body=True) for part in sorted(parts)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MassProperties:
    """Mass, kg, centre of mass (3,), m, and moments of inertia about it (3, 3), kg m^2."""

    mass: float
    centre: Array
    inertia: Array

    def seen_from(self, placement: Placement) -> MassProperties:
        """Return the mass properties in the coordinates in which the present ones are placed."""
        rotation = placement.rotation.as_matrix()
        centre = placement.apply(self.centre[None])[0]
        return MassProperties(
            mass=self.mass, centre=centre, inertia=rotation @ self.inertia @ rotation.T
        )


def mass_properties(model: mujoco.MjModel, link: Link) -> MassProperties | None:
    """Return mass and inertia of a link in its shape's coordinates; None where it has none."""
    if not link.frame_is_body:
        return None
    bodies = np.unique(model.geom_bodyid[link.geoms])
    parts = [_body_mass(model, int(body), link.frame) for body in bodies if model.body_mass[body]]
    mass = sum(part.mass for part in parts)
    if not mass:
        return None
    centre = np.sum([part.mass * part.centre for part in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        arm = part.centre - centre
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    link_mass = MassProperties(mass=mass, centre=centre, inertia=inertia)
    return link_mass.seen_from(link.placement.inverse())


def _body_mass(model: mujoco.MjModel, body: int, frame: int) -> MassProperties:
    principal = _placement(model.body_ipos[body], model.body_iquat[body])
    properties = MassProperties(
        mass=float(model.body_mass[body]),
        centre=np.zeros(3),
        inertia=np.diag(model.body_inertia[body]),
    )
    return properties.seen_from(principal.within(_place_welded(model, body, frame)))


def touches(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a geom takes part in contacts, by its masks or by a pair that names it."""
    collision_bits = model.geom_contype[geom] or model.geom_conaffinity[geom]
    return bool(collision_bits or (geom in model.pair_geom1) or (geom in model.pair_geom2))


def _sounding(model: mujoco.MjModel, geoms: Index) -> list[int]:
    """Return the visible meshes that do not collide, or else the geometries that collide."""
    visual_meshes = [g for g in geoms if model.geom_type[g] == _MESH and not touches(model, int(g))]
    return [
        int(g) for g in (visual_meshes or [g for g in geoms if touches(model, int(g))] or geoms)
    ]


def _material(model: mujoco.MjModel, geom: int) -> str:
    number = int(model.geom_matid[geom])
    return model.mat(number).name if number >= 0 else ""


def geom_placement(model: mujoco.MjModel, geom: int, link: Link) -> Placement:
    """Return where a geom's coordinates are in the frame of its link."""
    return _place_in_frame(model, geom, link.frame if link.frame_is_body else None)


def _place_in_frame(model: mujoco.MjModel, geom: int, frame: int | None) -> Placement:
    """Return a geom's place in the coordinates of a body that it is welded to, or of the world."""
    if frame is None:
        return Placement(offset=np.zeros(3), rotation=Rotation.identity())
    place = _placement(model.geom_pos[geom], model.geom_quat[geom])
    return place.within(_place_welded(model, int(model.geom_bodyid[geom]), frame))


def _place_welded(model: mujoco.MjModel, body: int, frame: int) -> Placement:
    """Return a body's place in the coordinates of another that it is welded to."""
    place = Placement(offset=np.zeros(3), rotation=Rotation.identity())
    while body != frame:
        place = place.within(_placement(model.body_pos[body], model.body_quat[body]))
        body = int(model.body_parentid[body])
    return place


def _placement(offset: Array, quaternion: Array) -> Placement:
    rotation = Rotation.from_quat(np.asarray(quaternion), scalar_first=True)
    return Placement(offset=np.array(offset), rotation=rotation)


def _shape(
    model: mujoco.MjModel, geoms: Sequence[int], placements: Sequence[Placement]
) -> tuple[Shape | None, Placement, str]:
    """Return the shape that sounds, its placement in the frame, and the reason if it is silent."""
    identity = Placement(offset=np.zeros(3), rotation=Rotation.identity())
    kinds = {int(model.geom_type[geom]) for geom in geoms}
    for kind, reason in _SILENT.items():
        if kind in kinds:
            return None, placements[0] if len(geoms) == 1 else identity, reason
    if len(geoms) > 1:
        parts = [
            (place.apply(points), faces)
            for place, (points, faces) in zip(
                placements, (triangles(model, geom) for geom in geoms), strict=True
            )
        ]
        return _join_parts(parts), identity, ""
    (geom,), (place,) = geoms, placements
    size = [float(length) for length in model.geom_size[geom]]
    kind = kinds.pop()
    if kind == _BOX:
        return Block(size=(2 * size[0], 2 * size[1], 2 * size[2])), place, ""
    if kind == _CYLINDER:
        return Tube(length=2 * size[1], radius=size[0], wall=size[0]), place, ""
    points, faces = triangles(model, geom)
    if kind != _MESH:
        return _join_parts([(points, faces)]), place, ""
    file_placement = file_coordinates(model, geom)
    return (
        _join_parts([(file_placement.apply(points), faces)]),
        file_placement.inverse().within(place),
        "",
    )


def _join_parts(parts: Sequence[tuple[Array, Index]]) -> Mesh:
    offsets = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    faces = [part + start for (_, part), start in zip(parts, offsets, strict=True)]
    return Mesh(points=np.concatenate([points for points, _ in parts]), faces=np.concatenate(faces))


def file_coordinates(model: mujoco.MjModel, geom: int) -> Placement:
    """Return the placement of a mesh, which MuJoCo moves and rotates, in its file's coordinates."""
    mesh = model.geom_dataid[geom]
    return _placement(model.mesh_pos[mesh], model.mesh_quat[mesh])


def triangles(model: mujoco.MjModel, geom: int) -> tuple[Array, Index]:
    """Return vertices (V, 3), m, and faces (F, 3) of a geom's surface in its own coordinates."""
    import trimesh

    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _MESH or model.geom_dataid[geom] >= 0:
        mesh = model.mesh(model.geom_dataid[geom])
        at, vertex_count = mesh.vertadr[0], mesh.vertnum[0]
        first, count = mesh.faceadr[0], mesh.facenum[0]
        points = np.asarray(model.mesh_vert[at : at + vertex_count], np.float64)
        return points, np.asarray(model.mesh_face[first : first + count], np.int64)
    if kind == _BOX:
        surface = trimesh.creation.box(2 * size)
    elif kind == _CYLINDER:
        surface = trimesh.creation.cylinder(size[0], 2 * size[1], sections=48)
    elif kind == _CAPSULE:
        surface = trimesh.creation.capsule(2 * size[1], size[0], count=(24, 24))
    else:  # a ball, or one with three radii
        surface = trimesh.creation.icosphere(subdivisions=4)
        surface.apply_scale(size if kind == _ELLIPSOID else np.full(3, size[0]))
    return np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int64)
