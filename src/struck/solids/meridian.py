"""Bodies of revolution from their meridian: curves in the half-plane (r, z), walls along them.

A wall lies between two curves, its right and its left edge as one walks along its mid-line.
Where it meets the axis, a disc without a pole takes the place of the quadrilaterals that would
degenerate there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from struck.errors import MeshError
from struck.solids.hexahedra import angles, disc, lattice, merged, stacked
from struck.solids.outline import crossing

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A curve in the meridian half-plane.

    Parameters
    ----------
    at : function
        From positions along the curve (K,) to points (r, z), m (K, 2).
    knots : array
        Ascending positions of its ends and of the places where it is not smooth.
    """

    at: Callable[[Array], Array]
    knots: Array

    def sampled(self, start: float, end: float, count: int = 24) -> Array:
        """Return points from `start` to `end`, backward if need be, knots among them."""
        pieces = [np.linspace(a, b, count, endpoint=False) for a, b in self._pieces(start, end)]
        points = self.at(np.concatenate([*pieces, [max(start, end)]]))
        return points if start < end else points[::-1]

    def swept_volume(self, start: float, end: float) -> float:
        """Return pi times the integral of r^2 dz from `start` to `end`, m^3."""
        volume = sum(_swept(self.at, a, b) for a, b in self._pieces(start, end))
        return float(volume if start < end else -volume)

    def _pieces(self, start: float, end: float) -> list[tuple[float, float]]:
        low, high = min(start, end), max(start, end)
        inner = self.knots[(self.knots > low) & (self.knots < high)]
        return list(pairwise([low, *inner.tolist(), high]))


_DEGREE = 32  # of the interpolant between knots: its error is that of rounding


def _swept(at: Callable[[Array], Array], low: float, high: float) -> float:
    r, z = (
        Chebyshev.interpolate(lambda s, axis=axis: at(s)[:, axis], _DEGREE, [low, high])
        for axis in (0, 1)
    )
    primitive = (np.pi * r * r * z.deriv()).integ()
    return float(primitive(high) - primitive(low))


def segment(start: Array, end: Array) -> Curve:
    """Return the straight curve from `start` to `end`, positions 0 to 1."""
    return Curve(at=lambda s: start + np.multiply.outer(s, end - start), knots=np.array([0.0, 1.0]))


def smooth_curve(points: Array) -> Curve:
    """Return the cubic spline through `points` (n, 2); it meets the axis at a right angle."""
    chord = _chord(points)
    return Curve(at=_spline(points, chord), knots=chord)


def straight_curve(points: Array) -> Curve:
    """Return the polyline through `points` (n, 2)."""
    chord = _chord(points)
    return Curve(at=lambda s: _interpolated(s, chord, points), knots=chord)


def _chord(points: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _interpolated(s: Array, chord: Array, points: Array) -> Array:
    return np.stack([np.interp(s, chord, column) for column in points.T], axis=-1)


def _spline(points: Array, chord: Array) -> CubicSpline:
    start = (1, np.array([1.0, 0.0])) if points[0, 0] == 0 else "not-a-knot"
    end = (1, np.array([-1.0, 0.0])) if points[-1, 0] == 0 else "not-a-knot"
    conditions: Any = (start, end)  # a pair, which the stubs of scipy do not know
    return CubicSpline(chord, points, bc_type=conditions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """The material between two curves with the same knots, `left` to the left of `right`."""

    right: Curve
    left: Curve

    @property
    def knots(self) -> Array:
        """Positions along the mid-line of its ends and corners, m."""
        return self.right.knots

    @property
    def length(self) -> float:
        """Length of the mid-line, m (along chords between its points)."""
        return float(self.knots[-1])

    def at(self, s: Array, through: Array) -> Array:
        """Return points (K, 2) at `s` along and `through` (0 right, 1 left) the wall."""
        share = np.asarray(through)[..., None]
        return (1 - share) * self.right.at(s) + share * self.left.at(s)

    def rim(self) -> Curve:
        """Return the straight end of the wall, from right to left."""
        return segment(self.right.at(self.knots[-1:])[0], self.left.at(self.knots[-1:])[0])

    def foot(self) -> Curve:
        """Return the straight beginning of the wall, from left to right."""
        return segment(self.left.at(self.knots[:1])[0], self.right.at(self.knots[:1])[0])

    def reversed_at(self, s: Array, through: Array) -> Array:
        """Return points of the same wall walked from its other end."""
        return self.at(self.length - s, 1 - np.asarray(through))


def smooth_wall(points: Array, thickness: Array) -> Wall:
    """Return the wall about the spline through `points`, of a thickness that varies smoothly."""
    chord = _chord(points)
    middle, half = _spline(points, chord), _half_thickness(points, chord, thickness)

    def offset(side: float) -> Curve:
        def at(s: Array) -> Array:
            slope = middle(s, 1)
            normal = np.stack([-slope[..., 1], slope[..., 0]], axis=-1)
            unit = normal / np.linalg.norm(slope, axis=-1, keepdims=True)
            return middle(s) + side * half(s)[..., None] * unit

        return Curve(at=at, knots=chord)

    return Wall(right=offset(-1.0), left=offset(1.0))


def _half_thickness(points: Array, chord: Array, thickness: Array) -> PchipInterpolator:
    """Interpolate without overshoot; mirrored beyond the axis, so that no tip arises there."""
    at, half = list(chord), list(thickness / 2)
    if points[0, 0] == 0:
        at, half = [-chord[1], *at], [half[1], *half]
    if points[-1, 0] == 0:
        at, half = [*at, 2 * chord[-1] - chord[-2]], [*half, half[-2]]
    return PchipInterpolator(at, half)


def straight_wall(points: Array, thickness: Array) -> Wall:
    """Return the wall about the polyline through `points`, mitred at its corners."""
    chord = _chord(points)
    offsets = _mitres(points) * thickness[:, None] / 2
    edges = (points - offsets, points + offsets)
    right, left = (
        Curve(at=lambda s, edge=edge: _interpolated(s, chord, edge), knots=chord) for edge in edges
    )
    return Wall(right=right, left=left)


def _mitres(points: Array) -> Array:
    """Return the offsets of the corners that move every segment to its left by one."""
    steps = np.diff(points, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1)[:, None]
    before, after = (
        np.vstack([directions[:1], directions]),
        np.vstack([directions, directions[-1:]]),
    )
    # Beyond the axis the wall goes on as its own mirror image.
    if points[0, 0] == 0:
        before[0] = after[0] * (1, -1)
    if points[-1, 0] == 0:
        after[-1] = before[-1] * (1, -1)
    bend = np.sum(before * after, axis=1)
    if bend.min() < -0.85:
        raise MeshError(
            f"the profile folds back at {_place(points[np.argmin(bend)])}, by more than 148 "
            "degrees: blunt that corner with a further point"
        )
    normals = (before + after)[:, ::-1] * (-1, 1)
    return normals / (1 + bend)[:, None]


def check_wall(wall: Wall) -> None:
    """Refuse a wall that folds over itself or reaches across the axis.

    Raises
    ------
    MeshError
        Naming where.
    """
    right, left = (edge.sampled(0, wall.length) for edge in (wall.right, wall.left))
    middle, lowest = (right + left) / 2, np.minimum(right, left)[:, 0]
    step = np.diff(middle, axis=0)
    folded = [np.sum(np.diff(edge, axis=0) * step, axis=1) <= 0 for edge in (right, left)]
    if np.any(folded):
        raise MeshError(
            f"the wall folds over itself near {_place(middle[:-1][np.any(folded, axis=0)][0])}, "
            "where the profile bends too tightly for its thickness: thin the wall or widen the bend"
        )
    reach = 1e-9 * np.abs(middle).max()
    forbidden = lowest <= reach
    forbidden[[0, -1]] &= middle[[0, -1], 0] > reach
    if forbidden.any():
        raise MeshError(
            f"the wall reaches the axis near {_place(middle[np.argmax(forbidden)])}: move the "
            "profile out or thin the wall; only its ends may lie on the axis, at r = 0"
        )


def _place(point: Array) -> str:
    return f"(r, z) = ({point[0]:.6g}, {point[1]:.6g}) m"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """A curved quadrilateral of the meridian, cut into elements.

    Parameters
    ----------
    at : function
        From u (K,) and v (K,), v to the left of u, to points (r, z), m (K, 2).
    along, across : array (2m + 1,), (2n + 1,)
        Values of u and v at the ends and middles of elements.
    rings : int
        Where u = 0 lies on the axis: elements between the core of a disc and the last u, which
        replaces what `along` says in between; 0 elsewhere.
    """

    at: Callable[[Array, Array], Array]
    along: Array
    across: Array
    rings: int = 0


def revolved(patches: Iterable[Patch], around: int) -> tuple[Array, Index]:
    """Turn patches about the z axis and glue them: nodes (N, 3) and hexahedra (E, 20)."""
    parts = [_turned(patch, around) for patch in patches]
    return merged([nodes for nodes, _ in parts], [elements for _, elements in parts])


def _turned(patch: Patch, around: int) -> tuple[Array, Index]:
    if patch.rings:
        parameters, elements = stacked(disc(around, patch.rings), patch.across)
        x, y, v = parameters.T
        u, angle = np.hypot(x, y) * patch.along[-1], np.arctan2(y, x)
    else:
        sheet = lattice(patch.along, angles(around), closed=True)
        parameters, elements = stacked(sheet, patch.across)
        u, angle, v = parameters.T
    r, z = patch.at(u, v).T
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), elements


def check_contour(contour: Array) -> None:
    """Refuse a meridian outline (n, 2) that crosses itself.

    Raises
    ------
    MeshError
        Naming where.
    """
    place = crossing(contour)
    if place is not None:
        raise MeshError(
            f"the profile crosses itself near {_place(place)}: move its points apart or thin "
            "the wall"
        )
