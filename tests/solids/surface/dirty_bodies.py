"""Clean bodies with known volumes, and what files do to them."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Triangles as they go into a file, and what `load_body` is to be told."""

    points: Array
    faces: Index
    options: dict[str, object] = field(default_factory=dict)

    def written(self, path: Path) -> Path:
        """Write an OBJ file with all digits."""
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in self.points.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (self.faces + 1).tolist()]
        path.write_text("\n".join(lines))
        return path

    @property
    def extent(self) -> float:
        return float(np.ptp(self.points, axis=0).max())

    @property
    def centroids(self) -> Array:
        return self.points[self.faces].mean(axis=1)

    @property
    def normals(self) -> Array:
        """Unit normals at the vertices."""
        corners = self.points[self.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sums = np.zeros_like(self.points)
        for column in self.faces.T:
            np.add.at(sums, column, areas)
        return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def of(body: trimesh.Trimesh) -> Surface:
    return Surface(points=np.array(body.vertices), faces=np.array(body.faces))


def joined(*surfaces: Surface) -> Surface:
    starts = np.cumsum([0, *(len(each.points) for each in surfaces)])
    return Surface(
        points=np.concatenate([each.points for each in surfaces]),
        faces=np.concatenate([s.faces + n for s, n in zip(surfaces, starts, strict=False)]),
    )


# Clean bodies, m and m^3


def ellipsoid() -> Surface:
    ball = of(trimesh.creation.icosphere(subdivisions=4))
    return Surface(points=ball.points * [0.06, 0.045, 0.03], faces=ball.faces)


def blocks(*boxes: tuple[float, ...], cell: float) -> Surface:
    """The outside of axis-parallel boxes that fill whole cells of a grid, two triangles a cell."""
    filled = {
        (i, j, k)
        for x, y, z, a, b, c in boxes
        for i in range(round(x / cell), round(a / cell))
        for j in range(round(y / cell), round(b / cell))
        for k in range(round(z / cell), round(c / cell))
    }
    quads = []
    for cube in filled:
        for axis in range(3):
            u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            for side in (0, 1):
                step = np.eye(3, dtype=int)[axis]
                if tuple(np.array(cube) + (2 * side - 1) * step) not in filled:
                    base = np.array(cube) + side * step
                    quad = [base, base + u, base + u + v, base + v]
                    quads.append(quad if side else quad[::-1])
    points, faces = np.unique(np.array(quads).reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = faces.reshape(-1, 4).T
    return Surface(
        points=points * cell, faces=np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    )


def hollow_ball() -> Surface:
    inner = of(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    outer = of(trimesh.creation.icosphere(subdivisions=4, radius=0.05))
    return joined(outer, Surface(points=inner.points, faces=inner.faces[:, ::-1]))


def revolved(profile: Array, around: int) -> Surface:
    """A profile (n, 2) of radii and heights from pole to pole, turned about z."""
    turn = 2 * np.pi * np.arange(around) / around
    rings = [
        np.stack([r * np.cos(turn), r * np.sin(turn), np.full(around, z)], 1)
        for r, z in profile[1:-1]
    ]
    poles = np.array([[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]])
    points = np.concatenate([*rings, poles])
    low, high = len(points) - 2, len(points) - 1
    here = np.arange(around)
    there = (here + 1) % around
    faces = [np.stack([np.full(around, low), there, here], 1)]
    for start in around * np.arange(len(rings) - 1):
        a, b, c, d = start + here, start + there, start + around + there, start + around + here
        faces += [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    last = around * (len(rings) - 1)
    faces.append(np.stack([last + here, last + there, np.full(around, high)], 1))
    return Surface(points=points, faces=np.concatenate(faces))


def cylinder() -> Surface:
    disc = np.linspace(0, 0.03, 7)[:-1]
    side = np.linspace(-0.05, 0.05, 21)
    radii = np.concatenate([disc, np.full(len(side), 0.03), disc[::-1]])
    heights = np.concatenate([np.full(6, -0.05), side, np.full(6, 0.05)])
    return revolved(np.stack([radii, heights], 1), 48)


def capsule() -> Surface:
    angle = np.linspace(-np.pi / 2, 0, 13)
    bottom = 0.025 * np.stack([np.cos(angle), np.sin(angle)], 1) + [0, -0.04]
    middle = np.stack([np.full(11, 0.025), np.linspace(-0.04, 0.04, 13)[1:-1]], 1)
    top = bottom[::-1] * [1, -1]
    return revolved(np.concatenate([bottom, middle, top]), 48)


def ring() -> Surface:
    return of(trimesh.creation.torus(0.05, 0.02, major_sections=72, minor_sections=36))


CLEAN: dict[str, tuple[Callable[[], Surface], float]] = {
    "ball": (lambda: of(trimesh.creation.icosphere(4, 0.05)), 4 / 3 * np.pi * 0.05**3),
    "ellipsoid": (ellipsoid, 4 / 3 * np.pi * 0.06 * 0.045 * 0.03),
    "ring": (ring, 2 * np.pi**2 * 0.05 * 0.02**2),
    "cube": (lambda: blocks((0, 0, 0, 0.08, 0.08, 0.08), cell=0.005), 0.08**3),
    "cylinder": (cylinder, np.pi * 0.03**2 * 0.1),
    "bracket": (
        lambda: blocks((0, 0, 0, 0.1, 0.03, 0.05), (0, 0, 0, 0.03, 0.1, 0.05), cell=0.005),
        (0.1 * 0.03 + 0.07 * 0.03) * 0.05,
    ),
    "hollow ball": (hollow_ball, 4 / 3 * np.pi * (0.05**3 - 0.03**3)),
    "capsule": (capsule, np.pi * 0.025**2 * (0.08 + 4 / 3 * 0.025)),
}


# What files do to them


def holes(body: Surface, rng: np.random.Generator) -> Surface:
    """Three holes of a few faces, as where a scanner did not reach."""
    centres = body.centroids[rng.choice(len(body.faces), 3, replace=False)]
    away = np.linalg.norm(body.centroids[:, None] - centres, axis=2).min(axis=1)
    return Surface(points=body.points, faces=body.faces[away > 0.06 * body.extent])


def soup(body: Surface, rng: np.random.Generator) -> Surface:
    """Each triangle with vertices of its own, 1e-7 of the extent beside where they should be."""
    points = body.points[body.faces].reshape(-1, 3)
    jitter = 1e-7 * body.extent * rng.uniform(-1, 1, points.shape)
    return Surface(points=points + jitter, faces=np.arange(len(points)).reshape(-1, 3))


def flips(body: Surface, rng: np.random.Generator) -> Surface:
    """A third of the faces turned over."""
    chosen = rng.random(len(body.faces)) < 0.3
    faces = np.where(chosen[:, None], body.faces[:, ::-1], body.faces)
    return Surface(points=body.points, faces=faces)


def inside_out(body: Surface, rng: np.random.Generator) -> Surface:
    return Surface(points=body.points, faces=rng.permutation(body.faces)[:, ::-1])


def doubles(body: Surface, rng: np.random.Generator) -> Surface:
    """A tenth of the faces twice, half of those the other way round."""
    chosen = body.faces[rng.random(len(body.faces)) < 0.1]
    half = len(chosen) // 2
    return Surface(
        points=body.points,
        faces=np.concatenate([body.faces, chosen[:half], chosen[half:, ::-1]]),
    )


def halves(body: Surface, rng: np.random.Generator) -> Surface:
    """Two parts pushed into each other: each closed, and together the body."""
    axis = int(rng.integers(3))
    place = body.centroids[:, axis]
    low, high = np.quantile(place, [0.4, 0.6])
    return joined(capped(body, place < high), capped(body, place > low))


def capped(body: Surface, chosen: NDArray[np.bool_]) -> Surface:
    """Some faces, closed by a fan from the middle of each loop of open edges."""
    faces = body.faces[chosen]
    sides = {(int(a), int(b)) for f in faces for a, b in zip(f, np.roll(f, -1), strict=True)}
    onward: dict[int, list[int]] = defaultdict(list)
    for a, b in sides:
        if (b, a) not in sides:
            onward[b].append(a)
    points, fans = [body.points], []
    for start in list(onward):
        loop = [start]
        while onward[loop[-1]]:
            loop.append(onward[loop[-1]].pop())
        if len(loop) > 1:
            middle = sum(map(len, points))
            points.append(body.points[loop].mean(axis=0, keepdims=True))
            fans += [(a, b, middle) for a, b in itertools.pairwise(loop)]
    return Surface(
        points=np.concatenate(points), faces=np.concatenate([faces, np.array(fans, dtype=int)])
    )


def slivers(body: Surface, rng: np.random.Generator) -> Surface:
    """Vertices put on edges of one face alone, the gap closed by a triangle without area."""
    points, faces = body.points, body.faces
    chosen = rng.choice(len(faces), 50, replace=False)
    a, b, c = faces[chosen].T
    middle = len(points) + np.arange(len(chosen))
    parts = [np.delete(faces, chosen, axis=0)]
    parts += [np.stack(t, 1) for t in ((a, middle, c), (middle, b, c), (a, b, middle))]
    return Surface(
        points=np.concatenate([points, (points[a] + points[b]) / 2]), faces=np.concatenate(parts)
    )


def shells(body: Surface, rng: np.random.Generator) -> Surface:
    """The same surface once more, a little within the material."""
    depth = 0.02 * body.extent * rng.uniform(0.8, 1.2)
    return joined(body, Surface(points=body.points - depth * body.normals, faces=body.faces))


def crossing(body: Surface, rng: np.random.Generator) -> Surface:
    """The same surface once more, a hair turned about z: the faces cross everywhere."""
    turn = np.deg2rad(rng.uniform(1, 2))
    matrix = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    return joined(body, Surface(points=body.points @ matrix.T, faces=body.faces))


def millimetres(body: Surface, rng: np.random.Generator) -> Surface:
    """In millimetres, with the unit said, and the faces in another order."""
    faces = rng.permutation(body.faces)
    return Surface(points=1000 * body.points, faces=faces, options={"units": "mm"})


def lidless(body: Surface, rng: np.random.Generator) -> Surface:
    """Open at one end, and no wall given."""
    del rng
    place = body.centroids[:, 2]
    return Surface(points=body.points, faces=body.faces[place < place.max() - 1e-9])


def debris(body: Surface, rng: np.random.Generator) -> Surface:
    """Crumbs around it, a unit that no one knows, and the size said."""
    crumb = of(trimesh.creation.icosphere(1, 0.02 * body.extent))
    places = body.points.mean(axis=0) + body.extent * np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1]])
    crumbs = [Surface(points=crumb.points + place, faces=crumb.faces) for place in places]
    many = joined(body, *crumbs)
    return Surface(
        points=rng.uniform(2, 50) * many.points, faces=many.faces, options={"size": body.extent}
    )


def slabs(body: Surface, rng: np.random.Generator) -> Surface:
    """A cube of two blocks pushed into each other, with four pairs of sides in one plane."""
    del body, rng
    low = blocks((0, 0, 0, 0.05, 0.08, 0.08), cell=0.01)
    return joined(low, blocks((0.03, 0, 0, 0.08, 0.08, 0.08), cell=0.005))


def legs(body: Surface, rng: np.random.Generator) -> Surface:
    """A bracket of two blocks pushed into each other, unlike in their triangles."""
    del body, rng
    one = blocks((0, 0, 0, 0.1, 0.03, 0.05), cell=0.01)
    return joined(one, blocks((0, 0, 0, 0.03, 0.1, 0.05), cell=0.005))


def balls_on_a_rod(body: Surface, rng: np.random.Generator) -> Surface:
    """A capsule of two balls and a rod that ends within them."""
    del body
    ball = of(trimesh.creation.icosphere(4, 0.025))
    rod = of(trimesh.creation.cylinder(0.025, 0.08, sections=96))
    ends = [
        Surface(points=ball.points + np.array([0, 0, z]), faces=ball.faces) for z in (-0.04, 0.04)
    ]
    return joined(*(rod, *ends)[:: rng.choice([1, -1])])


VERSIONS: dict[str, tuple[Callable[[Surface, np.random.Generator], Surface], ...]] = {
    "ball": (holes, soup, flips, crossing, debris),
    "ellipsoid": (holes, doubles, halves, slivers, inside_out),
    "ring": (soup, flips, halves, shells, crossing),
    "cube": (holes, slabs, slivers, millimetres, lidless),
    "cylinder": (doubles, flips, crossing, shells, lidless),
    "bracket": (holes, soup, legs, shells, debris),
    "hollow ball": (holes, soup, flips, shells, millimetres),
    "capsule": (doubles, balls_on_a_rod, slivers, inside_out, millimetres),
}
