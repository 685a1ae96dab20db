"""Spherical waves: harmonics over directions, and how well each order radiates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import jv, sph_legendre_p_all, yv

Array = NDArray[np.float64]

HIGHEST_ORDER = 12
"""Order up to which a velocity is split; what is left radiates as one order above."""

# Functions of direction that others already make up to rounding add nothing of their own.
_DEPENDENT = 1e-10


def sphere_efficiency(order: ArrayLike, ka: ArrayLike) -> Array:
    """Return the radiation efficiency of a spherical order (Williams 1999, chapter 6).

    A sphere whose normal velocity is a harmonic of one order n radiates sigma rho c S <v^2>, with
    <v^2> the mean square over surface and time, and sigma = 1 / |x h_n'(x)|^2 at x = ka.

    Parameters
    ----------
    order : array_like
        Any real order of at least 0.
    ka : array_like
        Wave number times radius, above 0.

    Returns
    -------
    array
        From 0 (also where it is smaller than the smallest number) to somewhat above 1.
    """
    degree, x = np.asarray(order, float), np.asarray(ka, float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        slope = _hankel(degree - 1, x) - (degree + 1) / x * _hankel(degree, x)
        efficiency = 1 / np.square(x * np.abs(slope))
    return np.where(np.isfinite(efficiency), efficiency, 0.0)  # |h'| beyond the largest number


def _hankel(order: Array, x: Array) -> NDArray[np.complex128]:
    """Return the spherical Hankel function of the first kind of a real order."""
    return np.sqrt(np.pi / (2 * x)) * (jv(order + 0.5, x) + 1j * yv(order + 0.5, x))


def harmonics(directions: Array, highest: int) -> tuple[Array, NDArray[np.int64]]:
    """Return real spherical harmonics at some directions.

    Parameters
    ----------
    directions : array (K, 3)
        Of any length but 0.
    highest : int
        Highest order.

    Returns
    -------
    values : array (K, (highest + 1)^2)
        Of no particular normalisation.
    orders : array ((highest + 1)^2,)
        The order of each, ascending.
    """
    x, y, z = directions.T
    polar, azimuth = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    meridians = sph_legendre_p_all(highest, highest, polar)[0]
    values = np.empty((len(directions), (highest + 1) ** 2))
    for rank in range(highest + 1):
        cosine, sine = np.cos(rank * azimuth), np.sin(rank * azimuth)
        for order in range(rank, highest + 1):
            middle = order * (order + 1)
            values[:, middle - rank] = meridians[order, rank] * sine
            values[:, middle + rank] = meridians[order, rank] * cosine  # last: rank 0 has no sine
    numbers = np.arange(highest + 1)
    return values, np.repeat(numbers, 2 * numbers + 1)


def split_by_order(
    directions: Array, weights: Array, velocities: Array, highest: int = HIGHEST_ORDER
) -> tuple[Array, Array]:
    """Split velocities over directions into spherical orders.

    The harmonics are made orthonormal in the body's own measure, order after order, so the share
    of order n is what its harmonics explain beyond the lower orders: the shares never exceed the
    whole, do not change when the body is turned, and are the usual ones on a sphere.

    Parameters
    ----------
    directions : array (F, 3)
        From the centre to each face.
    weights : array (F,)
        Shares of the faces in the area, above 0; they add up to 1.
    velocities : array (F, M)
        Normal velocities.
    highest : int
        Highest order N.

    Returns
    -------
    powers : array (N + 1, M)
        Share of each order in the weighted mean square, in the unit of velocity squared.
    rest : array (F, M)
        What no order up to N explains.
    """
    roots = np.sqrt(weights)[:, None]
    values, orders = harmonics(directions, highest)
    values *= roots
    smallest = _DEPENDENT * np.linalg.norm(values, axis=0).max()
    basis, members = np.empty_like(values), np.empty(0, int)
    for order in range(highest + 1):
        fresh = _beyond(basis[:, : len(members)], values[:, orders == order], smallest)
        basis[:, len(members) : len(members) + fresh.shape[1]] = fresh
        members = np.append(members, np.full(fresh.shape[1], order))
    basis = basis[:, : len(members)]
    moving = roots * velocities
    parts = basis.T @ moving
    powers = (members == np.arange(highest + 1)[:, None]).astype(float) @ np.square(parts)
    return powers, (moving - basis @ parts) / roots


def _beyond(basis: Array, block: Array, smallest: float) -> Array:
    """Return an orthonormal basis of what `block` (F, B) adds to an orthonormal `basis` (F, K)."""
    for _ in range(2):  # once leaves rounding of the size of what may be left
        block = block - basis @ (basis.T @ block)
    fresh, heights, _ = np.linalg.svd(block, full_matrices=False)
    return fresh[:, heights > smallest]
