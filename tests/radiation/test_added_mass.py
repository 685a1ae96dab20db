"""Recoil of rigid bodies against closed forms and boundary elements, through the engine.

The boundary elements are those of `test_boundary_elements` (collocation, Burton & Miller's
equation), on a disc of 1,848 triangles, a rod of 2,068 and a cube of 3,072 that move to and fro as
a whole. Of a ball they meet the closed form within 0.05 dB.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.integrate import quad

import struck
from struck import ModalModel, Strike
from struck.errors import MeshError
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.model.recoil import Recoil
from struck.radiation import by_name
from struck.radiation.added_mass import Hull, lamb, recoil_of
from tests.radiation.bodies import ball, box, rod

Array = NDArray[np.float64]
RATE = 48_000


def rigid(surface: Mesh, mass: float) -> ModalModel:
    """Return a body that has no modes, only its recoil."""
    none = np.zeros(0)
    return ModalModel(
        frequencies=none,
        natural_frequencies=none,
        decays=none,
        gains=ShapeGains(
            surface=surface,
            shapes=np.zeros((len(surface.points), 3, 0), np.float32),
            outputs=np.zeros(0, np.complex128),
            centre=np.zeros(3),
            radiation=by_name("power"),
        ),
        mass=mass,
        centre=np.zeros(3),
        inertia=np.eye(3) * mass * 1e-4,
        geometry=surface,
        complete_to=20_000.0,
        recoil=recoil_of(surface, mass),
    )


def heard(model: ModalModel, direction: tuple[float, float, float], frequencies: Array) -> Array:
    """Return the pressure at 1 m of a unit impulse, as `render` makes it, at frequencies, Hz."""
    strike = Strike(at=model.geometry.points[0], direction=direction, impulse=1.0, time=0.001)
    samples = struck.render(model, strike, seconds=0.05, listener=(1.0, 0.0, 0.0)).samples[0]
    turns = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(len(samples))) / RATE)
    return np.abs(turns @ samples) / RATE


def decibels(one: Array, other: Array) -> Array:
    return 20 * np.log10(one / other)


@pytest.mark.filterwarnings("ignore:an impulse moves its body")  # 1 N s, as of a linear system
@pytest.mark.parametrize("radius", [0.002, 0.007, 0.03])
def test_a_ball_recoils_as_its_closed_form(radius: float) -> None:
    """The first spherical wave of a ball that is free to move: Koss & Alfredson 1973."""
    mass = 7850 * 4 / 3 * np.pi * radius**3
    frequencies = np.geomspace(50, 10_000, 40)
    tau, s = radius / AIR.sound_speed, 2j * np.pi * frequencies
    level = AIR.density * radius**3 / (AIR.sound_speed * mass)
    on_axis = level * s / (2 + 2 * tau * s + (tau * s) ** 2)
    expected = np.abs(on_axis) / np.sqrt(3)  # root mean square of a cosine over directions
    got = heard(rigid(ball(radius, 3), mass), (1.0, 2.0, -2.0), frequencies)
    assert np.abs(decibels(got, expected)).max() < 0.25


# Pressure far away of a body of density 1 in a gas of density and sound speed 1 that moves at unit
# velocity, root mean square over directions, by wave number times half of its width.
WAVES = np.array([0.02, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0])
DISC = "6.6234e-05 .0016584 .0066657 .020684 .043066 .087543 .19152 .40716 .73021 .77667 .70156"
ROD = ".0022416 .05479 .20459 .53413 .91775 1.4021 1.8594 2.0775 2.1404 2.1802 2.3523"
CUBE = ".00025216 .0062981 .025117 .076216 .15261 .28335 .48806 .67684 .82019 .81932 .76013"
BODIES = {
    "disc, 40 by 4 mm, hit flat": (rod(0.02, 0.004, 48, 4), (0.0, 0.0, -1.0), 0.02, DISC),
    "rod, 10 by 100 mm, hit across": (rod(0.005, 0.1, 24, 20), (1.0, 0.0, 0.0), 0.005, ROD),
    "cube of 12 mm": (box((0.012,) * 3, (4, 4, 4)), (0.0, 1.0, 0.0), 0.006, CUBE),
}


@pytest.mark.parametrize("name", BODIES)
def test_bodies_recoil_as_boundary_elements_do(name: str) -> None:
    surface, direction, size, pressures = BODIES[name]
    mass = 7850 * surface.volume
    frequencies = WAVES * AIR.sound_speed / (2 * np.pi * size)
    inside = (frequencies > 50) & (frequencies < 11_000)
    velocities = 1 / (2 * np.pi * frequencies * mass)  # after a unit impulse
    expected = AIR.impedance * size * np.array(pressures.split(), float) * velocities
    got = heard(rigid(surface, mass), direction, frequencies[inside])
    assert np.abs(decibels(got, expected[inside])).max() < 1.0


def test_a_pushed_body_radiates_the_power_of_its_axes() -> None:
    surface = box((0.03, 0.02, 0.004), (6, 4, 1))
    recoil, low = recoil_of(surface, 0.02), np.array([100.0])
    pushes = np.eye(3)[[0, 1, 2]]
    alone = [heard(rigid(surface, 0.02), tuple(push), low)[0] for push in pushes]
    together = heard(rigid(surface, 0.02), (1.0, -2.0, 2.0), low)[0]
    assert together == pytest.approx(np.sqrt(np.square(alone) @ [1, 4, 4]) / 3, rel=1e-3)
    assert recoil.drives(pushes[0]) == pytest.approx(recoil.drives(-pushes[0]))


@pytest.mark.parametrize("half", [(1.0, 1.0, 1.0), (1.0, 1.0, 1e-3), (3.0, 1.0, 0.2)])
def test_added_masses_are_those_of_lamb(half: tuple[float, float, float]) -> None:
    a, b, c = half

    def alpha(axis: int) -> float:
        def under(u: float) -> float:
            root = np.sqrt((a * a + u) * (b * b + u) * (c * c + u))
            return a * b * c / ((half[axis] ** 2 + u) * root)

        return quad(under, 0, 1e-3, limit=500)[0] + quad(under, 1e-3, np.inf, limit=500)[0]

    expected = [alpha(axis) / (2 - alpha(axis)) for axis in range(3)]
    assert lamb(np.array(half)) == pytest.approx(expected, rel=1e-5)


def test_a_thin_disc_carries_the_air_of_its_closed_form() -> None:
    """8/3 rho a^3 (Lamb 1932, article 102): as of its rim, not of its ellipsoid, 3 dB more."""
    hull = Hull.of(rod(0.1, 1e-4, 96, 1))
    assert hull.carried_volumes.max() == pytest.approx(8 / 3 * 0.1**3, rel=0.01)
    assert hull.half.max() == pytest.approx(0.1 * np.sqrt(5 / 4), rel=0.01)


def test_the_hull_is_what_moves_air() -> None:
    turned = trimesh.transformations.rotation_matrix(1.0, (1, 2, 3), (0.1, 0, 0))
    solid = trimesh.creation.box((0.03, 0.02, 0.01))
    solid.apply_transform(turned)
    hull = Hull.of(Mesh(points=solid.vertices, faces=solid.faces))
    assert hull.volume == pytest.approx(6e-6)
    assert hull.half == pytest.approx(np.sqrt(5 / 12) * np.array([0.01, 0.02, 0.03]))
    assert hull.shadows == pytest.approx([6e-4, 3e-4, 2e-4])
    assert hull.facing_areas == pytest.approx(2 * hull.shadows)
    assert np.abs(hull.axes @ turned[:3, :3]) == pytest.approx(np.eye(3)[::-1], abs=1e-9)
    flat = Mesh(points=np.eye(3), faces=np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match="flat"):
        Hull.of(flat)


def test_recoil_goes_with_size_and_density() -> None:
    surface = box((0.03, 0.02, 0.004), (6, 4, 1))
    mass = 2000 * surface.volume
    grown = recoil_of(surface.scaled(3.0), 27 * mass * 1.5)
    arithmetic: Recoil = recoil_of(surface, mass).changed(3.0, 1.5)
    for name in ("axes", "levels", "corners", "dampings"):
        assert getattr(arithmetic, name) == pytest.approx(getattr(grown, name), rel=1e-9)
