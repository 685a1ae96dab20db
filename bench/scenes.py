"""Scenes: how long a million rows of a contact log take, and how many bodies may slide at once.

`python bench/scenes.py` prints processor seconds; all runs on one thread.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time

import numpy as np
from numpy.typing import NDArray

import struck
from struck.ears import Mono
from struck.scene import Body, Contacts, Poses, Scene, events_of
from struck.solids import Block

Array = NDArray[np.float64]
STEP = 1e-3  # s
ROWS = 10**6
BODIES, TOUCHES, SECONDS = 16, 64, 2.0
SPEED = 0.05  # m/s


def block() -> struck.ModalModel:
    """Return a wooden block."""
    return struck.analyze(Block(size=(0.2, 0.1, 0.02)), "oak", accuracy="preview")


def sliding(pairs: list[tuple[int, int]], steps: int) -> Contacts:
    """Return the log of blocks that slide on each other at four points, and knock now and then."""
    chance = np.random.default_rng(0)
    times, corners = STEP * np.arange(steps), np.array([[x, y] for x in (-1, 1) for y in (-1, 1)])
    bodies = 1 + max(max(pair) for pair in pairs)
    way = 0.003 * np.sin(2 * np.pi * times)  # of a body on the one before it
    places = np.zeros((steps, bodies, 3))
    places[:, :, 2] = 0.02 * np.arange(bodies)
    places[:, :, 0] = np.outer(way, np.arange(bodies))
    count = steps * len(corners)
    load = chance.dirichlet(np.ones(4), steps).ravel() * 9.81 * STEP
    load[chance.integers(0, count, count // 4000)] += 0.2
    columns = []
    for first, second in pairs:
        place = np.tile(np.column_stack([0.03 * corners, np.full(4, 0.01)]), (steps, 1))
        place += np.repeat(places[:, second] - [0, 0, 0.02], 4, axis=0)
        pace = (second - first) * np.repeat(np.gradient(way, STEP), 4)
        columns.append((np.full(count, first), np.full(count, second), place, pace))
    first, second, place, pace = (np.concatenate(each) for each in zip(*columns, strict=True))
    rows = np.tile(np.repeat(np.arange(steps), 4), len(pairs))
    order = np.argsort(rows, kind="stable")
    return Contacts(
        names=[f"block {k}" for k in range(bodies)],
        time=times[rows[order]],
        dt=STEP,
        body0=first[order],
        body1=second[order],
        position=place[order],
        impulse=np.outer(np.tile(load, len(pairs))[order], [0, 0, 1]),
        velocity=np.outer(pace[order], [1, 0, 0]),
        poses=Poses.together(times, places, np.tile([1.0, 0, 0, 0], (steps, bodies, 1))),
    )


def scene(model: struck.ModalModel, bodies: int) -> Scene:
    """Return so many bodies of one model."""
    return Scene(bodies={f"block {k}": Body(model=model) for k in range(bodies)})


def main() -> None:
    """Measure and print."""
    model = block()
    pairs = [(k, k + 1) for k in range(15)]
    log = sliding(pairs, ROWS // (4 * len(pairs)))
    begun = time.process_time()
    events = events_of(scene(model, 16), log)
    found = time.process_time()
    events.on()
    done = time.process_time()
    print(
        f"{len(log)} rows: {len(events.impacts)} points of blows, {len(events.sustained)} lasting"
    )
    print(f"  rows to events    {found - begun:6.2f} s of a processor (at most 10)")
    print(f"  events to pushes  {done - found:6.2f} s")

    some = [(a, b) for a in range(BODIES) for b in range(a + 1, BODIES)]
    some = [some[k] for k in np.linspace(0, len(some) - 1, TOUCHES).astype(int)]
    log = sliding(some, round(SECONDS / STEP))
    events = events_of(scene(model, BODIES), log)
    excited = events.on()
    begun = time.process_time()
    struck.render(excited, listener=Mono(position=(0, 1, 1)), seconds=SECONDS)
    taken = time.process_time() - begun
    print(
        f"{len(events.sustained)} sustained contacts among {BODIES} bodies of "
        f"{len(model.frequencies)} modes: {SECONDS / taken:.2f} times real time"
    )


if __name__ == "__main__":
    main()
