from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from scipy.special import eval_legendre, h1vp

from struck.air import AIR
from struck.mesh import Mesh
from struck.radiation import by_name
from struck.radiation.skin import Skin, normal_velocities
from struck.radiation.spherical import sphere_efficiency

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


def ball(radius: float = 0.1, subdivisions: int = 4) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh(points=np.array(sphere.vertices), faces=np.array(sphere.faces))


def box(size: tuple[float, float, float], edge: float, offset: float = 0.0) -> Mesh:
    body = trimesh.creation.box(extents=size).subdivide_to_size(edge, max_iter=20)
    body.merge_vertices()
    points = np.array(body.vertices) + np.array([offset, 0.0, 0.0])
    return Mesh(points=points, faces=np.array(body.faces))


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(points=np.vstack([m.points for m in meshes]), faces=np.vstack(faces))


def ring(profile: list[tuple[float, float]], around: int) -> Mesh:
    """Turn a closed profile of (radius, z), counter-clockwise, about the z axis."""
    body = trimesh.creation.revolve([*profile, profile[0]], sections=around)
    return Mesh(points=np.array(body.vertices), faces=np.array(body.faces))


def tube(radius: float, wall: float, length: float) -> Mesh:
    along = np.linspace(-length / 2, length / 2, 81)
    outer = [(radius, z) for z in along]
    inner = [(radius - wall, z) for z in along[::-1]]
    return ring(outer + inner, 24)


def radial(mesh: Mesh, order: int) -> Array:
    """Return shapes of a ball that moves along its normals by a Legendre polynomial (V, 3, 1)."""
    normals = mesh.points / np.linalg.norm(mesh.points, axis=1)[:, None]
    return (normals * eval_legendre(order, normals[:, 2])[:, None])[:, :, None]


def along_z(mesh: Mesh) -> Array:
    """Return the shape of a body that moves as a whole along z (V, 3, 1)."""
    return np.broadcast_to(np.eye(3)[2], mesh.points.shape)[:, :, None]


def power(mesh: Mesh, shapes: Array, frequency: ArrayLike, centre: Array = CENTRE) -> Array:
    frequencies = np.broadcast_to(np.asarray(frequency, float), shapes.shape[2:])
    return by_name("power").coefficients(mesh, shapes, frequencies, centre)


def frequency_at(ka: ArrayLike, radius: float) -> Array:
    return np.asarray(ka) * AIR.sound_speed / (2 * np.pi * radius)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_sphere_radiates_as_theory_says(order: int) -> None:
    mesh = ball()
    expected = AIR.impedance * 0.1 * np.sqrt(EFFICIENCIES[order] / (2 * order + 1))
    shapes = np.repeat(radial(mesh, order), len(KA), axis=2)
    computed = power(mesh, shapes, frequency_at(KA, 0.1))
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=0.1)


def test_pulsating_sphere() -> None:
    mesh = ball()
    shapes = np.repeat(radial(mesh, 0), 2, axis=2)
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
    parts = [radial(mesh, 1), radial(mesh, 2)]
    first, second, both = power(mesh, np.concatenate([*parts, parts[0] + parts[1]], axis=2), 1000)
    assert both == pytest.approx(np.hypot(first, second), rel=1e-3)


def test_orders_above_the_highest_radiate_by_their_gradient() -> None:
    mesh, orders, ka = ball(), np.array([14, 15, 16]), np.array([14, 17, 20])
    expected = AIR.impedance * 0.1 * np.sqrt(sphere_efficiency(orders, ka) / (2 * orders + 1))
    shapes = np.concatenate([radial(mesh, order) for order in orders], axis=2)
    computed = power(mesh, shapes, frequency_at(ka, 0.1))
    np.testing.assert_allclose(decibels(computed / expected), 0, atol=3)


def test_turning_a_body_changes_nothing() -> None:
    mesh = box((0.12, 0.05, 0.03), 0.012)
    generator = np.random.default_rng(3)
    bend = generator.normal(size=(3, 3, 4))
    shapes = np.einsum("vj,jdm->vdm", np.sin(40 * mesh.points), bend)
    turn = Rotation.random(rng=generator).as_matrix()
    turned = Mesh(points=mesh.points @ turn.T, faces=mesh.faces)
    before = power(mesh, shapes, 3000)
    after = power(turned, np.einsum("de,vem->vdm", turn, shapes), 3000)
    np.testing.assert_allclose(after, before, rtol=1e-9)


def test_moving_a_body_changes_nothing() -> None:
    mesh = ball()
    centre = np.array([1.0, -2.0, 3.0])
    moved = Mesh(points=mesh.points + centre, faces=mesh.faces)
    there = power(moved, radial(mesh, 2), 1000, centre)
    np.testing.assert_allclose(there, power(mesh, radial(mesh, 2), 1000), rtol=1e-9)


# A chime of O'Brien et al. 2002, Table 2, and the first bending modes of a free bar.
CHIME = {"radius": 0.0125, "wall": 0.001, "length": 0.505}
BENDING = [4.730040745, 7.853204624, 10.995607838]
LOWEST = 587.33  # Hz


def bending(mesh: Mesh, wave_number: float, length: float) -> Array:
    """Return the bending mode of a free bar with unit mean square along x (V, 3, 1)."""
    b, along = wave_number, mesh.points[:, 2] / length + 0.5
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    deflection = np.cosh(b * along) + np.cos(b * along)
    deflection -= ratio * (np.sinh(b * along) + np.sin(b * along))
    slope = np.sinh(b * along) - np.sin(b * along)
    slope -= ratio * (np.cosh(b * along) + np.cos(b * along))
    turned = -mesh.points[:, 0] * slope * b / length
    return np.stack([deflection, 0 * along, turned], axis=1)[:, :, None]


@pytest.mark.parametrize("wave_number", BENDING)
def test_bending_tube_is_about_as_loud_as_an_endless_cylinder(wave_number: float) -> None:
    mesh = tube(**CHIME)
    frequency = LOWEST * (wave_number / BENDING[0]) ** 2  # as thin bars have it
    x = 2 * np.pi * frequency / AIR.sound_speed * CHIME["radius"]
    efficiency = 2 / (np.pi * x * abs(h1vp(1, x)) ** 2)
    area = 2 * np.pi * CHIME["radius"] * CHIME["length"]
    expected = AIR.impedance * np.sqrt(area * efficiency * 0.5 / (4 * np.pi))
    shapes = bending(mesh, wave_number, CHIME["length"])
    assert np.abs(decibels(power(mesh, shapes, frequency) / expected)) < 10


def test_signed_sum_would_silence_a_bending_tube_but_the_amount_does_not() -> None:
    mesh = tube(**CHIME)
    shapes = bending(mesh, BENDING[0], CHIME["length"])
    corners = shapes[mesh.faces, :, 0].mean(axis=1)
    signed = abs(np.einsum("fd,fd->", corners, mesh.area_vectors)) / (2 * np.pi)
    amount = by_name("obrien2002").coefficients(mesh, shapes, np.array([LOWEST]), CENTRE)
    assert signed < 1e-9 * amount[0]


def test_disc_is_a_dipole_with_the_mass_of_air_that_it_drags_along() -> None:
    radii = np.linspace(0.0, 0.1, 41)
    outline = [(max(r, 1e-9), -1e-3) for r in radii] + [(max(r, 1e-9), 1e-3) for r in radii[::-1]]
    mesh = ring(outline, 48)
    wave_number = 2 * np.pi * 100 / AIR.sound_speed
    # Dragged mass 8/3 rho a^3 (Lamb): a force on the air of omega times it, a dipole.
    on_axis = AIR.impedance * wave_number**2 * (8 / 3) * 0.1**3 / (4 * np.pi)
    computed = power(mesh, along_z(mesh), 100)
    assert np.abs(decibels(computed / (on_axis / np.sqrt(3)))) < 3


def test_plate_radiates_plane_waves_when_it_is_large() -> None:
    mesh = box((0.3, 0.3, 0.01), 0.02)
    expected = AIR.impedance * np.sqrt(2 * 0.3**2 / (4 * np.pi))  # both sides, efficiency 1
    assert np.abs(decibels(power(mesh, along_z(mesh), 20e3) / expected)) < 1


def test_wall_of_a_closed_cavity_is_silent() -> None:
    outer, inner = ball(0.1), ball(0.09)
    hollow = joined(outer, Mesh(points=inner.points, faces=inner.faces[:, ::-1]))
    shapes = np.concatenate([radial(outer, 2), radial(inner, 2)])
    expected = power(outer, radial(outer, 2), 1000)
    np.testing.assert_allclose(power(hollow, shapes, 1000), expected, rtol=1e-9)
    assert Skin.of(hollow, CENTRE).radius == pytest.approx(0.1, rel=1e-3)


def test_wall_of_a_cavity_aside_is_silent() -> None:
    outer, bubble = ball(0.1), ball(0.03, subdivisions=2)
    aside = bubble.points + np.array([0.05, 0.0, 0.0])  # half of its wall looks away from CENTRE
    body = joined(outer, Mesh(points=aside, faces=bubble.faces[:, ::-1]))
    shapes = np.concatenate([radial(outer, 2), 10 * radial(bubble, 0)])
    expected = power(outer, radial(outer, 2), 1000)
    np.testing.assert_allclose(power(body, shapes, 1000), expected, rtol=1e-9)


def test_inside_of_a_tube_is_not_outward() -> None:
    skin = Skin.of(tube(**CHIME), CENTRE)
    around = 2 * np.pi * 0.0125 * 0.505
    ends = 2 * np.pi * (0.0125**2 - 0.0115**2)
    assert skin.area == pytest.approx(around + ends, rel=0.005)


def fork_swinging() -> tuple[Mesh, Array]:
    """Return two prongs and the shape in which they swing apart."""
    left, right = (box((0.008, 0.008, 0.1), 0.004, offset) for offset in (-0.009, 0.009))
    fork = joined(left, right)
    swing = np.sign(fork.points[:, 0]) * (fork.points[:, 2] + 0.05) ** 2
    return fork, np.stack([swing, 0 * swing, 0 * swing], axis=1)[:, :, None]


def test_prongs_that_swing_apart_displace_no_air() -> None:
    fork, shapes = fork_swinging()
    low, octave_up = power(fork, np.repeat(shapes, 2, axis=2), [20, 40])
    assert octave_up / low > 3.99  # a monopole would double, a dipole is four times as loud


def test_orders_share_all_of_the_velocity() -> None:
    fork, shapes = fork_swinging()
    skin, velocities = Skin.of(fork, CENTRE), normal_velocities(fork, shapes)
    mean_square = fork.areas[skin.outward] @ velocities[skin.outward] ** 2 / skin.area
    assert skin.orders(velocities).powers.sum() == pytest.approx(mean_square[0], rel=1e-9)


def test_order_of_the_rest_is_that_of_the_rest_alone() -> None:
    mesh = ball()
    velocities = normal_velocities(mesh, 5 * radial(mesh, 1) + radial(mesh, 16))
    rest = Skin.of(mesh, CENTRE).orders(velocities).numbers[-1, 0]
    assert rest == pytest.approx(16, rel=0.05)  # with order 1 in its mean it would be 13


@pytest.mark.parametrize(("name", "exponent"), [("power", -0.5), ("obrien2002", 0.5)])
def test_similar_bodies_are_in_proportion(name: str, exponent: float) -> None:
    # Frequencies go with 1/size, so ka stays; shapes with size^(-3/2); pressure with velocity
    # times radius, the 2002 sum with velocity times area.
    mesh, factor = box((0.12, 0.05, 0.03), 0.012), 3.0
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
    computed = estimate.coefficients(mesh, radial(mesh, 0), np.array([frequency]), CENTRE)
    np.testing.assert_allclose(computed, expected, rtol=0.005)


@pytest.mark.parametrize("name", ["power", "obrien2002"])
def test_modes_do_not_depend_on_each_other(name: str) -> None:
    mesh = ball(subdivisions=3)
    shapes = np.random.default_rng(2).normal(size=(len(mesh.points), 3, 5))
    frequencies = np.array([200.0, 900.0, 4000.0, 9000.0, 19000.0])
    estimate = by_name(name)
    together = estimate.coefficients(mesh, shapes, frequencies, CENTRE)
    alone = estimate.coefficients(mesh, shapes[:, :, 1:2], frequencies[1:2], CENTRE)
    np.testing.assert_allclose(alone, together[1:2], rtol=1e-12)
    assert estimate.coefficients(mesh, shapes[:, :, :0], frequencies[:0], CENTRE).shape == (0,)


def test_mode_that_does_not_move_along_the_normals_is_silent() -> None:
    mesh = ball(subdivisions=3)
    turning = np.cross([0.0, 0.0, 1.0], mesh.points)[:, :, None]
    assert power(mesh, turning, 1000)[0] < 1e-3 * power(mesh, radial(mesh, 0) * 0.1, 1000)[0]
    assert power(mesh, np.zeros_like(turning), 1000)[0] == 0
