"""Compiled variable projection: the bins of a group of modes split into their fit and a residual.

A mode that rings from the first of N samples on has the transform r / (1 - z / u) at u = exp(2 pi i
k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate belongs to it, for
samples are real.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index
from struck.synth.compiler import Compiler


class GroupBlocks(NamedTuple):
    """Blocks of all groups and segments: bins of the shortest spectrum in which the modes end."""

    members: Index  # modes of all groups, group by group
    starts: Index  # (G + 1,), where each group begins in members
    numbers: Index  # (G, S), of the blocks
    firsts: Index  # (G S + 1,), where the bins of each block begin
    offsets: Index  # (G S + 1,), where its data begin
    turns: AnyComplex  # (K,), exp(-2 pi i k / N) of all bins
    data: AnyComplex  # spectra there, (bins, channels) of each block
    lengths: Array  # (G S,), N / sample rate of the blocks, s
    weights: Array  # (C, G), one over the noise's energy in a bin
    rows: Index  # (S + 1,), where the gains of each segment begin
    sample_rate: float  # Hz


_COMPILER = Compiler.of_packages(__file__)
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within


Scalar = Any  # an element of an array


@jitted
def bins_around(
    low: Index, high: Index, members: Index, starts: Index, groups: Index
) -> tuple[Index, Index]:
    """Return the bins from low to high of any mode of each group, and their number (G,)."""
    most = 0
    for group in groups:
        for place in range(starts[group], starts[group + 1]):
            most += high[members[place]] + 1 - low[members[place]]
    bins, counts = np.empty(most, np.int64), np.empty(len(groups), np.int64)
    total = 0
    for number in range(len(groups)):
        some = members[starts[groups[number]] : starts[groups[number] + 1]]
        begun, following = total, 0
        for _ in range(len(some)):
            # The lowest of those that reach beyond the last bin.
            first, last = _next_run(low, high, some, following)
            for each in range(first, last):
                bins[total] = each
                total += 1
            following = max(following, last)
        counts[number] = total - begun
    return bins[:total], counts


@jitted_within
def _next_run(low: Index, high: Index, some: Index, following: Scalar) -> tuple[Scalar, Scalar]:
    """Return the next run of bins from `following` on; -1, -1 where there is none."""
    first, last = -1, -1
    for mode in some:
        begin, end = max(low[mode], following), high[mode] + 1
        if begin < end and (first < 0 or begin < first or (begin == first and end > last)):
            first, last = begin, end
    return first, last


@jitted
def labelled(coupling: Array, threshold: float, most: int) -> Index:
    """Return the group number of each mode: those coupled (M, M) beyond a threshold, in chains.

    Where more than `most` would belong together, their threshold is doubled.
    """
    labels = np.full(len(coupling), -1)
    thresholds = np.full(len(coupling), threshold)
    queue, count, first = np.empty(len(coupling), np.int64), 0, 0
    while first < len(coupling):
        if labels[first] >= 0:
            first += 1
            continue
        size = _reached(coupling, first, thresholds[first], labels, queue)
        for place in range(size):
            if size > most:
                thresholds[queue[place]] *= 2
            else:
                labels[queue[place]] = count
        count += size <= most
    return labels


@jitted_within
def _reached(coupling: Array, first: int, threshold: float, labels: Index, queue: Index) -> int:
    """Write which modes a free one reaches through others; return their number."""
    free = labels < 0
    queue[0], free[first] = first, False
    size, place = 1, 0
    while place < size:
        here = coupling[queue[place]]
        for other in range(len(coupling)):
            if free[other] and here[other] > threshold:
                queue[size], free[other] = other, False
                size += 1
        place += 1
    return size


# Algebra of a few complex vectors: inner products, QR factors, triangular systems.

_CANCELLED = 0.1  # share left from which no second turn is needed
_DEPENDENT = 1e-14  # least independent share of a vector


@jitted_within
def chosen(values: AnyComplex, places: Index) -> AnyComplex:
    """Return the values at some places."""
    some = np.empty(len(places), np.complex128)
    for place in range(len(places)):
        some[place] = values[places[place]]
    return some


@jitted_within
def inner(left: AnyComplex, right: AnyComplex) -> complex:
    """Return the sum of conj(left) right."""
    real, imaginary = 0.0, 0.0
    for k in range(len(left)):
        real += left[k].real * right[k].real + left[k].imag * right[k].imag
        imaginary += left[k].real * right[k].imag - left[k].imag * right[k].real
    return complex(real, imaginary)


@jitted_within
def energy(vector: AnyComplex) -> float:
    """Return the sum of squared sizes."""
    total = 0.0
    for k in range(len(vector)):
        total += vector[k].real * vector[k].real + vector[k].imag * vector[k].imag
    return total


@jitted_within
def take_off(vector: AnyComplex, factor: complex, direction: AnyComplex) -> None:
    """Subtract a multiple of a direction."""
    for k in range(len(vector)):
        vector[k] -= factor * direction[k]


@jitted_within
def take_off_all(vector: AnyComplex, basis: AnyComplex) -> None:
    """Subtract what orthonormal vectors (M, K) explain."""
    for m in range(len(basis)):
        take_off(vector, inner(basis[m], vector), basis[m])


@jitted_within
def orthonormalise(vectors: AnyComplex, basis: AnyComplex, triangle: AnyComplex) -> None:
    """Write the QR factors of vectors (M, K), never singular.

    Gram and Schmidt's way; a vector that all but cancels takes a second turn, which is enough
    (Daniel, Gragg, Kaufman and Stewart 1976).
    """
    for j in range(len(vectors)):
        for i in range(len(vectors)):
            triangle[i, j] = 0
        for k in range(len(basis[j])):
            basis[j, k] = vectors[j, k]
        whole = np.sqrt(energy(vectors[j]))
        after = whole
        for _ in range(2):
            before = after
            for i in range(j):
                part = inner(basis[i], basis[j])
                triangle[i, j] += part
                take_off(basis[j], part, basis[i])
            after = np.sqrt(energy(basis[j]))
            if after > _CANCELLED * before:
                break
        size = max(after, _DEPENDENT * whole, 1e-300)
        triangle[j, j] = size
        for k in range(len(basis[j])):
            basis[j, k] /= size


@jitted_within
def solve_triangle(triangle: AnyComplex, sides: AnyComplex) -> None:
    """Replace sides (M, C) by the solutions of an upper triangular system."""
    size, count = sides.shape
    for i in range(size - 1, -1, -1):
        over = 1 / triangle[i, i].real
        for j in range(i + 1, size):
            for c in range(count):
                sides[i, c] -= triangle[i, j] * sides[j, c]
        for c in range(count):
            sides[i, c] *= over


@jitted_within
def inverse_spreads(triangle: AnyComplex) -> Array:
    """Return the diagonal of the inverse Gram matrix, from the factor of QR."""
    size = len(triangle)
    inverse, spreads = np.zeros((size, size), np.complex128), np.empty(size)
    for i in range(size):
        inverse[i, i] = 1
    solve_triangle(triangle, inverse)
    for i in range(size):
        spreads[i] = energy(inverse[i])
    return spreads


@jitted_within
def solve_damped(matrix: AnyComplex, damping: float, side: AnyComplex) -> AnyComplex:
    """Solve a Hermitian system with its diagonal raised by a share, by Cholesky's L L^H."""
    size = len(matrix)
    factor, solved = np.zeros_like(matrix), side.copy()
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j] * (1 + damping if i == j else 1.0)
            for k in range(j):
                total -= factor[i, k] * np.conj(factor[j, k])
            if i == j:
                factor[i, i] = np.sqrt(max(total.real, 1e-300))
            else:
                factor[i, j] = total / factor[j, j].real
        for k in range(i):
            solved[i] -= factor[i, k] * solved[k]
        solved[i] /= factor[i, i].real
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            solved[i] -= np.conj(factor[k, i]) * solved[k]
        solved[i] /= factor[i, i].real
    return solved


_CHANCE = 3.0  # standard deviations of the mean energy that a bin of noise leaves


class Projection(NamedTuple):
    """Least-squares fit of M modes to a group's blocks; arrays hold those of all S segments."""

    lines: AnyComplex  # (M, K) of each block, spectra of the modes without r
    basis: AnyComplex  # (M, K) of each block, their orthonormal factors
    triangles: AnyComplex  # (S, M, M), their triangular factors
    residues: AnyComplex  # (M, C), least-squares factors r of the lines
    left: AnyComplex  # (C, K) of each block, residual of the data


@jitted_within
def empty_projection(blocks: GroupBlocks, group: int, modes: int) -> Projection:
    """Return empty arrays for the projection of a group."""
    bins, data, segments = 0, 0, blocks.numbers.shape[1]
    for number in blocks.numbers[group]:
        bins += blocks.firsts[number + 1] - blocks.firsts[number]
        data += blocks.offsets[number + 1] - blocks.offsets[number]
    return Projection(
        np.empty(modes * bins, np.complex128),
        np.empty(modes * bins, np.complex128),
        np.empty((segments, modes, modes), np.complex128),
        np.empty((modes, blocks.rows[-1]), np.complex128),
        np.empty(data, np.complex128),
    )


@jitted_within
def rows_of(array: AnyComplex, first: int, rows: int, length: int) -> AnyComplex:
    """Return a view (rows, length) of an array from one place on."""
    return array[first : first + rows * length].reshape((rows, length))


@jitted_within
def turns_of(blocks: GroupBlocks, number: int) -> AnyComplex:
    """Return exp(-2 pi i k / N) of the bins of a block."""
    return blocks.turns[blocks.firsts[number] : blocks.firsts[number + 1]]


@jitted_within
def span(pole: Scalar, length: Scalar) -> complex:
    """Return (1 - z^N) / 2i, the ratio of residue to gain."""
    return (1 - np.exp(pole * length)) / 2j


@jitted_within
def write_line(turns: AnyComplex, ratio: Scalar, line: AnyComplex) -> None:
    """Write 1 / (1 - z / u)."""
    for k in range(len(turns)):
        real = 1 - (turns[k].real * ratio.real - turns[k].imag * ratio.imag)
        imaginary = turns[k].real * ratio.imag + turns[k].imag * ratio.real
        over = 1 / (real * real + imaginary * imaginary)
        line[k] = complex(real * over, imaginary * over)


@jitted_within
def write_lines(
    turns: AnyComplex, poles: AnyComplex, sample_rate: float, lines: AnyComplex
) -> None:
    """Write the lines of modes (M, K)."""
    for m in range(len(poles)):
        write_line(turns, np.exp(poles[m] / sample_rate), lines[m])


@jitted_within
def project(
    blocks: GroupBlocks, group: int, data: AnyComplex, poles: AnyComplex, projection: Projection
) -> float:
    """Fit the lines of poles to a group's cleared data; return the residual over a bin's noise."""
    modes, line, datum, cost = len(poles), 0, 0, 0.0
    for segment in range(blocks.numbers.shape[1]):
        turns = turns_of(blocks, blocks.numbers[group, segment])
        first, last = blocks.rows[segment], blocks.rows[segment + 1]
        lines = rows_of(projection.lines, line, modes, len(turns))
        basis = rows_of(projection.basis, line, modes, len(turns))
        left = rows_of(projection.left, datum, last - first, len(turns))
        whole = rows_of(data, datum, last - first, len(turns))
        write_lines(turns, poles, blocks.sample_rate, lines)
        orthonormalise(lines, basis, projection.triangles[segment])
        residues = projection.residues[:, first:last]
        for c in range(len(left)):
            for k in range(len(turns)):
                left[c, k] = whole[c, k]
            for m in range(modes):
                residues[m, c] = inner(basis[m], left[c])
                take_off(left[c], residues[m, c], basis[m])
            cost += blocks.weights[first + c, group] * energy(left[c])
        solve_triangle(projection.triangles[segment], residues)
        line += modes * len(turns)
        datum += left.size
    return cost


@jitted_within
def misfit(projection: Projection, cost: float) -> float:
    """Return the residual of a bin and channel, noise being 1; 1 where chance may explain it."""
    unknowns = projection.residues.size + len(projection.residues)
    values = max(len(projection.left) - unknowns, 1)
    left = cost / values
    return left if left > 1 + _CHANCE / np.sqrt(values) else 1.0


@jitted_within
def cleared(blocks: GroupBlocks, group: int, poles: AnyComplex, gains: AnyComplex) -> AnyComplex:
    """Return the data of a group, (C, K) of each block, less all other modes."""
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
    """Return the numbers of all other modes."""
    others, size = np.empty(count, np.int64), 0
    for mode in range(count):
        outside = True
        for member in members:
            outside = outside and member != mode
        others[size] = mode
        size += outside
    return others[:size]


@jitted_within
def _read(values: AnyComplex, block: AnyComplex) -> None:
    channels, bins = block.shape
    for k in range(bins):
        for c in range(channels):
            block[c, k] = values[k * channels + c]


@jitted_within
def _take_off_others(
    turns: AnyComplex,
    modes: Index,
    poles: AnyComplex,
    gains: AnyComplex,
    length: Scalar,
    interval: float,
    block: AnyComplex,
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
def _write_shape(turns: AnyComplex, ratio: Scalar, real: Array, imaginary: Array) -> None:
    """Write the real and minus the imaginary part of 1 / ((1 - z / u) (u - conj(z)))."""
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
    turns: AnyComplex,
    modes: Index,
    poles: AnyComplex,
    gains: AnyComplex,
    length: Scalar,
    interval: float,
    block: AnyComplex,
) -> None:
    """Subtract the spectra of the conjugate poles at positive frequencies."""
    line = np.empty(len(turns), np.complex128)
    for mode in modes:
        write_line(turns, np.exp(np.conj(poles[mode]) * interval), line)
        for c in range(len(block)):
            take_off(block[c], np.conj(gains[c, mode] * span(poles[mode], length)), line)
