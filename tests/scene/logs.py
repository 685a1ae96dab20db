"""Contact logs of a block on a board, as solvers of several kinds write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from struck.model.damping import Rayleigh
from struck.scene import Body, Contacts, Poses, Scene
from tests.scene.boxes import OAK, box

Array = NDArray[np.float64]
DULL = replace(OAK, damping=Rayleigh(mass=60.0, stiffness=2e-7))
BOARD, BLOCK = box((0.4, 0.3, 0.02), material=DULL), box((0.1, 0.06, 0.05), material=DULL, seed=3)
SCENE = Scene(bodies={"board": Body(model=BOARD, fixed=True), "block": Body(model=BLOCK)})
HALF = np.array([0.05, 0.03])
TOP = 0.01  # of the board, m
MASS = float(BLOCK.mass or 0)
CORNERS = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * HALF


@dataclass(frozen=True, kw_only=True)
class Solver:
    """How a simulation tells of a block that falls on a board and slides."""

    step: float = 1e-3  # s
    spread: int = 1  # steps that the blow takes
    points: Array = field(default_factory=lambda: CORNERS)
    flicker: bool = False  # whether the load leaps from point to point
    sway: float = 0.0  # share by which it sways
    seed: int = 0


def landing(
    solver: Solver,
    *,
    speed: float = 0.5,
    at: float = 0.1,
    seconds: float = 2.0,
    slides: Callable[[Array], Array] | None = None,
    rests: bool = True,
) -> Contacts:
    """Return the log of a block that lands at a speed, m/s, and slides along x or rests."""
    chance, step, many = np.random.default_rng(solver.seed), solver.step, len(solver.points)
    times = step * np.arange(round(seconds / step))
    first = round(at / step)
    steps = np.arange(first, len(times) if rests else first + solver.spread)
    shape = np.sin(np.pi * (np.arange(solver.spread) + 0.5) / solver.spread)
    total = np.full(len(steps), MASS * 9.81 * step * rests)
    total *= 1 + solver.sway * chance.standard_normal(len(steps))
    total[: solver.spread] += MASS * speed * shape / shape.sum()
    shares = np.full((len(steps), many), 1 / many)
    if solver.flicker:
        shares[solver.spread :] = chance.dirichlet(np.full(many, 0.3), len(steps) - solver.spread)
    way = np.zeros(len(times)) if slides is None else slides(times)
    pace = np.gradient(way, step)
    places = np.zeros((len(times), 2, 3))
    places[:, 1, 0], places[:, 1, 2] = way, TOP + 0.025
    rows = np.repeat(steps, many)
    position = np.column_stack([np.tile(solver.points, (len(steps), 1)), np.full(len(rows), TOP)])
    position[:, 0] += way[rows]
    velocity = np.column_stack([pace[rows], 0 * pace[rows], np.where(rows == first, -speed, 0.0)])
    return Contacts(
        names=["board", "block"],
        time=times[rows],
        dt=step,
        body0=np.zeros(len(rows)),
        body1=np.ones(len(rows)),
        position=position,
        normal=np.tile([0.0, 0.0, 1.0], (len(rows), 1)),
        impulse=(total[:, None] * shares).reshape(-1, 1) * [0.0, 0.0, 1.0],
        velocity=velocity,
        poses=Poses.together(times, places, np.tile([1.0, 0, 0, 0], (len(times), 2, 1))),
    )
