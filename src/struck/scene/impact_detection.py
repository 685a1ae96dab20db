"""Touches: the rows of a contact log, parted into blows and lasting loads, pair by pair.

A simulation tells of a touch step by step, and how depends on its solver: a hard one gives the
whole impulse in one step, a soft one spreads it over a dozen, a body at rest gives its weight times
the step in every step, and the points of contact that carry it change from step to step. So the
rows of a pair are added up step by step; what a step has above the lasting load of its
neighbourhood belongs to a blow, the rest is load.

The lasting load is a running median of the impulse of a step, once the flicker of single steps is
averaged out: a blow is short, so a median does not see it, at the edge of a rest as little as
within. A touch too short to be a rest is a blow as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, median_filter, uniform_filter1d

from struck.model.arrays import Array, Index, Mask
from struck.scene.contacts import Contacts

_APART = 3  # steps without a row that do not end a touch, nor part two hits of one blow
_APART_SECONDS = 5e-3  # of steps longer than that, one
# A touch of fewer steps is a blow: a soft solver takes a dozen for one, and 40 ms are no rest.
BRIEF_STEPS, _BRIEF_SECONDS, _FEWEST = 31, 40e-3, 4
_FLICKER = 6  # steps over which the load of changing points of contact is averaged
_STANDS_OUT = 3.0  # times the lasting load above it: such a step is of a blow
_SWELLS = 0.5  # times it, on the average: such steps are, where the bodies came together
_TOGETHER = 5e-3  # m/s
_FLANK = 0.25  # of the lasting load above it: there the flanks of a blow end


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two bodies that touch, and the rows of the log in which they do."""

    first: int  # number of the body that gets the opposite impulse
    second: int
    rows: Index  # (n,), in order of time
    sign: Array  # (n,), -1 where the log names them the other way round


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touches:
    """The rows of a pair, each parted into a share of a blow and a share of a load."""

    step: float  # s; 0 where rows are blows by themselves
    blow: Index  # (n,), number of the blow a row belongs to, -1 for none
    share: Array  # (n,), of the row's impulse that belongs to the blow
    rest: Index  # (n,), number of the lasting touch a row belongs to, -1 for none
    load: Array  # (n,), N, that lasts about a row's step, of all its rows together

    @property
    def blows(self) -> int:
        """Number of blows in the log."""
        return int(self.blow.max(initial=-1)) + 1


def pairs_of(contacts: Contacts) -> Iterator[Pair]:
    """Yield the pairs of a log, whichever body a row names first."""
    low = np.minimum(contacts.body0, contacts.body1)
    high = np.maximum(contacts.body0, contacts.body1)
    keys = low * len(contacts.names) + high
    order = np.argsort(keys, kind="stable")  # rows are in order of time
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    for rows in np.split(order, begins[1:]) if len(order) else ():
        first, second = int(low[rows[0]]), int(high[rows[0]])
        sign = np.where(contacts.body0[rows] == first, 1.0, -1.0)
        yield Pair(first=first, second=second, rows=rows, sign=sign)


def touches_of(time: Array, dt: Array, strength: Array, approach: Array | None = None) -> Touches:
    """Part the rows of a pair into blows and loads.

    Parameters
    ----------
    time, dt : array (n,)
        When the step of each row begins, ascending, and how long it lasts, s; a row that lasts 0 s
        is a blow by itself.
    strength : array (n,)
        Size of its impulse, N s.
    approach : array (n,) or None
        How fast the bodies come together there when the step begins, m/s.
    """
    count = len(time)
    blow, share = np.full(count, -1), np.ones(count)
    rest, load = np.full(count, -1), np.zeros(count)
    alone, lasting = np.flatnonzero(dt == 0), np.flatnonzero(dt > 0)
    step = float(np.median(dt[lasting])) if len(lasting) else 0.0
    first = 0
    if len(lasting):
        coming = None if approach is None else approach[lasting]
        parts = _stepped(time[lasting], step, strength[lasting], coming)
        for column, part in zip((blow, share, rest, load), parts, strict=True):
            column[lasting] = part
        first = int(blow.max()) + 1
    if len(alone):
        blow[alone] = first + np.unique(time[alone], return_inverse=True)[1]
    return Touches(step=step, blow=blow, share=share, rest=rest, load=load)


def _stepped(
    time: Array, step: float, strength: Array, approach: Array | None
) -> tuple[Index, Array, Index, Array]:
    """Return blow, share, rest and load of rows that last a step."""
    numbers = np.round((time - time[0]) / step).astype(np.int64)
    places, touch, starts, lengths = _laid_out(numbers, _apart(step))
    impulses = np.zeros(int(starts[-1] + lengths[-1]))
    np.add.at(impulses, places, strength)
    brief = max(_FEWEST, min(BRIEF_STEPS, int(_BRIEF_SECONDS / step)))
    parts = [
        _lasting(impulses[start : start + length], brief)
        for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
    ]
    smooth, base = (np.concatenate(part) for part in zip(*parts, strict=True))
    above, swell = np.maximum(impulses - base, 0.0), smooth - base
    standing = above > _STANDS_OUT * base
    if approach is not None:
        coming = np.zeros(len(impulses), np.bool_)
        coming[places[approach > _TOGETHER]] = True
        coming = binary_dilation(coming, iterations=brief)
        standing |= coming & (swell > _SWELLS * base) & (above > 0)
    # Flicker of single steps is no flank.
    within = binary_dilation(standing, iterations=brief) & (swell > _FLANK * base) & (above > 0)
    blow = _blows(within | standing, standing, _apart(step), starts)
    share = np.where(blow >= 0, above, 0.0) / np.maximum(impulses, 1e-300)
    rests = np.where(lengths >= brief, np.cumsum(lengths >= brief) - 1, -1)
    return blow[places], share[places], rests[touch], base[places] / step


def _apart(step: float) -> int:
    return max(1, min(_APART, int(_APART_SECONDS / step)))


def _laid_out(numbers: Index, apart: int) -> tuple[Index, Index, Index, Index]:
    """Lay the steps of all touches end to end, so that a gap inside a touch is a step without load.

    Returns the place of each row and the number of its touch (n,), and where touches start and how
    many steps they have (T,).
    """
    ends = np.flatnonzero(np.diff(numbers) > apart)
    firsts, lasts = np.append(0, ends + 1), np.append(ends, len(numbers) - 1)
    lengths = numbers[lasts] - numbers[firsts] + 1
    starts = np.cumsum(lengths) - lengths
    touch = np.repeat(np.arange(len(firsts)), lasts - firsts + 1)
    return numbers - numbers[firsts][touch] + starts[touch], touch, starts, lengths


def _lasting(impulses: Array, brief: int) -> tuple[Array, Array]:
    """Return each step's impulse without flicker, and its lasting part, in one touch (steps,)."""
    smooth = uniform_filter1d(impulses, _FLICKER, mode="nearest")
    if len(impulses) < brief:
        return smooth, np.zeros(len(impulses))
    window = 2 * brief + 1
    if len(smooth) <= window:
        return smooth, np.full(len(smooth), np.median(smooth))
    # Beyond the ends it goes on as at the ends, blows there left out.
    before, after = (
        np.full(brief, np.median(part)) for part in (smooth[:window], smooth[-window:])
    )
    padded = np.concatenate([before, smooth, after])
    return smooth, median_filter(padded, window, mode="nearest")[brief:-brief]


def _blows(within: Mask, standing: Mask, apart: int, starts: Index) -> Index:
    """Return the number of the blow that each step belongs to (steps,), -1 for none."""
    numbers = _runs(within, apart, starts)
    # A run in which nothing stands out is the load that sways.
    stands = np.zeros(numbers.max(initial=-1) + 2, np.bool_)
    stands[numbers[standing]] = True
    stands[-1] = False  # of steps without number
    return np.where(stands, np.cumsum(stands) - 1, -1)[numbers]


def _runs(mask: Mask, apart: int, starts: Index) -> Index:
    """Return the number of each place's run in a mask, small gaps in a touch closed; -1 outside."""
    places = np.flatnonzero(mask)
    numbers = np.full(len(mask), -1)
    if len(places):
        touch = np.searchsorted(starts, places, side="right")
        new = (np.diff(places) > apart) | (np.diff(touch) > 0)
        numbers[places] = np.concatenate([[0], np.cumsum(new)])
    return numbers
