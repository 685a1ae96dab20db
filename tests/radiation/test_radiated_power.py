from __future__ import annotations

from time import process_time

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from scipy.special import eval_legendre, h1vp

from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.radiation import by_name
from struck.radiation.on_surface import Skin, sphere_impedance
from tests.radiation.bodies import ball, bending, box, fork, joined, radial, rod, swinging, tube

Array = NDArray[np.float64]
CENTRE = np.zeros(3)

# Spheres, orders 0 to 2: Junger & Feit; Fahy; checked there against spherical Hankel functions.
KA = np.array([0.1, 0.5, 1, 2, 5])
EFFICIENCIES = np.array(
    [
        [0.0099009901, 0.2, 0.5, 0.8, 0.96153846],
        [2.4999375e-05, 0.015384615, 0.2, 0.8, 0.9936407],
        [1.2332007e-08, 0.0001879346, 0.011235955, 0.4295302, 1.0643008],
    ]
)

# |p| at 1 m of a sphere of 0.1 m moving at 0.01 m/s, at 100 and 1000 Hz (textbook formulas).
PULSATING = np.array([0.07441903294, 0.36267922738])
OSCILLATING_ON_AXIS = np.array([0.00788989462, 0.35540414605])


def decibels(ratio: Array | float) -> Array:
    return 20 * np.log10(np.asarray(ratio))


def legendre(mesh: Mesh, order: int) -> Array:
    """Return shapes of a ball that moves along its normals by a Legendre polynomial (V, 3, 1)."""
    heights = mesh.points[:, 2] / np.linalg.norm(mesh.points, axis=1)
    return radial(mesh, eval_legendre(order, heights))


def along_z(mesh: Mesh) -> Array:
    """Return the shape of a body that moves as a whole along z (V, 3, 1)."""
    return np.broadcast_to(np.eye(3)[2], mesh.points.shape)[:, :, None]


def power(
    mesh: Mesh, shapes: NDArray[np.floating], frequency: ArrayLike, centre: Array = CENTRE
) -> Array:
    frequencies = np.broadcast_to(np.asarray(frequency, float), shapes.shape[2:])
    return np.abs(by_name("power").coefficients(mesh, shapes, frequencies, centre))


def frequency_at(ka: ArrayLike, radius: float) -> Array:
    return np.asarray(ka) * AIR.sound_speed / (2 * np.pi * radius)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_sphere_radiates_as_theory_says(order: int) -> None:
    mesh = ball()
    expected = AIR.impedance * 0.1 * np.sqrt(EFFICIENCIES[order] / (2 * order + 1))
    shapes = np.repeat(legendre(mesh, order), len(KA), axis=2)
    computed = power(mesh, shapes, frequency_at(KA, 0.1))
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=0.1)


def test_pulsating_sphere() -> None:
    mesh = ball()
    shapes = np.repeat(legendre(mesh, 0), 2, axis=2)
    computed = 0.01 * power(mesh, shapes, [100, 1000])
    np.testing.assert_allclose(decibels(computed / PULSATING), 0, atol=0.1)


def test_oscillating_sphere() -> None:
    mesh = ball()
    wave_numbers = 2 * np.pi * np.array([100, 1000]) / AIR.sound_speed
    # A dipole: 1/sqrt(3) of its axis over all directions, and near-field on the axis at 1 m.
    expected = OSCILLATING_ON_AXIS / np.sqrt(3 * (1 + wave_numbers**-2))
    computed = 0.01 * power(mesh, np.repeat(along_z(mesh), 2, axis=2), [100, 1000])
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=0.1)


def test_powers_of_orders_add_up() -> None:
    mesh = ball()
    parts = [legendre(mesh, 1), legendre(mesh, 2)]
    first, second, both = power(mesh, np.concatenate([*parts, parts[0] + parts[1]], axis=2), 1000)
    assert both == pytest.approx(np.hypot(first, second), rel=1e-3)


def test_orders_above_the_highest_radiate_by_their_gradient() -> None:
    mesh, orders, ka = ball(), np.array([14, 15, 16]), np.array([14, 17, 20])
    expected = AIR.impedance * 0.1 * np.sqrt(sphere_impedance(orders, ka).real / (2 * orders + 1))
    shapes = np.concatenate([legendre(mesh, order) for order in orders], axis=2)
    computed = power(mesh, shapes, frequency_at(ka, 0.1))
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=3)


def test_turning_a_body_changes_nothing() -> None:
    mesh = box((0.12, 0.05, 0.03), (12, 6, 4))
    generator = np.random.default_rng(3)
    bend = generator.normal(size=(3, 3, 4))
    shapes = np.einsum("vj,jdm->vdm", np.sin(40 * mesh.points), bend)
    turn = Rotation.random(rng=generator).as_matrix()
    turned = Mesh(points=mesh.points @ turn.T, faces=mesh.faces)
    before = power(mesh, shapes, 3000)
    after = power(turned, np.einsum("de,vem->vdm", turn, shapes), 3000)
    np.testing.assert_allclose(decibels(after / before), 0, atol=0.3)


def test_moving_a_body_changes_nothing() -> None:
    mesh = ball(subdivisions=3)
    centre = np.array([1.0, -2.0, 3.0])
    moved = Mesh(points=mesh.points + centre, faces=mesh.faces)
    there = power(moved, legendre(mesh, 2), 1000, centre)
    np.testing.assert_allclose(there, power(mesh, legendre(mesh, 2), 1000), rtol=1e-9)


# A chime of O'Brien et al. 2002, Table 2, at its lowest modes.
CHIME = {"radius": 0.0125, "wall": 0.001, "length": 0.505}
CHIME_FREQUENCIES = np.array([587.33, 1619, 3174])


# Only where waves are shorter than the tube. The long one is also heard where they are shorter
# than its bundles of faces, yet longer than its girth.
@pytest.mark.parametrize(
    ("body", "frequencies", "within"),
    [
        (CHIME, CHIME_FREQUENCIES[2:], 1),
        ({"radius": 0.007, "wall": 0.001, "length": 2.0}, [3e3, 4.7e3, 5e3, 7e3, 10e3, 20e3], 7),
    ],
)
def test_long_bending_tube_is_as_loud_as_an_endless_cylinder(
    body: dict[str, float], frequencies: ArrayLike, within: float
) -> None:
    mesh = tube(body["radius"], body["wall"], body["length"], around=12, along=160)
    x = 2 * np.pi * np.asarray(frequencies) / AIR.sound_speed * body["radius"]
    efficiencies = 2 / (np.pi * x * np.abs(h1vp(1, x)) ** 2)
    area = 2 * np.pi * body["radius"] * body["length"]
    expected = AIR.impedance * np.sqrt(area * efficiencies * 0.5 / (4 * np.pi))
    shapes = np.repeat(bending(3, body["length"])(mesh.points)[:, :, None], len(x), axis=2)
    computed = power(mesh, shapes, frequencies)
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=within)


def test_signed_sum_would_silence_a_bending_tube_but_the_amount_does_not() -> None:
    mesh = tube(**CHIME, around=24, along=80)
    shapes = bending(1, CHIME["length"])(mesh.points)[:, :, None]
    corners = shapes[mesh.faces, :, 0].mean(axis=1)
    signed = abs(np.einsum("fd,fd->", corners, mesh.area_vectors)) / (2 * np.pi)
    amount = by_name("obrien2002").coefficients(mesh, shapes, CHIME_FREQUENCIES[:1], CENTRE)
    assert signed < 1e-9 * amount[0]


def test_disc_is_a_dipole_with_the_mass_of_air_that_it_drags_along() -> None:
    mesh = rod(0.1, 2e-3, around=48, along=1)
    wave_number = 2 * np.pi * 100 / AIR.sound_speed
    # Dragged mass 8/3 rho a^3 (Lamb): a force on the air of omega times it, a dipole.
    on_axis = AIR.impedance * wave_number**2 * (8 / 3) * 0.1**3 / (4 * np.pi)
    computed = power(mesh, along_z(mesh), 100)
    assert np.abs(decibels(computed / (on_axis / np.sqrt(3)))) < 5  # -4.9: thin bodies are low


def test_plate_radiates_plane_waves_when_it_is_large() -> None:
    mesh = box((0.3, 0.3, 0.01), (24, 24, 1))
    expected = AIR.impedance * np.sqrt(2 * 0.3**2 / (4 * np.pi))  # both sides, efficiency 1
    assert np.abs(decibels(power(mesh, along_z(mesh), 20e3) / expected)) < 1


def test_wall_of_a_closed_cavity_is_silent() -> None:
    def walled(subdivisions: int) -> Mesh:
        outer, inner = ball(0.1, subdivisions), ball(0.09, subdivisions)
        return joined(outer, Mesh(points=inner.points, faces=inner.faces[:, ::-1]))

    hollow, outer, inner = walled(3), ball(0.1, 3), ball(0.09, 3)
    shapes = np.concatenate([legendre(outer, 2), legendre(inner, 2)])
    expected = power(outer, legendre(outer, 2), 1000)
    np.testing.assert_allclose(power(hollow, shapes, 1000), expected, rtol=1e-9)
    assert Skin.of(walled(4), CENTRE).radius == pytest.approx(0.1, rel=1e-3)


def test_wall_of_a_cavity_aside_is_silent() -> None:
    outer, bubble = ball(0.1, subdivisions=3), ball(0.03, subdivisions=2)
    aside = bubble.points + np.array([0.05, 0.0, 0.0])  # half of its wall looks away from CENTRE
    body = joined(outer, Mesh(points=aside, faces=bubble.faces[:, ::-1]))
    shapes = np.concatenate([legendre(outer, 2), 10 * legendre(bubble, 0)])
    expected = power(outer, legendre(outer, 2), 1000)
    np.testing.assert_allclose(power(body, shapes, 1000), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "height", [0, *(pytest.param(h, marks=pytest.mark.prove) for h in (1e-17, 1e-15, 1e-13))]
)
def test_faces_without_area_change_nothing(height: float) -> None:
    mesh = box((0.12, 0.05, 0.03), (24, 12, 8))
    first, second, third = mesh.faces[0]
    middle = mesh.points[[first, second]].mean(axis=0)
    middle += height * (mesh.points[third] - middle) / np.linalg.norm(mesh.points[third] - middle)
    number = len(mesh.points)  # a needle along one edge, and its face cut in two
    cut = [[first, second, number], [number, second, third], [first, number, third]]
    needled = Mesh(points=np.vstack([mesh.points, middle]), faces=np.vstack([mesh.faces[1:], cut]))
    shapes, cut_shapes = (np.sin(40 * m.points)[:, :, None] for m in (mesh, needled))
    ratio = power(needled, cut_shapes, 3000) / power(mesh, shapes, 3000)
    np.testing.assert_allclose(decibels(ratio), 0, atol=0.1)


def test_prongs_that_swing_apart_displace_no_air() -> None:
    mesh = fork()
    shapes = np.repeat(swinging(np.sign)(mesh.points)[:, :, None], 2, axis=2)
    low, octave_up = power(mesh, shapes, [20, 40])
    assert octave_up / low > 3.99  # a monopole would double, a dipole is four times as loud


@pytest.mark.parametrize(("name", "exponent"), [("power", -0.5), ("obrien2002", 0.5)])
def test_similar_bodies_are_in_proportion(name: str, exponent: float) -> None:
    # Frequencies go with 1/size, so ka stays; shapes with size^(-3/2); pressure with velocity
    # times radius, the 2002 sum with velocity times area.
    mesh, factor = box((0.12, 0.05, 0.03), (12, 6, 4)), 3.0
    generator = np.random.default_rng(5)
    shapes = np.einsum("vj,jdm->vdm", np.cos(30 * mesh.points), generator.normal(size=(3, 3, 6)))
    frequencies = np.linspace(300, 9000, 6)
    estimate = by_name(name)
    small = estimate.coefficients(mesh, shapes, frequencies, CENTRE)
    large = estimate.coefficients(
        mesh.scaled(factor), shapes * factor**-1.5, frequencies / factor, CENTRE
    )
    np.testing.assert_allclose(large, small * factor**exponent, rtol=1e-9)


@pytest.mark.parametrize("frequency", [50.0, 5000.0])
def test_coupling_of_2002_is_displacement_times_frequency(frequency: float) -> None:
    mesh = ball(0.1)
    expected = frequency * 4 * np.pi * 0.1**2 / (2 * np.pi * frequency)
    estimate = by_name("obrien2002")
    computed = estimate.coefficients(mesh, legendre(mesh, 0), np.array([frequency]), CENTRE)
    np.testing.assert_allclose(computed, expected, rtol=0.005)


@pytest.mark.parametrize("name", ["power", "obrien2002"])
def test_modes_do_not_depend_on_each_other(name: str) -> None:
    mesh = ball(subdivisions=2)
    shapes = np.random.default_rng(2).normal(size=(len(mesh.points), 3, 70))
    frequencies = np.linspace(200, 19e3, 70)
    estimate = by_name(name)
    together = estimate.coefficients(mesh, shapes, frequencies, CENTRE)
    for mode in (slice(1, 2), slice(66, 67)):
        alone = estimate.coefficients(mesh, shapes[:, :, mode], frequencies[mode], CENTRE)
        np.testing.assert_allclose(alone, together[mode], rtol=1e-12)
    assert estimate.coefficients(mesh, shapes[:, :, :0], frequencies[:0], CENTRE).shape == (0,)


def test_mode_that_does_not_move_along_the_normals_is_silent() -> None:
    mesh = ball(subdivisions=3)
    turning = np.cross([0.0, 0.0, 1.0], mesh.points)[:, :, None]
    assert power(mesh, turning, 1000)[0] < 1e-3 * power(mesh, legendre(mesh, 0) * 0.1, 1000)[0]
    assert power(mesh, np.zeros_like(turning), 1000)[0] == 0


@pytest.mark.parametrize(
    ("cells", "least", "modes", "most"),
    [
        (40, 1_600, 40, 300),  # a collapse alone
        pytest.param(185, 7_500, 200, 15, marks=pytest.mark.prove),  # usually 3
        pytest.param(370, 14_500, 200, 15, marks=pytest.mark.prove),
    ],
)
@pytest.mark.timed
def test_many_modes_of_a_fine_mesh_take_little_time(
    cells: int, least: int, modes: int, most: float
) -> None:
    mesh = box((0.3, 0.03, 0.01), (cells, 15, 5))
    assert len(mesh.points) > least
    shapes = np.random.default_rng(0).normal(size=(len(mesh.points), 3, modes)).astype(np.float32)
    flat = shapes.reshape(-1, modes)
    start = process_time()
    power(mesh, shapes, np.linspace(200, 20e3, modes))
    taken, start = process_time() - start, process_time()
    for _ in range(20):
        flat.T @ flat
    assert taken < most * (process_time() - start)
