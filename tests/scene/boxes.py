"""Boxes with smooth, made-up modes, for tests that need no finite elements."""

from __future__ import annotations

import numpy as np
import trimesh

from struck.analysis.analysis import model_of_modes
from struck.model.damping import Rayleigh
from struck.model.material import Material
from struck.model.model import ModalModel
from tests.scene.test_render import FREQUENCIES, Loud

OAK = Material(
    name="test oak",
    density=700.0,
    youngs_modulus=1.1e10,
    poisson_ratio=0.3,
    damping=Rayleigh(mass=20.0, stiffness=2e-7),
)


def box(size: tuple[float, float, float], *, material: Material = OAK, seed: int = 7) -> ModalModel:
    """Return a box of that size, m, about the origin."""
    mesh = trimesh.creation.box(size).subdivide().subdivide()
    random = np.random.default_rng(seed)
    waves = random.normal(size=(3, 3, len(FREQUENCIES))) * 3 / max(size)
    shapes = np.sin(np.einsum("vd,dem->vem", mesh.vertices, waves) + random.normal(size=3)[:, None])
    mass = material.density * float(np.prod(size))
    squares = np.square(size)
    return model_of_modes(
        mesh.vertices,
        mesh.faces,
        FREQUENCIES,
        shapes / np.sqrt(mass),
        material=material,
        mass=mass,
        centre=np.zeros(3),
        inertia=np.diag(squares.sum() - squares) * mass / 12,
        radiation=Loud(),
    )
