"""Bodies whose sounds are known: plates of chosen tones, and a clamped plate by Ritz's method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from struck.analysis.analysis import model_of_modes
from struck.model.damping import InternalFriction
from struck.model.gains import TransverseShapes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.modes import Modes
from struck.radiation import by_name
from struck.shapes.skins import rectangle, slab

Array = NDArray[np.float64]

STEEL = Material(
    name="steel",
    density=7800.0,
    youngs_modulus=2e11,
    poisson_ratio=0.3,
    damping=InternalFriction(loss_tangent=1e-4, external=2.0),
)
SIZE = np.array([0.30, 0.22, 0.003])


class Plain:
    """Radiation that hears all modes alike."""

    name = "plain"
    calibrated = False
    references = ()

    def coefficients(
        self, surface: object, shapes: object, frequencies: Array, centre: object
    ) -> NDArray[np.complex128]:
        del surface, shapes, centre
        return np.ones(len(frequencies), np.complex128)


def given(mesh: Mesh, frequencies: ArrayLike, heights: ArrayLike) -> ModalModel:
    """Return a body whose modes move along z by heights (V, M) at its vertices."""
    shapes = np.zeros((len(mesh.points), 3, np.shape(heights)[1]))
    shapes[:, 2] = heights
    return model_of_modes(
        mesh.points,
        mesh.faces,
        frequencies,
        shapes,
        material=STEEL,
        mass=1.0,
        centre=mesh.bounds.mean(axis=0),
        inertia=np.eye(3),
        radiation=Plain(),
    )


LEFT, RIGHT = (0.02, 0.05, 0.002), (0.18, 0.05, 0.002)


def chord(frequencies: ArrayLike, left: ArrayLike, right: ArrayLike) -> ModalModel:
    """Return a plate whose modes all have heights `left` around LEFT and `right` around RIGHT."""
    mesh = slab(*rectangle(0.2, 0.1, 0.05), 0.004)
    share = np.clip(mesh.points[:, :1] / 0.1 - 0.5, 0, 1)
    return given(mesh, frequencies, (1 - share) * np.asarray(left) + share * np.asarray(right))


def hinged_bar(modes: int, *, cells: int = 200) -> ModalModel:
    """Return a bar 0.5 m long that sounds as a string does: sines, harmonics of 200 Hz."""
    mesh = slab(*rectangle(0.5, 0.01, 0.5 / cells), 0.005)
    numbers = np.arange(1, modes + 1)
    heights = np.sin(np.pi * mesh.points[:, :1] / 0.5 * numbers)
    return given(mesh, 200.0 * numbers, heights)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClampedForms:
    """Ritz's sums of (1 - s^2)^2 times Legendre polynomials along both sides."""

    amounts: Array
    dimensions: int = 2

    def values(self, places: Array) -> Array:
        sides = 2 * np.asarray(places) / SIZE[:2] - 1
        along, across = (_clamped_beam(np.clip(side, -1, 1)) for side in sides.T)
        terms = np.einsum("ip,ijm->pjm", along, self.amounts, optimize=True)
        return 2 * np.einsum("jp,pjm->pm", across, terms, optimize=True)

    def chosen(self, modes: NDArray[np.int64]) -> ClampedForms:
        return replace(self, amounts=self.amounts[:, :, modes])


TERMS = 24


@cache
def _beam_terms() -> tuple[list[Legendre], Array]:
    """Return the polynomials, and what makes them orthonormal over -1 to 1."""
    edge = Legendre.fromroots([-1, -1, 1, 1])
    terms = [edge * Legendre.basis(degree) for degree in range(TERMS)]
    nodes, weights = np.polynomial.legendre.leggauss(80)
    values = np.array([term(nodes) for term in terms])
    return terms, np.linalg.inv(np.linalg.cholesky((values * weights) @ values.T))


def _clamped_beam(places: Array, derivative: int = 0) -> Array:
    terms, mix = _beam_terms()
    return mix @ np.array([(t.deriv(derivative) if derivative else t)(places) for t in terms])


def clamped_plate(highest: float, *, spacing: float = 0.03) -> ModalModel:
    """Return a steel plate clamped all around, 0.30 m by 0.22 m, 3 mm thick."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    slopes, bends = (_clamped_beam(nodes, order) for order in (1, 2))
    first, second = ((each * weights) @ each.T for each in (slopes, bends))
    half, one = SIZE[:2] / 2, np.eye(TERMS)
    stiffness = np.kron(second, one) / half[0] ** 4 + np.kron(one, second) / half[1] ** 4
    stiffness += 2 * np.kron(first, first) / np.prod(half) ** 2
    squares, vectors = eigh(stiffness)
    rigidity = STEEL.youngs_modulus * SIZE[2] ** 3 / 12 / (1 - STEEL.poisson_ratio**2)
    frequencies = np.sqrt(squares * rigidity / (STEEL.density * SIZE[2])) / (2 * np.pi)
    kept = np.flatnonzero(frequencies < highest)
    mesh = slab(*rectangle(*SIZE[:2], spacing), SIZE[2])
    mass = STEEL.density * float(np.prod(SIZE))
    forms = ClampedForms(amounts=vectors[:, kept].reshape(TERMS, TERMS, -1))
    formula = TransverseShapes.of(forms, len(kept), mass)
    unknown = np.full(len(kept), np.nan)
    modes = Modes(
        frequencies=frequencies[kept],
        surface=mesh,
        shapes=formula.displacements(mesh.points),
        formula=formula,
        mass=mass,
        centre=np.array([*SIZE[:2] / 2, 0.0]),
        inertia=np.eye(3),
        complete_to=highest,
        poisson_slopes=unknown,
        errors=unknown,
        supported=True,
    )
    return ModalModel.of(modes, STEEL, radiation=by_name("power"))


def random_contacts(mesh: Mesh, count: int, seed: int) -> tuple[Array, Array]:
    """Return points (K, 3) anywhere on a surface and the pushes straight into it."""
    random = np.random.default_rng(seed)
    faces = random.choice(len(mesh.faces), count, p=mesh.areas / mesh.areas.sum())
    shares = random.dirichlet([1, 1, 1], count)
    points = np.einsum("kc,kcd->kd", shares, mesh.points[mesh.faces[faces]])
    return points, -mesh.face_normals[faces]
