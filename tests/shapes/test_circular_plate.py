"""Circular plates: bad input, forms, and what thin-plate theory leaves out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Material
from struck.errors import OptionError
from struck.shapes import RectangularPlate
from struck.shapes.circular_membrane import RoundForms
from struck.shapes.circular_plate import EDGES, CircularPlate
from tests.shapes.test_membranes import closed, disk_rule, from_identity
from tests.yardstick import transforms

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
edges = pytest.mark.parametrize("edge", EDGES)


def plate(edge: str, thickness: float = 0.001) -> CircularPlate:
    return CircularPlate(radius=0.2, thickness=thickness, edge=edge)


@edges
def test_forms_are_orthonormal(edge: str) -> None:
    vibration = plate(edge).vibration(STEEL, 9500.0)
    assert len(vibration.frequencies) > 350
    places, weights = disk_rule(0.2, 0.0, 60, 100)
    assert from_identity(vibration.forms, places, weights) < 1e-11


def test_free_plate_moves_against_itself() -> None:
    """No mode has momentum or spin: what moves as a rigid body is left out, and only that."""
    vibration = plate("free").vibration(STEEL, 9500.0)
    places, weights = disk_rule(0.2, 0.0, 60, 100)
    rigid = np.column_stack([np.ones(len(places)), places / 0.1])
    held = (vibration.forms.values(places) * weights[:, None]).T @ rigid
    assert np.abs(held).max() < 1e-12
    assert vibration.frequencies[0] > 30


@edges
def test_edge_is_as_held_as_it_says(edge: str) -> None:
    body = plate(edge)
    forms = body.vibration(STEEL, 5000.0).forms
    angles = np.linspace(0, 2 * np.pi, 50)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    step = 1e-5
    rim, inside = forms.values(0.2 * around), forms.values((0.2 - 0.2 * step) * around)
    assert body.supported == (edge != "free")
    assert (np.abs(rim).max(axis=0) < 1e-11).all() == body.supported
    slope = np.abs(rim - inside).max(axis=0) / step
    assert (slope < 0.1).all() == (edge == "clamped")


@edges
def test_values_are_the_same_for_one_place_and_many(edge: str) -> None:
    forms = plate(edge).vibration(STEEL, 9500.0).forms
    places = np.random.default_rng(1).uniform(-0.15, 0.15, (800, 2))
    one_by_one = np.vstack([forms.values(place[None]) for place in places[:40]])
    np.testing.assert_allclose(forms.values(places)[:40], one_by_one, rtol=0, atol=1e-12)
    order = np.array([7, 7, 0])
    assert forms.chosen(order).values(places) == pytest.approx(
        forms.values(places)[:, order], abs=1e-12
    )


@pytest.mark.prove
@pytest.mark.parametrize("edge", EDGES)
def test_forms_of_very_high_order_are_stable(edge: str) -> None:
    thin = CircularPlate(radius=1.0, thickness=0.0005, edge=edge)
    forms = thin.vibration(STEEL, 9000.0).forms
    assert isinstance(forms, RoundForms)
    high = forms.chosen(np.flatnonzero(forms.orders > 200)[:20])
    assert len(high.orders) == 20
    places, weights = disk_rule(1.0, 0.0, 160, 2 * int(high.orders.max()) + 4)
    values = high.values(places)
    assert weights @ values**2 == pytest.approx(1.0, abs=1e-10)
    assert np.abs(high.values(np.zeros((1, 2)))).max() == 0


@edges
def test_modes_go_with_stiffness(edge: str) -> None:
    body = plate(edge)
    modes = body.modes(STEEL, (20.0, 4000.0))
    assert not body.tensioned
    assert modes.mass == pytest.approx(np.pi * 0.2**2 * 0.001 * 7850.0)
    thicker = plate(edge, 0.002).vibration(STEEL, 8000.0)
    assert thicker.frequencies == pytest.approx(2 * modes.frequencies, rel=1e-12)
    assert (np.diff(modes.frequencies) >= 0).all()
    assert closed(body.skin(0.03))


@edges
def test_thick_plate_is_warned_of(edge: str) -> None:
    thick = plate(edge, 0.03).vibration(STEEL, 20_000.0)
    said = str(thick.details["caution"])
    assert "thickness is 0.15 of the radius or half side, above 0.1" in said
    assert "overstates the lowest frequency by about" in said
    assert "caution" not in plate(edge).vibration(STEEL, 5000.0).details


@pytest.mark.parametrize(
    "body",
    [
        CircularPlate(radius=0.1, thickness=0.03),
        RectangularPlate(length=0.12, width=0.1, thickness=0.02),
    ],
)
def test_errors_of_thick_plates_are_those_against_elements(
    body: CircularPlate | RectangularPlate,
) -> None:
    thin = struck.analyze(body, "steel", recoil=False)
    solid = struck.analyze(body, "steel", method="fem", accuracy="preview", recoil=False)
    off = thin.frequencies[:3] / solid.frequencies[:3] - 1
    assert thin.errors is not None
    assert (off / thin.errors[:3]).tolist() == pytest.approx([1, 1, 1], abs=0.6)


def test_what_shear_takes_away_is_about_what_it_takes_in_mindlins_plate() -> None:
    """Mindlin 1951: (k^2 - w^2 rho / (kappa G)) (D k^2 - rho h^3 w^2 / 12) = rho h w^2."""
    thickness, nu = 0.02, STEEL.poisson_ratio
    body = CircularPlate(radius=0.2, thickness=thickness, edge="clamped")
    vibration = body.vibration(STEEL, 9000.0)
    overstated = [
        vibration.details[f"{end} frequency overstated by"] for end in ("lowest", "highest")
    ]
    stiffness = STEEL.youngs_modulus * thickness**3 / 12 / (1 - nu**2)
    shear, inertia = 5 / 6 * STEEL.shear_modulus, STEEL.density
    for share, kirchhoff in zip(
        overstated, 2 * np.pi * vibration.frequencies[[0, -1]], strict=True
    ):
        k2 = kirchhoff * np.sqrt(inertia * thickness / stiffness)
        turning = inertia * thickness**3 / 12
        a = inertia / shear * turning
        b = k2 * (turning + stiffness * inertia / shear) + inertia * thickness
        squared = (b - np.sqrt(b**2 - 4 * a * stiffness * k2**2)) / (2 * a)
        assert kirchhoff / np.sqrt(squared) - 1 == pytest.approx(share, rel=0.1)


def test_bad_plates_are_refused() -> None:
    with pytest.raises(OptionError, match=r"radius of the plate is -0\.1 m: it must exceed 0"):
        CircularPlate(radius=-0.1, thickness=0.001)
    with pytest.raises(OptionError, match="thickness of the plate is nan m"):
        CircularPlate(radius=0.1, thickness=np.nan)
    with pytest.raises(OptionError, match="edge of the plate is 'hinged': give one of free, supp"):
        CircularPlate(radius=0.1, thickness=0.001, edge="hinged")


@edges
def test_bands_without_modes_and_with_too_many_are_refused(edge: str) -> None:
    body = plate(edge)
    lowest = body.vibration(STEEL, 1000.0).frequencies[0]
    assert body.vibration(STEEL, 0.99 * lowest).frequencies.shape == (0,)
    with pytest.raises(OptionError, match=f"lowest mode is at {lowest:.4g} Hz"):
        body.modes(STEEL, (20.0, 0.99 * lowest))
    with pytest.raises(OptionError, match=r"modes up to 1e7 Hz: at most 100000"):
        body.vibration(STEEL, 1e7)


@edges
def test_four_hundred_modes_are_quick(edge: str) -> None:
    """Usually 10 to 110 transforms for the frequencies, and for the forms at 5,000 places."""
    places = np.random.default_rng(3).uniform(-0.15, 0.15, (5000, 2))
    vibration = plate(edge).vibration(STEEL, 11_000.0)
    assert len(vibration.frequencies) >= 400
    assert transforms(lambda: plate(edge).vibration(STEEL, 11_000.0)) < 500
    assert transforms(lambda: vibration.forms.values(places)) < 500
