"""Which contacts are enough: timbres chosen until each place of a surface has one like its own."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.perception.auditory_scale import threshold_in_quiet
from struck.perception.sonic_distance import HeardModel, filter_centres

# All sounds of a triangle at once: bounds on what pushes anywhere within it can sound like.
#
# A sound is told apart into its level and its timbre, the levels behind the ear's filters less the
# whole level. A map plays one stored timbre all over a triangle, at an amplitude that goes straight
# from corner to corner: a(x) = sum_c t_c A_c with the amplitudes A_c at the corners, sum_c t_c = 1.
#
# The gains of a push at x are sum_c t_c g_c + r(x): r is what a straight line leaves out, and it
# vanishes for mode shapes given at vertices. Behind a filter, ||g|| is the root of the intensity, a
# norm, so ||g(x)|| <= sum_c t_c (||g_c|| + ||r||); and with any unit vector u,
# ||g(x)|| >= sum_c t_c (<g_c, u> - ||r||). Divided by a(x), either lies between the least and the
# greatest of its three quotients at the corners (the mediant inequality).

# A parabola through the corners is largest at the centroid, 4/3 of the greatest that the middles
# of the edges tell; the rest is for what is no parabola.
_CURVED = 2.0
_AT_ONCE = 2_000_000  # numbers in the largest array, so that memory does not grow with the body
# Amplitudes over that of 20 micropascal: at -120 dB nothing is left but rounding. Taking it for
# silence moves levels at the threshold by less than the slack, dB.
_SILENT, _SLACK = 1e-6, 1e-4
_TINY = 1e-300
_ALIKE, _FLATTEST = 0.7, 100.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ear:
    """A body as it is heard through the ear's filters.

    Parameters
    ----------
    heard : Heard
    passing : array (B, P)
        What of each part passes each filter.
    quiet : array (B,)
        Threshold in quiet at the filters, dB.
    """

    heard: HeardModel
    passing: Array
    quiet: Array

    @classmethod
    def of(cls, heard: HeardModel) -> Ear:
        """Put all filters behind an ear."""
        centres = filter_centres()
        return cls(heard=heard, passing=heard.passing(centres), quiet=threshold_in_quiet(centres))

    def parts(self, points: Array, directions: Array) -> Array:
        """Return `Heard.amplitudes` at points (F, K, 3), one direction (F, 3) for K: (F, K, P)."""
        along = np.repeat(directions, points.shape[1], axis=0)
        parts = self.heard.amplitudes(points.reshape(-1, 3), along)
        return parts.reshape(*points.shape[:2], -1)

    def products(self, one: Array, other: Array) -> Array:
        """Return the inner products of parts (..., P) behind the filters (..., B)."""
        return (one * other) @ self.passing.T

    def behind(self, parts: Array) -> Array:
        """Return the amplitudes behind the filters (..., B)."""
        return np.sqrt(self.products(parts, parts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Facets:
    """Triangles with bounds on the sounds of pushes anywhere within them.

    Parameters
    ----------
    corners : array (F, 3, 3)
        m.
    directions : array (F, 3)
        Straight into the surface.
    amplitudes : array (F, 3)
        At the corners, over that of 20 micropascal.
    brightness : array (F, 3)
        Centroids of the spectra at the corners, Hz; NaN where it is silent.
    timbres : array (F, B)
        At the centroids: behind the filters less the whole, dB.
    least, most : array (F, B)
        Bounds of the timbres at the amplitude that a map plays, dB.
    soft, loud : array (F, B)
        Bounds of the levels behind the filters, dB.
    edges : array (F,)
        Which edge, from corner to next, the sound changes most along.
    """

    corners: Array
    directions: Array
    amplitudes: Array
    brightness: Array
    timbres: Array
    least: Array
    most: Array
    soft: Array
    loud: Array
    edges: Index

    @classmethod
    def of(cls, ear: Ear, corners: Array, directions: Array) -> Facets:
        """Look at triangles (F, 3, 3) that are pushed along directions (F, 3)."""
        count = max(1, _AT_ONCE // (7 * (ear.passing.shape[1] + len(ear.quiet))))
        starts = range(0, max(1, len(corners)), count)
        parts = [_looked_at(ear, corners[i : i + count], directions[i : i + count]) for i in starts]
        names = [each.name for each in fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.corners)

    def taken(self, which: Index | NDArray[np.bool_]) -> Facets:
        """Return some of them."""
        return Facets(**{each.name: getattr(self, each.name)[which] for each in fields(self)})

    def halved(self, ear: Ear) -> Facets:
        """Return twice as many, each cut from the middle of its `edges` to the corner opposite."""
        rows = np.arange(len(self))
        start, end, opposite = (self.corners[rows, (self.edges + step) % 3] for step in range(3))
        middle = (start + end) / 2
        halves = [(start, middle, opposite), (middle, end, opposite)]
        corners = np.concatenate([np.stack(half, axis=1) for half in halves])
        return Facets.of(ear, corners, np.tile(self.directions, (2, 1)))

    def misfits(self, quiet: Array, timbres: Array) -> Array:
        """Return bounds on the sonic distance from one timbre for each (F, B), dB (F,).

        What a filter adds is at most what the interval of timbres leaves, and at most what the
        louder of the two exceeds the threshold by. The mean counts filters where either is heard;
        of those that may or may not be heard, it takes the ones that make it largest.
        """
        strongest, weakest = _levels(self.amplitudes.max(axis=1)), _levels(self._least_amplitude())
        apart = np.maximum(self.most - timbres, timbres - self.least)
        above = np.maximum(self.loud, strongest[:, None] + timbres) - quiet
        squares = np.square(np.maximum(np.minimum(apart, above), 0.0))
        sure = (self.soft > quiet) | (weakest[:, None] + timbres > quiet)
        return np.sqrt(_largest_mean(squares, sure)) + _SLACK

    def distances(self, quiet: Array, timbres: Array) -> Array:
        """Return the sonic distances at the centroids from timbres (K, B), dB (F, K)."""
        level = _levels(self.amplitudes.mean(axis=1))[:, None]
        own = np.maximum(level + self.timbres - quiet, 0.0)
        found = np.empty((len(self), len(timbres)))
        for number, timbre in enumerate(timbres):
            other = np.maximum(level + timbre - quiet, 0.0)
            heard = np.count_nonzero((own > 0) | (other > 0), axis=1)
            squares = np.square(own - other).sum(axis=1)
            found[:, number] = np.sqrt(squares / np.maximum(heard, 1))
        return found

    def _least_amplitude(self) -> Array:
        return self.amplitudes.min(axis=1)


def _looked_at(ear: Ear, corners: Array, directions: Array) -> Facets:
    following = _next(corners)
    places = [corners, (corners + following) / 2, corners.mean(axis=1, keepdims=True)]
    parts = ear.parts(np.concatenate(places, axis=1), directions)
    ends, middles, centroid = parts[:, :3], parts[:, 3:6], parts[:, 6]
    bent = _CURVED * ear.behind(middles - (ends + _next(ends)) / 2)
    amplitudes = np.linalg.norm(ends, axis=2)
    squares, products = ear.products(ends, ends), ear.products(ends, _next(ends))
    along = (squares + products + np.roll(products, 1, axis=1)) / 3
    whole = _Range.of(squares, along, bent.max(axis=1), amplitudes)
    widths = _widths(ear, squares, products, bent, ends, middles)
    return Facets(
        corners=corners,
        directions=directions,
        amplitudes=amplitudes,
        brightness=_brightness(ear.heard, ends),
        timbres=_levels(ear.behind(centroid)) - _levels(np.linalg.norm(centroid, axis=1))[:, None],
        least=whole.least,
        most=whole.most,
        soft=whole.soft,
        loud=whole.loud,
        edges=_chosen(corners, widths),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Range:
    """Bounds of timbres and levels between some corners, behind the filters, dB (..., B)."""

    least: Array
    most: Array
    soft: Array
    loud: Array

    @classmethod
    def of(cls, squares: Array, along: Array, rest: Array, amplitudes: Array) -> _Range:
        """Bound what lies between k corners.

        Parameters
        ----------
        squares, along : array (..., k, B)
            Products of the corners' parts with themselves and with the mean of all.
        rest : array (..., B)
            What straight lines leave out.
        amplitudes : array (..., k)
            At the corners.
        """
        mean = np.sqrt(np.maximum(along.mean(axis=-2, keepdims=True), 0.0))
        low = along / np.maximum(mean, _TINY) - rest[..., None, :]
        high = np.sqrt(squares) + rest[..., None, :]
        level = _levels(amplitudes)[..., None]
        # A silent corner plays no part in the mediant.
        dumb = (amplitudes <= _SILENT)[..., None] & (high <= _SILENT)
        return cls(
            least=np.where(dumb, np.inf, _levels(low) - level).min(axis=-2),
            most=np.where(dumb, -np.inf, _levels(high) - level).max(axis=-2),
            soft=_levels(low.min(axis=-2)),
            loud=_levels(high.max(axis=-2)),
        )


def _widths(
    ear: Ear, squares: Array, products: Array, bent: Array, ends: Array, middles: Array
) -> Array:
    """Return for each edge how wide the interval of timbres is that can be heard on it (F, 3)."""
    amplitudes = np.linalg.norm(ends, axis=2)
    both = np.stack([squares, _next(squares)], axis=2)
    along = (both + products[:, :, None]) / 2
    edge = _Range.of(both, along, bent, np.stack([amplitudes, _next(amplitudes)], axis=2))
    between = _levels(ear.behind(middles)) - _levels(np.linalg.norm(middles, axis=2))[..., None]
    floor = ear.quiet - _levels(amplitudes.max(axis=1))[:, None, None]
    above = np.maximum(edge.loud - ear.quiet, 0.0)
    low = np.maximum(np.minimum(edge.least, between), floor)
    heard = np.clip(np.maximum(edge.most, between) - low, 0.0, above)
    return np.linalg.norm(heard, axis=2)


def _chosen(corners: Array, widths: Array) -> Index:
    """Return which edges to halve: the longest of those that are about as wide as the widest.

    Of needles simply the longest: what changes unseen between its ends and its middle would be
    closed in on from one side for ever.
    """
    sides = _next(corners) - corners
    lengths = np.linalg.norm(sides, axis=2)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    needles = np.square(lengths.max(axis=1)) > _FLATTEST * areas
    wide = (widths >= _ALIKE * widths.max(axis=1, keepdims=True)) | needles[:, None]
    return np.where(wide, lengths, -1.0).argmax(axis=1)


def _next(values: Array) -> Array:
    """Return what the following corner has, axis 1."""
    return np.roll(values, -1, axis=1)


def _largest_mean(squares: Array, sure: NDArray[np.bool_]) -> Array:
    """Return the largest mean over the `sure` columns and any of the others, row by row."""
    base, counts = np.where(sure, squares, 0.0).sum(axis=1), np.count_nonzero(sure, axis=1)
    others = np.where(sure, 0.0, squares)
    mean, more = np.full(len(squares), -1.0), base / np.maximum(counts, 1)
    while np.any(more > mean):  # those above the mean raise it, until none is left
        mean = np.maximum(mean, more)
        above = others > mean[:, None]
        total = base + np.where(above, others, 0.0).sum(axis=1)
        more = total / np.maximum(counts + np.count_nonzero(above, axis=1), 1)
    return mean


def _brightness(heard: HeardModel, ends: Array) -> Array:
    tones = np.tile(heard.model.frequencies, ends.shape[2] // len(heard.model.frequencies))
    energies = np.square(ends)
    whole = energies.sum(axis=2)
    return np.where(whole > _SILENT**2, (energies @ tones) / np.maximum(whole, _SILENT**2), np.nan)


def _levels(amplitudes: Array) -> Array:
    return 20 * np.log10(np.maximum(amplitudes, _TINY))


MOST_TRIANGLES = 300_000

# A triangle whose own timbre leaves no more than this share of the threshold is not cut further
# before a contact is chosen in it. Less cuts finer and needs fewer contacts.
_SHARE = 0.33
# Timbres compared at a time; of them, those are taken that suit this share of what the best does.
_POOL, _WORTH = 48, 0.5
# Farther than this share of the threshold at its centroid, no timbre is tried on a triangle: it
# would hardly suit everywhere within it.
_HOPE = 0.85


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cover:
    """Contacts with the triangles that they stand for.

    Parameters
    ----------
    points, directions : array (K, 3)
        The contacts, m, and the pushes straight into the surface.
    corners : array (F, 3, 3)
        Of the triangles, which are the whole surface, m.
    amplitudes, brightness : array (F, 3)
        As of `Facets`.
    owners : array (F,)
        Which contact each triangle takes its timbre from.
    misfits : array (F,)
        Bounds of the sonic distance within each triangle, dB.
    """

    points: Array
    directions: Array
    corners: Array
    amplitudes: Array
    brightness: Array
    owners: Index
    misfits: Array


@dataclass(slots=True, kw_only=True, eq=False)
class _Chosen:
    points: list[Array] = field(default_factory=list)
    directions: list[Array] = field(default_factory=list)
    timbres: list[Array] = field(default_factory=list)

    def take(self, facets: Facets, which: int) -> None:
        """Add the contact at the centroid of a facet."""
        self.points.append(facets.corners[which].mean(axis=0))
        self.directions.append(facets.directions[which])
        self.timbres.append(facets.timbres[which])


def covered(ear: Ear, surface: Mesh, threshold: float) -> Cover:
    """Choose contacts so that no place is farther than `threshold` dB from the one it takes.

    The loudest triangle gives the first. Triangles that a chosen timbre suits are done. Of the
    others, those in which the sound varies little offer theirs: greedily the one is taken that
    suits most. Those that none suits are halved, across the edge along which the sound changes
    most.

    Raises
    ------
    OptionError
        When that takes more than 300,000 triangles.
    """
    left = Facets.of(ear, surface.points[surface.faces], -surface.face_normals)
    chosen = _Chosen()
    chosen.take(left, int(left.amplitudes.mean(axis=1).argmax()))
    done: list[list[NDArray[Any]]] = []
    count = 0
    while len(left):
        _require_few(count + len(left), threshold)
        owners, misfits = _nearest(ear, left, np.stack(chosen.timbres))
        _choose(ear, left, owners, misfits, chosen, threshold)
        suited = misfits <= threshold
        parts = (left.corners, left.amplitudes, left.brightness, owners, misfits)
        done.append([part[suited] for part in parts])
        count += int(suited.sum())
        left = left.taken(~suited)
        left = left.halved(ear) if len(left) else left
    corners, amplitudes, brightness, owners, misfits = map(np.concatenate, zip(*done, strict=True))
    return Cover(
        points=np.stack(chosen.points),
        directions=np.stack(chosen.directions),
        corners=corners,
        amplitudes=amplitudes,
        brightness=brightness,
        owners=owners,
        misfits=misfits,
    )


def _choose(
    ear: Ear, facets: Facets, owners: Index, misfits: Array, chosen: _Chosen, threshold: float
) -> None:
    """Add timbres to `chosen` until all small facets have one; set `owners` and `misfits`."""
    small = facets.misfits(ear.quiet, facets.timbres) <= _SHARE * threshold
    while np.any(small & (misfits > threshold)):
        waiting = np.flatnonzero(misfits > threshold)
        able = waiting[small[waiting]]
        pool = able[np.linspace(0, len(able) - 1, min(_POOL, len(able))).astype(np.int64)]
        bounds = _bounds(ear, facets.taken(waiting), facets.timbres[pool], threshold)
        for pick in _greedy(bounds <= threshold):
            suits = bounds[:, pick] < misfits[waiting]
            misfits[waiting[suits]] = bounds[suits, pick]
            owners[waiting[suits]] = len(chosen.timbres)
            chosen.take(facets, int(pool[pick]))


def _greedy(suits: NDArray[np.bool_]) -> list[int]:
    """Return columns that suit the most rows, each in turn of those still waiting."""
    picks: list[int] = []
    waiting = suits.copy()
    best = waiting.sum(axis=0).max()
    while True:
        counts = waiting.sum(axis=0)
        pick = int(counts.argmax())
        if counts[pick] == 0 or counts[pick] < _WORTH * best:
            return picks
        picks.append(pick)
        waiting &= ~waiting[:, pick : pick + 1]


def _bounds(ear: Ear, facets: Facets, timbres: Array, threshold: float) -> Array:
    """Return bounds of the misfits with timbres (K, B), infinite where beyond hope: (F, K)."""
    found = np.full((len(facets), len(timbres)), np.inf)
    near = facets.distances(ear.quiet, timbres) <= _HOPE * threshold
    for number, timbre in enumerate(timbres):
        rows = np.flatnonzero(near[:, number])
        found[rows, number] = facets.taken(rows).misfits(ear.quiet, timbre[None])
    return found


def _nearest(ear: Ear, facets: Facets, timbres: Array) -> tuple[Index, Array]:
    """Return which of the timbres (K, B) suits each facet best at its centroid, and its misfit."""
    owners = facets.distances(ear.quiet, timbres).argmin(axis=1)
    return owners, facets.misfits(ear.quiet, timbres[owners])


def _require_few(count: int, threshold: float) -> None:
    if count > MOST_TRIANGLES:
        raise OptionError(
            f"threshold_db is {threshold:g}: the surface would be cut into {count} triangles, with "
            f"{MOST_TRIANGLES} allowed; give a larger one, or a lower level"
        )
