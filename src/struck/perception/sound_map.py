"""Sound maps: few stored sounds that represent all contacts of a body (1998, section 5)."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import FileFormatError, OptionError, counted
from struck.files.atomic import read_bytes, write_bytes
from struck.files.container import from_bytes, to_bytes
from struck.model.arrays import Array, Complex, Index, checked, require_number
from struck.model.contact import Contact
from struck.model.mesh import Mesh, Surface
from struck.model.model import ModalModel
from struck.model.provenance import Progress, silent
from struck.perception.auditory_scale import integrated, threshold_in_quiet
from struck.perception.sonic_distance import HeardModel, erb_distance, filter_centres, surface_of

THRESHOLD = 3.0  # dB
MOST_TRIANGLES = 300_000

# A triangle whose own timbre leaves no more than this share of the threshold is not cut further
# before a contact is chosen in it. Less cuts finer and needs fewer contacts.
_SHARE = 0.33
# Timbres compared at a time; of them, those are taken that suit this share of what the best does.
_POOL, _WORTH = 48, 0.5
# Farther than this share of the threshold at its centroid, no timbre is tried on a triangle: it
# would hardly suit everywhere within it.
_HOPE = 0.85

# A parabola through the corners is largest at the centroid, 4/3 of the greatest that the middles
# of the edges show; the rest is for what is no parabola.
_CURVED = 2.0
_AT_ONCE = 2_000_000  # numbers in the largest array, so that memory does not grow with the body
# Amplitudes over that of 20 micropascal: at -120 dB nothing is left but rounding. Taking it for
# silence moves levels at the threshold by less than the slack, dB.
_SILENT, _SLACK = 1e-6, 1e-4
_TINY = 1e-300
_ALIKE, _FLATTEST = 0.7, 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundMap:
    """Stored contacts, and which of them sounds, how loudly, wherever a body is struck.

    The surface is cut into triangles, finer where the timbre changes faster. Each takes the timbre
    of one stored contact, at a level that goes with the amplitude from corner to corner.

    Parameters
    ----------
    frequencies, decays : array (M,)
        Of the modes, Hz and 1/s.
    contacts, directions : array (K, 3)
        Where bodies were struck, m, and which way: straight into the surface.
    gains : array (K, M), complex
        Of the modes at the listener, Pa/(N s), or relative where not `calibrated`.
    calibrated : bool
        Whether gains are Pa/(N s).
    listener : array (3,)
        m.
    level : float
        That the loudest contact reaches where `bound` holds, dB re 20 micropascal.
    threshold : float
        Asked for, dB.
    bound : float
        No contact sounds farther from what is stored for it, by the sonic distance, dB.
    surface : Mesh
        The triangles.
    owners : array (F,)
        Which stored contact each takes its timbre from.
    factors : array (F, 3)
        What its sound is multiplied by at the corners.
    brightness : array (F, 3)
        Of the body itself at the corners: centroids of the spectra, Hz; NaN where it is silent.

    Raises
    ------
    OptionError
        When the arrays do not belong together.
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
        stored, modes, faces = len(self.contacts), len(self.frequencies), len(self.surface.faces)
        wanted = {
            "decays": (modes,),
            "contacts": (stored, 3),
            "directions": (stored, 3),
            "gains": (stored, modes),
            "listener": (3,),
            "owners": (faces,),
            "factors": (faces, 3),
            "brightness": (faces, 3),
        }
        for name, shape in wanted.items():
            if np.shape(getattr(self, name)) != shape:
                found = np.shape(getattr(self, name))
                raise OptionError(f"{name} are {found}, not {shape}: make the map again")
        if not (self.owners.min() >= 0 and self.owners.max() < stored):
            raise OptionError(f"triangles take sounds beyond the {stored} stored: make it again")

    def __repr__(self) -> str:
        contacts, modes = counted(len(self.contacts), "contact"), len(self.frequencies)
        told = f"{contacts} of {counted(modes, 'mode')}, no other farther than {self.bound:.2f} dB"
        return f"SoundMap({told})"

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
        """Return the gains of a unit impulse at a point, straight into the surface (M,).

        With `frequencies` and `decays` they are all that a synthesizer needs:
        p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)].

        Raises
        ------
        ContactError
            When the point is off the body.
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
        """Write the map to a `path`, whole or not at all: a safetensors file of parameters.

        Raises
        ------
        FileFormatError
            When it cannot be written.
        """
        write_bytes(path, to_bytes(self, (SoundMap, Mesh)))

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> SoundMap:
        """Read the sound map that `save` wrote to a `path`.

        Raises
        ------
        FileFormatError
            When it cannot be read, or is damaged or no map.
        """
        data = read_bytes(path)
        try:
            found = from_bytes(data, (SoundMap, Mesh))
        except FileFormatError as error:
            raise FileFormatError(f"{path}: {error}") from error
        if not isinstance(found, cls):
            raise FileFormatError(f"{path} holds no sound map: save one with SoundMap.save")
        return found


@checked
def sound_map(
    model: ModalModel,
    threshold_db: float = THRESHOLD,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
    progress: Progress = silent,
) -> SoundMap:
    """Choose the fewest contacts that cover a body, and their sounds (see `struck.sound_map`)."""
    wanted = "it must exceed 0, such as 3, and 0.1 dB is the least that is told apart"
    require_number("threshold_db", threshold_db, 0.1, wanted=wanted)
    surface = surface_of(model)
    heard = HeardModel.at(model, listener, level)
    if len(heard.listeners) > 1:
        raise OptionError(f"{len(heard.listeners)} listeners are given: make a map for each")
    cover = covered(Ear.of(heard), surface, threshold_db, progress)
    loud = np.linalg.norm(heard.amplitudes(cover.points, cover.directions), axis=1)
    points, numbers = np.unique(cover.corners.reshape(-1, 3), axis=0, return_inverse=True)
    return SoundMap(
        frequencies=model.frequencies,
        decays=model.decays,
        contacts=cover.points,
        directions=cover.directions,
        gains=heard.gains(cover.points, cover.directions)[:, 0],
        calibrated=model.calibrated,
        listener=heard.listeners[0],
        level=heard.level,
        threshold=float(threshold_db),
        bound=float(cover.misfits.max()),
        surface=Mesh(points=points, faces=numbers.reshape(-1, 3), up=surface.up),
        owners=cover.owners,
        factors=cover.amplitudes / loud[cover.owners][:, None],
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


def _contact(facets: Facets, which: int) -> _Contact:
    """Return the contact at the centroid of a facet."""
    return facets.corners[which].mean(axis=0), facets.directions[which], facets.timbres[which]


def covered(ear: Ear, surface: Mesh, threshold: float, progress: Progress = silent) -> Cover:
    """Choose contacts so that no place is farther than `threshold` dB from the one it takes."""
    # The loudest triangle gives the first contact. Triangles within the threshold of a chosen one
    # are done. Each other triangle in which the sound varies little proposes its own timbre, and
    # the proposal that covers most triangles is chosen. Triangles that no proposal covers are
    # halved, across the edge along which the sound changes most.
    left = Facets.of(ear, surface.points[surface.faces], -surface.face_normals)
    chosen = [_contact(left, int(left.amplitudes.mean(axis=1).argmax()))]
    done: list[list[NDArray[Any]]] = []
    count, whole = 0, _area(left.corners)
    while len(left):
        progress("choosing contacts", 1 - _area(left.corners) / whole)
        if count + len(left) > MOST_TRIANGLES:
            raise OptionError(
                f"threshold_db is {threshold:g}: the surface would be cut into "
                f"{count + len(left)} triangles, with {MOST_TRIANGLES} allowed; give a larger one, "
                "or a lower level"
            )
        timbres = np.stack([timbre for _, _, timbre in chosen])
        owners = left.distances(ear.quiet, timbres).argmin(axis=1)
        misfits = left.misfits(ear.quiet, timbres[owners])
        _choose(ear, left, owners, misfits, chosen, threshold)
        suited = misfits <= threshold
        parts = (left.corners, left.amplitudes, left.brightness, owners, misfits)
        done.append([part[suited] for part in parts])
        count += int(suited.sum())
        left = left.taken(~suited)
        left = left.halved(ear) if len(left) else left
    points, directions, _ = (np.stack(each) for each in zip(*chosen, strict=True))
    return Cover(points, directions, *map(np.concatenate, zip(*done, strict=True)))


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
    small = facets.misfits(ear.quiet, facets.timbres) <= _SHARE * threshold
    while np.any(small & (misfits > threshold)):
        waiting = np.flatnonzero(misfits > threshold)
        able = waiting[small[waiting]]
        pool = able[np.linspace(0, len(able) - 1, min(_POOL, len(able))).astype(np.int64)]
        bounds = _bounds(ear, facets.taken(waiting), facets.timbres[pool], threshold)
        for pick in _greedy(bounds <= threshold):
            suits = bounds[:, pick] < misfits[waiting]
            misfits[waiting[suits]] = bounds[suits, pick]
            owners[waiting[suits]] = len(chosen)
            chosen.append(_contact(facets, int(pool[pick])))


def _greedy(suits: NDArray[np.bool_]) -> list[int]:
    """Return columns chosen greedily: each suits the most rows not yet covered."""
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
    """A body as it is heard through the ear's filters."""

    heard: HeardModel
    passing: Array  # (B, P): the share of each part that passes each filter
    quiet: Array  # (B,): threshold in quiet at the filters, dB

    @classmethod
    def of(cls, heard: HeardModel) -> Ear:
        """Put the ear's filters behind a heard model."""
        centres = filter_centres()
        return cls(heard=heard, passing=heard.passing(centres), quiet=threshold_in_quiet(centres))

    def parts(self, points: Array, directions: Array) -> Array:
        """Return amplitudes at points (F, K, 3), one direction (F, 3) for K points: (F, K, P)."""
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
        count = max(1, _AT_ONCE // (7 * (ear.passing.shape[1] + len(ear.quiet))))
        starts = range(0, max(1, len(corners)), count)
        parts = [_looked_at(ear, corners[i : i + count], directions[i : i + count]) for i in starts]
        names = [each.name for each in fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.corners)

    def taken(self, which: Index | NDArray[np.bool_]) -> Facets:
        """Return the facets of some triangles only."""
        return Facets(**{each.name: getattr(self, each.name)[which] for each in fields(self)})

    def halved(self, ear: Ear) -> Facets:
        """Return two facets for each, cut from the middle of `edges` to the opposite corner."""
        rows = np.arange(len(self))
        start, end, opposite = (self.corners[rows, (self.edges + step) % 3] for step in range(3))
        middle = (start + end) / 2
        halves = [(start, middle, opposite), (middle, end, opposite)]
        corners = np.concatenate([np.stack(half, axis=1) for half in halves])
        return Facets.of(ear, corners, np.tile(self.directions, (2, 1)))

    def misfits(self, quiet: Array, timbres: Array) -> Array:
        """Return bounds on the sonic distance from one timbre for each (F, B), dB (F,)."""
        # What a filter adds is at most what the interval of timbres leaves, and at most what the
        # louder of the two exceeds the threshold by. The mean counts filters where either is heard;
        # of those that may or may not be heard, it takes the ones that make it largest.
        strongest, weakest = (_levels(each(self.amplitudes, axis=1)) for each in (np.max, np.min))
        apart = np.maximum(self.most - timbres, timbres - self.least)
        above = np.maximum(self.loud, strongest[:, None] + timbres) - quiet
        squares = np.square(np.maximum(np.minimum(apart, above), 0.0))
        sure = (self.soft > quiet) | (weakest[:, None] + timbres > quiet)
        return np.sqrt(_largest_mean(squares, sure)) + _SLACK

    def distances(self, quiet: Array, timbres: Array) -> Array:
        """Return the sonic distances at the centroids from timbres (K, B), dB (F, K)."""
        level = _levels(self.amplitudes.mean(axis=1))[:, None]
        own = np.maximum(level + self.timbres - quiet, 0.0)
        played = (np.maximum(level + timbre - quiet, 0.0) for timbre in timbres)
        return np.stack([erb_distance(own, each) for each in played], axis=1)


def _looked_at(ear: Ear, corners: Array, directions: Array) -> Facets:
    places = [corners, (corners + _next(corners)) / 2, corners.mean(axis=1, keepdims=True)]
    parts = ear.parts(np.concatenate(places, axis=1), directions)
    ends, middles, centroid = parts[:, :3], parts[:, 3:6], parts[:, 6]
    bent = _CURVED * ear.behind(middles - (ends + _next(ends)) / 2)
    amplitudes = np.linalg.norm(ends, axis=2)
    squares, products = ear.products(ends, ends), ear.products(ends, _next(ends))
    along = (squares + products + np.roll(products, 1, axis=1)) / 3
    least, most, soft, loud = _ranges(squares, along, bent.max(axis=1), amplitudes)
    widths = _widths(ear, squares, products, bent, ends, middles)
    return Facets(
        corners=corners,
        directions=directions,
        amplitudes=amplitudes,
        brightness=_brightness(ear.heard, ends),
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
    rest: Array,  # (..., B): what straight lines leave out
    amplitudes: Array,  # (..., k)
) -> tuple[Array, Array, Array, Array]:
    """Return bounds of timbres and of levels between corners, behind the filters, dB (..., B)."""
    mean = np.sqrt(np.maximum(along.mean(axis=-2, keepdims=True), 0.0))
    low = along / np.maximum(mean, _TINY) - rest[..., None, :]
    high = np.sqrt(squares) + rest[..., None, :]
    level = _levels(amplitudes)[..., None]
    # A silent corner plays no part in the mediant.
    dumb = (amplitudes <= _SILENT)[..., None] & (high <= _SILENT)
    least = np.where(dumb, np.inf, _levels(low) - level).min(axis=-2)
    most = np.where(dumb, -np.inf, _levels(high) - level).max(axis=-2)
    return least, most, _levels(low.min(axis=-2)), _levels(high.max(axis=-2))


def _widths(
    ear: Ear, squares: Array, products: Array, bent: Array, ends: Array, middles: Array
) -> Array:
    """Return for each edge how wide the interval of audible timbres on it is, dB (F, 3)."""
    amplitudes = np.linalg.norm(ends, axis=2)
    both = np.stack([squares, _next(squares)], axis=2)
    along = (both + products[:, :, None]) / 2
    corners = np.stack([amplitudes, _next(amplitudes)], axis=2)
    least, most, _, loud = _ranges(both, along, bent, corners)
    between = _levels(ear.behind(middles)) - _levels(np.linalg.norm(middles, axis=2))[..., None]
    floor = ear.quiet - _levels(amplitudes.max(axis=1))[:, None, None]
    above = np.maximum(loud - ear.quiet, 0.0)
    low = np.maximum(np.minimum(least, between), floor)
    return np.linalg.norm(np.clip(np.maximum(most, between) - low, 0.0, above), axis=2)


def _chosen(corners: Array, widths: Array) -> Index:
    """Return the edge of each triangle to halve: the longest of its widest ones."""
    # Of needles simply the longest: what changes unseen between its ends and its middle would be
    # closed in on from one side for ever.
    sides = _next(corners) - corners
    lengths = np.linalg.norm(sides, axis=2)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    needles = np.square(lengths.max(axis=1)) > _FLATTEST * areas
    wide = (widths >= _ALIKE * widths.max(axis=1, keepdims=True)) | needles[:, None]
    return np.where(wide, lengths, -1.0).argmax(axis=1)


def _next(values: Array) -> Array:
    """Return the values of the following corner, axis 1."""
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
