"""What a strike asks for, and what a body receives."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from struck.errors import OptionError
from struck.excitation.hertz import Striker
from struck.excitation.strike import Blow, Strike
from struck.model.material import Material

STEEL = Material(density=7850.0, youngs_modulus=210e9, poisson_ratio=0.3)
HIT = SimpleNamespace(
    point=np.array([0.5, 0.0, 0.0]), direction=np.array([0.0, 0.0, -1.0]), distance=0.0
)
ROD = SimpleNamespace(
    gains=SimpleNamespace(of_surface=True),
    mass=1.0,
    centre=np.zeros(3),
    inertia=np.diag([1e-6, 1 / 12, 1 / 12]),
    material=STEEL,
    supported=False,
)
RECORDING = SimpleNamespace(
    mass=None,
    centre=None,
    inertia=None,
    material=None,
    supported=False,
    gains=SimpleNamespace(of_surface=False),
)
HELD = SimpleNamespace(**{**vars(ROD), "supported": True})


def test_a_body_that_is_held_does_not_give_way() -> None:
    free, held = (
        Strike(striker="steel", speed=1.0).resolved(body, HIT).impulse for body in (ROD, HELD)
    )
    striker = Striker.named("steel")
    assert held == pytest.approx(striker.mass * (1 + striker.restitution))
    assert free < held


def integrated_at_2_mhz(striker: Striker, body: SimpleNamespace, speed: float) -> float:
    """Step m x'' = -4/3 E* R^(1/2) x^(3/2) from the first touch to the last (Johnson, 11.4)."""
    rate, mass = 2e6, striker.mass
    if body.mass is not None:
        mass = 1 / (1 / striker.mass + 4 / body.mass)  # a rod at its end: a quarter of its mass
    modulus = 1 / ((1 - striker.poisson_ratio**2) / striker.youngs_modulus + (1 - 0.3**2) / 210e9)
    dent, count = 0.0, 0
    while dent >= 0:
        force = 4 / 3 * modulus * np.sqrt(striker.radius) * dent**1.5
        speed -= force / mass / rate
        dent += speed / rate
        count += 1
    return count / rate


@pytest.mark.parametrize("name", ["fingertip", "felt", "rubber", "wood", "plastic", "steel"])
@pytest.mark.parametrize("speed", [0.2, 3.0])
def test_contact_times_are_those_of_hertz_s_law_integrated(name: str, speed: float) -> None:
    blow = Strike(striker=name, speed=speed).resolved(ROD, HIT)
    expected = integrated_at_2_mhz(Striker.named(name), ROD, speed)
    assert blow.duration == pytest.approx(expected, rel=0.05)


def test_an_impulse_alone_acts_in_no_time() -> None:
    push = Strike(at="rim", impulse=0.02).resolved(ROD, HIT)
    assert push == Blow(impulse=0.02, duration=0.0)


def test_a_given_duration_is_kept() -> None:
    strike = Strike(impulse=0.02, duration=1e-3)
    assert strike.resolved(ROD, HIT) == Blow(impulse=0.02, duration=1e-3)
    hard = Strike(striker="steel", speed=1.0, duration=1e-3).resolved(ROD, HIT)
    assert hard.duration == 1e-3


def test_striker_and_speed_leave_the_bodies_with_the_restitution() -> None:
    head = Striker.named("rubber")
    impulse = Strike(striker="rubber", speed=2.0).resolved(ROD, HIT).impulse
    after = 2.0 - impulse / head.mass
    spin = impulse * 0.5 * 12
    rod = impulse / ROD.mass + spin * 0.5
    assert rod - after == pytest.approx(head.restitution * 2.0, rel=1e-12)


def test_impulse_and_striker_last_as_long_as_the_speed_that_they_need() -> None:
    by_speed = Strike(striker="wood", speed=1.5).resolved(ROD, HIT)
    by_impulse = Strike(striker="wood", impulse=by_speed.impulse).resolved(ROD, HIT)
    assert by_impulse.impulse == by_speed.impulse
    assert by_impulse.duration == pytest.approx(by_speed.duration, rel=1e-12)


def test_twice_the_speed_shortens_the_blow_by_the_fifth_root() -> None:
    slow = Strike(striker="steel", speed=1.0).resolved(ROD, HIT)
    fast = Strike(striker="steel", speed=2.0).resolved(ROD, HIT)
    assert fast.impulse == pytest.approx(2 * slow.impulse, rel=1e-12)
    assert fast.duration == pytest.approx(slow.duration / 2**0.2, rel=1e-12)


def test_a_recording_counts_as_heavy_and_hard() -> None:
    head = Striker.named("steel")
    push = Strike(striker="steel", speed=1.0).resolved(RECORDING, HIT)
    assert push.impulse == pytest.approx(head.mass * (1 + head.restitution))
    alone = head.youngs_modulus / (1 - head.poisson_ratio**2)
    expected = 2.8683 * (head.mass**2 / (head.radius * alone**2)) ** 0.2
    assert push.duration == pytest.approx(expected, rel=1e-4)
    assert (
        push.duration
        < Strike(striker="steel", speed=1.0)
        .resolved(SimpleNamespace(**{**vars(RECORDING), "material": STEEL}), HIT)
        .duration
    )


def test_a_bare_strike_is_wood_at_half_a_metre_a_second() -> None:
    assert Strike().resolved(ROD, HIT) == Strike(striker="wood", speed=0.5).resolved(ROD, HIT)


def test_places_and_directions_become_plain_numbers() -> None:
    strike = Strike(at=np.array([0, 0, 0.1]), direction=[0, 0, -4])
    assert strike.at == (0.0, 0.0, 0.1)
    assert strike.direction == (0.0, 0.0, -1.0)
    assert hash(strike) == hash(Strike(at=(0, 0, 0.1), direction=(0, 0, -1)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"impulse": 0.02, "speed": 1.0, "striker": "wood"}, r"0\.02 N s and speed is 1\.0"),
        ({"speed": 1.0}, "add a striker"),
        ({"striker": "stel"}, "did you mean steel"),
        ({"impulse": 0.0}, r"impulse is 0\.0: it must be a finite number above 0"),
        ({"impulse": -1.0}, r"impulse is -1\.0"),
        ({"impulse": np.nan}, "impulse is nan"),
        ({"striker": "wood", "speed": np.inf}, "speed is inf"),
        ({"impulse": 1.0, "duration": -1e-3}, r"duration is -0\.001: .* at least 0"),
        ({"impulse": 1.0, "time": -0.1}, r"time is -0\.1"),
        ({"at": (0, np.nan, 0)}, "at is .*finite"),
        ({"at": ((0, 0, 0), (1, 1, 1))}, "at is"),
        ({"at": (0, "x", 0)}, "at is"),
        ({"direction": (0, 0, 0)}, "a vector .* with a length"),
        ({"direction": (0, 1)}, "a vector"),
    ],
)
def test_impossible_strikes_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Strike(**arguments)


def test_a_bare_strike_of_a_recorded_body_is_the_blow_that_was_recorded() -> None:
    assert Strike().resolved(RECORDING, HIT) == Blow(impulse=1.0, duration=0.0)
    assert Strike(striker="wood").resolved(RECORDING, HIT).duration > 0
    assert Strike(impulse=0.5).resolved(RECORDING, HIT) == Blow(impulse=0.5, duration=0.0)
