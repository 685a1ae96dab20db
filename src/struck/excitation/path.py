"""A path over a body, the shortest one from place to place.

Over a computed body it follows the surface; over a recorded one it goes straight from place to
place in the coordinates of its contacts, and its length in metres is what the body's chart says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from struck.errors import ContactError, OptionError, require_choice
from struck.excitation.excitation import coordinates
from struck.model.arrays import Array, Mask
from struck.model.chart import Chart
from struck.model.gains import ShapeGains
from struck.model.mesh import Mesh, Surface
from struck.model.model import ModalModel

Waypoints = Sequence[Sequence[float] | str | Array]

REPEATS = ("once", "back", "loop")  # stop at the end, go there and back, or go round

_PIECES = 128
# Spacings at which points are pulled tight in turn, and rounds at each.
_SPACINGS, _ROUNDS = (16, 8, 4, 2, 1), 24
_SAME_RATIO = 1e-9  # of the extent: places nearer each other are one
# A step longer than this many mean ones leaps through the body.
_MAX_STEP_RATIO = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A curve on a body, by the length travelled along it."""

    points: Array  # (N, D): on the surface, m; of a recorded body its contacts' coordinates
    spots: Array  # (N, 3), where they lie, m
    normals: Array  # (N, 3), outward, of length 1; 0 of a recorded body
    lengths: Array  # (N,), distance from the start, m; ascending from 0
    repeat: str = "once"  # one of `REPEATS`; a loop ends where it starts

    @classmethod
    def over(cls, model: ModalModel, places: Waypoints, *, repeat: str = "once") -> Path:
        """Return the path through two or more places; ContactError where the surface has none."""
        require_waypoints(places, repeat)
        mesh = model.geometry
        if mesh is None or model.recorded:
            return _make_recorded_path(model, places, repeat)
        stops = [model.contact(place).point for place in places]
        if repeat == "loop":
            stops.append(stops[0])
        surface = model.gains.locator if isinstance(model.gains, ShapeGains) else Surface(mesh)
        legs = [find_shortest(mesh, surface, *ends) for ends in pairwise(stops)]
        points = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        is_moving = np.concatenate([[True], steps > _SAME_RATIO * mesh.extent])
        _require_moving(is_moving)
        _, faces, nearest_points = surface.closest(points[is_moving])
        return cls(
            points=points[is_moving],
            spots=points[is_moving],
            normals=mesh.normals_at(faces, nearest_points),
            lengths=np.concatenate([[0.0], np.cumsum(steps[is_moving[1:]])]),
            repeat=repeat,
        )

    @property
    def length(self) -> float:
        """Distance from the first place to the last, m."""
        return float(self.lengths[-1])

    def at(self, travelled: ArrayLike) -> Array:
        """Return the points (..., D) after distances (...) of `travelled` m."""
        return self._read(self.points, travelled)

    def spot(self, travelled: ArrayLike) -> Array:
        """Return the positions in space (..., 3), m, of points of the path."""
        return self._read(self.spots, travelled)

    def normal(self, travelled: ArrayLike) -> Array:
        """Return the outward unit normals (..., 3) after distances (...) of `travelled` m."""
        normals = self._read(self.normals, travelled)
        sizes = np.linalg.norm(normals, axis=-1, keepdims=True)
        return normals / np.maximum(sizes, np.finfo(float).tiny)

    def _read(self, table: Array, travelled: ArrayLike) -> Array:
        folded = self._folded(np.asarray(travelled, np.float64))
        return np.stack([np.interp(folded, self.lengths, axis) for axis in table.T], axis=-1)

    def _folded(self, travelled: Array) -> Array:
        """Return distances from the first place to the last."""
        if self.repeat == "loop":
            return travelled % self.length
        if self.repeat == "back":
            return self.length - np.abs(travelled % (2 * self.length) - self.length)
        return travelled  # held at its ends


def _make_recorded_path(model: ModalModel, places: Waypoints, repeat: str) -> Path:
    """Return the path through places of a recorded body, straight in their coordinates."""
    stops, chart = _stops(model, places)
    stops += stops[:1] * (repeat == "loop")
    legs = [np.linspace(*ends, _PIECES + 1) for ends in pairwise(stops)]
    points = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    model.gains.at(points, np.zeros((len(points), 3)))  # refuses what was not recorded
    spots = chart.places(points)
    steps = np.linalg.norm(np.diff(spots, axis=0), axis=1)
    is_moving = np.concatenate([[True], steps > 0])
    _require_moving(is_moving)
    return Path(
        points=points[is_moving],
        spots=spots[is_moving],
        normals=np.zeros((np.count_nonzero(is_moving), 3)),
        lengths=np.concatenate([[0.0], np.cumsum(steps[steps > 0])]),
        repeat=repeat,
    )


def _stops(model: ModalModel, places: Waypoints) -> tuple[list[Array], Chart]:
    """Return places of a recorded body in coordinates, and where these lie."""
    if model.coordinates:
        stops = [model.contact(place).point for place in places]
        if model.chart is None:
            raise ContactError(
                "speed is in m/s, and it is not known how long a unit of "
                f"{' and of '.join(model.coordinates)} is: say it in metres by pitch=, as in "
                "model.charted(pitch=0.25), or to fit"
            )
        return stops, model.chart
    stops = [np.zeros(0) if isinstance(place, str) else np.asarray(place) for place in places]
    if not len(stops[0]) or any(stop.shape != stops[0].shape for stop in stops):
        raise ContactError(
            f"the path is {places!r}: the body was recorded at one place, which sounds alike "
            "however far one goes, so give two coordinates in m, as far apart as one goes, such as "
            "0 and 0.1"
        )
    return stops, Chart(pitch=np.ones(len(stops[0])))


def _require_moving(is_moving: Mask) -> None:
    if not is_moving[1:].any():
        raise OptionError("the places of the path are one and the same: set them apart")


def require_waypoints(places: Waypoints, repeat: str) -> None:
    """Raise an OptionError on fewer than two places or an unknown repetition."""
    if isinstance(places, str) or len(places) < 2:
        raise OptionError(f"the path is {places!r}: give two places or more, such as [p, q]")
    require_choice("repeat", repeat, REPEATS)
    for place in places:
        if not isinstance(place, str):
            coordinates("a place of the path", place)


def find_shortest(mesh: Mesh, surface: Surface, start: Array, end: Array) -> Array:
    """Return points (N, 3) of a locally shortest path over a surface."""
    # The shortest path along edges (Dijkstra) is pulled tight like a string: each point in turn
    # moves to the midpoint of its neighbours and back onto the surface, first at wide spacings,
    # then at narrow ones.
    edge_path = _resample(_find_edge_path(mesh, surface, start, end), _PIECES)
    for coarsest in _SPACINGS:
        points = _tighten(surface, edge_path, coarsest)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if steps.max() <= _MAX_STEP_RATIO * steps.mean():
            return points
    # Pulled tight at any spacing it leaps through a thin wall.
    return edge_path


def _tighten(surface: Surface, points: Array, coarsest: int) -> Array:
    for spacing in (size for size in _SPACINGS if size <= coarsest):
        chosen = points[::spacing]
        for _ in range(_ROUNDS):
            chosen = _pull_tight(surface, chosen)
        points = _resample(chosen, _PIECES)
        points[1:-1] = surface.closest(points[1:-1])[2]
    return points


def _pull_tight(surface: Surface, points: Array) -> Array:
    """Move every second point, then the others, to the midpoints of their neighbours."""
    points = points.copy()
    for parity in (1, 2):
        midpoints = (points[parity - 1 : -2 : 2] + points[parity + 1 :: 2]) / 2
        points[parity:-1:2] = surface.closest(midpoints)[2]
    return points


def _resample(points: Array, pieces: int) -> Array:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lengths = np.concatenate([[0.0], np.cumsum(steps)])
    target_lengths = np.linspace(0, lengths[-1], pieces + 1)
    return np.stack([np.interp(target_lengths, lengths, axis) for axis in points.T], axis=1)


def _find_edge_path(mesh: Mesh, surface: Surface, start: Array, end: Array) -> Array:
    """Return the shortest path along edges, its ends joined to the corners of their faces."""
    _, faces, ends = surface.closest(np.stack([start, end]))
    if faces[0] == faces[1]:
        return ends
    first, last = (
        _find_nearest_corner(mesh, faces[0], start),
        _find_nearest_corner(mesh, faces[1], end),
    )
    _, predecessors = dijkstra(
        _edges(mesh), directed=False, indices=[first], return_predecessors=True
    )
    vertices = [last]
    while vertices[-1] != first:
        vertices.append(int(predecessors[0, vertices[-1]]))
        if vertices[-1] < 0:
            raise ContactError(
                "no path over the surface leads from one place of the path to the next: they lie "
                "on separate parts; choose both on one"
            )
    return np.concatenate([ends[:1], mesh.points[vertices[::-1]], ends[1:]])


def _find_nearest_corner(mesh: Mesh, face: int, point: Array) -> int:
    corners = mesh.faces[face]
    return int(corners[np.argmin(np.linalg.norm(mesh.points[corners] - point, axis=1))])


def _edges(mesh: Mesh) -> csr_array:
    count = len(mesh.points)
    pairs = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    pairs = np.stack(np.divmod(np.unique(pairs @ np.array([count, 1])), count), axis=1)
    lengths = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
    return csr_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
