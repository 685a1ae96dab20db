"""Polygon membranes: bad input, forms, places, and the parts that find their modes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.special import gammaln, j0, jv, y0
from skfem import Basis, BilinearForm, ElementTriCR, ElementTriP2, MeshTri
from skfem.helpers import dot, grad

from struck import Material
from struck.errors import OptionError, SolverError
from struck.shapes import PolygonMembrane
from struck.shapes.bessel_series import (
    pair,
    series,
    series_slope,
    tabulate_irregular,
    tabulate_regular,
)
from struck.shapes.particular_solutions import Eigenfunction, PolygonForms
from struck.shapes.polygon import Triangulation, area_nodes, place_sources, plan_of
from struck.shapes.polygon_membrane import _merge_groups, _prove_complete
from struck.shapes.shape import Vibration
from tests.shapes.test_membranes import closed

Array = NDArray[np.float64]
MYLAR = Material(density=1390.0, youngs_modulus=4.5e9, poisson_ratio=0.38)
THIN = {"thickness": 0.0002, "tension": 3000.0}
L_SHAPE = PolygonMembrane.l_shape(side=0.2, **THIN)
# Long and nhook: Fourier-Bessel functions about its corners alone do not suffice.
HOOK = PolygonMembrane(
    corners=((0, 0), (0.8, 0), (0.7, 0.15), (0.15, 0.15), (0.15, 0.5), (0, 0.5)), **THIN
)
SPIRAL = np.array(
    [
        (0, 0),
        (5, 0),
        (5, 5),
        (1, 5),
        (1, 2),
        (3, 2),
        (3, 3),
        (2, 3),
        (2, 4),
        (4, 4),
        (4, 1),
        (0, 1),
    ],
    float,
)


@pytest.fixture(scope="module")
def l_shape() -> Vibration:
    return L_SHAPE.vibration(MYLAR, 900.0)


@pytest.fixture(scope="module")
def wide_l_shape() -> Vibration:
    return L_SHAPE.vibration(MYLAR, 1300.0)


@pytest.fixture(scope="module")
def hook() -> Vibration:
    return HOOK.vibration(MYLAR, 520.0)


each_vibration = pytest.mark.parametrize(
    "name",
    ["l_shape", *(pytest.param(n, marks=pytest.mark.prove) for n in ("hook", "wide_l_shape"))],
)


def from_corner(count: int) -> tuple[Array, Array]:
    """Return nodes and weights over three squares around the L's inner corner, crowding to it."""
    points, weights = np.polynomial.legendre.leggauss(count)
    share, weight = ((points + 1) / 2) ** 4, 2 * ((points + 1) / 2) ** 3 * weights
    x, y = (axis.ravel() for axis in np.meshgrid(share, share))
    quarters = [np.column_stack([a * x, b * y]) for a, b in ((-1, -1), (-1, 1), (1, -1))]
    places = 0.2 + 0.2 * np.vstack(quarters)
    return places, np.tile(np.outer(weight, weight).ravel(), 3) / 3


@pytest.mark.prove
@pytest.mark.parametrize(("name", "least"), [("l_shape", 20), ("wide_l_shape", 40)])
def test_forms_are_orthonormal(name: str, least: int, request: pytest.FixtureRequest) -> None:
    vibration: Vibration = request.getfixturevalue(name)
    places, weights = from_corner(50)
    values = vibration.forms.values(places)
    assert values.shape[1] == len(vibration.frequencies) >= least
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    products = (values * weights[:, None]).T @ values
    assert np.abs(products - np.eye(len(products))).max() < 2e-9


@pytest.mark.prove
def test_forms_with_sources_are_orthonormal(hook: Vibration) -> None:
    """By scikit-fem's rules on small triangles."""
    filling = Triangulation.of(plan_of(np.array(HOOK.corners)).corners, 0.03)
    mesh = MeshTri(filling.points.T.copy(), filling.triangles.T.copy())
    basis = Basis(mesh, ElementTriP2(), intorder=8)
    x, y = (axis.ravel() for axis in np.asarray(basis.global_coordinates()))
    values = hook.forms.values(np.column_stack([x, y]))
    weights = basis.dx.ravel() / basis.dx.sum()
    products = (values * weights[:, None]).T @ values
    assert len(products) == 7
    assert np.abs(products - np.eye(len(products))).max() < 1e-7  # of the rule near corners
    assert len(hook.forms.sources) > 50  # type: ignore[attr-defined]


@pytest.mark.prove
@each_vibration
def test_forms_solve_the_wave_equation(name: str, request: pytest.FixtureRequest) -> None:
    """Weber 1869: the mean over a circle is J_0(k radius) times the value in its middle."""
    vibration: Vibration = request.getfixturevalue(name)
    body = HOOK if name == "hook" else L_SHAPE
    speed = np.sqrt(body.tension / (body.thickness * MYLAR.density))
    wavenumbers = 2 * np.pi * vibration.frequencies / speed
    middle, radius = body.places["top"][:2], 0.06
    angles = 2 * np.pi * np.arange(80) / 80
    ring = middle + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    mean = vibration.forms.values(ring).mean(axis=0)
    expected = j0(wavenumbers * radius) * vibration.forms.values(middle[None])[0]
    assert mean == pytest.approx(expected, abs=1e-10)


@pytest.mark.prove
@each_vibration
def test_forms_vanish_along_the_edges_as_stated(name: str, request: pytest.FixtureRequest) -> None:
    vibration: Vibration = request.getfixturevalue(name)
    corners = np.array((HOOK if name == "hook" else L_SHAPE).corners, float)
    share = np.linspace(0, 1, 173)[:, None]
    edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    rim = np.vstack([start + share * (end - start) for start, end in edges])
    largest = np.abs(vibration.forms.values(rim)).max(axis=0)
    assert (largest < 1.3 * vibration.errors + 1e-13).all()
    assert vibration.errors.max() < 1e-8


@pytest.mark.prove
def test_values_outside_are_those_on_the_nearest_edge(l_shape: Vibration) -> None:
    outside = np.array([[0.3, 0.203], [-0.004, 0.1], [0.21, 0.21], [np.pi, -50.0]])
    on_edge = np.array([[0.3, 0.2], [0.0, 0.1], [0.21, 0.2], [0.4, 0.0]])
    found = l_shape.forms.values(outside)
    assert np.abs(found - l_shape.forms.values(on_edge)).max() < 1e-12
    assert np.abs(found).max() < 1e-11


@pytest.mark.prove
def test_values_are_the_same_for_one_place_and_many(hook: Vibration) -> None:
    places = np.random.default_rng(0).uniform(0.0, 0.5, (3000, 2))
    many = hook.forms.values(places)
    one = np.vstack([hook.forms.values(place[None]) for place in places[::500]])
    assert np.abs(many[::500] - one).max() < 1e-10
    some = np.array([3, 0, 3])
    assert np.abs(hook.forms.chosen(some).values(places[:9]) - many[:9, some]).max() < 1e-10
    assert isinstance(hook.forms, PolygonForms)
    assert hook.forms.dimensions == 2


@pytest.mark.prove
def test_direction_and_straight_corners_do_not_matter() -> None:
    body = PolygonMembrane(corners=((0, 0), (0, 0.3), (0.5, 0.2), (0.4, 0)), **THIN)
    turned = PolygonMembrane(
        corners=((0.2, 0), (0.4, 0), (0.5, 0.2), (0.25, 0.25), (0, 0.3), (0, 0)), **THIN
    )
    found, again = (each.vibration(MYLAR, 450.0) for each in (body, turned))
    assert len(found.frequencies) >= 4
    assert again.frequencies == pytest.approx(found.frequencies, rel=1e-12)
    assert turned.volume == pytest.approx(body.volume, rel=1e-14)
    places = np.array([[0.1, 0.1], [0.3, 0.15]])
    shapes, others = (np.abs(each.forms.values(places)) for each in (found, again))
    assert shapes == pytest.approx(others, abs=1e-8)


@pytest.mark.prove
def test_size_tension_and_density_scale_frequencies(l_shape: Vibration) -> None:
    body = PolygonMembrane.l_shape(side=0.4, thickness=0.0004, tension=750.0)
    heavy = Material(density=4 * 1390.0, youngs_modulus=1.0, poisson_ratio=0.0)
    slower = 2 * 8**0.5 * 2  # by the size, by thickness and tension together, by the density
    again = body.vibration(heavy, 600.0 / slower).frequencies
    expected = l_shape.frequencies[l_shape.frequencies < 600.0] / slower
    assert again == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "highest",
    [
        449.0,
        *(pytest.param(each, marks=pytest.mark.prove) for each in (350.0, 400.0, 467.0, 470.0)),
    ],
)
def test_it_tells_how_far_its_modes_are_proved_to_be_all(
    highest: float, l_shape: Vibration
) -> None:
    told = L_SHAPE.vibration(MYLAR, highest)
    assert told.details["proved complete up to (Hz)"] >= highest
    assert len(told.frequencies) == np.count_nonzero(l_shape.frequencies <= highest)


@pytest.mark.prove
def test_a_wide_band_is_proved_complete(wide_l_shape: Vibration) -> None:
    assert wide_l_shape.details["proved complete up to (Hz)"] >= 1300.0


def test_waves_are_those_of_tension_alone(l_shape: Vibration) -> None:
    assert l_shape.details["proved complete up to (Hz)"] >= 900.0
    assert not l_shape.poisson_slopes.any()
    speed = np.sqrt(3000.0 / 0.0002 / 1390.0)
    assert l_shape.half_wave == pytest.approx(speed / l_shape.frequencies[-1] / 2)


@pytest.mark.parametrize(("left_out", "doubled"), [((), ()), ((3,), ()), ((), (3,)), ((8,), (6,))])
def test_counts_notice_modes_missing_or_doubled(
    left_out: tuple[int, ...], doubled: tuple[int, ...]
) -> None:
    """Of the L's lowest nine: those of a square twice 49.348, then 56.71."""
    values = [9.639724, 15.197252, 19.739209, 29.521481, 31.912636, 41.47451, 44.948488]
    values += [49.348022, 49.348022]
    kept = [value for i, value in enumerate(values) if i not in left_out]
    kept = sorted(kept + [values[i] for i in doubled])
    found = [
        Eigenfunction(value=value, wavenumber=value**0.5, coefficients=np.zeros(0), error=1e-6)
        for value in kept
    ]
    plan = plan_of(5 * np.array(L_SHAPE.corners))
    if len(kept) == 9:  # as many as there are: what is doubled is for `_merged` to find
        assert _prove_complete(plan, found, 50.0, 56.7) > 50.0
    else:
        with pytest.raises(SolverError, match=f"{len(kept)} modes .* elements count 9"):
            _prove_complete(plan, found, 50.0, 56.7)


def test_groups_that_find_the_same_mode_are_merged() -> None:
    rough, groups = np.array([1.01, 2.01, 2.02, 3.01]), [(0, 1), (1, 2), (2, 3), (3, 4)]

    def merged(*values: float) -> list[tuple[int, int]]:
        found = [
            [Eigenfunction(value=value, wavenumber=1.0, coefficients=np.zeros(0), error=0.0)]
            for value in values
        ]
        return _merge_groups(groups, found, rough, 1e-8)

    assert merged(1.0, 2.0, 2.01, 3.0) == groups
    assert merged(1.0, 2.0, 2.0 + 1e-9, 3.0) == [(0, 1), (1, 3), (3, 4)]  # the same
    assert merged(1.0, 2.015, 2.012, 3.0) == [(0, 1), (1, 3), (3, 4)]  # past each other
    assert merged(1.0, 2.0, 2.5, 3.0) == [(0, 1), (1, 2), (2, 4)]  # above what it can be
    assert merged(1.0, 2.0, 2.01, 3.5) == [(0, 1), (1, 2), (2, 4)]


def test_places_lie_inside_on_the_top() -> None:
    for body in (L_SHAPE, HOOK, PolygonMembrane(corners=SPIRAL, **THIN)):
        assert {"top", "middle", "edge", "corner"} == set(body.places)
        plan = plan_of(np.array(body.corners, float))
        flat = np.array([place[:2] for place in body.places.values()])
        assert np.array_equal(plan.locate(flat)[0], flat)
        assert {place[2] for place in body.places.values()} == {0.0001}
    # As deep as any: the circle that touches two edges and the inner corner.
    assert L_SHAPE.places["top"][:2] == pytest.approx([0.2 / (1 + 0.5**0.5)] * 2, abs=0.004)


def test_skin_is_closed_and_of_the_volume() -> None:
    for body in (L_SHAPE, HOOK):
        mesh = body.skin(body.extent / 20)
        assert closed(mesh)
        assert mesh.volume == pytest.approx(body.volume, rel=1e-12)
    assert L_SHAPE.volume == pytest.approx(3 * 0.2**2 * 0.0002)
    assert L_SHAPE.extent == 0.4
    assert L_SHAPE.supported
    assert L_SHAPE.tensioned


@pytest.mark.parametrize(
    ("corners", "reason"),
    [
        (((0, 0), (1, 1), (1, 0), (0, 1)), "crosses itself near .*untangle"),
        (((0, 0), (1, 0)), "has 2 corners: give at least 3"),
        (((0, 0), (1, 0), (1, 0), (0, 1)), r"repeats corner \(1, 0\) m: give it once"),
        (((0, 0), (1, 0), (1, 1), (0, 0)), r"repeats corner \(0, 0\) m: give it once"),
        (((0, 0), (2, 0), (1, 0), (1, 1)), "folds back"),
        (((0, 0), (np.nan, 0), (0, 1)), "finite pairs"),
        (((0, 0), (np.inf, 0), (0, 1)), "finite pairs"),
        (((0, 0, 0), (1, 0, 0), (0, 1, 0)), r"form \(3, 3\): give finite pairs"),
    ],
)
def test_what_is_no_polygon_is_refused(corners: tuple[tuple[float, ...], ...], reason: str) -> None:
    with pytest.raises(OptionError, match=reason):
        PolygonMembrane(corners=corners, **THIN)


@pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
@pytest.mark.parametrize("name", ["side", "thickness", "tension"])
def test_lengths_and_tension_must_be_positive(name: str, value: float) -> None:
    with pytest.raises(OptionError, match=f"{name} of the .* is {value} .*exceed 0"):
        PolygonMembrane.l_shape(**{"side": 0.2, **THIN, name: value})


@pytest.mark.prove
def test_bands_without_modes_and_with_too_many_are_refused() -> None:
    lowest = 9.63972384402194**0.5 / 0.2 * (3000.0 / 0.0002 / 1390.0) ** 0.5 / (2 * np.pi)
    assert len(L_SHAPE.vibration(MYLAR, 0.999 * lowest).frequencies) == 0
    assert len(L_SHAPE.vibration(MYLAR, 1.001 * lowest).frequencies) == 1
    with pytest.raises(OptionError, match=f"lowest mode is at {lowest:.4g} Hz"):
        L_SHAPE.modes(MYLAR, (20.0, 0.9 * lowest))
    message = "modes lie below 20000 Hz, and 1000 can be had: check the lengths"
    with pytest.raises(OptionError, match=message):
        L_SHAPE.vibration(MYLAR, 20_000.0)


@pytest.mark.prove
def test_modes_are_those_of_the_band(l_shape: Vibration) -> None:
    modes = L_SHAPE.modes(MYLAR, (20.0, 500.0))
    expected = l_shape.frequencies[l_shape.frequencies < 500.0]
    assert modes.frequencies == pytest.approx(expected, rel=1e-12)
    assert modes.mass == pytest.approx(3 * 0.2**2 * 0.0002 * 1390.0)
    assert modes.centre == pytest.approx([0.5 / 3, 0.5 / 3, 0.0], abs=1e-12)
    assert {"moler1968", "liu2015"} <= set(modes.provenance.references)


def test_angles_are_followed_around_bends() -> None:
    """In a spiral, the inner corners see its end at more than a whole turn."""
    plan = plan_of(SPIRAL)
    way = np.array([(0.5, 0.5), (4.5, 0.5), (4.5, 4.5), (1.5, 4.5), (1.5, 2.5), (2.5, 2.5)])
    shares = np.linspace(0, 1, 400)[:, None]
    path = np.vstack([a + t * (b - a) for a, b in pairwise(way) for t in shares])
    assert np.array_equal(plan.locate(path)[0], path)
    for corner in range(len(plan.corners)):
        radii, angles = plan.polar(corner, *plan.locate(path))
        assert radii == pytest.approx(np.linalg.norm(path - plan.corners[corner], axis=1))
        assert np.abs(np.diff(angles)).max() < 0.05
    total = [np.ptp(plan.polar(c, *plan.locate(path))[1]) for c in range(len(plan.corners))]
    assert max(total) > 2 * np.pi


def test_angles_start_and_end_on_the_edges_of_a_corner() -> None:
    for corners in (SPIRAL, np.array(HOOK.corners)):
        plan = plan_of(corners)
        assert plan.angles.sum() == pytest.approx((len(corners) - 2) * np.pi)
        for corner in range(len(plan.corners)):
            sides = np.array([corner + 1, corner - 1]) % len(plan.corners)
            middles = (plan.corners[corner] + plan.corners[sides]) / 2
            angles = plan.polar(corner, *plan.locate(middles))[1]
            assert angles == pytest.approx([0.0, plan.angles[corner]], abs=1e-13)


def test_nodes_integrate_over_the_plan() -> None:
    for corners in (SPIRAL, np.array(HOOK.corners), np.array(L_SHAPE.corners)):
        plan = plan_of(corners)
        nodes = area_nodes(plan, 1.0)
        a, b = corners, np.roll(corners, -1, axis=0)
        turns = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        second = (turns @ (a[:, 0] ** 2 + a[:, 0] * b[:, 0] + b[:, 0] ** 2)) / 12
        assert nodes.weights.sum() == pytest.approx(plan.area, rel=1e-13)
        assert nodes.weights @ nodes.points[:, 0] ** 2 == pytest.approx(second, rel=1e-12)


def test_sources_stay_outside() -> None:
    plan = plan_of(SPIRAL)
    sources = place_sources(plan, 0.4, 0.5, 0.1)
    moved = plan.locate(sources)[0]
    assert np.linalg.norm(sources - moved, axis=1).min() > 0.3
    assert len(sources) > 200


def test_tables_hold_bessel_functions() -> None:
    """Against SciPy's; where x is small beside the order both are nearly 1."""
    arguments = np.linspace(0.01, 39.9, 500)
    orders = 0.8 * np.arange(1, 40)
    found = series(arguments, tabulate_regular(0.8, 39, 40))
    factor = np.exp(gammaln(orders + 1) - orders * np.log(arguments[:, None] / 2))
    bessel, following = jv(orders, arguments[:, None]), jv(orders + 1, arguments[:, None])
    envelope = factor * np.hypot(bessel, following)
    sound = (envelope > 0) & np.isfinite(envelope)
    assert np.abs((found - factor * bessel) / envelope)[sound].max() < 3e-13
    slope = series_slope(arguments, tabulate_regular(0.8, 39, 40))
    expected = -factor * following  # d/dx (x^-nu J_nu) = -x^-nu J_(nu + 1)
    assert np.abs((slope - expected) / envelope)[sound].max() < 3e-12


def test_tables_hold_the_irregular_function() -> None:
    arguments = np.linspace(0.05, 59.9, 800)[:, None]
    even, rest = pair(arguments, tabulate_irregular(60))
    assert np.abs(even - j0(arguments)).max() < 1e-15
    assert np.abs(2 / np.pi * np.log(arguments / 2) * even + rest - y0(arguments)).max() < 3e-15


@BilinearForm
def _stiffness(u, v, _):  # noqa: ANN001, ANN202 - as scikit-fem calls it
    return dot(grad(u), grad(v))


@BilinearForm
def _mass(u, v, _):  # noqa: ANN001, ANN202
    return u * v


@pytest.mark.parametrize("kind", ["quadratic", "nonconforming"])
def test_elements_are_those_of_scikit_fem(kind: str) -> None:
    filling = Triangulation.of(plan_of(SPIRAL).corners, 0.5)
    pencil = getattr(filling, f"assemble_{kind}")()
    mesh = MeshTri(filling.points.T.copy(), filling.triangles.T.copy())
    basis = Basis(mesh, ElementTriP2() if kind == "quadratic" else ElementTriCR())
    inner = basis.complement_dofs(basis.get_dofs())
    stiffness, mass = (form.assemble(basis)[inner][:, inner] for form in (_stiffness, _mass))
    expected = scipy.sparse.linalg.eigsh(
        stiffness, 30, mass, sigma=0, return_eigenvectors=False, tol=1e-12
    )
    value = float(np.sort(expected)[24:26].mean())
    found = pencil.find_below(value)
    assert pencil.count(value) == len(found) == 25
    assert found == pytest.approx(np.sort(expected)[:25], rel=1e-9)


@pytest.mark.parametrize("longest", [0.7, 0.31, 0.05])
def test_triangles_are_as_small_as_asked_for(longest: float) -> None:
    filling = Triangulation.of(SPIRAL, longest)
    assert longest / 2 < filling.longest <= longest
    corners = filling.points[filling.triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(plan_of(SPIRAL).area)
