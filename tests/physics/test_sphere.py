"""Free spheres, solid and hollow, stuffed from triangle surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from tests.physics import reference, spheres
from tests.physics.bodies import ALUMINIUM, ball

Array = NDArray[np.float64]
RADIUS = 0.05
# omega = 1 in units of c_s / R, as a frequency in Hz.
UNIT = np.sqrt(ALUMINIUM.shear_modulus / ALUMINIUM.density) / RADIUS / (2 * np.pi)
NU = ALUMINIUM.poisson_ratio
TORSIONAL = reference.TORSIONAL[2][0]


def frequencies(accuracy: str, highest: float, *, subdivisions: int, wall: float | None) -> Array:
    """Return the frequencies up to `highest`, all in units of c_s / R."""
    body = FilledBody(mesh=ball(RADIUS, subdivisions), wall=wall)
    mesh = fill_body(body, accuracy).mesh
    return vibration_modes(mesh, ALUMINIUM, highest * UNIT).frequencies / UNIT


def exact(highest: float, bore: float = 0.0) -> Array:
    """Return all exact frequencies up to `highest`, each as often as it occurs."""
    found = [] if bore else [reference.BREATHING[NU]]
    for n in range(1, 11):
        roots = spheres.torsional(n, highest, bore=bore)
        roots += spheres.spheroidal(n, NU, highest, bore=bore)
        found += (2 * n + 1) * roots
    return np.sort([root for root in found if root < highest])


@pytest.mark.parametrize("n", reference.TORSIONAL)
def test_exact_torsional_roots_are_the_published_ones(n: int) -> None:
    assert spheres.torsional(n, 11.0)[:2] == pytest.approx(reference.TORSIONAL[n], rel=1e-10)


@pytest.mark.parametrize("nu", reference.SPHEROIDAL)
def test_exact_spheroidal_roots_are_the_published_ones(nu: float) -> None:
    for n, published in reference.SPHEROIDAL[nu].items():
        assert spheres.spheroidal(n, nu, 8.5)[:2] == pytest.approx(published, rel=1e-10)


def test_exact_roots_of_a_hollow_sphere_approach_those_of_a_solid_one() -> None:
    for n, published in reference.SPHEROIDAL[0.25].items():
        root = spheres.spheroidal(n, 0.25, 5.2, bore=0.001)[0]
        assert root == pytest.approx(published[0], rel=1e-7)


@pytest.mark.parametrize("wall", reference.HOLLOW_SPHERE)
def test_exact_bending_of_a_hollow_sphere_is_what_was_computed_before(wall: float) -> None:
    root = spheres.spheroidal(2, NU, 2.0, bore=1 - wall / RADIUS)[0]
    assert root * UNIT == pytest.approx(reference.HOLLOW_SPHERE[wall], rel=1e-7)


def test_solid_sphere_at_preview_is_as_good_as_promised_at_standard() -> None:
    found = frequencies("preview", 2.7, subdivisions=5, wall=None)
    assert found == pytest.approx(exact(2.7), rel=2e-4)


@pytest.mark.prove
@pytest.mark.parametrize("subdivisions", [5, 6])
def test_solid_sphere_at_standard(subdivisions: int) -> None:
    found = frequencies("standard", 4.5, subdivisions=subdivisions, wall=None)
    assert found[:5] == pytest.approx([TORSIONAL] * 5, rel=2e-4)
    assert found == pytest.approx(exact(4.5), rel=2e-4)


@pytest.mark.prove
@pytest.mark.parametrize("subdivisions", [5, 6])
def test_solid_sphere_at_fine(subdivisions: int) -> None:
    found = frequencies("fine", 2.7, subdivisions=subdivisions, wall=None)
    assert found[:5] == pytest.approx([TORSIONAL] * 5, rel=1e-4)
    assert found[5:] == pytest.approx([reference.SPHEROIDAL[NU][2][0]] * 5, rel=1e-4)


def check_hollow_sphere(accuracy: str, subdivisions: int, wall: float, within: float) -> None:
    bending = reference.HOLLOW_SPHERE[wall] / UNIT
    found = frequencies(accuracy, 1.03 * bending, subdivisions=subdivisions, wall=wall)
    assert found == pytest.approx([bending] * 5, rel=within)


WALLS = [(0.008, 0.0005), (0.002, 0.005)]


@pytest.mark.prove
def test_thin_hollow_sphere_at_preview_is_as_good_as_promised_at_standard() -> None:
    check_hollow_sphere("preview", 5, *WALLS[1])


@pytest.mark.prove
@pytest.mark.parametrize(("wall", "within"), WALLS)
def test_hollow_sphere_of_few_triangles_at_standard(wall: float, within: float) -> None:
    check_hollow_sphere("standard", 5, wall, within)


@pytest.mark.prove
@pytest.mark.parametrize("accuracy", ["standard", "fine"])
@pytest.mark.parametrize(("wall", "within"), WALLS)
def test_hollow_sphere(wall: float, within: float, accuracy: str) -> None:
    check_hollow_sphere(accuracy, 6, wall, within)


@pytest.mark.prove
def test_many_modes_of_a_hollow_sphere_at_standard() -> None:
    """As many nodes as the errors of a coarser mesh ask for: `filled` alone only begins."""
    model = struck.analyze(
        ball(RADIUS, 6), ALUMINIUM, wall=0.002, band=(0.0, 2.4 * UNIT), cache=False
    )
    expected = exact(2.4, 1 - 0.002 / RADIUS) * UNIT
    assert model.natural_frequencies == pytest.approx(expected, rel=0.005)
    assert (np.abs(model.natural_frequencies / expected - 1) <= model.errors).all()
