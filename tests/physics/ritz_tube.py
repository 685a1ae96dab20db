"""Free tubes by Rayleigh and Ritz: three-dimensional elasticity without finite elements.

Displacements are U cos(m a), V sin(m a), W cos(m a) in the radial, circumferential and axial
directions, with U, V and W products of Legendre polynomials in radius and height. It shares no
line with the package, and converges exponentially.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.polynomial import Legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Polynomials:
    """Legendre polynomials up to a degree between two ends, at Gauss points."""

    def __init__(self, degree: int, low: float, high: float) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(degree + 8)
        self.at = (low + high + (high - low) * nodes) / 2
        self.weights = weights * (high - low) / 2
        family = [Legendre.basis(k, domain=[low, high]) for k in range(degree + 1)]
        self.values = np.array([member(self.at) for member in family])
        self.slopes = np.array([member.deriv()(self.at) for member in family])


def tube_frequencies(
    length: float,
    radius: float,
    wall: float,
    lame: tuple[float, float],
    density: float,
    *,
    order: int,
    count: int,
    degrees: tuple[int, int] = (3, 24),
) -> Array:
    """Return the lowest frequencies of a free tube, rigid motions included, Hz.

    Parameters
    ----------
    length, radius, wall : float
        m; the radius is the outer one.
    lame : pair of float
        Lame's constants, Pa.
    density : float
        kg/m^3.
    order : int
        Waves around: 1 for bending, 2 and more for ovals.
    count : int
        How many.
    degrees : pair of int
        Of the polynomials in radius and height.
    """
    r = Polynomials(degrees[0], radius - wall, radius)
    z = Polynomials(degrees[1], -length / 2, length / 2)
    stiffness = _stiffness(r, z, order, *lame)
    mass = density * np.kron(np.eye(3), _product(r, z, (r.values, z.values), (r.values, z.values)))
    squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, count - 1])
    return np.sqrt(np.abs(squares)) / (2 * np.pi)


def _strains(r: Polynomials, z: Polynomials, m: int) -> dict[str, list[tuple[int, Array, Array]]]:
    """Return each strain as a sum of (component, function of radius, function of height)."""
    over_r = r.values / r.at
    return {
        "rr": [(0, r.slopes, z.values)],
        "aa": [(0, over_r, z.values), (1, m * over_r, z.values)],
        "zz": [(2, r.values, z.slopes)],
        "ra": [(1, r.slopes - over_r, z.values), (0, -m * over_r, z.values)],
        "az": [(1, r.values, z.slopes), (2, -m * over_r, z.values)],
        "rz": [(0, r.values, z.slopes), (2, r.slopes, z.values)],
    }


def _stiffness(r: Polynomials, z: Polynomials, m: int, first: float, shear: float) -> Array:
    strains = _strains(r, z, m)
    normal = ("rr", "aa", "zz")
    terms = [(a, b, first + 2 * shear * (a == b)) for a in normal for b in normal]
    terms += [(a, a, shear) for a in ("ra", "az", "rz")]
    size = len(r.values) * len(z.values)
    blocks = np.zeros((3, size, 3, size))
    for left, right, modulus in terms:
        for i, *one in strains[left]:
            for j, *other in strains[right]:
                blocks[i, :, j] += modulus * _product(r, z, one, other)
    return blocks.reshape(3 * size, 3 * size)


def _product(r: Polynomials, z: Polynomials, one: list[Array], other: list[Array]) -> Array:
    """Integrate products of functions of radius and height over the meridian section."""
    across = (one[0] * (r.weights * r.at)) @ other[0].T
    along = (one[1] * z.weights) @ other[1].T
    return np.kron(across, along)
