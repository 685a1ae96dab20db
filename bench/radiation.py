"""Processor time of boundary elements and of listening; two threads; and bempp-cl beside them.

python bench/radiation.py remade   outputs of another material or size beside those of a new body
python bench/radiation.py          on one core: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
python bench/radiation.py threads  wall time of one thread and of two
python bench/radiation.py bempp    320 triangles by bempp-cl, where it is installed, and by struck
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import cast

import numpy as np

import struck
from struck.model.gains import ShapeGains
from struck.radiation import RadiatedPower
from struck.radiation.boundary_elements import solve_field
from struck.radiation.multipoles import Multipoles
from struck.radiation.sound_field import FieldPlan, fields_of
from struck.solids import Block
from tests.radiation import bodies
from tests.radiation.bempp_numbers import by_bempp

RUNS = 5
MODES, DEGREE = 100, 8


def best(work: Callable[[int], object]) -> float:
    """Return the least processor time that work takes, s."""
    times = []
    for run in range(RUNS):
        begun = time.process_time()
        work(run)
        times.append(time.process_time() - begun)
    return min(times)


def solving() -> float:
    """Return the processor time of a solution on 1,152 triangles, s."""
    mesh = bodies.bowl(0.06, 0.004, 24, 12)
    velocities = np.random.default_rng(0).standard_normal((len(mesh.faces), 2))
    return best(lambda run: solve_field(mesh, 20.0 + run, velocities, np.arange(2)))


def listening() -> float:
    """Return the time of two ears that hear a hundred modes of degree 8, s."""
    chance = np.random.default_rng(1)
    waves = [chance.normal(size=((DEGREE + 1) ** 2, 2)) @ (1, 1j) for _ in range(MODES)]
    wave_numbers = np.linspace(5.0, 80.0, MODES)
    errors = np.zeros((MODES, 2))
    field = Multipoles.of(waves, wave_numbers, radius=0.06, errors=errors)
    ears = np.array([[0.5, 0.09, 0.1], [0.5, -0.09, 0.1]])
    field.at(ears)
    return best(lambda _: [field.at(ears) for _ in range(100)]) / 100


def whole_field() -> float:
    """Return the wall time of the field of a plate: 1,000 elements, ten frequencies, s."""
    sheet = Block(size=(0.2, 0.1, 0.006))
    model = struck.analyze(sheet, "steel", accuracy="preview", band=(20, 6000), cache=False)
    gains = cast("ShapeGains", model.gains)
    plan = FieldPlan.of(gains, model.natural_frequencies, (20.0, 6000.0))
    begun = time.perf_counter()
    fields_of(gains, plan)
    return time.perf_counter() - begun


def remade() -> None:
    """Print the processor time of `made_of` and `scaled` beside the first outputs, runs in turn."""
    plate = Block(size=(0.3, 0.2, 0.004))
    model = struck.analyze(plate, "steel", accuracy="preview", band=(20, 20_000), cache=False)
    gains = cast("ShapeGains", model.gains)

    def first() -> None:
        surface, shapes = gains.surface.scaled(1.0), gains.shapes.astype(np.float64)
        RadiatedPower().coefficients(surface, shapes, model.natural_frequencies, gains.centre)

    works = {
        "first outputs": first,
        "made_of": lambda: model.made_of("aluminium"),
        "scaled": lambda: model.scaled(1.5),
    }
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(RUNS):
        for name, work in works.items():
            begun = time.process_time()
            work()
            times[name].append(time.process_time() - begun)
    print(f"{gains.count} modes, {len(gains.surface.points)} vertices")
    whole = min(times["first outputs"])
    for name, each in times.items():
        print(f"{name:14} {min(each):.3f} s of a processor, {min(each) / whole:.0%}")


def in_threads() -> None:
    """Print wall times of one thread and of two, tries in turn."""
    found: dict[str, list[float]] = {"1": [], "2": []}
    for _ in range(3):
        for count, times in found.items():
            own = {"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count}
            command = [sys.executable, __file__, "wall"]
            done = subprocess.run(
                command, env={**os.environ, **own}, capture_output=True, text=True, check=True
            )
            times.append(float(done.stdout))
    one, two = (min(times) for times in found.values())
    print(f"a field by one thread {one:.2f} s, by two {two:.2f} s: {one / two:.2f} times")


def beside_bempp() -> None:
    """Print the time of a sphere of 320 triangles, bempp-cl's loops being compiled before."""
    mesh = bodies.ball(1.0, 2)
    flows = mesh.centroids[:, 2].copy()
    by_bempp(mesh, flows, 2.0)
    theirs = best(lambda run: by_bempp(mesh, flows, 2.0 + 0.1 * run))
    column, every = flows[:, None], np.arange(1)
    ours = best(lambda run: solve_field(mesh, 2.0 + 0.1 * run, column, every))
    print(f"bempp-cl {theirs:.3f} s, struck {ours:.4f} s: {theirs / ours:.0f} times")


def main() -> None:
    """Print the figures."""
    wanted = sys.argv[1:]
    if wanted == ["wall"]:
        print(whole_field())
    elif wanted == ["threads"]:
        in_threads()
    elif wanted == ["remade"]:
        remade()
    elif wanted == ["bempp"]:
        beside_bempp()
    else:
        each = solving()
        print(f"1,152 triangles: {each:.3f} s of a processor a frequency; 100: {100 * each:.0f} s")
        amplitudes = 16 * MODES * (DEGREE + 1) ** 2
        print(f"two ears, {MODES} modes of degree {DEGREE}: {1e3 * listening():.2f} ms")
        print(f"their waves in a file: {amplitudes / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
