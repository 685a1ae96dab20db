"""Everyday things as watertight meshes of both faces: cups, bells, boxes, plates."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from manifold3d import CrossSection, Manifold
from numpy.typing import ArrayLike, NDArray

from struck.model.mesh import Mesh

Profile = NDArray[np.float64]


def mug() -> Mesh:
    """Return a mug 96 mm high with walls of 4 mm, a rounded lip and a handle."""
    profile = [
        [[0, 0], [37, 0]],
        arc((37, 3), 3, -80, 0, 4),
        arc((38, 94), 2, 0, 180, 9),
        [[36, 8]],
        arc((32, 8), 4, -10, -80, 4),
        [[0, 4]],
    ]
    ring = _turned([arc((26, 0), 5, 0, 360, 17)[:-1]], 64).rotate([90, 0, 0])
    inside = Manifold.cylinder(116, 38, 38, 96).translate([0, 0, -10])
    return meshed(_turned(profile, 96) + (ring.translate([42, 0, 48]) - inside))


def glass() -> Mesh:
    """Return a wine glass 190 mm high with a bowl of 1.2 mm on a stem of 8 mm."""
    outer, inner = arc((0, 130), 35, -85, 5, 28), arc((0, 130), 33.8, 5, -90, 28)
    foot = [[0, 0], [32, 0], [32.6, 0.6], [32, 1.2], [12, 3], [6, 8], [4, 20], [4, 80], [5, 92]]
    return meshed(_turned([foot, outer, [[33, 190], [31.8, 190]], inner], 96))


def vase() -> Mesh:
    """Return a vase of 3 mm whose floor meets its wall between two rows of facets."""
    height = np.linspace(0, 220, 40)
    outer = np.stack([35 + 18 * np.sin(height * np.pi / 100), height], axis=1)
    inner = (outer - [3, 0])[:1:-1]
    return meshed(_turned([[[0, 0]], outer, inner, [[inner[-1, 0], 4], [0, 4]]], 72))


def bell() -> Mesh:
    """Return a bell 620 mm high, from 8 mm thick at its shoulder to 24 mm at its lip."""
    height = np.linspace(0, 500, 40)
    radius, wall = 120 + 200 * np.exp(-height / 110), 8 + 16 * np.exp(-height / 90)
    profile = [
        np.stack([radius, height], axis=1),
        arc((0, 500), 120, 0, 90, 14)[1:],
        arc((0, 500), 112, 90, 0, 14)[:-1],
        np.stack([radius - wall, height], axis=1)[::-1],
    ]
    return meshed(_turned(profile, 96))


def table() -> Mesh:
    """Return a table of 1 m by 0.6 m with a top of 25 mm on four legs of 50 mm."""
    legs = [_box(50, 50, 710).translate([x, y, 0]) for x in (30, 920) for y in (30, 520)]
    return meshed(sum(legs, start=_box(1000, 600, 25).translate([0, 0, 700])))


def crate() -> Mesh:
    """Return an open crate of 400 mm with walls of 12 mm."""
    return meshed(_box(400, 300, 250) - _box(376, 276, 300).translate([12, 12, 12]))


def guitar_box() -> Mesh:
    """Return a box of 450 mm with walls of 3 mm and a sound hole of 90 mm."""
    hole = Manifold.cylinder(20, 45, 45, 64).translate([250, 175, 90])
    return meshed(_box(450, 350, 100) - _box(444, 344, 94).translate([3, 3, 3]) - hole)


def hollow_cube() -> Mesh:
    """Return a cube of 50 mm with walls of 2.5 mm, closed (O'Brien et al. 2002, Table 1)."""
    return meshed(_box(50, 50, 50) - _box(45, 45, 45).translate([2.5, 2.5, 2.5]))


def plate(thickness: float) -> Mesh:
    """Return a plate of 300 by 200 mm, `thickness` in mm."""
    return meshed(_box(300, 200, thickness))


def undercut_bar() -> Mesh:
    """Return a marimba bar of 320 mm."""
    return _extruded(
        [[0, 0], [100, 0], [120, 12], [200, 12], [220, 0], [320, 0], [320, 20], [0, 20]], 40
    )


def fork() -> Mesh:
    """Return a tuning fork of 130 mm."""
    right = np.array([[2, 0], [2, 40], [9, 47], [9, 130], [4, 130], [4, 52]])
    left = right[::-1] * [-1, 1]
    return _extruded(np.vstack([right, [[0, 49]], left]), 6)


def perforated_plate() -> Mesh:
    """Return a sheet of 200 by 120 by 2 mm with fifteen holes of 16 mm."""
    hole = Manifold.cylinder(10, 8, 8, 32)
    places = [(20 + 40 * i, 20 + 40 * j) for i in range(5) for j in range(3)]
    holes = [hole.translate([x, y, -4]) for x, y in places]
    return meshed(_box(200, 120, 2) - sum(holes[1:], start=holes[0]))


def coin() -> Mesh:
    """Return a coin of 25 mm with a raised rim."""
    upper = np.array([[10.5, 1.8], [11, 2], [12.5, 2]])
    lower = (upper * [1, -1] + [0, 2])[::-1]
    return meshed(_turned([[[0, 1.8]], upper, lower, [[0, 0.2]]], 128))


def prism() -> Mesh:
    """Return a triangular prism 100 mm long, with sides of 60 mm."""
    return _extruded([[0, 0], [60, 0], [30, 30 * np.sqrt(3)]], 100)


def hemisphere() -> Mesh:
    """Return half a ball of 80 mm."""
    return meshed(_turned([arc((0, 0), 40, 0, 90, 17), [[0, 0]]], 64))


BODIES: dict[str, Callable[[], Mesh]] = {
    "mug": mug,
    "wine glass": glass,
    "bell": bell,
    "table": table,
    "crate": crate,
    "guitar box": guitar_box,
    "hollow cube": hollow_cube,
    "plate of 4 mm": lambda: plate(4),
    "plate of 1 mm": lambda: plate(1),
    "undercut bar": undercut_bar,
    "fork": fork,
    "perforated plate": perforated_plate,
    "coin": coin,
    "prism": prism,
    "hemisphere": hemisphere,
}


def meshed(body: Manifold) -> Mesh:
    """Return a body's surface in m, from mm."""
    found = body.to_mesh()
    points = np.asarray(found.vert_properties[:, :3], np.float64)
    return Mesh(points=points / 1000, faces=np.asarray(found.tri_verts, np.int64))


def _box(*size: float) -> Manifold:
    return Manifold.cube(list(size))


def _turned(profile: Sequence[ArrayLike], around: int) -> Manifold:
    """Turn a profile of (radius, height) about the axis."""
    points = np.vstack([np.asarray(part, np.float64) for part in profile])
    points[np.abs(points[:, 0]) < 1e-6, 0] = 0.0
    return Manifold.revolve(_section(points), around)


def _extruded(outline: ArrayLike, depth: float) -> Mesh:
    return meshed(Manifold.extrude(_section(np.asarray(outline, np.float64)), depth))


def _section(outline: Profile) -> CrossSection:
    """Return what an outline encloses, whichever way it runs."""
    x, y = outline.T
    area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return CrossSection([outline if area > 0 else outline[::-1]])


def arc(centre: tuple[float, float], radius: float, first: float, last: float, n: int) -> Profile:
    """Return points on an arc, its angles in degrees."""
    angle = np.radians(np.linspace(first, last, n))
    return np.array(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
