"""Compiled: the bins of a group without all other modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.compiling import jitted_within
from struck.recordings.poles.kernels.vectors import take_off
from struck.recordings.poles.projection import rows_of, span, turns_of, write_line

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]
Scalar = Any
"""An element of an array."""


@jitted_within
def cleared(blocks: Blocks, group: int, poles: Complex, gains: Complex) -> Complex:
    """Return the data of a group, (C, K) of each block, less all other modes.

    Parameters
    ----------
    blocks : Blocks
        Of the group and others.
    group : int
        Which.
    poles : array (M,)
        Of all modes.
    gains : array (C, M)
        Of all modes in all segments.
    """
    members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
    others = _without(members, len(poles))
    size = 0
    for number in blocks.numbers[group]:
        size += blocks.offsets[number + 1] - blocks.offsets[number]
    data, first = np.empty(size, np.complex128), 0
    for segment in range(blocks.numbers.shape[1]):
        number = blocks.numbers[group, segment]
        turns = turns_of(blocks, number)
        own = gains[blocks.rows[segment] : blocks.rows[segment + 1]]
        block = rows_of(data, first, len(own), len(turns))
        _read(blocks.data[blocks.offsets[number] :], block)
        length, interval = blocks.lengths[number], 1 / blocks.sample_rate
        _take_off_others(turns, others, poles, own, length, interval, block)
        _take_off_mirrored(turns, members, poles, own, length, interval, block)
        first += block.size
    return data


@jitted_within
def _without(members: Index, count: int) -> Index:
    """Return all other modes."""
    others, size = np.empty(count, np.int64), 0
    for mode in range(count):
        outside = True
        for member in members:
            outside = outside and member != mode
        others[size] = mode
        size += outside
    return others[:size]


@jitted_within
def _read(values: Complex, block: Complex) -> None:
    channels, bins = block.shape
    for k in range(bins):
        for c in range(channels):
            block[c, k] = values[k * channels + c]


@jitted_within
def _take_off_others(
    turns: Complex,
    modes: Index,
    poles: Complex,
    gains: Complex,
    length: Scalar,
    interval: float,
    block: Complex,
) -> None:
    """Subtract modes with their conjugates.

    r / (1 - z / u) and its conjugate's line over one denominator: sums of real products.
    """
    channels, bins = block.shape
    real, imaginary = np.empty(bins), np.empty(bins)
    turned, still = np.zeros((channels, 2, bins)), np.zeros((channels, 2, bins))
    for mode in modes:
        ratio = np.exp(poles[mode] * interval)
        _write_shape(turns, ratio, real, imaginary)
        over = span(poles[mode], length)
        for c in range(channels):
            residue = 2 * gains[c, mode] * over
            _add_products(residue.real, real, imaginary, turned[c])
            _add_products((residue * np.conj(ratio)).real, real, imaginary, still[c])
    for c in range(channels):
        for k in range(bins):
            whole = np.conj(turns[k]) * complex(turned[c, 0, k], -turned[c, 1, k])
            block[c, k] -= whole - complex(still[c, 0, k], -still[c, 1, k])


@jitted_within
def _write_shape(turns: Complex, ratio: Scalar, real: Array, imaginary: Array) -> None:
    """Write 1 / ((1 - z / u) (u - conj(z))): real part, less the other."""
    square = ratio.real * ratio.real + ratio.imag * ratio.imag
    more, less, twice = 1 + square, 1 - square, 2 * ratio.real
    for k in range(len(turns)):
        a = more * turns[k].real - twice
        b = -less * turns[k].imag
        over = 1 / (a * a + b * b)
        real[k] = a * over
        imaginary[k] = b * over


@jitted_within
def _add_products(factor: float, real: Array, imaginary: Array, sums: Array) -> None:
    for k in range(len(real)):
        sums[0, k] += factor * real[k]
        sums[1, k] += factor * imaginary[k]


@jitted_within
def _take_off_mirrored(
    turns: Complex,
    modes: Index,
    poles: Complex,
    gains: Complex,
    length: Scalar,
    interval: float,
    block: Complex,
) -> None:
    """Subtract what the conjugate poles add at positive frequencies."""
    line = np.empty(len(turns), np.complex128)
    for mode in modes:
        write_line(turns, np.exp(np.conj(poles[mode]) * interval), line)
        for c in range(len(block)):
            take_off(block[c], np.conj(gains[c, mode] * span(poles[mode], length)), line)
