"""Bodies of revolution from their meridian: curves in the half-plane (r, z), walls along them.

A wall lies between two curves, its right and its left edge as one walks along its mid-line.
Where it meets the axis, a disc without a pole takes the place of the quadrilaterals that would
degenerate there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import root_scalar

from struck.errors import MeshError, rounded
from struck.model.arrays import Array, Index
from struck.solids.hexahedra import angles, disc, divide_breaks, lattice, merge_meshes, stack_layers
from struck.solids.polygon_mesh import crossing, place_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeridianCurve:
    """A curve in the meridian half-plane (r, z)."""

    at: Callable[[Array], Array]  # from positions along it (K,) to points, m (K, 2)
    knots: Array  # ascending positions of its ends and corners

    def sample(self, start: float, end: float, count: int = 24) -> Array:
        """Return points from `start` to `end`, backward if need be, knots among them."""
        pieces = [np.linspace(a, b, count, endpoint=False) for a, b in self._pieces(start, end)]
        points = self.at(np.concatenate([*pieces, [max(start, end)]]))
        return points if start < end else points[::-1]

    def swept_volume(self, start: float, end: float) -> float:
        """Return pi times the integral of r^2 dz from `start` to `end`, m^3."""
        volume = sum(_sweep_volume(self.at, a, b) for a, b in self._pieces(start, end))
        return float(volume if start < end else -volume)

    def _pieces(self, start: float, end: float) -> list[tuple[float, float]]:
        low, high = min(start, end), max(start, end)
        inner = self.knots[(self.knots > low) & (self.knots < high)]
        return list(pairwise([low, *inner.tolist(), high]))


_UNIT_INTERVAL = np.array([0.0, 1.0])
_ROUNDING = 1e-14
_DEGREE = 32  # of the interpolant between knots: its error is that of rounding


def _sweep_volume(at: Callable[[Array], Array], low: float, high: float) -> float:
    r, z = (
        Chebyshev.interpolate(lambda s, axis=axis: at(s)[:, axis], _DEGREE, [low, high])
        for axis in (0, 1)
    )
    primitive = (np.pi * r * r * z.deriv()).integ()
    return float(primitive(high) - primitive(low))


def segment(start: Array, end: Array) -> MeridianCurve:
    """Return the straight curve from `start` to `end`, positions 0 to 1."""
    return _polyline(_UNIT_INTERVAL, np.stack([start, end]))


def smooth_curve(points: Array) -> MeridianCurve:
    """Return the cubic spline through `points` (n, 2); it meets the axis at a right angle."""
    chord = _chord(points)
    curve, rounding = _spline(points, chord), _ROUNDING * np.abs(points).max()

    def at(s: Array) -> Array:
        positions = np.asarray(curve(s), np.float64)
        # Radii within rounding of the axis are 0.
        positions[..., 0] = np.where(np.abs(positions[..., 0]) <= rounding, 0.0, positions[..., 0])
        return positions

    return MeridianCurve(at=at, knots=chord)


def straight_curve(points: Array) -> MeridianCurve:
    """Return the polyline through `points` (n, 2)."""
    return _polyline(_chord(points), points)


def _chord(points: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _polyline(chord: Array, points: Array) -> MeridianCurve:
    def at(s: Array) -> Array:
        return np.stack([np.interp(s, chord, column) for column in points.T], axis=-1)

    return MeridianCurve(at=at, knots=chord)


def _spline(points: Array, chord: Array) -> CubicSpline:
    start = (1, np.array([1.0, 0.0])) if points[0, 0] == 0 else "not-a-knot"
    end = (1, np.array([-1.0, 0.0])) if points[-1, 0] == 0 else "not-a-knot"
    conditions: Any = (start, end)  # a pair, which the stubs of scipy do not know
    return CubicSpline(chord, points, bc_type=conditions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """The material between two curves with the same knots, `left` to the left of `right`."""

    right: MeridianCurve
    left: MeridianCurve

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
        fractions = np.asarray(through)[..., None]
        return (1 - fractions) * self.right.at(s) + fractions * self.left.at(s)

    def rim(self) -> MeridianCurve:
        """Return the straight end of the wall, from right to left."""
        return segment(self.right.at(self.knots[-1:])[0], self.left.at(self.knots[-1:])[0])

    def foot(self) -> MeridianCurve:
        """Return the straight beginning of the wall, from left to right."""
        return segment(self.left.at(self.knots[:1])[0], self.right.at(self.knots[:1])[0])

    def reversed_at(self, s: Array, through: Array) -> Array:
        """Return points of the same wall walked from its other end."""
        return self.at(self.length - s, 1 - np.asarray(through))


def smooth_wall(points: Array, thickness: Array) -> Wall:
    """Return the wall about the spline through `points`, of a thickness that varies smoothly."""
    chord = _chord(points)
    centre_line, half = _spline(points, chord), _half_thickness(points, chord, thickness)

    def offset(side: float) -> MeridianCurve:
        def at(s: Array) -> Array:
            slope = centre_line(s, 1)
            normal = np.stack([-slope[..., 1], slope[..., 0]], axis=-1)
            unit = normal / np.linalg.norm(slope, axis=-1, keepdims=True)
            return centre_line(s) + side * half(s)[..., None] * unit

        return MeridianCurve(at=at, knots=chord)

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
    return Wall(right=_polyline(chord, points - offsets), left=_polyline(chord, points + offsets))


def _mitres(points: Array) -> Array:
    """Return the offsets of the corners that move every segment to its left by one."""
    steps = np.diff(points, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1)[:, None]
    previous_directions = np.vstack([directions[:1], directions])
    next_directions = np.vstack([directions, directions[-1:]])
    # Beyond the axis the wall continues as its mirror image.
    if points[0, 0] == 0:
        previous_directions[0] = next_directions[0] * (1, -1)
    if points[-1, 0] == 0:
        next_directions[-1] = previous_directions[-1] * (1, -1)
    bend = np.sum(previous_directions * next_directions, axis=1)
    if bend.min() < -0.85:
        raise MeshError(
            f"the profile folds back at {_place(points[np.argmin(bend)])}, by more than 148 "
            "degrees: blunt that corner with a further point"
        )
    normals = (previous_directions + next_directions)[:, ::-1] * (-1, 1)
    return normals / (1 + bend)[:, None]


def check_wall(wall: Wall) -> None:
    """Raise MeshError, naming where, on a wall that folds over itself or crosses the axis."""
    right, left = (edge.sample(0, wall.length) for edge in (wall.right, wall.left))
    centre_line, min_radii = (right + left) / 2, np.minimum(right, left)[:, 0]
    step = np.diff(centre_line, axis=0)
    folded = [np.sum(np.diff(edge, axis=0) * step, axis=1) <= 0 for edge in (right, left)]
    if np.any(folded):
        raise MeshError(
            "the wall folds over itself near "
            f"{_place(centre_line[:-1][np.any(folded, axis=0)][0])}, "
            "where the profile bends too tightly for its thickness: thin the wall or widen the bend"
        )
    reach = 1e-9 * np.abs(centre_line).max()
    forbidden = min_radii <= reach
    forbidden[[0, -1]] &= centre_line[[0, -1], 0] > reach
    if forbidden.any():
        raise MeshError(
            f"the wall reaches the axis near {_place(centre_line[np.argmax(forbidden)])}: move the "
            "profile out or thin the wall; only its ends may lie on the axis, at r = 0"
        )


def _place(point: Array) -> str:
    return f"(r, z) = {place_of(point)}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """A curved quadrilateral of the meridian, cut into elements."""

    at: Callable[[Array, Array], Array]  # from u and v (K,), v left of u, to (r, z), m (K, 2)
    along: Array  # (2m + 1,): u of ends and midpoints of elements
    across: Array  # (2n + 1,): v of them
    rings: int = 0  # where u = 0 is on the axis: elements from core to last u


def revolve(patches: Iterable[Patch], count: int) -> tuple[Array, Index]:
    """Turn patches about the z axis and glue them: nodes (N, 3) and hexahedra (E, 20)."""
    parts = [_revolve_patch(patch, count) for patch in patches]
    return merge_meshes([nodes for nodes, _ in parts], [elements for _, elements in parts])


def _revolve_patch(patch: Patch, count: int) -> tuple[Array, Index]:
    if patch.rings:
        parameters, elements = stack_layers(disc(count, patch.rings), patch.across)
        x, y, v = parameters.T
        u, angle = np.hypot(x, y) * patch.along[-1], np.arctan2(y, x)
    else:
        sheet = lattice(patch.along, angles(count), closed=True)
        parameters, elements = stack_layers(sheet, patch.across)
        u, angle, v = parameters.T
    r, z = patch.at(u, v).T
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), elements


def check_contour(contour: Array) -> None:
    """Raise MeshError, naming where, on a meridian outline (n, 2) that crosses itself."""
    place = crossing(contour)
    if place is not None:
        raise MeshError(
            f"the profile crosses itself near {_place(place)}: move its points apart or thin "
            "the wall"
        )


# Cross-sections yield patches to mesh, the contour around them, counter-clockwise, and places.

Contour = list[tuple[MeridianCurve, float, float]]
Points = dict[str, Array]

INSET = 0.01  # share by which places stand off an edge, so that their normal is that of one face


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counts:
    """Elements around, along the meridian and through the wall."""

    around: int
    along: int
    through: int

    @property
    def rings(self) -> int:
        """Elements between core and edge of a disc on the axis."""
        return max(1, round(self.around / 24))


def volume(contour: Contour) -> float:
    """Return the volume that a contour sweeps, m^3 (Pappus: 2 pi times the integral of r dA)."""
    return sum(curve.swept_volume(start, end) for curve, start, end in contour)


def outline(contour: Contour) -> Array:
    """Return points (n, 2) of a contour, each once."""
    count = max(2, 800 // sum(len(curve.knots) for curve, _, _ in contour))
    return np.vstack([curve.sample(start, end, count)[:-1] for curve, start, end in contour])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shell:
    """A wall along its mid-line."""

    wall: Wall
    breaks: Array  # where elements must end along the mid-line, its ends among them, m
    on_axis: tuple[bool, bool]  # whether it starts, and ends, on the axis

    def contour(self) -> Contour:
        """Return the bounding curves, each with its start and end."""
        wall = self.wall
        return [
            (wall.right, 0.0, wall.length),
            (wall.rim(), 0.0, 1.0),
            (wall.left, wall.length, 0.0),
            (wall.foot(), 0.0, 1.0),
        ]

    def patches(self, counts: Counts, disc: float | None = None) -> list[Patch]:
        """Return patches; `disc` is where the first disc on the axis ends along the mid-line, m."""
        length, levels = self.wall.length, divide_breaks(_UNIT_INTERVAL, counts.through)
        end_lengths = np.diff(self.breaks)[[0, -1]]
        first, last = np.where(self.on_axis, [self._disc(counts, run) for run in end_lengths], 0.0)
        first = disc or first
        patches = [
            Patch(at=at, along=np.array([0.0, end]), across=levels, rings=counts.rings)
            for at, end in ((self.wall.at, first), (self.wall.reversed_at, last))
            if end
        ]
        remaining_length = length - first - last
        if remaining_length > 1e-9 * length:
            inner_breaks = self.breaks[(self.breaks > first) & (self.breaks < length - last)]
            breaks = np.concatenate([[first], inner_breaks, [length - last]])
            positions = divide_breaks(
                breaks, max(1, round(counts.along * remaining_length / length))
            )
            patches.append(Patch(at=self.wall.at, along=positions, across=levels))
        return patches

    def _disc(self, counts: Counts, end_length: float) -> float:
        """Return the radius of the disc on the axis: as wide as its elements are long."""
        fitting = min(counts.around / 8 / counts.along, 0.35) * self.wall.length
        return end_length if end_length < 1.5 * fitting else fitting

    def places(self) -> Points:
        """Return points (r, z) by name."""
        centre_line = self.wall.at(np.linspace(0, self.wall.length, 400), np.full(400, 0.5))
        enclosed_area = float(
            np.sum((centre_line[1:, 0] + centre_line[:-1, 0]) / 2 * np.diff(centre_line[:, 1]))
        )
        right, left = self.wall.right, self.wall.left
        if abs(enclosed_area) < 1e-6 * self.wall.length**2:
            lower, upper = sorted((left, right), key=_height)
            poles = {"top": _at(upper, 0.0), "bottom": _at(lower, 0.0)} if self.on_axis[0] else {}
            return poles | self._rim_and_side(upper)
        outer = right if enclosed_area > 0 else left
        poles = {}
        for end, on_axis in zip((0, -1), self.on_axis, strict=True):
            if on_axis:
                name = "top" if centre_line[end, 1] > centre_line[:, 1].mean() else "bottom"
                poles[name] = _at(outer, -end * self.wall.length)
        return poles | self._rim_and_side(outer)

    def _rim_and_side(self, outer: MeridianCurve) -> Points:
        length = self.wall.length
        ends = [length * (1 - INSET), length * INSET]
        free = [end for end, pole in zip(ends, reversed(self.on_axis), strict=True) if not pole]
        rim = {"rim": _at(outer, free[0])} if free else {}
        return rim | {"side": _at(outer, length / 2)}


def _at(curve: MeridianCurve, s: float) -> Array:
    return curve.at(np.array([s]))[0]


def _height(curve: MeridianCurve) -> float:
    return float(_at(curve, float(curve.knots[-1] / 2))[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spindle:
    """A solid between the axis and a curve that rises along it; its ends are flat."""

    side: MeridianCurve
    breaks: Array  # where elements must end along it, its ends among them, m

    def contour(self) -> Contour:
        """Return the bounding curves, each with its start and end."""
        start, end = _at(self.side, 0.0), _at(self.side, float(self.breaks[-1]))
        foot, head = start * (0, 1), end * (0, 1)
        return [
            (segment(foot, start), 0.0, 1.0),
            (self.side, 0.0, float(self.breaks[-1])),
            (segment(end, head), 0.0, 1.0),
            (segment(head, foot), 0.0, 1.0),
        ]

    def patches(self, counts: Counts) -> list[Patch]:
        """Return the one patch."""

        def at(u: Array, v: Array) -> Array:
            r, z = self.side.at(v).T
            return np.stack([u * r, z], axis=-1)

        levels = divide_breaks(self.breaks, counts.along)
        return [Patch(at=at, along=_UNIT_INTERVAL, across=levels, rings=counts.through)]

    def places(self) -> Points:
        """Return points (r, z) by name."""
        length = float(self.breaks[-1])
        return {
            "top": _at(self.side, length) * (0, 1),
            "bottom": _at(self.side, 0.0) * (0, 1),
            "side": _at(self.side, length / 2),
            "rim": _at(self.side, length * (1 - INSET)),
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goblet:
    """A bowl on a solid stem on a foot; bowl and foot start on the axis."""

    bowl: Shell  # the stem joins its right edge, the underside
    foot: Shell  # and the left edge of this, its top
    radii: Array  # of the stem at equal heights from foot to bowl, m

    @property
    def _joints(self) -> tuple[float, float]:
        """Positions along foot and bowl where the side of the stem meets them."""
        foot_joint = _reach(self.foot.wall.left, float(self.radii[0]), "foot")
        return foot_joint, _reach(self.bowl.wall.right, float(self.radii[-1]), "bowl")

    def _side(self) -> MeridianCurve:
        foot_joint, bowl_joint = self._joints
        heights = _at(self.foot.wall.left, foot_joint)[1], _at(self.bowl.wall.right, bowl_joint)[1]
        knots = np.linspace(0, 1, len(self.radii))
        radius = PchipInterpolator(knots, self.radii)
        return MeridianCurve(
            at=lambda v: np.stack([radius(v), heights[0] + v * (heights[1] - heights[0])], axis=-1),
            knots=knots,
        )

    def contour(self) -> Contour:
        """Return the bounding curves, each with its start and end."""
        (foot_joint, bowl_joint), bowl, foot = self._joints, self.bowl.wall, self.foot.wall
        axis = segment(_at(bowl.left, 0.0), _at(foot.right, 0.0))
        return [
            (foot.right, 0.0, foot.length),
            (foot.rim(), 0.0, 1.0),
            (foot.left, foot.length, foot_joint),
            (self._side(), 0.0, 1.0),
            (bowl.right, bowl_joint, bowl.length),
            (bowl.rim(), 0.0, 1.0),
            (bowl.left, bowl.length, 0.0),
            (axis, 0.0, 1.0),
        ]

    def patches(self, counts: Counts) -> list[Patch]:
        """Return patches of bowl, foot and stem, elements about as long in all three."""
        (foot_joint, bowl_joint), step = self._joints, self.bowl.wall.length / counts.along
        side = self._side()
        height = float(np.diff(side.at(_UNIT_INTERVAL)[:, 1])[0])
        lengths = self.foot.wall.length, height / 2  # a slender stem bends in long waves
        length_counts = [max(4, round(length / step)) for length in lengths]
        on_foot = replace(counts, along=length_counts[0])
        stem = Patch(
            at=self._inside_stem(),
            along=_UNIT_INTERVAL,
            across=divide_breaks(side.knots, length_counts[1]),
            rings=counts.rings,
        )
        return [
            *self.bowl.patches(counts, bowl_joint),
            *self.foot.patches(on_foot, foot_joint),
            stem,
        ]

    def _inside_stem(self) -> Callable[[Array, Array], Array]:
        """Return the blend of foot, bowl, axis and side (a Coons patch)."""
        (foot_joint, bowl_joint), side = self._joints, self._side()
        top, bottom = self.bowl.wall.right, self.foot.wall.left
        corners = _at(bottom, foot_joint), _at(top, bowl_joint)

        def at(u: Array, v: Array) -> Array:
            up, out = v[:, None], u[:, None]
            flat = (1 - up) * bottom.at(u * foot_joint) + up * top.at(u * bowl_joint)
            chord = (1 - up) * corners[0] + up * corners[1]
            return flat + out * (side.at(v) - chord)

        return at

    def places(self) -> Points:
        """Return points (r, z) by name."""
        foot = self.foot.wall
        bowl = {name: at for name, at in self.bowl.places().items() if name != "bottom"}
        return bowl | {
            "stem": _at(self._side(), 0.5),
            "foot": _at(foot.left, 0.9 * foot.length),
            "bottom": _at(foot.right, 0.0),
        }


def _reach(curve: MeridianCurve, radius: float, name: str) -> float:
    """Return the first position where a curve from the axis reaches `radius`."""
    positions = np.linspace(0, curve.knots[-1], 1000)
    is_beyond = curve.at(positions)[:, 0] >= radius
    if not is_beyond.any() or radius <= 0:
        raise MeshError(
            f"the stem ends with a radius of {rounded(radius)} m, the {name} reaches "
            f"{rounded(curve.at(positions)[:, 0].max(), 4)} m: give a radius between 0 and that"
        )
    index = int(np.argmax(is_beyond))
    bracket = positions[index - 1 : index + 1]
    return float(root_scalar(lambda s: _at(curve, s)[0] - radius, bracket=bracket).root)
