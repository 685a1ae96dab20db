"""Sound maps: few stored sounds that represent all contacts of a body (1998, section 5)."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import ArgumentError, FileFormatError, OptionError, article, counted, rounded
from struck.files.atomic import read_bytes, write_bytes
from struck.files.container import from_bytes, to_bytes
from struck.model.arrays import Array, Complex, Index, checked, require_number, require_numbers
from struck.model.contact import Contact
from struck.model.mesh import Mesh, Surface
from struck.model.model import ModalModel
from struck.model.provenance import Progress, reported, shown, silent
from struck.perception.auditory_scale import integrated, threshold_in_quiet
from struck.perception.sonic_distance import HeardModel, erb_distance, filter_centres, surface_of

THRESHOLD = 3.0  # dB
MOST_TRIANGLES = 300_000

# A triangle whose own timbre leaves no more than this share of the threshold is not cut further
# before a contact is chosen in it. Less cuts finer and needs fewer contacts.
_TIMBRE_FRACTION = 0.33
# Timbres compared at a time; of them, those are taken that suit this share of what the best does.
_POOL, _WORTH = 48, 0.5
# Farther than this share of the threshold at its centroid, no timbre is tried on a triangle: it
# would exceed the threshold elsewhere in it.
_TRIAL_FRACTION = 0.85

# A parabola through the corners is largest at the centroid, 4/3 of the largest value at the
# midpoints of the edges; the rest is for deviations from a parabola.
_CURVATURE_FACTOR = 2.0
_MAX_VALUES = 2_000_000  # numbers in the largest array, so that memory does not grow with the body
# Amplitudes over that of 20 micropascal: at -120 dB nothing is left but rounding. Taking it for
# silence moves levels at the threshold by less than the slack, dB.
_SILENT, _SLACK = 1e-6, 1e-4
_TINY = 1e-300
_WIDTH_FRACTION, _MAX_FLATNESS = 0.7, 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundMap:
    """Stored contacts of a body, and the parts of its surface that each represents.

    The surface is cut into triangles, which are smaller where the timbre changes faster. Each has
    the timbre of one stored contact, at a level that is interpolated between its corners.

    Parameters
    ----------
    frequencies : array (M,)
        Frequencies of the modes, Hz.
    decays : array (M,)
        Decay rates of the modes, 1/s.
    contacts : array (K, 3)
        Stored contacts, m.
    directions : array (K, 3)
        Directions of the pushes, straight into the surface.
    gains : array (K, M), complex
        Gains of the modes at the listener, Pa/(N s) if `calibrated`, otherwise relative.
    calibrated : bool
        Whether gains are in Pa/(N s).
    listener : array (3,)
        Position, m.
    level : float
        Level of the loudest contact for which `bound` holds, dB re 20 micropascal.
    threshold : float
        Requested largest distance, dB.
    bound : float
        Upper bound of the sonic distance between a contact and the one that represents it, dB.
    surface : Mesh
        The triangles.
    owners : array (F,) of int
        Stored contact that represents each triangle.
    factors : array (F, 3)
        Factors of its sound at the corners.
    brightness : array (F, 3)
        Centroid of the spectrum of the body itself at the corners, Hz; NaN if it is silent.

    Raises
    ------
    OptionError
        If the arrays do not fit each other.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", band=(20.0, 1000.0), progress=None)
    >>> chart = struck.sound_map(model, threshold_db=6.0, progress=None)
    >>> chart.at(model.contact("end").point).shape == chart.frequencies.shape
    True
    >>> chart.save("bar.map")
    >>> struck.SoundMap.load("bar.map").bound == chart.bound
    True
    """

    frequencies: Array
    decays: Array
    contacts: Array
    directions: Array
    gains: Complex
    calibrated: bool
    listener: Array
    level: float
    threshold: float
    bound: float
    surface: Mesh
    owners: Index
    factors: Array
    brightness: Array

    def __post_init__(self) -> None:
        if not isinstance(self.surface, Mesh) or not isinstance(self.calibrated, bool):
            raise ArgumentError(
                f"surface is {article(type(self.surface).__name__)}, and calibrated is "
                f"{article(type(self.calibrated).__name__)}: give a Mesh, and True or False"
            )
        stored, modes = np.shape(self.contacts)[:1], np.shape(self.frequencies)[:1]
        faces = len(self.surface.faces)
        shapes = {
            "frequencies": modes,
            "decays": modes,
            "contacts": (*stored, 3),
            "directions": (*stored, 3),
            "gains": (*stored, *modes),
            "listener": (3,),
            "level": (),
            "threshold": (),
            "bound": (),
            "owners": (faces,),
            "factors": (faces, 3),
            "brightness": (faces, 3),
        }
        for name, shape in shapes.items():
            require_numbers(name, getattr(self, name), shape, gaps=name == "brightness")
            if name != "gains" and np.iscomplexobj(getattr(self, name)):
                raise ArgumentError(f"{name} are complex: give real numbers")
        if self.owners.dtype.kind not in "iu" or not (
            self.owners.min() >= 0 and self.owners.max() < stored[0]
        ):
            raise OptionError(
                f"owners are {self.owners.dtype.name} from {self.owners.min()} to "
                f"{self.owners.max()}: give the index of one of {stored[0]} stored contacts each"
            )

    def __repr__(self) -> str:
        contacts, modes = counted(len(self.contacts), "contact"), len(self.frequencies)
        description = (
            f"{contacts} of {counted(modes, 'mode')}, no other farther than {self.bound:.2f} dB"
        )
        return f"SoundMap({description})"

    @cached_property
    def locator(self) -> Surface:
        """The triangles as a place to look contacts up on."""
        return Surface(self.surface)

    @checked
    def stored(self, point: ArrayLike) -> tuple[int, float]:
        """Return the number of the stored sound at a point, and the factor to multiply it by.

        Parameters
        ----------
        point : array-like (3,)
            In the body's coordinates, m; the push goes straight into the surface.

        Returns
        -------
        tuple of int, float
            Number of the stored contact, and the factor of its sound.

        Raises
        ------
        ContactError
            When the point is off the body.
        """
        contact = Contact.on(self.locator, self.surface, np.asarray(point, float))
        faces, weights = self.locator.barycentric(contact.point)
        return int(self.owners[faces[0]]), float(weights[0] @ self.factors[faces[0]])

    @checked
    def at(self, point: ArrayLike) -> Complex:
        """Return the gains of a unit impulse at a point, straight into the surface.

        With `frequencies` and `decays` they define the sound: p(t) = sum_n Im[g_n exp((-d_n + 2 pi
        i f_n) t)].

        Parameters
        ----------
        point : array-like (3,)
            Point in body coordinates, m.

        Returns
        -------
        array (M,), complex
            Gains.

        Raises
        ------
        ContactError
            If the point is not on the body.
        """
        number, factor = self.stored(point)
        return factor * self.gains[number]

    @property
    def stored_brightness(self) -> Array:
        """Centroids of the spectra of the stored sounds, Hz (K,)."""
        energies = np.square(np.abs(self.gains)) * integrated(self.decays)
        return energies @ self.frequencies / energies.sum(axis=1)

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to a safetensors file, completely or not at all.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        FileFormatError
            If the file cannot be written.
        """
        write_bytes(path, to_bytes(self, (SoundMap, Mesh)))

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> SoundMap:
        """Read a sound map.

        Parameters
        ----------
        path : path
            A file that `save` wrote.

        Returns
        -------
        SoundMap
            The map.

        Raises
        ------
        FileFormatError
            If the file cannot be read, is damaged, or is not a sound map.
        """
        data = read_bytes(path)
        try:
            content = from_bytes(data, (SoundMap, Mesh))
        except FileFormatError as error:
            raise FileFormatError(f"{path}: {error}") from error
        if not isinstance(content, cls):
            raise FileFormatError(f"{path} holds no sound map: save one with SoundMap.save")
        return content


@checked
def sound_map(
    model: ModalModel,
    threshold_db: float = THRESHOLD,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
    progress: Progress | None = shown,
) -> SoundMap:
    """Choose the contacts whose sounds represent the whole surface of a body.

    Parameters
    ----------
    model : ModalModel
        A model with a surface.
    threshold_db : float, default 3.0
        Largest `sonic_distance` between a stored sound and that of a push straight into the surface
        at any contact that it represents.
    listener : array-like (3,), optional
        Position, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact, dB re 20 micropascal. A lower one needs fewer contacts.
        Default: 85.
    progress : callable or None, optional
        As for `analyze`.

    Returns
    -------
    SoundMap
        Contacts, and the triangles of the surface that each represents. Its `bound` holds for all
        contacts, not for a sample of them (see `docs/explanation/perception.md`).

    Raises
    ------
    OptionError
        If the model has no surface, or a value is out of range.
    ContactError
        If the listener is inside the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> chart = struck.sound_map(model, threshold_db=6.0, progress=None)
    >>> chart.gains.shape == (len(chart.contacts), len(chart.frequencies))
    True
    """
    hint = "it must exceed 0, such as 3, and 0.1 dB is the least that is told apart"
    require_number("threshold_db", threshold_db, 0.1, hint=hint)
    surface = surface_of(model)
    hearing = HeardModel.at(model, listener, level)
    if len(hearing.listeners) > 1:
        raise OptionError(f"{len(hearing.listeners)} listeners are given: make a map for each")
    cover = cover_surface(Ear.of(hearing), surface, threshold_db, reported(progress))
    contact_amplitudes = np.linalg.norm(hearing.amplitudes(cover.points, cover.directions), axis=1)
    points, numbers = np.unique(cover.corners.reshape(-1, 3), axis=0, return_inverse=True)
    return SoundMap(
        frequencies=model.frequencies,
        decays=model.decays,
        contacts=cover.points,
        directions=cover.directions,
        gains=hearing.gains(cover.points, cover.directions)[:, 0],
        calibrated=model.calibrated,
        listener=hearing.listeners[0],
        level=hearing.level,
        threshold=float(threshold_db),
        bound=float(cover.misfits.max()),
        surface=Mesh(points=points, faces=numbers.reshape(-1, 3), up=surface.up),
        owners=cover.owners,
        factors=cover.amplitudes / contact_amplitudes[cover.owners][:, None],
        brightness=cover.brightness,
    )


class Cover(NamedTuple):
    """Contacts, and the triangles that take their timbre from them."""

    points: Array  # (K, 3): the contacts, m
    directions: Array  # (K, 3): of the pushes, straight into the surface
    corners: Array  # (F, 3, 3): of the triangles of the whole surface, m
    amplitudes: Array  # (F, 3): as of `Facets`
    brightness: Array  # (F, 3)
    owners: Index  # (F,): which contact each triangle takes its timbre from
    misfits: Array  # (F,): bounds of the sonic distance within each triangle, dB


_Contact = tuple[Array, Array, Array]  # point (3,), direction (3,) and timbre (B,)


def _contact(facets: Facets, facet: int) -> _Contact:
    """Return the contact at the centroid of a facet."""
    return facets.corners[facet].mean(axis=0), facets.directions[facet], facets.timbres[facet]


def cover_surface(ear: Ear, surface: Mesh, threshold: float, progress: Progress = silent) -> Cover:
    """Choose contacts so that no place is farther than `threshold` dB from the one it takes."""
    # The loudest triangle gives the first contact. Triangles within the threshold of a chosen one
    # are done. Each other triangle in which the sound varies little proposes its own timbre, and
    # the proposal that covers most triangles is chosen. Triangles that no proposal covers are
    # halved, across the edge along which the sound changes most.
    left = Facets.of(ear, surface.points[surface.faces], -surface.face_normals)
    chosen = [_contact(left, int(left.amplitudes.mean(axis=1).argmax()))]
    finished_parts: list[list[NDArray[Any]]] = []
    count, total_area = 0, _area(left.corners)
    while len(left):
        progress("choosing contacts", 1 - _area(left.corners) / total_area)
        if count + len(left) > MOST_TRIANGLES:
            raise OptionError(
                f"threshold_db is {rounded(threshold)}: the surface would be cut into "
                f"{count + len(left)} triangles, with {MOST_TRIANGLES} allowed; give a larger one, "
                "or a lower level"
            )
        timbres = np.stack([timbre for _, _, timbre in chosen])
        owners = left.distances(ear.quiet, timbres).argmin(axis=1)
        misfits = left.misfits(ear.quiet, timbres[owners])
        _choose(ear, left, owners, misfits, chosen, threshold)
        is_suited = misfits <= threshold
        parts = (left.corners, left.amplitudes, left.brightness, owners, misfits)
        finished_parts.append([part[is_suited] for part in parts])
        count += int(is_suited.sum())
        left = left.taken(~is_suited)
        left = left.halved(ear) if len(left) else left
    points, directions, _ = (np.stack(values) for values in zip(*chosen, strict=True))
    return Cover(points, directions, *map(np.concatenate, zip(*finished_parts, strict=True)))


def _area(corners: Array) -> float:
    """Return twice the area of triangles (F, 3, 3) together, m^2."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(normals, axis=1).sum())


def _choose(
    ear: Ear,
    facets: Facets,
    owners: Index,
    misfits: Array,
    chosen: list[_Contact],
    threshold: float,
) -> None:
    """Add timbres to `chosen` until all small facets have one; set `owners` and `misfits`."""
    small = facets.misfits(ear.quiet, facets.timbres) <= _TIMBRE_FRACTION * threshold
    while np.any(small & (misfits > threshold)):
        waiting = np.flatnonzero(misfits > threshold)
        able = waiting[small[waiting]]
        pool = able[np.linspace(0, len(able) - 1, min(_POOL, len(able))).astype(np.int64)]
        bounds = _bounds(ear, facets.taken(waiting), facets.timbres[pool], threshold)
        for column in _choose_greedily(bounds <= threshold):
            suits = bounds[:, column] < misfits[waiting]
            misfits[waiting[suits]] = bounds[suits, column]
            owners[waiting[suits]] = len(chosen)
            chosen.append(_contact(facets, int(pool[column])))


def _choose_greedily(suits: NDArray[np.bool_]) -> list[int]:
    """Return columns chosen greedily: each suits the most rows not yet covered."""
    columns: list[int] = []
    waiting = suits.copy()
    best_count = waiting.sum(axis=0).max()
    while True:
        counts = waiting.sum(axis=0)
        column = int(counts.argmax())
        if counts[column] == 0 or counts[column] < _WORTH * best_count:
            return columns
        columns.append(column)
        waiting &= ~waiting[:, column : column + 1]


def _bounds(ear: Ear, facets: Facets, timbres: Array, threshold: float) -> Array:
    """Return bounds of the misfits with timbres (K, B), infinite where beyond hope: (F, K)."""
    bounds = np.full((len(facets), len(timbres)), np.inf)
    is_near = facets.distances(ear.quiet, timbres) <= _TRIAL_FRACTION * threshold
    for number, timbre in enumerate(timbres):
        rows = np.flatnonzero(is_near[:, number])
        bounds[rows, number] = facets.taken(rows).misfits(ear.quiet, timbre[None])
    return bounds


# Bounds on the sounds of all pushes anywhere within a triangle.
#
# A sound is divided into its level and its timbre: the levels behind the ear's filters less the
# whole level. A map plays one stored timbre all over a triangle, at an amplitude that goes straight
# from corner to corner: a(x) = sum_c t_c A_c with the amplitudes A_c at the corners, sum_c t_c = 1.
#
# The gains of a push at x are sum_c t_c g_c + r(x): r is what a straight line leaves out, and it
# vanishes for mode shapes given at vertices. Behind a filter, ||g|| is the root of the intensity, a
# norm, so ||g(x)|| <= sum_c t_c (||g_c|| + ||r||); and with any unit vector u,
# ||g(x)|| >= sum_c t_c (<g_c, u> - ||r||). Divided by a(x), either lies between the least and the
# greatest of its three quotients at the corners (the mediant inequality).


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ear:
    """A body behind the ear's filters."""

    hearing: HeardModel
    passing: Array  # (B, P): the share of each part that passes each filter
    quiet: Array  # (B,): threshold in quiet at the filters, dB

    @classmethod
    def of(cls, hearing: HeardModel) -> Ear:
        """Put the ear's filters behind a heard model."""
        centres = filter_centres()
        return cls(
            hearing=hearing, passing=hearing.passing(centres), quiet=threshold_in_quiet(centres)
        )

    def parts(self, points: Array, directions: Array) -> Array:
        """Return amplitudes at points (F, K, 3), one direction (F, 3) for K points: (F, K, P)."""
        along = np.repeat(directions, points.shape[1], axis=0)
        parts = self.hearing.amplitudes(points.reshape(-1, 3), along)
        return parts.reshape(*points.shape[:2], -1)

    def products(self, one: Array, other: Array) -> Array:
        """Return the inner products of parts (..., P) behind the filters (..., B)."""
        return (one * other) @ self.passing.T

    def behind(self, parts: Array) -> Array:
        """Return the amplitudes behind the filters (..., B)."""
        return np.sqrt(self.products(parts, parts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Facets:
    """Triangles with bounds on the sounds of pushes anywhere within them."""

    corners: Array  # (F, 3, 3), m
    directions: Array  # (F, 3): straight into the surface
    amplitudes: Array  # (F, 3): at the corners, relative to 20 micropascal
    brightness: Array  # (F, 3): centroids of the spectra, Hz; NaN where it is silent
    timbres: Array  # (F, B): at the centroids, levels of B auditory bands less the total, dB
    least: Array  # (F, B): bounds of the timbres at the amplitude that a map plays, dB
    most: Array
    soft: Array  # (F, B): bounds of the levels behind the filters, dB
    loud: Array
    edges: Index  # (F,): which edge, from corner to next, the sound changes most along

    @classmethod
    def of(cls, ear: Ear, corners: Array, directions: Array) -> Facets:
        """Measure and bound the sounds of triangles (F, 3, 3) pushed along directions (F, 3)."""
        count = max(1, _MAX_VALUES // (7 * (ear.passing.shape[1] + len(ear.quiet))))
        starts = range(0, max(1, len(corners)), count)
        parts = [
            _measure_facets(ear, corners[i : i + count], directions[i : i + count]) for i in starts
        ]
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.corners)

    def taken(self, rows: Index | NDArray[np.bool_]) -> Facets:
        """Return the facets of some triangles only."""
        return Facets(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def halved(self, ear: Ear) -> Facets:
        """Return two facets for each, cut from the middle of `edges` to the opposite corner."""
        rows = np.arange(len(self))
        start, end, opposite_corners = (
            self.corners[rows, (self.edges + step) % 3] for step in range(3)
        )
        midpoints = (start + end) / 2
        halves = [(start, midpoints, opposite_corners), (midpoints, end, opposite_corners)]
        corners = np.concatenate([np.stack(half, axis=1) for half in halves])
        return Facets.of(ear, corners, np.tile(self.directions, (2, 1)))

    def misfits(self, thresholds: Array, timbres: Array) -> Array:
        """Return bounds on the sonic distance from one timbre for each (F, B), dB (F,)."""
        # What a filter adds is at most what the interval of timbres leaves, and at most what the
        # louder of the two exceeds the threshold by. The mean counts filters where either is above
        # threshold; of the undecided ones, it counts those that make it largest.
        max_levels, min_levels = (
            _levels(extremum(self.amplitudes, axis=1)) for extremum in (np.max, np.min)
        )
        deviations = np.maximum(self.most - timbres, timbres - self.least)
        level_excess = np.maximum(self.loud, max_levels[:, None] + timbres) - thresholds
        squares = np.square(np.maximum(np.minimum(deviations, level_excess), 0.0))
        is_sure = (self.soft > thresholds) | (min_levels[:, None] + timbres > thresholds)
        return np.sqrt(_find_largest_mean(squares, is_sure)) + _SLACK

    def distances(self, thresholds: Array, timbres: Array) -> Array:
        """Return the sonic distances at the centroids from timbres (K, B), dB (F, K)."""
        level = _levels(self.amplitudes.mean(axis=1))[:, None]
        levels = np.maximum(level + self.timbres - thresholds, 0.0)
        played_levels = (np.maximum(level + timbre - thresholds, 0.0) for timbre in timbres)
        return np.stack(
            [erb_distance(levels, stored_levels) for stored_levels in played_levels], axis=1
        )


def _measure_facets(ear: Ear, corners: Array, directions: Array) -> Facets:
    places = [corners, (corners + _roll_corners(corners)) / 2, corners.mean(axis=1, keepdims=True)]
    parts = ear.parts(np.concatenate(places, axis=1), directions)
    ends, midpoints, centroid = parts[:, :3], parts[:, 3:6], parts[:, 6]
    bent = _CURVATURE_FACTOR * ear.behind(midpoints - (ends + _roll_corners(ends)) / 2)
    amplitudes = np.linalg.norm(ends, axis=2)
    squares, products = ear.products(ends, ends), ear.products(ends, _roll_corners(ends))
    along = (squares + products + np.roll(products, 1, axis=1)) / 3
    least, most, soft, loud = _ranges(squares, along, bent.max(axis=1), amplitudes)
    widths = _widths(ear, squares, products, bent, ends, midpoints)
    return Facets(
        corners=corners,
        directions=directions,
        amplitudes=amplitudes,
        brightness=_brightness(ear.hearing, ends),
        timbres=_levels(ear.behind(centroid)) - _levels(np.linalg.norm(centroid, axis=1))[:, None],
        least=least,
        most=most,
        soft=soft,
        loud=loud,
        edges=_chosen(corners, widths),
    )


def _ranges(
    squares: Array,  # (..., k, B): products of the parts of k corners with themselves
    along: Array,  # (..., k, B): and with the mean of all
    deviation: Array,  # (..., B): deviations from straight lines
    amplitudes: Array,  # (..., k)
) -> tuple[Array, Array, Array, Array]:
    """Return bounds of timbres and of levels between corners, behind the filters, dB (..., B)."""
    mean = np.sqrt(np.maximum(along.mean(axis=-2, keepdims=True), 0.0))
    low = along / np.maximum(mean, _TINY) - deviation[..., None, :]
    high = np.sqrt(squares) + deviation[..., None, :]
    level = _levels(amplitudes)[..., None]
    # A silent corner plays no part in the mediant.
    is_silent = (amplitudes <= _SILENT)[..., None] & (high <= _SILENT)
    least = np.where(is_silent, np.inf, _levels(low) - level).min(axis=-2)
    most = np.where(is_silent, -np.inf, _levels(high) - level).max(axis=-2)
    return least, most, _levels(low.min(axis=-2)), _levels(high.max(axis=-2))


def _widths(
    ear: Ear, squares: Array, products: Array, bent: Array, ends: Array, midpoints: Array
) -> Array:
    """Return for each edge how wide the interval of audible timbres on it is, dB (F, 3)."""
    amplitudes = np.linalg.norm(ends, axis=2)
    edge_squares = np.stack([squares, _roll_corners(squares)], axis=2)
    along = (edge_squares + products[:, :, None]) / 2
    corners = np.stack([amplitudes, _roll_corners(amplitudes)], axis=2)
    least, most, _, loud = _ranges(edge_squares, along, bent, corners)
    midpoint_timbres = (
        _levels(ear.behind(midpoints)) - _levels(np.linalg.norm(midpoints, axis=2))[..., None]
    )
    floor = ear.quiet - _levels(amplitudes.max(axis=1))[:, None, None]
    level_excess = np.maximum(loud - ear.quiet, 0.0)
    low = np.maximum(np.minimum(least, midpoint_timbres), floor)
    return np.linalg.norm(
        np.clip(np.maximum(most, midpoint_timbres) - low, 0.0, level_excess), axis=2
    )


def _chosen(corners: Array, widths: Array) -> Index:
    """Return the edge of each triangle to halve: the longest of its widest ones."""
    # Needles are cut at the longest edge: a change between its ends and its midpoint that is not
    # sampled would otherwise be approached from one side without end.
    sides = _roll_corners(corners) - corners
    lengths = np.linalg.norm(sides, axis=2)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    needles = np.square(lengths.max(axis=1)) > _MAX_FLATNESS * areas
    wide = (widths >= _WIDTH_FRACTION * widths.max(axis=1, keepdims=True)) | needles[:, None]
    return np.where(wide, lengths, -1.0).argmax(axis=1)


def _roll_corners(values: Array) -> Array:
    """Return the values of the following corner, axis 1."""
    return np.roll(values, -1, axis=1)


def _find_largest_mean(squares: Array, is_sure: NDArray[np.bool_]) -> Array:
    """Return the largest mean over the `is_sure` columns and any of the others, row by row."""
    base, counts = np.where(is_sure, squares, 0.0).sum(axis=1), np.count_nonzero(is_sure, axis=1)
    others = np.where(is_sure, 0.0, squares)
    mean, new_mean = np.full(len(squares), -1.0), base / np.maximum(counts, 1)
    while np.any(new_mean > mean):  # values above the mean raise it, until none is left
        mean = np.maximum(mean, new_mean)
        is_above = others > mean[:, None]
        total = base + np.where(is_above, others, 0.0).sum(axis=1)
        new_mean = total / np.maximum(counts + np.count_nonzero(is_above, axis=1), 1)
    return mean


def _brightness(hearing: HeardModel, ends: Array) -> Array:
    tones = np.tile(hearing.model.frequencies, ends.shape[2] // len(hearing.model.frequencies))
    energies = np.square(ends)
    total_energies = energies.sum(axis=2)
    return np.where(
        total_energies > _SILENT**2,
        (energies @ tones) / np.maximum(total_energies, _SILENT**2),
        np.nan,
    )


def _levels(amplitudes: Array) -> Array:
    return 20 * np.log10(np.maximum(amplitudes, _TINY))
