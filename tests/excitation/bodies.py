"""Bodies with shapes known in closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh

from struck.analysis.analysis import model_of_modes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel

STEEL = Material(density=7850.0, youngs_modulus=210e9, poisson_ratio=0.3)
SIZE = np.array([0.4, 0.3, 0.02])
WAVENUMBERS = np.array([20.0, 45.0, 90.0])


@cache
def plate(cells: int = 80) -> ModalModel:
    """Return a plate whose shapes are waves along x, across the plate: cos(q x + 0.3)."""
    xs, ys = (np.linspace(-half, half, cells + 1) for half in SIZE[:2] / 2)
    sheet = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = corner[:, None] + np.array([0, cells + 1, cells + 2, 1])
    top = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    points = np.concatenate(
        [np.column_stack([sheet, np.full(len(sheet), side * SIZE[2] / 2)]) for side in (1, -1)]
    )
    faces = np.concatenate([top, top[:, ::-1] + len(sheet)])
    shapes = np.zeros((len(points), 3, len(WAVENUMBERS)))
    shapes[:, 2] = np.cos(np.outer(points[:, 0], WAVENUMBERS) + 0.3)
    return model(Mesh(points=points, faces=faces), shapes)


def of(solid: trimesh.Trimesh) -> ModalModel:
    """Return a body of any surface, one mode."""
    mesh = Mesh(points=solid.vertices, faces=solid.faces)
    return model(mesh, np.ones((len(mesh.points), 3, 1)))


def model(mesh: Mesh, shapes: np.ndarray) -> ModalModel:
    """Return a model with given shapes and harmonic frequencies."""
    return model_of_modes(
        mesh.points,
        mesh.faces,
        200.0 * np.arange(1, shapes.shape[2] + 1),
        shapes,
        material=STEEL,
        mass=2.0,
        centre=np.zeros(3),
        inertia=np.eye(3) * 0.01,
        air=False,  # no body has these shapes: that of the whole as one mode overdamps
    )
