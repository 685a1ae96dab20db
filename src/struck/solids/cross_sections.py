"""Meridian cross-sections of bodies of revolution: walls, walls on a stem, solids.

Each yields patches to mesh, the contour that bounds it, counter-clockwise, and places on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import root_scalar

from struck.errors import MeshError
from struck.solids.hexahedra import divided
from struck.solids.meridian import Curve, Patch, Wall, segment

Array = NDArray[np.float64]
Contour = list[tuple[Curve, float, float]]
Points = dict[str, Array]

# Places near an edge stand off it by this share, so that their normal is that of one face.
_INSET = 0.01
_WHOLE = np.array([0.0, 1.0])


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
    knots = sum(len(curve.knots) for curve, _, _ in contour)
    count = max(2, 800 // knots)
    return np.vstack([curve.sampled(start, end, count)[:-1] for curve, start, end in contour])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shell:
    """A wall along its mid-line.

    Parameters
    ----------
    wall : Wall
    breaks : array
        Positions along the mid-line where elements must end, its ends among them, m.
    on_axis : pair of bool
        Whether it starts and ends on the axis.
    """

    wall: Wall
    breaks: Array
    on_axis: tuple[bool, bool]

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
        length, across = self.wall.length, divided(_WHOLE, counts.through)
        straight = np.diff(self.breaks)[[0, -1]]
        first, last = np.where(self.on_axis, [self._disc(counts, run) for run in straight], 0.0)
        first = disc or first
        patches = [
            Patch(at=at, along=np.array([0.0, end]), across=across, rings=counts.rings)
            for at, end in ((self.wall.at, first), (self.wall.reversed_at, last))
            if end
        ]
        rest = length - first - last
        if rest > 1e-9 * length:
            near = self.breaks[(self.breaks > first) & (self.breaks < length - last)]
            breaks = np.concatenate([[first], near, [length - last]])
            along = divided(breaks, max(1, round(counts.along * rest / length)))
            patches.append(Patch(at=self.wall.at, along=along, across=across))
        return patches

    def _disc(self, counts: Counts, straight: float) -> float:
        """Return the radius of the disc on the axis: as wide as its elements are long."""
        fitting = min(counts.around / 8 / counts.along, 0.35) * self.wall.length
        return straight if straight < 1.5 * fitting else fitting

    def places(self) -> Points:
        """Return points (r, z) by name."""
        middle = self.wall.at(np.linspace(0, self.wall.length, 400), np.full(400, 0.5))
        enclosed = float(np.sum((middle[1:, 0] + middle[:-1, 0]) / 2 * np.diff(middle[:, 1])))
        right, left = self.wall.right, self.wall.left
        if abs(enclosed) < 1e-6 * self.wall.length**2:
            return self._places_of_plate(*sorted((left, right), key=_height))
        outer = right if enclosed > 0 else left
        poles = [end for end, is_pole in zip((0, -1), self.on_axis, strict=True) if is_pole]
        named = {
            "top" if middle[end, 1] > middle[:, 1].mean() else "bottom": _at(
                outer, -end * self.wall.length
            )
            for end in poles
        }
        return named | self._rim_and_side(outer)

    def _places_of_plate(self, lower: Curve, upper: Curve) -> Points:
        poles = {"top": _at(upper, 0.0), "bottom": _at(lower, 0.0)} if self.on_axis[0] else {}
        return poles | self._rim_and_side(upper)

    def _rim_and_side(self, outer: Curve) -> Points:
        length = self.wall.length
        ends = [length * (1 - _INSET), length * _INSET]
        free = [end for end, pole in zip(ends, reversed(self.on_axis), strict=True) if not pole]
        rim = {"rim": _at(outer, free[0])} if free else {}
        return rim | {"side": _at(outer, length / 2)}


def _at(curve: Curve, s: float) -> Array:
    return curve.at(np.array([s]))[0]


def _height(curve: Curve) -> float:
    return float(_at(curve, float(curve.knots[-1] / 2))[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spindle:
    """A solid between the axis and a curve that rises along it; its ends are flat.

    Parameters
    ----------
    side : Curve
    breaks : array
        Positions along it where elements must end, its ends among them, m.
    """

    side: Curve
    breaks: Array

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

        levels = divided(self.breaks, counts.along)
        return [Patch(at=at, along=_WHOLE, across=levels, rings=counts.through)]

    def places(self) -> Points:
        """Return points (r, z) by name."""
        length = float(self.breaks[-1])
        return {
            "top": _at(self.side, length) * (0, 1),
            "bottom": _at(self.side, 0.0) * (0, 1),
            "side": _at(self.side, length / 2),
            "rim": _at(self.side, length * (1 - _INSET)),
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goblet:
    """A bowl on a solid stem on a foot; bowl and foot start on the axis.

    Parameters
    ----------
    bowl, foot : Shell
        The stem joins the bowl's right edge (its underside) and the foot's left (its top).
    radii : array
        Radii of the stem at equal heights from the foot's top to the bowl's underside, m.
    """

    bowl: Shell
    foot: Shell
    radii: Array

    @property
    def _joints(self) -> tuple[float, float]:
        """Positions along foot and bowl where the side of the stem meets them."""
        below = _reach(self.foot.wall.left, float(self.radii[0]), "foot")
        return below, _reach(self.bowl.wall.right, float(self.radii[-1]), "bowl")

    def _side(self) -> Curve:
        below, above = self._joints
        heights = _at(self.foot.wall.left, below)[1], _at(self.bowl.wall.right, above)[1]
        knots = np.linspace(0, 1, len(self.radii))
        radius = PchipInterpolator(knots, self.radii)
        return Curve(
            at=lambda v: np.stack([radius(v), heights[0] + v * (heights[1] - heights[0])], axis=-1),
            knots=knots,
        )

    def contour(self) -> Contour:
        """Return the bounding curves, each with its start and end."""
        (below, above), bowl, foot = self._joints, self.bowl.wall, self.foot.wall
        axis = segment(_at(bowl.left, 0.0), _at(foot.right, 0.0))
        return [
            (foot.right, 0.0, foot.length),
            (foot.rim(), 0.0, 1.0),
            (foot.left, foot.length, below),
            (self._side(), 0.0, 1.0),
            (bowl.right, above, bowl.length),
            (bowl.rim(), 0.0, 1.0),
            (bowl.left, bowl.length, 0.0),
            (axis, 0.0, 1.0),
        ]

    def patches(self, counts: Counts) -> list[Patch]:
        """Return patches of bowl, foot and stem, elements about as long in all three."""
        (below, above), step = self._joints, self.bowl.wall.length / counts.along
        lengths = self.foot.wall.length, self._length() / 2  # a slender stem bends in long waves
        along = [max(4, round(length / step)) for length in lengths]
        on_foot = Counts(around=counts.around, along=along[0], through=counts.through)
        stem = Patch(
            at=self._inside_stem(),
            along=_WHOLE,
            across=divided(self._side().knots, along[1]),
            rings=counts.rings,
        )
        return [*self.bowl.patches(counts, above), *self.foot.patches(on_foot, below), stem]

    def _length(self) -> float:
        ends = self._side().at(_WHOLE)
        return float(ends[1, 1] - ends[0, 1])

    def _inside_stem(self) -> Callable[[Array, Array], Array]:
        """Return the blend of foot, bowl, axis and side (a Coons patch)."""
        (below, above), side = self._joints, self._side()
        top, bottom = self.bowl.wall.right, self.foot.wall.left
        corners = _at(bottom, below), _at(top, above)

        def at(u: Array, v: Array) -> Array:
            up, out = v[:, None], u[:, None]
            flat = (1 - up) * bottom.at(u * below) + up * top.at(u * above)
            straight = (1 - up) * corners[0] + up * corners[1]
            return flat + out * (side.at(v) - straight)

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


def _reach(curve: Curve, radius: float, name: str) -> float:
    """Return the first position where a curve from the axis reaches `radius`."""
    positions = np.linspace(0, curve.knots[-1], 1000)
    beyond = curve.at(positions)[:, 0] >= radius
    if not beyond.any() or radius <= 0:
        raise MeshError(
            f"the stem ends with a radius of {radius:g} m, the {name} reaches "
            f"{curve.at(positions)[:, 0].max():.4g} m: give a radius between 0 and that"
        )
    index = int(np.argmax(beyond))
    bracket = positions[index - 1 : index + 1]
    return float(root_scalar(lambda s: _at(curve, s)[0] - radius, bracket=bracket).root)
