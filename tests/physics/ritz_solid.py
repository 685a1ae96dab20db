"""Free blocks, plates and rods by Rayleigh and Ritz: solids of one section along their height.

Displacements are products of Legendre polynomials in x, y and z (Visscher et al. 1991, J. Acoust.
Soc. Am. 90:2154, with monomials), sorted by parity about the three planes of symmetry. Along the
edges of a thin plate, twist leaves a layer that decays as exp(-pi distance / thickness), in which
polynomials converge slowly: there, what they miss of this function joins them. It shares no line
with the package.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray

from struck import Material

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Of a function's norm: where the others leave less of it than this, rounding is what is left.
_LEAST_LEFT = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Orthonormal functions from -1 to 1: Legendre polynomials, and what they miss of decays.

    Products of two families multiply their condition: unless each is orthonormal, the mass matrix
    of a section is nearly singular, and whether it can be factored is up to the machine's rounding.

    Parameters
    ----------
    degree : int
    decays : tuple of float
        Of an odd and an even function each, over half the length.
    """

    degree: int
    decays: tuple[float, ...] = ()

    @property
    def parities(self) -> Index:
        """0 for even functions, 1 for odd ones."""
        return _mixture(self)[1]

    @property
    def rule(self) -> tuple[Array, Array]:
        """Gauss points and weights that integrate products of two."""
        return legendre.leggauss(self.degree + (50 if self.decays else 2))

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return values and slopes (functions, points)."""
        values, slopes = self.unmixed(points)
        mixture, _ = _mixture(self)
        return mixture @ values, mixture @ slopes

    def unmixed(self, points: Array) -> tuple[Array, Array]:
        """Return values and slopes of normal polynomials and, as they are, of the decays."""
        unit = np.diag(np.sqrt(np.arange(self.degree + 1) + 0.5))
        values = [legendre.legval(points, unit)]
        slopes = [legendre.legval(points, legendre.legder(unit))]
        for k in self.decays:
            up, down = np.exp(k * (points - 1)), np.exp(-k * (points + 1))
            values.append(np.array([up - down, up + down]))
            slopes.append(k * np.array([up + down, up - down]))
        return np.vstack(values), np.vstack(slopes)


@cache
def _mixture(family: Family) -> tuple[Array, Index]:
    """Return how orthonormal functions mix the others (functions, unmixed), and their parities."""
    at, weights = family.rule
    values = family.unmixed(at)[0] * np.sqrt(weights)
    count = family.degree + 1
    mixtures, parities = [np.eye(count, len(values))], [np.arange(count) % 2]
    for parity in (1, 0):
        polynomials = np.arange(parity, count, 2)
        decays = np.arange(count + 1 - parity, len(values), 2)
        mixture = np.zeros((len(decays), len(values)))
        mixture[:, decays] = np.diag(1 / np.linalg.norm(values[decays], axis=1))
        mixture[:, polynomials] = -mixture @ values @ values[polynomials].T
        turns, left, _ = np.linalg.svd(mixture @ values, full_matrices=False)
        kept = left > _LEAST_LEFT
        mixtures.append((turns[:, kept] / left[kept]).T @ mixture)
        parities.append(np.full(np.count_nonzero(kept), parity))
    return np.vstack(mixtures), np.concatenate(parities)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """Points and weights that integrate over a section, and the functions on it.

    Parameters
    ----------
    points, weights : array (q, 2), (q,)
    half : pair of float
        Half its width and depth, m.
    family : Family
        Along either side.
    pairs : array (p, 2)
        Functions of x and y that are multiplied.
    """

    points: Array
    weights: Array
    half: tuple[float, float]
    family: Family
    pairs: Index

    @classmethod
    def rectangle(cls, width: float, depth: float, family: Family) -> Section:
        """Return a rectangle."""
        at, weights = family.rule
        half = (width / 2, depth / 2)
        count = range(len(family.parities))
        return cls(
            points=np.array(list(itertools.product(at * half[0], at * half[1]))),
            weights=np.outer(weights, weights).ravel() * half[0] * half[1],
            half=half,
            family=family,
            pairs=np.array(list(itertools.product(count, count))),
        )

    @classmethod
    def disc(cls, radius: float, degree: int) -> Section:
        """Return a disc, with polynomials of x and y up to a degree together."""
        at, weights = legendre.leggauss(degree + 2)  # over the square of the radius
        angles = np.arange(4 * degree + 8) * np.pi / (2 * degree + 4)
        around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return cls(
            points=radius * (np.sqrt((at + 1) / 2)[:, None, None] * around).reshape(-1, 2),
            weights=np.repeat(weights, len(angles)) / 2 * np.pi * radius**2 / len(angles),
            half=(radius, radius),
            family=Family(degree=degree),
            pairs=np.array([(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]),
        )

    def functions(self, x_parity: int, y_parity: int) -> Array:
        """Return slopes along x and y, and values, of the functions of a parity (3, p, q)."""
        parities = self.family.parities[self.pairs]
        first, second = self.pairs[(parities == [x_parity, y_parity]).all(axis=1)].T
        (x, dx), (y, dy) = (self.family.at(self.points[:, i] / self.half[i]) for i in (0, 1))
        return np.array(
            [
                dx[first] * y[second] / self.half[0],
                x[first] * dy[second] / self.half[1],
                x[first] * y[second],
            ]
        )


def solid_frequencies(section: Section, height: float, degree: int, material: Material) -> Array:
    """Return elastic frequencies of a free solid, each as often as it occurs, Hz.

    Parameters
    ----------
    section : Section
    height : float
        m.
    degree : int
        Of the polynomials along the height.
    material : Material
    """
    along = Family(degree=degree)
    found = [
        _Class(section, height, along, parity).frequencies(material)
        for parity in itertools.product((0, 1), repeat=3)
    ]
    return np.sort(np.concatenate(found))[6:]


class _Class:
    """Displacements of one parity, in the scalar sense: component i is turned along axis i."""

    def __init__(
        self, section: Section, height: float, along: Family, parity: tuple[int, ...]
    ) -> None:
        at, weights = along.rule
        self._weights = section.weights, weights * height / 2
        values, slopes = along.at(at)
        self._across, self._along = [], []
        for axis in range(3):
            x, y, z = ((p + (i == axis)) % 2 for i, p in enumerate(parity))
            chosen = along.parities == z
            self._across.append(section.functions(x, y))
            self._along.append((values[chosen], slopes[chosen] * 2 / height))

    def _integral(self, i: int, j: int, a: int | None = None, b: int | None = None) -> Array:
        """Integrate components i and j, or the slope of i along a times that of j along b."""
        sides = ((i, a), (j, b))
        wide = [self._across[k][2 if c in (2, None) else c] for k, c in sides]
        high = [self._along[k][1 if c == 2 else 0] for k, c in sides]
        across, up = self._weights
        return np.kron((wide[0] * across) @ wide[1].T, (high[0] * up) @ high[1].T)

    def frequencies(self, material: Material) -> Array:
        """Return the frequencies, rigid motions included, Hz."""
        first, shear = material.first_lame, material.shear_modulus
        axes = range(3)
        stiffness = [
            [first * self._integral(i, j, i, j) + shear * self._integral(i, j, j, i) for j in axes]
            for i in axes
        ]
        for i in axes:
            stiffness[i][i] = stiffness[i][i] + shear * sum(
                self._integral(i, i, a, a) for a in axes
            )
        mass = scipy.linalg.block_diag(*(self._integral(i, i) for i in axes))
        squares = scipy.linalg.eigh(np.block(stiffness), material.density * mass, eigvals_only=True)
        return np.sqrt(np.abs(squares)) / (2 * np.pi)
