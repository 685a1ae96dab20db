"""Boundary elements against closed forms, and the estimate of power against such elements.

The numbers of bodies that are no spheres were made once by a solver that is no part of this
library: direct collocation of the Helmholtz integral equation, constant triangles, the velocities
below at their middles (Burton & Miller's equation above ka = 2, where ka is that of the sphere of
the same area). It meets the closed forms of a sphere's orders 0 to 2 within 0.1 dB (1,280
triangles, ka 0.5 to 5); here, its power through the surface and far away agree within 0.6 dB, and
0.3 to 0.5 times as many triangles change no number by more than 0.6 dB (not tried with the tube of
the chime and the fork).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.special import eval_legendre, sph_harm_y, spherical_jn, spherical_yn

from struck.errors import MeshError
from struck.model.arrays import Array
from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.radiation import by_name
from struck.radiation.boundary_elements import SurfaceField, Walls, join_fields, solve_field
from tests.radiation import bempp_numbers, bodies
from tests.radiation.bodies import Motion, bending, bowl_mode, ovalling, swinging, upward
from tests.samples import sampled

BODIES: dict[str, Callable[[], Mesh]] = {
    "rod": lambda: bodies.rod(0.0125, 0.505, 14, 56),
    "chime": lambda: bodies.tube(0.0125, 0.001, 0.505, 16, 56),
    "pipe": lambda: bodies.tube(0.04, 0.004, 0.3, 24, 20),
    "hoop": lambda: bodies.hoop(0.05, 0.01, 48, 8),
    "bar": lambda: bodies.box((0.005, 0.03, 0.3), (1, 4, 50)),
    "plate": lambda: bodies.box((0.2, 0.2, 0.006), (16, 16, 1)),
    "bowl": lambda: bodies.bowl(0.06, 0.004, 24, 14),
    "fork": bodies.fork,
    "block": lambda: bodies.box((0.12, 0.05, 0.03), (16, 7, 4)),
}
# Triangles of the boundary elements: 3,400 for the rod, 3,648 for the chime, 4,224 for the pipe,
# 1,536 for the hoop, 3,264 for the bar, 2,688 for the plate, 2,560 for the bowl, 1,664 for the
# fork, 1,776 for the block.

SADDLE = upward(lambda x, y: x**2 - y**2)
TWIST = upward(lambda x, y: x * y)
WAVES = upward(lambda x, y: np.cos(10 * np.pi * x) * np.cos(10 * np.pi * y))
BEND = upward(lambda x, _: np.cos(2 * np.pi * x / 0.12))


def stretching(points: np.ndarray) -> np.ndarray:
    """Return the lowest stretching of a block along x."""
    along = np.sin(np.pi * points[:, 0] / 0.12)
    return np.stack([along, 0 * along, 0 * along], axis=1)


# Body, motion, decibels reached, and the pressure in Pa by frequency in Hz, at 1 m, root mean
# square over directions, for the velocities of the motion in m/s.
CASES: list[tuple[str, Motion, float, dict[float, float]]] = [
    ("rod", bending(1, 0.505), 2, {587: 0.2590, 1620: 3.627, 3170: 10.28, 6000: 15.32}),
    ("rod", bending(2, 0.505), 2, {587: 0.1036, 1620: 3.261, 3170: 10.14, 6000: 15.31}),
    ("rod", bending(3, 0.505), 3, {587: 0.02172, 1620: 2.531, 3170: 9.908, 6000: 15.31}),
    ("chime", bending(1, 0.505), 4, {587: 0.2478, 1620: 3.665, 3170: 10.25, 6000: 15.42}),
    ("chime", bending(2, 0.505), 4, {587: 0.1036, 1620: 3.304, 3170: 10.12, 6000: 15.41}),
    ("chime", bending(3, 0.505), 4, {1620: 2.570, 3170: 9.887, 6000: 15.41}),
    ("pipe", ovalling(2), 4, {500: 0.3461, 1500: 7.571, 4000: 23.18}),
    ("pipe", ovalling(3), 3, {500: 0.01936, 4000: 22.80}),
    ("hoop", ovalling(2), 2, {400: 0.004760, 1200: 0.1119, 3500: 0.5887, 8000: 3.198}),
    ("hoop", ovalling(3), 2, {400: 0.0003703, 1200: 0.02734, 3500: 0.7807, 8000: 3.747}),
    ("bar", bending(1, 0.3), 6, {290: 0.01311, 800: 0.2370, 1570: 1.926, 5000: 16.07}),
    ("bar", bending(2, 0.3), 6, {290: 0.003351, 800: 0.1021, 1570: 1.226, 5000: 16.05}),
    ("bar", bending(3, 0.3), 5, {290: 0.006488, 800: 0.04166, 1570: 0.4964, 5000: 15.98}),
    ("plate", TWIST, 4, {800: 1.108 / 400, 2500: 45.01 / 400, 5000: 44.23 / 400}),
    ("plate", SADDLE, 5, {800: 0.2091 / 100, 2500: 15.11 / 100, 5000: 13.77 / 100}),
    ("plate", WAVES, 3, {200: 0.02537, 800: 0.7271, 2500: 10.39, 5000: 18.01}),
    ("bowl", bowl_mode(2), 7, {500: 0.1037, 1500: 2.352, 4000: 30.49, 8000: 20.14}),
    ("bowl", bowl_mode(3), 3, {500: 0.01021, 1500: 0.7230, 4000: 9.898, 8000: 20.35}),
    ("bowl", bodies.breathing_bowl, 9, {500: 1.175, 1500: 15.04, 4000: 25.55, 8000: 19.26}),
    ("fork", swinging(np.sign), 3, {440: 0.0006326, 2000: 0.05704, 5000: 0.8562}),
    ("fork", swinging(np.ones_like), 1, {440: 0.01055, 2000: 0.2041, 5000: 0.8190}),
    ("block", BEND, 4, {1000: 0.2356, 4000: 8.674, 8000: 9.156}),
    ("block", stretching, 1, {1000: 1.331, 4000: 5.012, 8000: 6.613}),
]


ORDERS = np.arange(5)
EVERY_CASE = [
    pytest.param(*case, marks=[pytest.mark.prove] * bool(n % 4)) for n, case in enumerate(CASES)
]


@cache
def body(name: str) -> Mesh:
    return BODIES[name]()


def directions(subdivisions: int) -> Array:
    return np.array(trimesh.creation.icosphere(subdivisions=subdivisions).vertices)


def round_ball(subdivisions: int) -> Mesh:
    """Return a polyhedron of the volume of the unit ball."""
    inscribed = bodies.ball(1.0, subdivisions)
    return inscribed.scaled((4 * np.pi / 3 / inscribed.volume) ** (1 / 3))


def orders(places: Array) -> Array:
    """Return real spherical harmonics (P, 5) of orders 0 to 4, all but the first of degree 1."""
    places = places / np.linalg.norm(places, axis=1)[:, None]
    below, around = np.arccos(places[:, 2]), np.arctan2(places[:, 1], places[:, 0])
    return np.stack([sph_harm_y(n, min(n, 1), below, around).real for n in ORDERS], axis=1)


def outgoing(order: int, x: float | Array, *, slope: bool = False) -> NDArray[np.complex128]:
    return spherical_jn(order, x, slope) - 1j * spherical_yn(order, x, slope)


def off_the_sphere(mesh: Mesh, ka: float, turn: Array, offset: Array) -> Array:
    """Return relative errors (5,) at 3 radii of a sphere that is turned, then moved."""
    moved = Mesh(points=mesh.points @ turn.T + offset, faces=mesh.faces)
    field = solve_field(moved, ka, orders(mesh.centroids), ORDERS)
    places = 3 * directions(1)
    heard = field.pressure(places @ turn.T + offset, ORDERS)
    ratios = np.array([outgoing(n, 3 * ka) / outgoing(n, ka, slope=True) for n in ORDERS])
    exact = -1j * AIR.impedance * ratios * orders(places)
    return np.linalg.norm(heard - exact, axis=0) / np.linalg.norm(exact, axis=0)


TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN *= np.linalg.det(TURN)
UNTURNED = np.eye(3), np.zeros(3)


@pytest.mark.parametrize("ka", [0.5, 2, np.pi])
def test_orders_of_a_coarse_sphere_meet_the_closed_form(ka: float) -> None:
    assert off_the_sphere(round_ball(2), ka, *UNTURNED).max() < 0.025


def test_with_fewer_elements_a_wave_than_asked_for_a_sphere_is_hardly_worse() -> None:
    assert off_the_sphere(round_ball(2), 4.4934, *UNTURNED).max() < 0.03  # 4.6, in place of 6


def test_orders_of_a_sphere_meet_the_closed_form_wherever_it_lies() -> None:
    mesh, ka = round_ball(3), 4.4934  # the first resonance inside of order 1
    errors = off_the_sphere(mesh, ka, *UNTURNED)
    assert errors.max() < 0.01
    moved = off_the_sphere(mesh, ka, TURN, np.array([0.3, -2.0, 1.0]))
    np.testing.assert_allclose(moved, errors, atol=2e-4)


@pytest.mark.parametrize("ka", [0.5, 2.0, 5.0])
def test_a_cap_on_a_sphere_meets_the_closed_form(ka: float) -> None:
    """Of half an angle of 30 degrees (Morse & Ingard 1968, section 7.2: a piston in a sphere)."""
    polar_angles = np.linspace(np.pi, 0, 25)  # a ring of edges lies on the rim of the cap
    inscribed = bodies.revolved(np.sin(polar_angles), np.cos(polar_angles), 36)
    mesh = inscribed.scaled((4 * np.pi / 3 / inscribed.volume) ** (1 / 3))
    rim = np.cos(np.pi / 6)
    is_on_cap = mesh.centroids[:, 2] > rim * np.linalg.norm(mesh.centroids, axis=1)
    field = solve_field(mesh, ka, is_on_cap[:, None].astype(float), np.zeros(1, np.int64))
    degrees = np.arange(60)
    speeds = (eval_legendre(np.maximum(degrees - 1, 0), rim) - eval_legendre(degrees + 1, rim)) / 2
    heights, weights = np.polynomial.legendre.leggauss(24)
    distance = 30.0
    waves = outgoing(degrees, distance * ka) / outgoing(degrees, ka, slope=True)
    is_finite = np.isfinite(waves)
    shapes = eval_legendre(degrees[is_finite, None], heights)
    exact = np.abs(AIR.impedance * (speeds * waves)[is_finite] @ shapes)
    places = distance * np.stack([np.sqrt(1 - heights**2), 0 * heights, heights], axis=1)
    heard = np.abs(field.pressure(places, np.zeros(1, np.int64))[:, 0])
    powers = [weights @ np.square(pressures) for pressures in (heard, exact)]
    assert abs(10 * np.log10(powers[0] / powers[1])) < 0.4
    loud = exact > 0.3 * exact.max()
    assert np.abs(20 * np.log10(heard[loud] / exact[loud])).max() < 0.4


@pytest.mark.prove
@pytest.mark.parametrize("ka", [0.5, 1, 2, np.pi, 4, 4.4934, 5, 6, 2 * np.pi, 7.7253])
def test_orders_of_a_sphere_meet_the_closed_form(ka: float) -> None:
    assert off_the_sphere(round_ball(3), ka, *UNTURNED).max() < 0.025
    # Inscribed, it is smaller by 1 % in the radius, which shifts the phase by the more the higher.
    assert off_the_sphere(bodies.ball(1.0, 3), ka, *UNTURNED).max() < (0.025 if ka < 7 else 0.035)


@pytest.mark.prove
@pytest.mark.parametrize(("subdivisions", "within"), [(3, 0.05), (4, 0.02)])
def test_orders_of_a_large_sphere_meet_the_closed_form(subdivisions: int, within: float) -> None:
    assert off_the_sphere(round_ball(subdivisions), 12.0, *UNTURNED).max() < within


def point_source(places: Array, ways: Array, k: float) -> tuple[NDArray, NDArray]:
    """Return pressure (P,) of a point source in the origin, and its velocity along `ways`."""
    r = np.linalg.norm(places, axis=1)
    wave = np.exp(-1j * k * r) / (4 * np.pi * r)
    slope = -(1j * k + 1 / r) * wave * np.einsum("pd,pd->p", places, ways) / r
    return wave, slope / (-1j * k * AIR.impedance)


def of_complex(mesh: Mesh, k: float, velocities: NDArray, places: Array) -> NDArray:
    """Return pressures (P,) of complex normal velocities (F,)."""
    pair = np.stack([velocities.real, velocities.imag], axis=1)
    heard = solve_field(mesh, k, pair, np.arange(2)).pressure(places, np.arange(2))
    return heard[:, 0] + 1j * heard[:, 1]


def moved(mesh: Mesh, offset: tuple[float, float, float]) -> Mesh:
    return Mesh(points=mesh.points + offset, faces=mesh.faces)


def torus() -> Mesh:
    made = trimesh.creation.torus(1.0, 0.35, major_sections=40, minor_sections=16)
    return moved(
        Mesh(points=np.array(made.vertices), faces=np.array(made.faces)), (-1, -0.05, -0.05)
    )


@pytest.mark.parametrize(
    ("name", "k"),
    [
        pytest.param(name, k, marks=[pytest.mark.prove] * (k != 2))
        for name in ("cube", "torus")
        for k in (0.5, 2, 5)
    ],
)
def test_a_source_within_is_heard_as_if_there_were_no_body(name: str, k: float) -> None:
    cube = moved(bodies.box((1.2, 1.2, 1.2), (8, 8, 8)), (-0.1, -0.05, 0.2))
    mesh = cube if name == "cube" else torus()
    _, velocities = point_source(mesh.centroids, mesh.face_normals, k)
    places = 3 * directions(1)
    exact, _ = point_source(places, places, k)
    heard = of_complex(mesh, k, velocities, places)
    assert np.linalg.norm(heard - exact) < 0.015 * np.linalg.norm(exact)


def of_motion(mesh: Mesh, motion: Motion, frequency: float) -> SurfaceField:
    """Return the field of a motion of a body's points."""
    along = np.einsum("fcd,fd->f", motion(mesh.points)[mesh.faces] / 3, mesh.face_normals)
    wave_number = 2 * np.pi * frequency / AIR.sound_speed
    return solve_field(mesh, wave_number, along[:, None], np.zeros(1))


def heard_and_power(field: SurfaceField, subdivisions: int = 3) -> tuple[float, float]:
    """Return the root mean square at 1 m and what its power at the skin gives instead, Pa."""
    middle = field.mesh.points.mean(axis=0)
    heard = field.pressure(middle + 30 * directions(subdivisions), np.zeros(1, int)) * 30
    power = field.mesh.areas @ (field.pressures[0, :, 0] * field.velocities[:, 0])
    return np.sqrt(np.mean(np.abs(heard) ** 2)), np.sqrt(power * AIR.impedance / (4 * np.pi))


@pytest.mark.parametrize(
    ("name", "motion", "pressures"),
    [
        pytest.param(name, motion, pressures, marks=[pytest.mark.prove] * (number != 8))
        for number, (name, motion, _, pressures) in enumerate(CASES)
    ],
)
def test_bodies_sound_as_other_boundary_elements_say(
    name: str, motion: Motion, pressures: dict[float, float]
) -> None:
    for frequency, expected in pressures.items():
        found = np.array(heard_and_power(of_motion(body(name), motion, frequency)))
        levels = 20 * np.log10(found / expected)
        assert abs(levels[0]) < 1
        assert abs(levels[1]) < 0.7


@pytest.mark.prove
@pytest.mark.parametrize(
    ("name", "frequencies"), [("hoop", (1200, 8000)), ("block", (1000, 8000)), ("bowl", (1500,))]
)
def test_four_times_the_elements_change_no_level(name: str, frequencies: tuple[int, ...]) -> None:
    points, faces = trimesh.remesh.subdivide(body(name).points, body(name).faces)
    finer = Mesh(points=points, faces=faces)
    motion = next(motion for each, motion, *_ in CASES if each == name)
    for frequency in frequencies:
        levels = [
            20 * np.log10(heard_and_power(of_motion(mesh, motion, frequency))[0])
            for mesh in (body(name), finer)
        ]
        # Errors fall at least as fast as the edges: the limit is no farther off than one step.
        assert abs(levels[1] - levels[0]) < 0.3


@pytest.mark.prove
@pytest.mark.parametrize(
    ("wall", "frequency", "within", "around"),
    # 0.11, 0.11, 0.17 and 0.34 elements of the coarser mesh: below 0.1, walls are refused
    [
        (0.0008, 800, 0.02, (42, 54)),
        (0.001, 800, 0.02, (36, 48)),
        (0.0015, 800, 0.01, (36, 48)),
        (0.003, 4000, 0.04, (36, 48)),
    ],
)
def test_a_thin_bowl_converges(
    wall: float, frequency: float, within: float, around: tuple[int, int]
) -> None:
    bowls = [bodies.bowl(0.06, wall, each, 5 * each // 12) for each in around]
    fields = [of_motion(mesh, bowl_mode(2), frequency) for mesh in bowls]
    one, finer = (each.pressure(30 * directions(1), np.zeros(1, int)) for each in fields)
    assert np.linalg.norm(one - finer) < within * np.linalg.norm(finer)


def sheet(wall: float, order: int) -> tuple[Array, Array, NDArray]:
    """Return places, normals and strengths of sources in the middle of a bowl's wall.

    They end softly before the rim; a turn about the axis turns their phase `order` times as far.
    """
    many = round(9 / wall)  # so near to each other that they are smooth on both sides of the wall
    end, around = 1.35, 2 * np.pi * np.arange(4 * many) / (4 * many)
    below, weights = (each[:, None] for each in np.polynomial.legendre.leggauss(many))
    below = (below + 1) / 2 * end
    rows = np.broadcast_arrays(
        np.sin(below) * np.cos(around), np.sin(below) * np.sin(around), -np.cos(below)
    )
    normals = np.stack(rows, axis=-1).reshape(-1, 3)
    soft = np.cos(np.pi * below / 2 / end) ** 2 * np.sin(below) ** (order + 1)
    middle = 1 - wall / 2 - 0.004  # of flat triangles
    return middle * normals, normals, (soft * weights * np.exp(1j * order * around)).ravel()


def of_sheet(
    sources: tuple[Array, Array, NDArray], places: Array, ways: Array, k: float, *, paired: bool
) -> tuple[NDArray, NDArray]:
    """Return the pressure (P,) of sources, or of pairs across the wall, and velocity along ways."""
    middles, normals, strengths = sources
    pressure, velocity = np.zeros(len(places), complex), np.zeros(len(places), complex)
    for side in (1, -1) if paired else (0,):
        moved_by = middles + 1e-3 * side * normals
        for row, (place, way) in enumerate(zip(places, ways, strict=True)):
            wave, along = point_source(place - moved_by, way[None], k)
            pressure[row] += (side or 1) * wave @ strengths
            velocity[row] += (side or 1) * along @ strengths
    return pressure, velocity


@pytest.mark.prove
@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize(("order", "k"), [(0, 1.5), (2, 0.5)])
def test_smooth_sources_within_a_thin_wall_are_heard_as_if_there_were_none(
    order: int, k: float, *, paired: bool
) -> None:
    around = 24, 36
    for wall, bound in ((0.05, 0.05), (0.03, 0.1)):  # 0.25 and 0.15 elements of the coarser mesh
        sources, places, errors = sheet(wall, order), 3 * directions(1), []
        exact, _ = of_sheet(sources, places, places, k, paired=paired)
        for each in around:
            mesh = bodies.bowl(1.0, wall, each, each // 2)
            angles = np.arctan2(*mesh.centroids[:, 1::-1].T)
            step = 2 * np.pi / each
            turns = np.floor(angles / step) * step
            back = trimesh.transformations.rotation_matrix
            one = [
                np.einsum("fij,fj->fi", [back(-t, (0, 0, 1))[:3, :3] for t in turns], vectors)
                for vectors in (mesh.centroids, mesh.face_normals)
            ]
            sector, owner = np.unique(np.hstack(one).round(9), axis=0, return_inverse=True)
            _, alike = of_sheet(sources, sector[:, :3], sector[:, 3:], k, paired=paired)
            velocities = alike[owner] * np.exp(1j * order * turns)
            heard = of_complex(mesh, k, velocities, places)
            errors.append(np.linalg.norm(heard - exact) / np.linalg.norm(exact))
        assert errors[1] < errors[0] < bound


def test_a_sharp_edge_is_no_thin_wall() -> None:
    """A lens whose faces meet at 28 degrees is refused by none of its edges."""
    ball = bodies.ball(1.0, 4)
    height = np.hypot(*ball.points[:, :2].T)
    points = np.column_stack(
        [ball.points[:, :2], np.sign(ball.points[:, 2]) * 0.25 * (1 - height**2)]
    )
    lens = Mesh(points=points, faces=ball.faces)
    walls = Walls.of(lens)
    edges = np.sqrt(lens.areas * 4 / np.sqrt(3))
    assert np.nanmin(walls.depths / edges) < 0.1 < walls.min_ratio


def test_a_wall_of_a_twentieth_of_an_element_is_refused() -> None:
    with pytest.raises(MeshError, match=r"of 0\.1 at least: give a finer mesh"):
        of_motion(bodies.bowl(0.06, 0.0005, 24, 10), bowl_mode(2), 800)


def test_interior_points_lie_inside_and_only_where_waves_could_stand() -> None:
    mesh = torus()
    walls = Walls.of(mesh)
    assert walls.inner_points(4.0).shape == (0, 3)
    points = walls.inner_points(6.0)
    assert points.shape == (24, 3)
    assert mesh.locator.holds(points).all()


def test_modes_of_a_field_can_be_chosen_and_scaled() -> None:
    mesh = bodies.ball(0.1, 1)
    values = orders(mesh.centroids)
    low = solve_field(mesh, 3.0, values[:, :2], np.array([4, 7]))
    high = solve_field(mesh, 9.0, values[:, 2:4], np.array([8, 9]))
    both, place = join_fields([low, high]), np.array([[0.3, 0.2, 0.1]])
    chosen = both.chosen(np.array([9, 1, 4]), 2.0, np.array([1.0, 1.0, 3.0]))
    assert chosen is not None
    np.testing.assert_array_equal(chosen.modes, [0, 2])
    heard = chosen.pressure(2 * place, np.array([0, 1]))[0]
    np.testing.assert_allclose(heard[0], high.pressure(place, np.array([1]))[0, 0], rtol=1e-5)
    np.testing.assert_allclose(heard[1], 3 * low.pressure(place, np.array([0]))[0, 0], rtol=1e-5)
    assert both.chosen(np.array([1, 2]), 1.0, 1.0) is None


@pytest.mark.parametrize("name", sampled(bempp_numbers.CASES, "block", "bowl"))
def test_bodies_sound_as_bempp_says(name: str) -> None:
    make, motion, frequencies, _ = bempp_numbers.CASES[name]
    mesh, every = make(), np.zeros(1, int)
    with np.load(bempp_numbers.PLACE) as numbers:
        for frequency in frequencies if len(mesh.faces) < 2000 else frequencies[:1]:
            places = bempp_numbers.DISTANCE * bempp_numbers.WAYS
            field = of_motion(mesh, motion, frequency)
            heard = field.pressure(places, every)[:, 0]
            exact = numbers[f"{name} {frequency:.0f}"]
            missed = np.linalg.norm(heard - exact) / np.linalg.norm(exact)
            assert missed < min(0.02, field.errors[0])


@pytest.mark.parametrize(("name", "motion", "within", "pressures"), EVERY_CASE)
def test_the_estimate_of_power_is_as_boundary_elements_say(
    name: str, motion: Motion, within: float, pressures: dict[float, float]
) -> None:
    mesh = body(name)
    frequencies, expected = np.array(list(pressures)), np.array(list(pressures.values()))
    shapes = np.repeat(motion(mesh.points)[:, :, None], len(frequencies), axis=2)
    centre = mesh.points.mean(axis=0)
    computed = by_name("power").coefficients(mesh, shapes, frequencies, centre)
    np.testing.assert_allclose(20 * np.log10(computed / expected), 0, atol=within)
