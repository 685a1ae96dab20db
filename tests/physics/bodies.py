"""Bodies that several tests vibrate."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from struck import InternalFriction, Material, Mesh, Rayleigh
from struck.solids import VolumeMesh
from tests.physics.reference import CHIME_DENSITY, CHIME_LAME, CHIME_STIFFNESS_DAMPING

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHIME = Material.from_lame(
    first=CHIME_LAME[0],
    shear=CHIME_LAME[1],
    density=CHIME_DENSITY,
    damping=Rayleigh(mass=0.0, stiffness=CHIME_STIFFNESS_DAMPING),
)
# Unit shear modulus and density: omega L / c_s is omega.
UNIT = Material(density=1.0, youngs_modulus=2.6, poisson_ratio=0.3)
ALUMINIUM = Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.25)


def custom(*, density: float, youngs: float, poisson: float, loss: float = 0.0) -> Material:
    """Return a material of these constants."""
    return Material(
        density=density,
        youngs_modulus=youngs,
        poisson_ratio=poisson,
        damping=InternalFriction(loss_tangent=loss),
    )


def ball(radius: float, subdivisions: int = 5) -> Mesh:
    """Return a polyhedron of exactly the sphere's volume."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    mesh = Mesh(points=np.array(sphere.vertices), faces=np.array(sphere.faces))
    return mesh.scaled(radius * (4 * np.pi / 3 / mesh.volume) ** (1 / 3))


def box(*size: float) -> Mesh:
    """Return a box of 12 triangles about the origin."""
    body = trimesh.creation.box(extents=size)
    return Mesh(points=np.array(body.vertices), faces=np.array(body.faces))


def bumpy(seed: int) -> Mesh:
    """Return a random smooth star-shaped body of about 0.1 m."""
    random = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(subdivisions=4)
    points = np.array(sphere.vertices)
    waves = random.normal(size=(6, 3)) * 2.0
    heights = random.uniform(-0.08, 0.08, 6)
    radii = 1 + np.sin(points @ waves.T + random.uniform(0, 6, 6)) @ heights
    stretch = random.uniform(0.03, 0.06, 3)
    return Mesh(points=points * radii[:, None] * stretch, faces=np.array(sphere.faces))


# A cell's corners in VTK's order, as steps in x, y and z.
_CELL = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
# Along each tetrahedron of Kuhn's six go x, y and z in another order.
_KUHN = [
    [tuple(int(axis in path[:step]) for axis in range(3)) for step in range(4)]
    for path in itertools.permutations(range(3))
]
_WEDGES = [[_CELL[k] for k in corners] for corners in ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))]
_PATTERNS = {"hex8": [list(_CELL)], "tet4": _KUHN, "wedge6": _WEDGES}


def grid(kind: str, counts: tuple[int, int, int], size: ArrayLike = (1, 1, 1)) -> VolumeMesh:
    """Return a box from the origin on, cut into cells and these into elements of a linear kind."""
    shape = np.array(counts) + 1
    number = np.arange(np.prod(shape)).reshape(shape)
    nodes = np.stack(np.unravel_index(number.ravel(), shape), axis=1) / counts * np.asarray(size)
    nx, ny, nz = counts
    elements = [
        np.stack([number[i : i + nx, j : j + ny, k : k + nz].ravel() for i, j, k in element], 1)
        for element in _PATTERNS[kind]
    ]
    return VolumeMesh(nodes=nodes, elements=_upright(nodes, np.vstack(elements)), kind=kind)


def _upright(nodes: Array, elements: Index) -> Index:
    """Give tetrahedra positive volume."""
    if elements.shape[1] != 4:
        return elements
    corners = nodes[elements]
    turned = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    return np.where(turned[:, None], elements[:, [0, 2, 1, 3]], elements)


def distorted(mesh: VolumeMesh, share: float, seed: int = 0) -> VolumeMesh:
    """Move the nodes inside at random, by up to a share of the shortest edge."""
    random = np.random.default_rng(seed)
    corners = mesh.nodes[mesh.elements]
    shortest = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).min()
    steps = share * shortest * random.uniform(-1, 1, mesh.nodes.shape)
    steps[on_the_surface(mesh)] = 0
    return replace(mesh, nodes=mesh.nodes + steps)


def on_the_surface(mesh: VolumeMesh) -> NDArray[np.bool_]:
    """Tell which nodes lie on the boundary (N,)."""
    outside = np.zeros(len(mesh.nodes), bool)
    for sides in mesh.boundary_sides():
        outside[sides] = True
    return outside
