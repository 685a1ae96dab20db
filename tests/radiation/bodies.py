"""Bodies that sound, and the motions that they are heard by: formulas near to real modes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]  # from points (V, 3) to velocities (V, 3)

# The first bending modes of a free bar, by wave number times length.
BENDING = (4.730040745, 7.853204624, 10.995607838)


def ball(radius: float = 0.1, subdivisions: int = 4) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh(points=np.array(sphere.vertices), faces=np.array(sphere.faces))


def box(size: tuple[float, float, float], cells: tuple[int, int, int], offset: float = 0.0) -> Mesh:
    """Return a box about (offset, 0, 0) with `cells` along its edges, two triangles a cell."""
    corners = []
    for axis in range(3):
        across = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, cells[axis]):
            first, second = (np.arange(cells[k]) for k in across)
            cell = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 1, 2)
            steps = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]])
            place = np.full((len(cell), 6, 3), side)
            place[:, :, across] = cell + (steps if side else steps[::-1])
            corners.append(place.reshape(-1, 3))
    numbers, faces = np.unique(np.concatenate(corners), axis=0, return_inverse=True)
    points = (numbers / cells - 0.5) * size + np.array([offset, 0.0, 0.0])
    return Mesh(points=points, faces=faces.reshape(-1, 3))


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(points=np.vstack([m.points for m in meshes]), faces=np.vstack(faces))


def revolved(radii: Array, heights: Array, around: int) -> Mesh:
    """Turn a profile, counter-clockwise, about the z axis; closed unless it ends on the axis."""
    profile = np.stack([radii, heights], axis=1)
    if radii[0] > 0:
        profile = np.vstack([profile, profile[:1]])
    body = trimesh.creation.revolve(profile, sections=around)
    return Mesh(points=np.array(body.vertices), faces=np.array(body.faces))


def rod(radius: float, length: float, around: int, along: int) -> Mesh:
    """Return a cylinder about the z axis, three cells from the axis to the rim of its ends."""
    spokes = radius * np.arange(3) / 3
    heights = np.linspace(-length / 2, length / 2, along + 1)
    radii = np.concatenate([spokes, np.full(along + 1, radius), spokes[::-1]])
    ends = np.repeat(length / 2, 3)
    return revolved(radii, np.concatenate([-ends, heights, ends]), around)


def tube(radius: float, wall: float, length: float, around: int, along: int) -> Mesh:
    """Return an open pipe about the z axis."""
    heights = np.linspace(-length / 2, length / 2, along + 1)
    radii = np.repeat([radius, radius - wall], along + 1)
    return revolved(radii, np.concatenate([heights, heights[::-1]]), around)


def bowl(radius: float, wall: float, around: int, along: int) -> Mesh:
    """Return half a hollow sphere, open to the top, with its centre in the origin."""
    angles = np.linspace(0, np.pi / 2, along + 1)
    sizes = np.repeat([radius, radius - wall], along + 1)
    angles = np.concatenate([angles, angles[::-1]])
    radii = sizes * np.sin(angles)
    return revolved(np.where(radii < 1e-12, 0.0, radii), -sizes * np.cos(angles), around)


def hoop(radius: float, thickness: float, around: int, across: int) -> Mesh:
    """Return a ring of round wire in the xy plane."""
    angles = 2 * np.pi * np.arange(across) / across
    radii = radius + thickness / 2 * np.cos(angles)
    return revolved(radii, thickness / 2 * np.sin(angles), around)


def fork() -> Mesh:
    """Return two prongs without a stem."""
    prongs = (box((0.008, 0.008, 0.1), (4, 4, 24), offset) for offset in (-0.009, 0.009))
    return joined(*prongs)


def radial(mesh: Mesh, profile: Array) -> Array:
    """Return shapes (V, 3, 1) of a ball that moves along its normals by `profile` (V,)."""
    normals = mesh.points / np.linalg.norm(mesh.points, axis=1)[:, None]
    return (normals * profile[:, None])[:, :, None]


def bending(order: int, length: float) -> Motion:
    """Return a free bar's bending along x, of unit mean square over its length along z."""
    b = BENDING[order - 1]
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))

    def motion(points: Array) -> Array:
        s = b * (points[:, 2] / length + 0.5)
        deflection = np.cosh(s) + np.cos(s) - ratio * (np.sinh(s) + np.sin(s))
        slope = np.sinh(s) - np.sin(s) - ratio * (np.cosh(s) + np.cos(s))
        return np.stack([deflection, 0 * s, -points[:, 0] * slope * b / length], axis=1)

    return motion


def ovalling(order: int) -> Motion:
    """Return the bending of a ring about the z axis that leaves its circumference as long."""

    def motion(points: Array) -> Array:
        angle = np.arctan2(points[:, 1], points[:, 0])
        outward, along = np.cos(order * angle), -np.sin(order * angle) / order
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = outward * cosine - along * sine, outward * sine + along * cosine
        return np.stack([x, y, 0 * x], axis=1)

    return motion


def bowl_mode(order: int) -> Motion:
    """Return the bending of a half sphere that stretches nothing (Rayleigh)."""

    def motion(points: Array) -> Array:
        angle = np.arctan2(points[:, 1], points[:, 0])
        below = np.arccos(np.clip(-points[:, 2] / np.linalg.norm(points, axis=1), -1, 1))
        growth, cosine = np.tan(below / 2) ** order, np.cos(order * angle)
        outward, along = -(order + np.cos(below)) * growth * cosine, np.sin(below) * growth * cosine
        around = np.sin(below) * growth * np.sin(order * angle)
        east, zero = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1), 0 * angle
        radius = np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        normal = np.sin(below)[:, None] * radius - np.cos(below)[:, None] * up
        upward = np.cos(below)[:, None] * radius + np.sin(below)[:, None] * up
        return outward[:, None] * normal + along[:, None] * upward + around[:, None] * east

    return motion


def breathing_bowl(points: Array) -> Array:
    """Return a motion along the radius, the same all around the z axis."""
    normal = points / np.linalg.norm(points, axis=1)[:, None]
    return np.cos(3 * np.arccos(np.clip(-normal[:, 2], -1, 1)))[:, None] * normal


def swinging(sign: Callable[[Array], Array]) -> Motion:
    """Return the bending of two prongs along x, clamped at the bottom, by sign of their x."""

    def motion(points: Array) -> Array:
        deflection = sign(points[:, 0]) * (points[:, 2] / 0.1 + 0.5) ** 2
        return np.stack([deflection, 0 * deflection, 0 * deflection], axis=1)

    return motion


def upward(height: Callable[[Array, Array], Array]) -> Motion:
    """Return a motion along z by a function of x and y."""

    def motion(points: Array) -> Array:
        z = height(points[:, 0], points[:, 1])
        return np.stack([0 * z, 0 * z, z], axis=1)

    return motion
