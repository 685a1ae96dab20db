"""No loop is slow by accident: a harmless edit can keep the compiler from making vectors.

That costs 4 to 15 times. What is measured is the least time of some turns, beside NumPy's product
of a matrix and a vector, which has to load what it multiplies. Ratios as measured are for a quiet
machine (`make prove`); the ordinary suite catches a collapse alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from struck.excitation.excitation import Push
from struck.synth.resonators import Resonators
from tests.synth.scenes import bank
from tests.yardstick import fastest

MODES, BLOCK = 2048, 128
SHAPE = (64, 1024)
TURNS = 50
COLLAPSE = 3.0
"""How many times slower than measured the ordinary suite allows."""


def playing(
    pushes: int, outputs: int, *, turned: bool = False, ramped: bool = False
) -> Callable[[], object]:
    """Return a call that makes a block of all modes, by Python's own road."""
    random = np.random.default_rng(2)
    resonators = Resonators([bank(random, MODES)], points=outputs, voices=4)
    gains = [random.uniform(0.5, 1.0, (outputs, MODES)) + 1j * turned for _ in range(2)]
    forces = random.standard_normal((pushes, BLOCK))
    drives = np.ones((pushes, MODES))
    push = [
        Push(force=f, drive=d, voice=n) for n, (f, d) in enumerate(zip(forces, drives, strict=True))
    ]
    resonators.process(push, [gains[0]])
    turn = iter(range(10**9))
    if not ramped:
        return lambda: resonators.process(push)
    return lambda: resonators.process(push, [gains[next(turn) % 2]])


def slowness(pushes: int, outputs: int, *, turned: bool, ramped: bool) -> float:
    """Return the time of an operation of a mode over that of NumPy's."""
    random = np.random.default_rng(1)
    matrix, vector = random.standard_normal(SHAPE), random.standard_normal(SHAPE[1])
    sums = np.zeros(SHAPE[0])
    numpy = fastest(lambda: np.matmul(matrix, vector, out=sums), TURNS) / matrix.size
    gains = pushes + outputs * (2 if turned else 1)
    operations = (2 + gains * (2 if ramped else 1)) * BLOCK * MODES
    played = fastest(playing(pushes, outputs, turned=turned, ramped=ramped), TURNS)
    return played / operations / numpy


@pytest.mark.prove
@pytest.mark.timed
@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("pushes", [1, 2, 4])
@pytest.mark.parametrize("turned", [False, True], ids=["real", "complex"])
@pytest.mark.parametrize("ramped", [False, True], ids=["still", "ramped"])
def test_the_bank_multiplies_no_slower_than_numpy(
    outputs: int, pushes: int, *, turned: bool, ramped: bool
) -> None:
    assert slowness(pushes, outputs, turned=turned, ramped=ramped) <= 1


@pytest.mark.parametrize("ramped", [False, True], ids=["still", "ramped"])
def test_loops_are_vectors(*, ramped: bool) -> None:
    assert slowness(1, 1, turned=True, ramped=ramped) <= COLLAPSE
