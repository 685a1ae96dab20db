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

MODES_AT_ONCE = 8
"""Modes whose sums fill a vector when a force is collected: the padding of rows of weights."""
LONGEST_RUN = 64
"""Modes summed in single precision before the sum goes to double."""
FORCES_AT_ONCE = 8
"""Samples of a force that are convolved together."""
REACH = 3
"""Frequencies of the grid below the bin of a mode that it touches; above it there is one more."""


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
        Sums of x W and of y W; what was there is forgotten.
    """
    straight[:] = 0.0
    turned[:] = 0.0
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
    weights: Single, bins: Index, straight: Single, turned: Single, collected: Single
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
def _pair(weights: Single, bins: Index, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of two modes, folded to four numbers each sum."""
    first = _mode(weights, bins, straight, turned, n)
    return folded(first, _mode(weights, bins, straight, turned, n + 1), 8)


@jitted
def _mode(weights: Single, bins: Index, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of one mode, folded to eight numbers each sum."""
    row = load(weights, 16 * n)
    first = multiply(row, load(straight, bins[n]))
    return folded(first, multiply(row, load(turned, bins[n])), 16)


@jitted
def grids_of(
    states: Complex,
    outputs: Array | Complex,
    weights: Single,
    runs: Index,
    places: Index,
    values: Single,
    grid: Array,
    spectra: Complex,
) -> None:
    """Find the spectra of what the modes sound like at each output.

    Parameters
    ----------
    states : array (N,)
    outputs : array (L, N)
        Gains, complex or real.
    weights, runs, places
        As for `spread`.
    values : array (2 N,)
        Room for states times outputs.
    grid : array (2, G)
        Room for sums on the grid.
    spectra : array (L, C, H + 1)
        The result, as `fold` tells.
    """
    for output in range(outputs.shape[0]):
        for n in range(states.size):
            heard = states[n] * outputs[output, n]
            values[2 * n] = np.float32(heard.real)
            values[2 * n + 1] = np.float32(heard.imag)
        spread(values, weights, runs, places, grid[0], grid[1])
        fold(grid[0], grid[1], spectra[output])


@jitted
def fold(straight: Array, turned: Array, spectra: Complex) -> None:
    """Turn sums of x W and y W on the grid into the spectrum of the real samples Im[...].

    Parameters
    ----------
    straight, turned : array (2 C (H + 7) + 16,)
        For each class the sums at the frequencies -3 to H + 3, real and imaginary parts
        alternating; H is half the length of the transform.
    spectra : array (C, H + 1)
        The spectrum at 0 to H, what lies outside folded back.
    """
    highest = spectra.shape[1] - 1
    spectra[:] = 0.0
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            real, imaginary = straight[i] - turned[i + 1], straight[i + 1] + turned[i]
            value = 0.5 * complex(imaginary, -real)
            if 0 <= k <= highest:
                spectra[c, k] += value
            if k <= 0:
                spectra[c, -k] += value.conjugate()
            if k >= highest:
                spectra[c, 2 * highest - k] += value.conjugate()


@jitted
def unfold(spectra: Complex, straight: Single, turned: Single) -> None:
    """Write the conjugate of a force's spectrum on the grid that `gather` reads.

    Parameters
    ----------
    spectra : array (C, H + 1)
        At the frequencies 0 to H.
    straight, turned : array (2 C (H + 7) + 16,)
        The grid as (real, -imaginary) and as (imaginary, real).
    """
    highest = spectra.shape[1] - 1
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            inside = 0 <= k <= highest
            mirrored = -k if k < 0 else 2 * highest - k
            value = spectra[c, k].conjugate() if inside else spectra[c, mirrored]
            straight[i], straight[i + 1] = value.real, -value.imag
            turned[i], turned[i + 1] = value.imag, value.real


@jitted
def reverse(force: Array, openings: Array, backwards: Array) -> None:
    """Write the force backwards in time, F[B - t] at t = 1 to B, times the opening of each class.

    Parameters
    ----------
    force : array (B,)
    openings : array (C, B + 1)
    backwards : array (C, M)
        The result; outside t = 1 to B it stays as it is.
    """
    block = force.size
    for c in range(openings.shape[0]):
        for t in range(1, block + 1):
            backwards[c, t] = force[block - t] * openings[c, t]


@jitted
def close(samples: Array, openings: Array, into: Array) -> None:
    """Add the samples of all classes, each times its opening.

    Parameters
    ----------
    samples : array (L, C, M)
    openings : array (C, B + 1)
    into : array (L, B)
    """
    for output in range(into.shape[0]):
        for c in range(openings.shape[0]):
            for t in range(into.shape[1]):
                into[output, t] += samples[output, c, t] * openings[c, t]


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
def convolve(force: Array, answer: Array, past: Array, into: Array) -> None:
    """Add the answer to a force within the block.

    Parameters
    ----------
    force, answer, into : array (B,)
    past : array (B + 8,)
        Room for the answer; its first eight samples are zero: nothing is heard before the force.
    """
    block = force.size
    past[8 : 8 + block] = answer
    whole = block - block % 8
    for first in range(0, whole, 8):
        f0, f1, f2, f3 = force[first], force[first + 1], force[first + 2], force[first + 3]
        f4, f5, f6, f7 = force[first + 4], force[first + 5], force[first + 6], force[first + 7]
        for t in range(block - first):
            early = f0 * past[t + 8] + f1 * past[t + 7] + f2 * past[t + 6] + f3 * past[t + 5]
            late = f4 * past[t + 4] + f5 * past[t + 3] + f6 * past[t + 2] + f7 * past[t + 1]
            into[first + t] += early + late
    for first in range(whole, block):
        for t in range(first, block):
            into[t] += force[first] * answer[t - first]
