"""Compiled algebra of a few complex vectors: inner products, QR factors, triangular systems."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.compiling import jitted_within

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_CANCELLED = 0.1
_DEPENDENT = 1e-14
"""A vector that others explain but for this counts as independent by so much."""


@jitted_within
def chosen(values: Complex, places: Index) -> Complex:
    """Return the values at some places."""
    some = np.empty(len(places), np.complex128)
    for place in range(len(places)):
        some[place] = values[places[place]]
    return some


@jitted_within
def inner(left: Complex, right: Complex) -> complex:
    """Return the sum of conj(left) right."""
    real, imaginary = 0.0, 0.0
    for k in range(len(left)):
        real += left[k].real * right[k].real + left[k].imag * right[k].imag
        imaginary += left[k].real * right[k].imag - left[k].imag * right[k].real
    return complex(real, imaginary)


@jitted_within
def energy(vector: Complex) -> float:
    """Return the sum of squared sizes."""
    total = 0.0
    for k in range(len(vector)):
        total += vector[k].real * vector[k].real + vector[k].imag * vector[k].imag
    return total


@jitted_within
def take_off(vector: Complex, factor: complex, direction: Complex) -> None:
    """Subtract a multiple of a direction."""
    for k in range(len(vector)):
        vector[k] -= factor * direction[k]


@jitted_within
def take_off_all(vector: Complex, basis: Complex) -> None:
    """Subtract what orthonormal vectors (M, K) explain."""
    for m in range(len(basis)):
        take_off(vector, inner(basis[m], vector), basis[m])


@jitted_within
def orthonormalise(vectors: Complex, basis: Complex, triangle: Complex) -> None:
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
def solve_triangle(triangle: Complex, sides: Complex) -> None:
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
def inverse_spreads(triangle: Complex) -> Array:
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
def solve_damped(matrix: Complex, damping: float, side: Complex) -> Complex:
    """Solve a Hermitian system whose diagonal grows by a share, by Cholesky's factors L L^H."""
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
