"""Elastic impact against Hertz's equation of motion, momentum and energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from struck.errors import OptionError
from struck.excitation.hertz import (
    CONTACT_CONSTANT,
    Striker,
    contact_modulus,
    contact_time,
    effective_mass,
    joint_mass,
    strikers,
)
from struck.model.material import Material

STEEL = Material(density=7850.0, youngs_modulus=210e9, poisson_ratio=0.3)
INERTIA = np.array([[2.0, 0.1, 0.2], [0.1, 3.0, -0.3], [0.2, -0.3, 4.0]])


def time_in_contact(*, mass: float, radius: float, modulus: float, speed: float) -> float:
    """Integrate m x'' = -4/3 E* R^(1/2) x^(3/2) from the first touch to the last."""
    stiffness = 4 / 3 * modulus * np.sqrt(radius)

    def motion(_: float, state: np.ndarray) -> list[float]:
        return [state[1], -stiffness / mass * max(state[0], 0.0) ** 1.5]

    def apart(_: float, state: np.ndarray) -> float:
        return state[0] + 1e-30 if state[1] < 0 else 1.0

    apart.terminal = True
    depth = (15 * mass * speed**2 / (16 * modulus * np.sqrt(radius))) ** 0.4
    longest = 10 * depth / speed
    done = solve_ivp(
        motion,
        (0, longest),
        [0, speed],
        events=apart,
        rtol=1e-11,
        atol=1e-16,
        max_step=longest / 50,
    )
    return float(done.t_events[0][0])


@pytest.mark.parametrize(
    "blow",
    [
        {"mass": 0.03, "radius": 0.01, "modulus": 1.1e11, "speed": 0.5},
        {"mass": 0.002, "radius": 0.1, "modulus": 2e5, "speed": 3.0},
    ],
)
def test_contact_time_is_that_of_the_equation_of_motion(blow: dict[str, float]) -> None:
    assert contact_time(**blow) == pytest.approx(time_in_contact(**blow), rel=1e-5)


def test_constant_is_the_printed_one() -> None:
    assert round(CONTACT_CONSTANT, 2) == 2.87  # Johnson 1985, section 11.4
    assert pytest.approx(2.8683, abs=5e-5) == CONTACT_CONSTANT


def test_a_steel_ball_on_a_heavy_steel_block_touches_for_as_long_as_worked_out_by_hand() -> None:
    # 20 mm ball, 1 m/s: E* = 210e9 / (2 * 0.91) = 115.4 GPa, m = 32.88 g,
    # (m^2 / (R E*^2 v))^(1/5) = (1.0811e-3 / 1.3317e20)^(1/5) = 2.4082e-5 s
    time = contact_time(mass=0.03288, radius=0.01, modulus=contact_modulus(STEEL, STEEL), speed=1.0)
    assert time == pytest.approx(2.8683 * 2.4082e-5, rel=1e-3)


def test_contact_modulus_of_equal_solids_halves() -> None:
    alone, pair = contact_modulus(STEEL), contact_modulus(STEEL, STEEL)
    assert alone == pytest.approx(210e9 / 0.91)
    assert pair == pytest.approx(alone / 2)


def push(point: np.ndarray, direction: np.ndarray) -> dict[str, object]:
    return {
        "mass": 2.0,
        "centre": np.array([0.1, -0.2, 0.3]),
        "inertia": INERTIA,
        "point": point,
        "direction": direction,
    }


def test_effective_mass_balances_momentum_and_energy() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        body = push(random.normal(size=3), direction)
        seen = effective_mass(**body)
        arm = body["point"] - body["centre"]
        impulse = 0.7
        travel = impulse * direction / 2.0
        spin = np.linalg.solve(INERTIA, np.cross(arm, impulse * direction))
        speed = (travel + np.cross(spin, arm)) @ direction
        energy = 0.5 * 2.0 * travel @ travel + 0.5 * spin @ INERTIA @ spin
        assert seen == pytest.approx(impulse / speed, rel=1e-12)
        assert energy == pytest.approx(impulse**2 / (2 * seen), rel=1e-12)


def test_a_push_through_the_centre_meets_the_whole_mass() -> None:
    body = push(np.array([0.1, -0.2, 5.0]), np.array([0.0, 0.0, -1.0]))
    assert effective_mass(**body) == pytest.approx(2.0)


def test_a_rod_struck_at_its_end_gives_way_like_a_quarter_of_its_mass() -> None:
    # A thin rod, length 1 m, mass 1 kg: I = 1/12; 1 / (1 + (1/2)^2 * 12) = 1/4.
    seen = effective_mass(
        mass=1.0,
        centre=np.zeros(3),
        inertia=np.diag([1e-6, 1 / 12, 1 / 12]),
        point=[0.5, 0, 0],
        direction=[0, 0, -1],
    )
    assert seen == pytest.approx(0.25)


def test_joint_mass_of_a_light_striker_is_its_own() -> None:
    assert joint_mass(0.01, np.inf) == pytest.approx(0.01)
    assert joint_mass(2.0, 2.0) == pytest.approx(1.0)


@pytest.mark.parametrize("name", strikers())
def test_strikers_are_possible_and_say_where_they_come_from(name: str) -> None:
    striker = Striker.named(name.upper())
    assert striker.name == name
    assert min(striker.radius, striker.mass, striker.youngs_modulus) > 0
    assert 0 <= striker.poisson_ratio < 0.5
    assert 0 < striker.restitution <= 1
    assert striker.source


@pytest.mark.parametrize(
    ("name", "density"), [("steel", 7850), ("brass", 8480), ("glass", 2500), ("plastic", 1190)]
)
def test_strikers_that_are_balls_weigh_what_balls_weigh(name: str, density: float) -> None:
    ball = Striker.named(name)
    assert ball.mass == pytest.approx(density * 4 / 3 * np.pi * ball.radius**3, rel=0.01)


def test_softer_strikers_touch_for_longer() -> None:
    times = []
    for name in ("fingertip", "felt", "rubber", "wood", "plastic", "steel"):
        head = Striker.named(name)
        modulus = contact_modulus(head, STEEL)
        times.append(contact_time(mass=head.mass, radius=head.radius, modulus=modulus, speed=0.5))
    assert times == sorted(times, reverse=True)
    assert 5e-3 < times[0] < 20e-3
    assert 20e-6 < times[-1] < 200e-6


def test_unknown_strikers_are_refused_with_the_nearest_names() -> None:
    with pytest.raises(OptionError, match=r"'wod'.*did you mean wood"):
        Striker.named("wod")
    with pytest.raises(OptionError, match="give one of fingertip, felt"):
        Striker.named("xylophone")
