"""Charts: where the contact coordinates of a recorded body lie in space, in metres.

Recordings have contacts by coordinates that the user chose (a height from 0 to 1, a number of
centimetres, an azimuth), and speed over a body is in metres a second. A chart gives the distance
of two places: by a pitch, metres a unit of each coordinate, or on a round body by the outline of
its surface.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, counted, rounded
from struck.model.arrays import UNITS, Array, checked, numbers
from struck.model.mesh import Mesh

_FINEST, _COARSEST = 1e-9, 1e6  # m a unit
_SLICES = 513  # heights at which the outline of a mesh is taken
_BEYOND = 0.02  # share of a mesh's height by which contacts may lie above or below it


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """Positions of contact coordinates in space.

    Parameters
    ----------
    pitch : array (D,)
        Metres per unit of each coordinate; for an azimuth in rad, the radius of the body.
    around : bool, default False
        Whether the first coordinate is a height along the z axis, and the second, if any, an
        azimuth about it, rad.
    outline : array (n, 2) or None, default None
        Heights, ascending, and radii of the surface of a body of revolution, m. None: the surface
        is flat, or with an azimuth a cylinder.

    Raises
    ------
    OptionError
        If a number is out of range.
    """

    pitch: Array
    around: bool = False
    outline: Array | None = None

    def __post_init__(self) -> None:
        pitch = np.array(self.pitch, np.float64)
        if pitch.shape not in {(1,), (2,), (3,)} or not np.all(
            (pitch >= _FINEST) & (pitch <= _COARSEST)
        ):
            raise OptionError(
                f"pitch is {pitch.tolist()}: give metres a unit of each coordinate, from "
                f"{_FINEST:g} to {_COARSEST:g}"
            )
        object.__setattr__(self, "pitch", pitch)
        if self.outline is not None:
            outline = numbers("outline", self.outline)
            _require_outline(outline)
            object.__setattr__(self, "outline", outline)

    @classmethod
    def named(cls, coordinates: Sequence[str]) -> Chart | None:
        """Make the chart of coordinates that all have a unit of length.

        Parameters
        ----------
        coordinates : sequence of str
            Names, such as "height (m)".

        Returns
        -------
        Chart or None
            None if a coordinate has no unit of length.
        """
        units = [re.search(r"\((\w+)\)$", name) for name in coordinates]
        pitch = [UNITS.get(unit[1], 0.0) if unit else 0.0 for unit in units]
        return cls(pitch=np.array(pitch)) if pitch and all(pitch) else None

    @classmethod
    def of(
        cls,
        coordinates: Sequence[str],
        *,
        pitch: ArrayLike | None,
        geometry: Mesh | None,
        round_about: Array | None,
        heights: tuple[float, float] = (0.0, 0.0),
    ) -> Chart:
        """Make the chart of coordinates from metres per unit, a surface, or both.

        Parameters
        ----------
        coordinates : sequence of str
            Names, with their unit of length in brackets if they have one: "height (m)".
        pitch : array-like, () or (D,), or None
            Metres per unit of each coordinate. None: by the names.
        geometry : Mesh or None
            Surface of a body of revolution, m; the first coordinate times its pitch is z.
        round_about : array (3,) or None
            A point of the axis along z. None: not a body of revolution.
        heights : tuple of float, default (0, 0)
            Lowest and highest first coordinate of the recordings.

        Returns
        -------
        Chart
            The chart.

        Raises
        ------
        OptionError
            If a pitch is missing, or the surface does not fit.
        """
        is_round = round_about is not None
        pitches = _pitches(coordinates, pitch, spared=is_round and geometry is not None)
        outline = None
        if geometry is not None:
            if round_about is None:
                raise OptionError(
                    "geometry defines distances on a round body alone, recorded with "
                    "symmetry='axial': give pitch= in metres a unit of "
                    f"{' and of '.join(coordinates)}"
                )
            _require_beside(geometry, pitches[0] * np.array(heights))
            outline = outline_of(geometry, round_about)
        return cls(pitch=pitches, around=is_round, outline=outline)

    def places(self, points: Array) -> Array:
        """Compute the points of contacts in space.

        Parameters
        ----------
        points : array (K, D)
            Contact coordinates.

        Returns
        -------
        array (K, 3)
            Points, m.

        Raises
        ------
        OptionError
            If the contacts have another number of coordinates than the chart.
        """
        if points.ndim != 2 or points.shape[1] != len(self.pitch):
            raise OptionError(
                f"points have shape {points.shape}: a chart of "
                f"{counted(len(self.pitch), 'coordinate')} takes (K, {len(self.pitch)})"
            )
        positions = points * self.pitch
        flat = np.zeros((len(points), 3))
        if not self.around:
            flat[:, : positions.shape[1]] = positions
            return flat
        has_angle = positions.shape[1] > 1
        radii = np.full(len(points), self.pitch[1] if has_angle else 0.0)
        if self.outline is not None:
            radii = np.interp(positions[:, 0], *self.outline.T)
        azimuths = points[:, 1] if has_angle else np.zeros(len(points))
        return np.stack(
            [radii * np.cos(azimuths), radii * np.sin(azimuths), positions[:, 0]], axis=1
        )

    def scaled(self, factor: float) -> Chart:
        """Return the chart of the same body in another size.

        Parameters
        ----------
        factor : float
            Ratio of the new to the old size.

        Returns
        -------
        Chart
            The scaled chart.
        """
        outline = None if self.outline is None else self.outline * factor
        return replace(self, pitch=self.pitch * factor, outline=outline)


def outline_of(mesh: Mesh, centre: Array) -> Array:
    """Return heights and largest radii about the z axis through a centre, m (n, 2)."""
    points = mesh.points - centre * [1, 1, 0]
    edges = points[np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]]])]
    edges = np.take_along_axis(edges, edges[:, :, 2:].argsort(axis=1), axis=1)  # upward
    low, high = edges[:, 0, 2], edges[:, 1, 2]
    heights = np.linspace(low.min(), high.max(), _SLICES)
    radii = np.empty(_SLICES)
    for number, height in enumerate(heights):
        is_crossed = (low <= height) & (height <= high)
        start, end = edges[is_crossed].swapaxes(0, 1)
        rise = end[:, 2] - start[:, 2]
        fraction = np.where(rise > 0, (height - start[:, 2]) / np.where(rise > 0, rise, 1.0), 1.0)
        crossings = start + fraction[:, None] * (end - start)
        radii[number] = np.hypot(crossings[:, 0], crossings[:, 1]).max()
    return np.stack([heights, radii], axis=1)


def _pitches(coordinates: Sequence[str], pitch: ArrayLike | None, *, spared: bool) -> Array:
    """Return metres a unit of each coordinate; `spared`: the second may stay unsaid."""
    count = len(coordinates)
    names = coordinates[:1] if spared else coordinates
    if pitch is None:
        known = Chart.named(names)
        if known is None:
            raise OptionError(
                f"how long a unit of {' and of '.join(names)} is is unknown: give pitch= in "
                f"metres a unit{' of each' * (len(names) > 1)}"
            )
        given = known.pitch
    else:
        given = numbers("pitch", pitch)
    given = np.full(len(names), given) if given.ndim == 0 and len(names) == 1 else given
    if given.shape == (1,) and count > 1 and spared:
        return np.concatenate([given, np.ones(count - 1)])
    if given.shape != (count,):
        raise OptionError(
            f"pitch is {given.tolist()}: give metres a unit of each of {', '.join(coordinates)}"
        )
    return given


def _require_beside(mesh: Mesh, heights: Array) -> None:
    """Refuse a surface that does not reach as far up and down as the recorded contacts."""
    low, high = mesh.bounds[:, 2]
    reach = _BEYOND * (high - low)
    if heights[0] < low - reach or heights[1] > high + reach:
        raise OptionError(
            f"contacts lie at z from {rounded(heights[0], 4)} to {rounded(heights[1], 4)} m, and "
            f"the geometry goes from {rounded(low, 4)} to {rounded(high, 4)} m: move it, give its "
            "units, or give another pitch="
        )


def _require_outline(outline: Array) -> None:
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 2:
        raise OptionError(f"outline has shape {outline.shape}: give heights and radii (n, 2)")
    is_finite = np.abs(outline).max() <= _COARSEST  # NaN neither
    if not is_finite or np.any(np.diff(outline[:, 0]) <= 0) or np.any(outline[:, 1] < 0):
        raise OptionError(
            "outline: heights must ascend and radii be at least 0, all finite, in m: put them right"
        )
