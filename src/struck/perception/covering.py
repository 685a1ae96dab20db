"""Which contacts are enough: timbres chosen until each place of a surface has one like its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.mesh import Mesh
from struck.perception.facets import Ear, Facets

Array = NDArray[np.float64]
Index = NDArray[np.int64]

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
