"""No kernel is slow by accident: a harmless edit can keep the compiler from making vectors.

That costs 4 to 15 times. What is measured is processor time of the thread, the least of some turns,
beside NumPy's product of a matrix and a vector, which has to load what it multiplies. Ratios as
measured are for a quiet machine (`make prove`); the ordinary suite catches a collapse alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from struck.excitation.excitation import Push
from struck.synth.resonators import Resonators
from struck.synth.sample_loop import PUSHES, kernel, samples_of
from tests.synth.scenes import RATE, Array, bank

MODES, BLOCK = 2048, 128
SHAPE = (64, 1024)
PRODUCTS = SHAPE[0] * SHAPE[1]
TURNS = 9
COLLAPSE = 3.0
"""How many times slower than measured the ordinary suite allows."""


def times(*calls: Callable[[], object]) -> list[float]:
    """Return the least processor time of each, s; they take turns of about half a millisecond."""
    for call in calls:
        call()
    counts = [max(1, int(5e-4 / max(spent(call, 1), 1e-6))) for call in calls]
    turns = [
        [spent(call, count) / count for call, count in zip(calls, counts, strict=True)]
        for _ in range(TURNS)
    ]
    return np.min(turns, axis=0).tolist()


def spent(call: Callable[[], object], count: int) -> float:
    begun = time.thread_time()
    for _ in range(count):
        call()
    return time.thread_time() - begun


def products() -> Callable[[], object]:
    """Return a call that makes `PRODUCTS` products and sums."""
    random = np.random.default_rng(1)
    matrix, vector = random.standard_normal(SHAPE), random.standard_normal(SHAPE[1])
    sums = np.zeros(SHAPE[0])
    return lambda: np.matmul(matrix, vector, out=sums)


def spread(count: int) -> Array:
    """Return rows of zeros that begin with a cache line, and not at the same place of a page."""
    line = 8
    width = MODES + 3 * line
    room = np.zeros(count * width + line)
    skipped = (-room.ctypes.data // room.itemsize) % line
    return room[skipped : skipped + count * width].reshape(count, width)[:, :MODES]


def playing(
    pushes: int, outputs: int, *, turned: bool, ramped: bool, unit: bool = False
) -> Callable[[], object]:
    """Return a call of a kernel for a block of all modes."""
    random, modes = np.random.default_rng(2), bank(np.random.default_rng(3), MODES)
    gains = outputs * (2 if turned else 1) + (0 if unit else pushes)
    rows = spread(4 + gains * (2 if ramped else 1))
    rows[0], rows[1] = 2 * modes.turns.real, -(np.abs(modes.turns) ** 2)
    rows[2:4] = random.standard_normal((2, MODES))
    rows[4 : 4 + gains] = random.uniform(0.5, 1.0, (gains, MODES))
    forces, sounds = random.standard_normal((pushes, BLOCK)), np.zeros((outputs, BLOCK))
    frames = BLOCK // samples_of(pushes, outputs, turned=turned, ramped=ramped)
    played = kernel(pushes, outputs, turned=turned, ramped=ramped, unit=unit)
    return lambda: played(frames, *rows, *forces, *sounds)


def slowness(pushes: int, outputs: int, *, turned: bool, ramped: bool) -> float:
    """Return the time of a kernel's operation over that of NumPy's."""
    gains = pushes + outputs * (2 if turned else 1)
    operations = 2 + gains * (2 if ramped else 1)
    played, numpy = times(playing(pushes, outputs, turned=turned, ramped=ramped), products())
    return played / (operations * BLOCK * MODES) * PRODUCTS / numpy


@pytest.mark.prove
@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("pushes", PUSHES)
@pytest.mark.parametrize("turned", [False, True], ids=["real", "complex"])
@pytest.mark.parametrize("ramped", [False, True], ids=["still", "ramped"])
@pytest.mark.timed
def test_a_kernel_multiplies_no_slower_than_numpy(
    outputs: int, pushes: int, *, turned: bool, ramped: bool
) -> None:
    assert slowness(pushes, outputs, turned=turned, ramped=ramped) <= 1


@pytest.mark.parametrize("ramped", [False, True], ids=["still", "ramped"])
def test_kernels_are_vectors(*, ramped: bool) -> None:
    assert slowness(1, 1, turned=True, ramped=ramped) <= COLLAPSE


@pytest.mark.prove
@pytest.mark.parametrize("turned", [False, True], ids=["real", "complex"])
@pytest.mark.timed
def test_a_kernel_of_unit_gain_is_no_slower_than_one_that_multiplies(*, turned: bool) -> None:
    unit, multiplied = times(
        playing(1, 1, turned=turned, ramped=False, unit=True),
        playing(1, 1, turned=turned, ramped=False),
    )
    assert unit <= 1.1 * multiplied


@pytest.mark.prove
@pytest.mark.parametrize("points", [1, 2])
@pytest.mark.timed
def test_resonators_take_little_more_than_their_kernel(points: int) -> None:
    random = np.random.default_rng(4)
    resonators = Resonators([bank(random, MODES)], points=points, engine="stepped", voices=1)
    push = [Push(force=random.standard_normal(BLOCK), drive=np.ones(MODES))]
    resonators.process(push, [np.ones((points, MODES))])
    whole, alone = times(
        lambda: resonators.process(push), playing(1, points, turned=False, ramped=False)
    )
    assert whole <= 3.0 * alone


@pytest.mark.prove
@pytest.mark.timed
def test_the_block_transform_is_faster_where_it_is_chosen() -> None:
    random = np.random.default_rng(5)
    modes, block = bank(random, 4 * MODES), 512
    push = [Push(force=random.standard_normal(block), drive=np.ones(4 * MODES))]
    calls = []
    for engine in ("stepped", "auto"):
        resonators = Resonators([modes], sample_rate=RATE, block=block, engine=engine, voices=1)
        resonators.process(push, [np.ones((1, 4 * MODES))])
        calls.append(lambda resonators=resonators: resonators.process(push))
    stepped, transformed = times(*calls)
    assert transformed <= stepped
