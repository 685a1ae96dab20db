"""Membranes: bad input, forms, surfaces, places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray

from struck import Material
from struck.errors import OptionError
from struck.model.gains import Forms
from struck.model.mesh import Mesh
from struck.shapes.circular_membrane import AnnularMembrane, CircularMembrane, RoundForms
from struck.shapes.rectangular_membrane import RectangularMembrane
from struck.shapes.shape import Shape
from tests.samples import sampled
from tests.yardstick import transforms

Array = NDArray[np.float64]
MYLAR = Material(density=1390.0, youngs_modulus=3.5e9, poisson_ratio=0.38)
THIN = {"thickness": 0.0002, "tension": 3000.0}
DRUM = CircularMembrane(radius=0.16, **THIN)
SHEET = RectangularMembrane(length=0.4, width=0.3, **THIN)
RING = AnnularMembrane(radius=0.2, hole=0.06, **THIN)
BODIES: list[Shape] = [DRUM, SHEET, RING]
names = pytest.mark.parametrize("body", BODIES, ids=lambda body: type(body).__name__)


def disk_rule(radius: float, hole: float, count: int, around: int) -> tuple[Array, Array]:
    """Return places and weights whose weighted sums are means over a disk or ring."""
    t, weights = legendre.leggauss(count)
    u = (t + 1) / 2
    # Closer near a hole, where Y_m is steep.
    r = hole + (radius - hole) * (u**3 if hole else u)
    weights = weights * r * (3 * u**2 if hole else 1)
    angles = 2 * np.pi * np.arange(around) / around
    x, y = np.multiply.outer([np.cos(angles), np.sin(angles)], r)
    places = np.column_stack([x.ravel(), y.ravel()])
    every = np.tile(weights, around)
    return places, every / every.sum()


def sheet_rule(length: float, width: float, count: int) -> tuple[Array, Array]:
    t, weights = legendre.leggauss(count)
    x, y = np.meshgrid(length * (t + 1) / 2, width * (t + 1) / 2)
    every = np.outer(weights, weights).ravel() / 4
    return np.column_stack([x.ravel(), y.ravel()]), every


RULES: dict[type, Callable[[], tuple[Array, Array]]] = {
    CircularMembrane: lambda: disk_rule(0.16, 0.0, 50, 100),
    AnnularMembrane: lambda: disk_rule(0.2, 0.06, 60, 120),
    RectangularMembrane: lambda: sheet_rule(0.4, 0.3, 70),
}


def from_identity(forms: Forms, places: Array, weights: Array) -> float:
    """Return how far the means of products of two forms are from 1 and 0, at most."""
    values = forms.values(places)
    gram = (values * weights[:, None]).T @ values
    return float(np.abs(gram - np.eye(len(gram))).max())


@names
def test_forms_are_orthonormal(body: Shape) -> None:
    vibration = body.vibration(MYLAR, 4000.0)
    places, weights = RULES[type(body)]()
    assert len(vibration.frequencies) > 350
    assert from_identity(vibration.forms, places, weights) < 1e-11


@pytest.mark.parametrize("hole", sampled([1e-6, 0.001, 0.9, 0.99], 0.001, 0.99))
def test_forms_of_extreme_rings_are_orthonormal(hole: float) -> None:
    ring = AnnularMembrane(radius=1.0, hole=hole, **THIN)
    speed = np.sqrt(3000.0 / (1390.0 * 0.0002))
    vibration = ring.vibration(MYLAR, speed * 1.02 / (2 * (1 - hole)) * (8 if hole < 0.5 else 1))
    around = 2 * int(vibration.forms.orders.max()) + 4
    places, weights = disk_rule(1.0, hole, 100, around)
    assert from_identity(vibration.forms, places, weights) < 1e-9


@names
def test_many_places_give_what_one_gives(body: Shape) -> None:
    forms = body.vibration(MYLAR, 5000.0).forms
    rng = np.random.default_rng(1)
    places = rng.uniform(-0.2, 0.4, (1000, 2))
    one_by_one = np.vstack([forms.values(place[None]) for place in places[:50]])
    np.testing.assert_allclose(forms.values(places)[:50], one_by_one, rtol=0, atol=1e-12)


@names
def test_forms_are_finite_and_vanish_on_the_edge_and_beyond(body: Shape) -> None:
    forms = body.vibration(MYLAR, 5000.0).forms
    rim = body.skin(0.02).points
    outside = rim[:, :2] * 1.02
    held = np.abs(forms.values(rim[:, :2])).max(axis=1) < 1e-10
    assert held.any()
    assert not held.all()
    values = forms.values(outside)
    assert np.isfinite(values).all()
    if not isinstance(body, RectangularMembrane):
        edge = np.hypot(*rim[:, :2].T) > 0.999 * body.extent / 2
        assert np.abs(values[edge]).max() < 1e-10


@names
def test_chosen_forms_are_those_asked_for(body: Shape) -> None:
    forms = body.vibration(MYLAR, 3000.0).forms
    places = np.random.default_rng(2).uniform(-0.2, 0.4, (300, 2))
    order = np.array([5, 0, 5, 17, 3])
    assert forms.chosen(order).values(places) == pytest.approx(
        forms.values(places)[:, order], abs=1e-12
    )
    assert forms.dimensions == 2
    assert forms.chosen(order[:0]).values(places).shape == (300, 0)


@pytest.mark.prove
def test_forms_of_very_high_order_are_stable() -> None:
    forms = DRUM.vibration(MYLAR, 30_000.0).forms
    assert isinstance(forms, RoundForms)
    high = forms.chosen(np.flatnonzero(forms.orders > 230)[:20])
    places, weights = disk_rule(0.16, 0.0, 130, 2 * int(high.orders.max()) + 4)
    values = high.values(places)
    assert weights @ values**2 == pytest.approx(1.0, abs=1e-11)
    assert np.abs(high.values(np.zeros((1, 2)))).max() == 0


@names
def test_membranes_hang_on_tension_alone(body: Shape) -> None:
    vibration = body.vibration(MYLAR, 3000.0)
    assert body.supported
    assert body.tensioned
    assert not vibration.poisson_slopes.any()
    assert (np.diff(vibration.frequencies) >= 0).all()
    assert vibration.frequencies[-1] <= 3000.0
    assert (vibration.errors < 1e-12).all()
    stiffer = Material(density=1390.0, youngs_modulus=7e9, poisson_ratio=0.1)
    assert (body.vibration(stiffer, 3000.0).frequencies == vibration.frequencies).all()


@names
def test_modes_are_mass_normalised(body: Shape) -> None:
    modes = body.modes(MYLAR, (20.0, 2000.0))
    places, weights = RULES[type(body)]()
    shapes = modes.formula.displacements(np.column_stack([places, np.zeros(len(places))]))
    assert modes.mass == pytest.approx(body.volume * 1390.0)
    assert (weights @ shapes[:, 2] ** 2) * modes.mass == pytest.approx(1.0, abs=1e-10)
    assert modes.complete_to == 2000.0


def closed(mesh: Mesh) -> bool:
    """Tell whether each edge has two faces that pass it in opposite senses."""
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    once = len(np.unique(edges, axis=0)) == len(edges)
    return once and set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1]))


@pytest.mark.parametrize("spacing", [0.3, 0.05, 0.011])
@names
def test_skin_is_closed_and_of_about_the_volume(body: Shape, spacing: float) -> None:
    mesh = body.skin(spacing)
    assert closed(mesh)
    assert (mesh.areas > 0).all()
    assert mesh.volume == pytest.approx(body.volume, rel=0.06 if spacing > 0.1 else 0.02)
    top = mesh.face_normals[mesh.centroids[:, 2] > 0.4 * THIN["thickness"]]
    assert (top[:, 2] > 0.999).all()


@pytest.mark.parametrize("hole", [1e-5, 0.01, 0.5, 0.99, 0.9999])
def test_skin_of_any_ring_is_closed(hole: float) -> None:
    ring = AnnularMembrane(radius=1.0, hole=hole, thickness=1e-5, tension=1.0)
    mesh = ring.skin(0.1)
    assert closed(mesh)
    top = mesh.centroids[:, 2] > 0.4e-5
    assert (mesh.area_vectors[top, 2] > 0).all()
    genus_of_a_ring = len(mesh.points) - len(mesh.faces) / 2
    assert genus_of_a_ring == 0


@names
def test_places_lie_on_the_top(body: Shape) -> None:
    assert {"top", "middle", "quarter", "edge"} <= set(body.places)
    values = np.abs(body.vibration(MYLAR, 1000.0).forms.values(np.array([*body.places.values()])))
    assert (values.max(axis=1) > 0).all()
    for place in body.places.values():
        assert place.shape == (3,)
        assert place[2] == 0.0001
        assert not place.flags.writeable
    with pytest.raises(TypeError):
        body.places["top"] = np.zeros(3)  # type: ignore[index]


@pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
@pytest.mark.parametrize("name", ["radius", "hole", "thickness", "tension"])
def test_lengths_and_tension_must_be_positive(name: str, value: float) -> None:
    right = {"radius": 0.2, "hole": 0.05, **THIN}
    with pytest.raises(OptionError, match=f"{name} of the membrane is {value} .*exceed 0"):
        AnnularMembrane(**right | {name: value})
    if name != "hole":
        del right["hole"]
        with pytest.raises(OptionError, match=f"{name} of the membrane is {value} .*exceed 0"):
            CircularMembrane(**right | {name: value})


@pytest.mark.parametrize("name", ["length", "width", "thickness", "tension"])
def test_sides_of_a_rectangle_must_be_positive(name: str) -> None:
    right = {"length": 0.4, "width": 0.3, **THIN}
    with pytest.raises(OptionError, match=f"{name} of the membrane is -1.*exceed 0"):
        RectangularMembrane(**right | {name: -1.0})


def test_hole_must_leave_a_ring() -> None:
    with pytest.raises(OptionError, match=r"radius of 0\.2 m: it must lie below .*0\.2 m"):
        AnnularMembrane(radius=0.2, hole=0.2, **THIN)


@names
def test_band_below_the_first_mode_is_refused_with_its_frequency(body: Shape) -> None:
    lowest = body.vibration(MYLAR, 1000.0).frequencies[0]
    assert body.vibration(MYLAR, 0.99 * lowest).frequencies.shape == (0,)
    with pytest.raises(OptionError, match=f"lowest mode is at {lowest:.4g} Hz"):
        body.modes(MYLAR, (20.0, 0.99 * lowest))


@pytest.mark.prove
@names
def test_mode_at_the_very_end_of_a_band_is_in_it(body: Shape) -> None:
    """Whatever rounding does, a band never fails for ending on a mode."""
    frequencies = body.vibration(MYLAR, 2000.0).frequencies
    for last in frequencies[:40]:
        found = body.vibration(MYLAR, last).frequencies
        assert abs(len(found) - np.searchsorted(frequencies, last, side="right")) <= 2


@names
def test_too_many_modes_are_refused(body: Shape) -> None:
    with pytest.raises(OptionError, match=r"modes up to 1e6 Hz: at most 100000"):
        body.vibration(MYLAR, 1e6)


@pytest.mark.prove
@names
def test_four_hundred_modes_are_quick(body: Shape) -> None:
    """Usually 10 to 110 transforms for the frequencies, and for the forms at 5,000 places."""
    places = np.random.default_rng(3).uniform(-0.1, 0.3, (5000, 2))
    vibration = body.vibration(MYLAR, 6500.0)
    assert len(vibration.frequencies) >= 400
    assert transforms(lambda: body.vibration(MYLAR, 6500.0)) < 500
    assert transforms(lambda: vibration.forms.values(places)) < 500
