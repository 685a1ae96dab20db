"""Finite elements on a polygon's triangles: bounds of a membrane's eigenvalues from both sides.

Quadratic elements conform, so their eigenvalues bound the true ones from above, one by one.
Crouzeix-Raviart elements do not; corrected by their size, theirs bound the true ones from below
(Carstensen & Gedicke 2014; Liu 2015). Counted by inertia, one such bound proves that no more
eigenvalues than those found lie below a value.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.solids.fem.factorisation import Factoriser
from struck.solids.fem.lanczos import Mass, block_lanczos
from struck.solids.polygon_mesh import sides, triangulated

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Liu 2015: the Crouzeix-Raviart interpolation error in L2 is at most this times the longest edge
# times its error in the gradient.
_INTERPOLATION = 0.1893
_AT_ONCE = 120  # eigenvalues a slice


class Triangulation:
    """Triangles that fill a polygon.

    Parameters
    ----------
    points : array (N, 2)
        m.
    triangles : array (T, 3)
        Counter-clockwise.
    """

    def __init__(self, points: Array, triangles: Index) -> None:
        self.points = points
        self.triangles = triangles

    @classmethod
    def of(cls, corners: Array, longest: float) -> Triangulation:
        """Fill a polygon (n, 2) with triangles whose edges are at most `longest` m.

        A coarse triangulation is halved: that is quicker, and keeps its angles.
        """
        extent = float(np.ptp(corners, axis=0).max())
        times = max(0, round(np.log2(extent / longest / _COARSE)))
        size = 2**times * longest / np.sqrt(2)
        while True:
            filling = cls(*triangulated((corners,), size)[:2])
            excess = filling.longest / (2**times * longest)
            if excess <= 1:
                break
            size *= 0.97 / excess
        for _ in range(times):
            filling = filling.halved()
        return filling

    @cached_property
    def _edges(self) -> tuple[Index, Index, NDArray[np.bool_]]:
        """Edges (E, 2), the edges opposite the triangles' corners (T, 3), which are inner."""
        every = np.sort(sides(self.triangles), axis=2)[:, [1, 2, 0]]
        edges, numbers, counts = np.unique(
            every.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
        )
        return edges, numbers.reshape(-1, 3), counts == 2

    @property
    def longest(self) -> float:
        """Length of the longest edge, m."""
        start, end = np.moveaxis(self.points[self._edges[0]], 1, 0)
        return float(np.linalg.norm(end - start, axis=1).max())

    def halved(self) -> Triangulation:
        """Cut each triangle into four alike."""
        edges, opposite, _ = self._edges
        a, b, c = self.triangles.T
        p, q, r = (opposite + len(self.points)).T
        parts = [np.stack(part, axis=1) for part in ((a, r, q), (r, b, p), (q, p, c), (p, q, r))]
        return Triangulation(
            np.vstack([self.points, self.points[edges].mean(axis=1)]), np.vstack(parts)
        )

    @cached_property
    def _gradients(self) -> tuple[Array, Array]:
        """Return gradients of the area coordinates (T, 3, 2) and areas (T,)."""
        corners = self.points[self.triangles]
        along = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        doubled = along[:, 0, 0] * along[:, 1, 1] - along[:, 0, 1] * along[:, 1, 0]
        inwards = np.stack([-along[..., 1], along[..., 0]], axis=2)
        return inwards / doubled[:, None, None], doubled / 2

    def quadratic(self) -> Pencil:
        """Return the matrices of six-node triangles, held along the boundary."""
        slopes, areas = self._gradients
        edges, opposite, inner = self._edges
        numbers = np.hstack([self.triangles, len(self.points) + opposite])
        grown = np.einsum("qni,tid->tqnd", _RISES, slopes)
        stiffness = np.einsum("t,tqnd,tqmd->tnm", areas / 3, grown, grown)
        free = np.ones(len(self.points) + len(edges), bool)
        free[edges[~inner]] = False
        free[len(self.points) :] = inner
        return Pencil.of(numbers, free, stiffness, areas[:, None, None] * _QUADRATIC_MASS)

    def nonconforming(self) -> Pencil:
        """Return the matrices of Crouzeix-Raviart elements, held along the boundary."""
        slopes, areas = self._gradients
        _, opposite, inner = self._edges
        stiffness = 4 * areas[:, None, None] * (slopes @ np.swapaxes(slopes, 1, 2))
        return Pencil.of(opposite, inner, stiffness, areas[:, None, None] * np.eye(3) / 3)

    @property
    def slack(self) -> float:
        """How far a true eigenvalue lies at most below a Crouzeix-Raviart one.

        lambda >= raviart / (1 + slack * raviart), m^2 (Liu 2015).
        """
        return (_INTERPOLATION * self.longest) ** 2


def edge_for(slack: float) -> float:
    """Return the longest edge that a triangulation of some slack, m^2, may have, m."""
    return float(np.sqrt(slack)) / _INTERPOLATION


_COARSE = 12  # edges along the extent
# Derivatives of the six quadratic shape functions by area coordinates, at the three mid-sides.
_CORNERS = np.eye(3)
_MIDDLES = (1 - _CORNERS) / 2
_RISES = np.array(
    [
        [(4 * at[i] - 1) * _CORNERS[i] for i in range(3)]
        + [4 * (at[j] * _CORNERS[k] + at[k] * _CORNERS[j]) for j, k in ((1, 2), (2, 0), (0, 1))]
        for at in _MIDDLES
    ]
)
_QUADRATIC_MASS = (
    np.block(
        [
            [7 * np.eye(3) - np.ones((3, 3)), -4 * np.eye(3)],
            [-4 * np.eye(3), 16 * np.eye(3) + 16 * np.ones((3, 3))],
        ]
    )
    / 180
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pencil:
    """Stiffness and mass matrix of a membrane under unit tension and of unit density."""

    stiffness: sparse.csc_matrix
    mass: sparse.csc_matrix
    factorise: Factoriser

    @classmethod
    def of(cls, numbers: Index, free: NDArray[np.bool_], stiffness: Array, mass: Array) -> Pencil:
        """Add up element matrices (T, n, n) over node numbers (T, n), without nodes not free."""
        rows = np.repeat(numbers, numbers.shape[1], axis=1).ravel()
        columns = np.tile(numbers, (1, numbers.shape[1])).ravel()
        shape = (len(free), len(free))
        assembled = [
            sparse.coo_matrix((part.ravel(), (rows, columns)), shape=shape).tocsc()[free][:, free]
            for part in (stiffness, mass)
        ]
        return cls(stiffness=assembled[0], mass=assembled[1], factorise=Factoriser())

    def count(self, value: float) -> int:
        """Return how many eigenvalues lie below a value: the inertia of K - value M."""
        return self.factorise(self._shifted(value)).negative

    def below(self, value: float) -> Array:
        """Return all eigenvalues below a value, ascending; counted by inertia, none is missed."""
        total = self.count(value)
        ends = value * np.linspace(0, 1, -(-total // _AT_ONCE) + 1)
        counts = [0, *(self.count(end) for end in ends[1:-1]), total]
        slices = zip(ends[:-1], ends[1:], counts[:-1], counts[1:], strict=True)
        found = [self._slice(*each) for each in slices] if total else [np.zeros(0)]
        return np.concatenate(found)

    def _slice(self, low: float, high: float, under: int, up_to: int) -> Array:
        """Return the eigenvalues between two values below which so many lie."""
        middle = (low + high) / 2
        factor = self.factorise(self._shifted(middle))
        if up_to == under:
            return np.zeros(0)
        pairs = block_lanczos(
            factor.solve,
            cast("Mass", self.mass),  # only multiplies
            middle,
            up_to - factor.negative,
            np.zeros((self.mass.shape[0], 0)),
            below=factor.negative - under,
        )
        return pairs.values

    def _shifted(self, value: float) -> sparse.csc_matrix:
        return sparse.tril(self.stiffness - value * self.mass, format="csc")
