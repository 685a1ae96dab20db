"""A steel ball on a steel rod: both engines against the contact law, integrated at 2 MHz."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from struck.model.material import Material
from struck.scene import Simulation, events_of

pytest.importorskip("mujoco")
pytest.importorskip("rapier3d")

LENGTH, EDGE, RADIUS = 0.3, 0.01, 0.01  # of the rod, its square section, and the ball, m
PLACE = 0.08  # where the ball hits, m from the rod's middle
STEEL = Material.named("steel")
ROD = STEEL.density * LENGTH * EDGE**2  # kg
BALL = STEEL.density * 4 / 3 * np.pi * RADIUS**3
RATE = 2_000_000
# Free-free beam of Euler and Bernoulli.
BETA = np.array([4.730040744862704, 7.853204624095838, 10.99560783800167, 14.13716549125746])
BETA = np.append(BETA, (2 * np.arange(5, 9) + 1) * np.pi / 2)
FREQUENCIES = (
    (BETA / LENGTH) ** 2
    * np.sqrt(STEEL.youngs_modulus / STEEL.density)
    * np.sqrt(EDGE**2 / 12)
    / (2 * np.pi)
)


def shapes(place: float) -> np.ndarray:
    """Return modes of mean square 1 at a place from the middle, m."""
    x = BETA * (place / LENGTH + 0.5)
    ratio = (np.cosh(BETA) - np.cos(BETA)) / (np.sinh(BETA) - np.sin(BETA))
    return np.cosh(x) + np.cos(x) - ratio * (np.sinh(x) + np.sin(x))


@cache
def law(speed: float) -> tuple[np.ndarray, float]:
    """Return Hertz's force on the rod, N (n,), and the restitution of the two as rigid bodies."""
    modulus = STEEL.youngs_modulus / (2 * (1 - STEEL.poisson_ratio**2))
    stiffness = 4 / 3 * modulus * np.sqrt(RADIUS)
    phi = shapes(PLACE)
    omega2 = (2 * np.pi * FREQUENCIES) ** 2
    arm = PLACE**2 * 12 / (LENGTH**2 + EDGE**2)  # the rod turns about its middle
    q, p, step = np.zeros(len(phi)), np.zeros(len(phi)), 1 / RATE
    ball, rod, fall, give, forces = 0.0, 0.0, -speed, 0.0, []
    for _ in range(RATE // 500):
        depth = rod + q @ phi - ball
        force = stiffness * depth**1.5 if depth > 0 else 0.0
        forces.append(force)
        fall += force / BALL * step
        give -= force * (1 + arm) / ROD * step
        p -= (force * phi / ROD + omega2 * q) * step
        ball, rod, q = ball + fall * step, rod + give * step, q + p * step
    return np.array(forces), (fall - give) / speed


def spectrum(force: np.ndarray, rate: float) -> np.ndarray:
    times = np.arange(len(force)) / rate
    return np.abs(np.exp(-2j * np.pi * FREQUENCIES[:, None] * times) @ force) / rate


@pytest.mark.parametrize("engine", ["mujoco", "rapier"])
@pytest.mark.parametrize("step", [0.0005, 0.001])
def test_impulse_and_forcing_are_those_of_the_law(tmp_path: Path, engine: str, step: float) -> None:
    speed = 1.5
    force, restitution = law(speed)
    path = tmp_path / "scene.xml"
    path.write_text(
        f"""<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody>
        <body name="rod"><freejoint/>
          <geom type="box" size="{LENGTH / 2} {EDGE / 2} {EDGE / 2}" mass="{ROD}"/></body>
        <body name="ball" pos="{PLACE} 0 {EDGE / 2 + RADIUS + 0.0037}"><freejoint/>
          <geom size="{RADIUS}" mass="{BALL}"/></body></worldbody><keyframe>
        <key name="k" qvel="0 0 0 0 0 0 0 0 {-speed} 0 0 0"/></keyframe></mujoco>"""
    )
    simulation = Simulation(
        path,
        materials="steel",
        mute=("rod", "ball"),
        engine=engine,
        restitution=restitution,
        keyframe="k",
        cache=False,
    )
    scene, contacts = simulation.run(0.02)
    events = events_of(scene, contacts)
    assert len(events.impacts) == 1
    impulse = float(np.linalg.norm(events.impacts.impulse[0]))
    true = force.sum() / RATE
    assert impulse == pytest.approx(true, rel=0.03)
    # What excites the rod: a half-sine of the law's own time, scaled to the law's impulse.
    duration = float(events.durations[0])
    times = (np.arange(round(duration * RATE)) + 0.5) / RATE
    pulse = np.sin(np.pi * times / duration)
    pulse *= true * RATE / pulse.sum()
    errors = np.abs(20 * np.log10(spectrum(pulse, RATE) / spectrum(force, RATE)))
    assert FREQUENCIES[-1] > 12_000
    assert errors[FREQUENCIES <= 8_000].max() < 1.0
    assert errors[FREQUENCIES <= 12_000].max() < 2.0
