"""Impact detection: rows of a contact log separated into blows and lasting loads, by pairs.

How a simulation logs a contact depends on its solver: a hard one gives the whole impulse in one
step, a soft one spreads it over a dozen. A body at rest has its weight times the step in every
step, and the points of contact that carry it change from step to step. So the rows of a pair are
summed in each step; the excess of a step over the lasting load of its neighbourhood belongs to a
blow, the remainder is load.

The lasting load is a running median of the impulse of a step, once the flicker of single steps is
averaged out: a blow is short, so a median does not see it, neither within a lasting contact nor at
its ends. A contact too short to be lasting is a blow as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, median_filter, uniform_filter1d

from struck.model.arrays import Array, Index, Mask
from struck.scene.contacts import Contacts

_MAX_GAP_STEPS = 3  # steps without a row that end neither a contact nor a blow
_MAX_GAP_SECONDS = 5e-3  # of steps longer than that, one
# A contact of fewer steps is a blow: a soft solver takes a dozen for one, and 40 ms are no rest.
BRIEF_STEPS, _BRIEF_SECONDS, _MIN_STEPS = 31, 40e-3, 4
_FLICKER_STEPS = 6  # steps over which the load of changing points of contact is averaged
_PEAK_RATIO = 3.0  # times the lasting load: a step with that excess is a peak of a blow
_SWELL_RATIO = 0.5  # times the lasting load: mean excess of a peak while bodies approach
_MIN_CLOSING_SPEED = 5e-3  # m/s, the approach speed of such bodies
_FLANK_RATIO = 0.25  # times the lasting load: excess at which the flanks of a blow end


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two bodies that touch, and the rows of the log in which they do."""

    first: int  # number of the body that gets the opposite impulse
    second: int
    rows: Index  # (n,), in order of time
    sign: Array  # (n,), -1 if the log names the two in the other order


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImpactDetection:
    """Impacts and loads detected in the rows of a pair: each row is part blow, part load."""

    step: float  # s; 0 if every row is a separate blow
    blow: Index  # (n,), number of the blow a row belongs to, -1 for none
    fraction: Array  # (n,), of the row's impulse that belongs to the blow
    contact: Index  # (n,), number of the lasting contact a row belongs to, -1 for none
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
    first_rows = np.flatnonzero(np.diff(keys[order], prepend=-1))
    for rows in np.split(order, first_rows[1:]) if len(order) else ():
        first, second = int(low[rows[0]]), int(high[rows[0]])
        sign = np.where(contacts.body0[rows] == first, 1.0, -1.0)
        yield Pair(first=first, second=second, rows=rows, sign=sign)


def detect_impacts(
    time: Array, dt: Array, strength: Array, approach: Array | None = None
) -> ImpactDetection:
    """Separate the rows of a pair into blows and loads.

    Parameters
    ----------
    time : array (n,)
        Start of the step of each row, ascending, s.
    dt : array (n,)
        Duration of that step, s; rows of 0 s are blows, one for each time.
    strength : array (n,)
        Size of its impulse, N s.
    approach : array (n,) or None
        How fast the bodies come together there when the step begins, m/s.
    """
    count = len(time)
    blow, fraction = np.full(count, -1), np.ones(count)
    contact, load = np.full(count, -1), np.zeros(count)
    instant_rows, step_rows = np.flatnonzero(dt == 0), np.flatnonzero(dt > 0)
    step = float(np.median(dt[step_rows])) if len(step_rows) else 0.0
    first = 0
    if len(step_rows):
        closing_speeds = None if approach is None else approach[step_rows]
        parts = _detect_in_steps(time[step_rows], step, strength[step_rows], closing_speeds)
        for column, part in zip((blow, fraction, contact, load), parts, strict=True):
            column[step_rows] = part
        first = int(blow.max()) + 1
    if len(instant_rows):
        blow[instant_rows] = first + np.unique(time[instant_rows], return_inverse=True)[1]
    return ImpactDetection(step=step, blow=blow, fraction=fraction, contact=contact, load=load)


def _detect_in_steps(
    time: Array, step: float, strength: Array, approach: Array | None
) -> tuple[Index, Array, Index, Array]:
    """Return blow, fraction, contact and load of rows that last a step."""
    numbers = np.round((time - time[0]) / step).astype(np.int64)
    positions, contact, start_steps, lengths = _concatenate_steps(numbers, _gap_limit(step))
    impulses = np.zeros(int(start_steps[-1] + lengths[-1]))
    np.add.at(impulses, positions, strength)
    min_contact_steps = max(_MIN_STEPS, min(BRIEF_STEPS, int(_BRIEF_SECONDS / step)))
    parts = [
        _estimate_load(impulses[start : start + length], min_contact_steps)
        for start, length in zip(start_steps.tolist(), lengths.tolist(), strict=True)
    ]
    smooth_impulses, base = (np.concatenate(part) for part in zip(*parts, strict=True))
    excess, smooth_excess = np.maximum(impulses - base, 0.0), smooth_impulses - base
    is_peak = excess > _PEAK_RATIO * base
    if approach is not None:
        is_closing = np.zeros(len(impulses), np.bool_)
        is_closing[positions[approach > _MIN_CLOSING_SPEED]] = True
        is_closing = binary_dilation(is_closing, iterations=min_contact_steps)
        is_peak |= is_closing & (smooth_excess > _SWELL_RATIO * base) & (excess > 0)
    # Flicker of single steps is no flank.
    is_flank = (
        binary_dilation(is_peak, iterations=min_contact_steps)
        & (smooth_excess > _FLANK_RATIO * base)
        & (excess > 0)
    )
    blow = _number_blows(is_flank | is_peak, is_peak, _gap_limit(step), start_steps)
    fraction = np.where(blow >= 0, excess, 0.0) / np.maximum(impulses, 1e-300)
    contact_numbers = np.where(
        lengths >= min_contact_steps, np.cumsum(lengths >= min_contact_steps) - 1, -1
    )
    return blow[positions], fraction[positions], contact_numbers[contact], base[positions] / step


def _gap_limit(step: float) -> int:
    return max(1, min(_MAX_GAP_STEPS, int(_MAX_GAP_SECONDS / step)))


def _concatenate_steps(numbers: Index, max_gap: int) -> tuple[Index, Index, Index, Index]:
    """Concatenate the steps of all contacts; a gap inside a contact is a step without load.

    Returns the step and the contact of each row (n,), and the first step and the number of steps of
    each contact (T,).
    """
    ends = np.flatnonzero(np.diff(numbers) > max_gap)
    first_rows, last_rows = np.append(0, ends + 1), np.append(ends, len(numbers) - 1)
    lengths = numbers[last_rows] - numbers[first_rows] + 1
    start_steps = np.cumsum(lengths) - lengths
    contact = np.repeat(np.arange(len(first_rows)), last_rows - first_rows + 1)
    return (
        numbers - numbers[first_rows][contact] + start_steps[contact],
        contact,
        start_steps,
        lengths,
    )


def _estimate_load(impulses: Array, min_contact_steps: int) -> tuple[Array, Array]:
    """Return each step's smoothed impulse and its lasting part in one contact (steps,)."""
    smooth_impulses = uniform_filter1d(impulses, _FLICKER_STEPS, mode="nearest")
    if len(impulses) < min_contact_steps:
        return smooth_impulses, np.zeros(len(impulses))
    window = 2 * min_contact_steps + 1
    if len(smooth_impulses) <= window:
        return smooth_impulses, np.full(len(smooth_impulses), np.median(smooth_impulses))
    # It is padded with the medians at its ends, which blows there do not change.
    head, tail = (
        np.full(min_contact_steps, np.median(part))
        for part in (smooth_impulses[:window], smooth_impulses[-window:])
    )
    padded_impulses = np.concatenate([head, smooth_impulses, tail])
    return smooth_impulses, median_filter(padded_impulses, window, mode="nearest")[
        min_contact_steps:-min_contact_steps
    ]


def _number_blows(is_blow: Mask, is_peak: Mask, max_gap: int, start_steps: Index) -> Index:
    """Return the number of the blow that each step belongs to (steps,), -1 for none."""
    numbers = _number_runs(is_blow, max_gap, start_steps)
    # A run without a peak is a load that varies.
    has_peak = np.zeros(numbers.max(initial=-1) + 2, np.bool_)
    has_peak[numbers[is_peak]] = True
    has_peak[-1] = False  # of steps without number
    return np.where(has_peak, np.cumsum(has_peak) - 1, -1)[numbers]


def _number_runs(mask: Mask, max_gap: int, start_steps: Index) -> Index:
    """Return the number of each step's run in a mask, closing small gaps; -1 outside."""
    places = np.flatnonzero(mask)
    numbers = np.full(len(mask), -1)
    if len(places):
        contact = np.searchsorted(start_steps, places, side="right")
        is_new = (np.diff(places) > max_gap) | (np.diff(contact) > 0)
        numbers[places] = np.concatenate([[0], np.cumsum(is_new)])
    return numbers
