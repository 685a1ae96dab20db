"""Rectangular plates against printed values, Levy's equation and Morley's elements."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh
from skfem.helpers import dd, ddot, eye, trace

from struck.model.material import Material
from struck.shapes import RectangularPlate
from tests.physics import reference

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.3)
LENGTH, WIDTH, THICKNESS = 0.3, 0.2, 0.002
Edges = str | tuple[str, str, str, str]


def parameters(edges: Edges, highest: float, *, width: float = WIDTH) -> tuple[Array, Array]:
    """Return (2 pi f)^2 density thickness / D, 1/m^4, with the stated errors of f."""
    plate = RectangularPlate(length=LENGTH, width=width, thickness=THICKNESS, edges=edges)
    vibration = plate.vibration(STEEL, highest)
    stiffness = STEEL.youngs_modulus * THICKNESS**3 / (12 * (1 - STEEL.poisson_ratio**2))
    rates = 2 * np.pi * vibration.frequencies
    return np.square(rates) * STEEL.density * THICKNESS / stiffness, vibration.errors


@pytest.mark.parametrize(
    ("edges", "values", "within"),
    [
        ("free", reference.SQUARE_PLATE, 1e-5),  # converged Ritz, reference values
        ("supported", (2 * np.pi**2, 5 * np.pi**2, 5 * np.pi**2, 8 * np.pi**2), 1e-10),
        ("clamped", (35.98519, 73.39385, 73.39385, 108.2165), 1e-6),  # Leissa 1973, converged
    ],
)
def test_square_plates(edges: str, values: tuple[float, ...], within: float) -> None:
    found, _ = parameters(edges, 2000.0, width=LENGTH)
    squared = np.sqrt(found[: len(values)]) * LENGTH**2
    np.testing.assert_allclose(squared, values, rtol=within)


def test_nafems_fv12() -> None:
    plate = RectangularPlate(length=10.0, width=10.0, thickness=0.05)
    material = Material(density=8000.0, youngs_modulus=2e11, poisson_ratio=0.3)
    found = plate.vibration(material, 8.0).frequencies
    distinct = found[[0, 1, 2, 3, 4, 5]]
    np.testing.assert_allclose(distinct, reference.FV12_KIRCHHOFF, rtol=2e-3)


def test_a_cantilever_plate() -> None:
    """Leissa 1973, CFFF: 3.4917, 8.5246, 21.429, 27.331 are upper bounds, within 0.7 %."""
    found, errors = parameters(("clamped", "free", "free", "free"), 500.0, width=LENGTH)
    squared = np.sqrt(found[:4]) * LENGTH**2
    printed = np.array([3.4917, 8.5246, 21.429, 27.331])
    assert np.all(squared < printed)
    np.testing.assert_allclose(squared, printed, rtol=0.007)
    assert errors.max() < 5e-5


def levy(found: float, half_waves: int, ends: tuple[str, str], nu: float) -> float:
    """Return Levy's determinant for w(x) sin(m pi y / width), scaled to be of order one."""
    across, wave = half_waves * np.pi / WIDTH, math.sqrt(found)  # k^2
    roots = np.array([across**2 + wave, across**2 - wave])  # squares of r in exp(r x)
    powers = np.sqrt(roots.astype(complex))
    powers = np.concatenate([powers, -powers])
    conditions = {
        "supported": (np.ones(4), powers**2 - nu * across**2),
        "clamped": (np.ones(4), powers),
        "free": (powers**2 - nu * across**2, powers * (powers**2 - (2 - nu) * across**2)),
    }
    rows = []
    for end, place in zip(ends, (0.0, LENGTH), strict=True):
        growth = np.exp(powers * place - np.maximum(powers.real, 0) * LENGTH)
        rows += [condition * growth for condition in conditions[end]]
    matrix = np.array(rows)
    matrix /= np.linalg.norm(matrix, axis=0)
    determinant = np.linalg.det(matrix / np.linalg.norm(matrix, axis=1)[:, None])
    # With two imaginary powers the determinant is imaginary: exchange them and it is conjugate.
    return float(determinant.imag if roots[1] < 0 else determinant.real)


@pytest.mark.parametrize(
    "ends", list(itertools.combinations_with_replacement(("free", "supported", "clamped"), 2))
)
def test_levys_equation_holds(ends: tuple[str, str]) -> None:
    """Each mode of a plate with y edges supported is a zero of one of Levy's determinants."""
    found, errors = parameters((*ends, "supported", "supported"), 4000.0)
    assert len(found) > 15
    margins = 1e-9 + 2 * errors  # of k^4, twice that of f, and rounding
    for value, margin in zip(found, margins, strict=True):
        crossed = [
            levy(value * (1 - margin), m, ends, 0.3) * levy(value * (1 + margin), m, ends, 0.3) < 0
            for m in range(1, 12)
        ]
        assert any(crossed), f"no determinant vanishes at {value}"


def morley(edges: Edges, cells: int, count: int) -> Array:
    """Return k^4 of the lowest modes by Morley's elements, which share nothing with Ritz."""
    mesh = skfem.MeshTri.init_tensor(
        np.linspace(0, LENGTH, 3 * cells + 1), np.linspace(0, WIDTH, 2 * cells + 1)
    )
    basis = skfem.Basis(mesh, skfem.ElementTriMorley())

    @skfem.BilinearForm
    def stiffness(u, v, _):  # noqa: ANN001, ANN202  as scikit-fem wants it
        nu = STEEL.poisson_ratio
        return ddot((1 - nu) * dd(u) + nu * eye(trace(dd(u)), 2), dd(v))

    @skfem.BilinearForm
    def mass(u, v, _):  # noqa: ANN001, ANN202  as scikit-fem wants it
        return u * v

    sides = (
        lambda x: x[0] < 1e-9,
        lambda x: x[0] > LENGTH - 1e-9,
        lambda x: x[1] < 1e-9,
        lambda x: x[1] > WIDTH - 1e-9,
    )
    around = (edges,) * 4 if isinstance(edges, str) else edges
    held = [np.zeros(0, int)]
    for side, edge in zip(sides, around, strict=True):
        dofs = basis.get_dofs(mesh.facets_satisfying(side))
        held += {"free": [], "supported": [dofs.all("u")], "clamped": [dofs.all()]}[edge]
    free = basis.complement_dofs(np.unique(np.concatenate(held)))
    k, m = (form.assemble(basis)[free][:, free] for form in (stiffness, mass))
    values = eigsh(k, count + 3, M=m, sigma=-1.0, return_eigenvectors=False)
    return np.sort(values)


@pytest.mark.prove
@pytest.mark.parametrize(
    "edges",
    [
        ("clamped", "free", "supported", "free"),
        pytest.param(("clamped", "supported", "free", "clamped"), marks=pytest.mark.prove),
        pytest.param(("supported", "free", "clamped", "clamped"), marks=pytest.mark.prove),
    ],
)
def test_mixed_edges_against_morleys_elements(edges: tuple[str, str, str, str]) -> None:
    count = 6
    coarse, fine = (morley(edges, cells, count)[:count] for cells in (10, 20))
    limit = fine + (fine - coarse) / 3  # second order
    found, _ = parameters(edges, 3000.0)
    np.testing.assert_allclose(np.sqrt(found[:count]), np.sqrt(limit), rtol=3e-3)


@pytest.mark.parametrize(("step", "within"), [(1e-4, 1e-4)])
def test_slopes_follow_poissons_ratio(step: float, within: float) -> None:
    plate = RectangularPlate(length=LENGTH, width=WIDTH, thickness=THICKNESS)

    def frequencies(nu: float) -> Array:
        material = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=nu)
        return plate.vibration(material, 2500.0).frequencies[:12]

    slopes = plate.vibration(STEEL, 2500.0).poisson_slopes[:12]
    difference = np.log(frequencies(0.3 + step) / frequencies(0.3 - step)) / (2 * step)
    np.testing.assert_allclose(slopes, difference, atol=within)
