"""The loops of the block transform over modes, compiled.

A mode is sixteen numbers: the real and imaginary parts of its eight weights, alternating. Its state
is x + i y, so that it adds x W + i y W to eight neighbours on the grid of frequencies: all modes of
a bin are summed into two vectors, one of x W and one of y W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.synth.compiling import jitted
from struck.synth.vectors import accumulate, add, folded, load, multiply, scaled, store, zeros

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]
Places = NDArray[np.int32]

STRETCH = 512
"""Modes that are moved on while what was collected for them is still near the core."""
MODES_AT_ONCE = 8
"""Modes whose sums fill a vector when a force is collected: the padding of rows of weights."""
LONGEST_RUN = 64
"""Modes summed in single precision before the sum goes to double."""


@jitted
def spread(
    values: Single,
    weights: Single,
    runs: Index,
    places: Index,
    straight: Array,
    turned: Array,
) -> None:
    """Sum the weights of all modes on the grid, times the real and the imaginary parts of values.

    Parameters
    ----------
    values : array (2 N,)
        Real and imaginary parts, alternating.
    weights : array (16 N,)
        Rows of weights.
    runs : array (R + 1,)
        Where the runs begin; the modes of a run share a bin.
    places : array (R,)
        Where the sums of a run belong.
    straight, turned : array
        Sums of x W and of y W: added to.
    """
    for run in range(places.size):
        n, end = runs[run], runs[run + 1]
        x_even = y_even = x_odd = y_odd = zeros()
        while n + 1 < end:
            even = load(weights, 16 * n)
            odd = load(weights, 16 * n + 16)
            x_even = scaled(values[2 * n], even, x_even)
            y_even = scaled(values[2 * n + 1], even, y_even)
            x_odd = scaled(values[2 * n + 2], odd, x_odd)
            y_odd = scaled(values[2 * n + 3], odd, y_odd)
            n += 2
        if n < end:
            last = load(weights, 16 * n)
            x_even = scaled(values[2 * n], last, x_even)
            y_even = scaled(values[2 * n + 1], last, y_even)
        accumulate(straight, places[run], add(x_even, x_odd))
        accumulate(turned, places[run], add(y_even, y_odd))


@jitted
def gather(
    weights: Single,
    bins: Places,
    straight: Single,
    turned: Single,
    collected: Single,
) -> None:
    """Read the grid back: for each mode the sums of W times `straight` and of W times `turned`.

    Parameters
    ----------
    weights : array (16 N,)
        Rows of weights, N a multiple of `MODES_AT_ONCE`.
    bins : array (N,)
        Where the neighbours of a mode begin.
    straight, turned : array
        The grid, its real and imaginary parts alternating, and the grid times -i, conjugate.
    collected : array (2 N,)
        The sums, alternating.
    """
    for n in range(0, bins.size, 8):
        first = folded(
            _pair(weights, bins, straight, turned, n),
            _pair(weights, bins, straight, turned, n + 2),
            4,
        )
        second = folded(
            _pair(weights, bins, straight, turned, n + 4),
            _pair(weights, bins, straight, turned, n + 6),
            4,
        )
        store(collected, 2 * n, folded(first, second, 2))


@jitted
def _pair(weights: Single, bins: Places, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of two modes, folded to four numbers each sum."""
    first = _mode(weights, bins, straight, turned, n)
    return folded(first, _mode(weights, bins, straight, turned, n + 1), 8)


@jitted
def _mode(weights: Single, bins: Places, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of one mode, folded to eight numbers each sum."""
    row = load(weights, 16 * n)
    first = multiply(row, load(straight, bins[n]))
    return folded(first, multiply(row, load(turned, bins[n])), 16)


@jitted
def sum_up(
    states: Complex,
    outputs: Array | Complex,
    weights: Single,
    runs: Index,
    places: Index,
    values: Single,
    grids: Array,
) -> None:
    """Sum on the grid what the modes of some runs sound like at each output.

    Parameters
    ----------
    states : array (N,)
    outputs : array (L, N)
        Gains, complex or real.
    weights, runs, places
        As for `spread`.
    values : array (2 N,)
        Room for states times outputs.
    grids : array (L, 2, G)
        Added to: `straight` and `turned` of each output.
    """
    first, end = runs[0], runs[-1]
    some, room = states[first:end], values[2 * first : 2 * end]
    for output in range(outputs.shape[0]):
        gains = outputs[output, first:end]
        for n in range(some.size):
            heard = some[n] * gains[n]
            room[2 * n] = np.float32(heard.real)
            room[2 * n + 1] = np.float32(heard.imag)
        spread(values, weights, runs, places, grids[output, 0], grids[output, 1])


@jitted
def advance(states: Complex, steps: Complex) -> None:
    """Multiply states by steps."""
    for n in range(states.size):
        states[n] *= steps[n]


@jitted
def absorb(states: Complex, drive: Array | Complex, collected: Single) -> None:
    """Add to states drive times what was collected from the force."""
    for n in range(states.size):
        states[n] += drive[n] * complex(collected[2 * n], collected[2 * n + 1])


@jitted
def step(
    states: Complex,
    steps: Complex,
    drive: Array | Complex,
    outputs: Array | Complex,
    weights: Single,
    bins: Places,
    runs: Index,
    places: Index,
    force: tuple[Single, Single],
    collected: Single,
    values: Single,
    grids: Array,
) -> None:
    """Do `advance`, `gather`, `absorb` and `sum_up`, some modes after others.

    So weights and states come from memory, slower than the core, once a block. Without a drive no
    force is absorbed.
    """
    grids[:] = 0.0
    run = 0
    for first in range(0, states.size, STRETCH):
        end = min(first + STRETCH, states.size)
        advance(states[first:end], steps[first:end])
        if drive.size:
            some = bins[first : first + STRETCH]
            gather(weights[16 * first :], some, force[0], force[1], collected)
            absorb(states[first:end], drive[first:end], collected)
        next_run = run
        while next_run < places.size and runs[next_run + 1] <= end:
            next_run += 1
        some_runs = runs[run : next_run + 1]
        sum_up(states, outputs, weights, some_runs, places[run:next_run], values, grids)
        run = next_run
