"""When the sound of each hit arrived: the moment from which its fitted modes explain the samples.

The steepest rise is off by some samples in noise. The fit knows better: run backwards, its modes
go on to explain the samples up to the moment of the hit, and before it only what rang already does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.air import AIR
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_EARLIER = 0.003
"""So long before the steepest rise a hit may have arrived, s."""
_MANY, _SAMPLES = 4, 3.0
"""Of so many takes or more half strike within so many samples: a trigger did."""
_DOUBTFUL = 100.0
"""A moment is possible where it leaves no more than this beyond the least, noise being 1."""


def arrivals(fitted: Fitted, recorded: Recorded) -> Array:
    """Return when the sound of each row arrived (rows,), s in its take.

    The channels of a hit share one moment, as far apart as their ways. Takes that a machine fired
    and recorded at once share the moment of impact too, where no take plainly speaks against it.
    """
    times = np.array([row.onset for row in fitted.rows])
    late = travels(fitted, recorded)
    numbers = np.array([(row.take, row.hit) for row in fitted.rows])
    hits = [np.flatnonzero((numbers == hit).all(axis=1)) for hit in np.unique(numbers, axis=0)]
    costs = [_shared_costs(fitted, recorded, rows, late[rows]) for rows in hits]
    for rows, cost in zip(hits, costs, strict=True):
        times[rows] += np.argmin(cost) / _rate(fitted, recorded, rows) - _EARLIER + late[rows]
    return _triggered(times, hits, costs, fitted, recorded)


def _rate(fitted: Fitted, recorded: Recorded, rows: Index) -> int:
    return recorded.takes[fitted.rows[rows[0]].take].sample_rate


def _shared_costs(fitted: Fitted, recorded: Recorded, rows: Index, late: Array) -> Array:
    """Return what is left of a hit for each moment of its arrival, from the earliest on."""
    shifts = np.round(late * _rate(fitted, recorded, rows)).astype(int)
    costs = [
        _costs(fitted, recorded, int(row), int(shift))
        for row, shift in zip(rows, shifts, strict=True)
    ]
    shortest = min(map(len, costs))
    return np.sum([each[:shortest] for each in costs], axis=0)


def _triggered(
    times: Array, hits: list[Index], costs: list[Array], fitted: Fitted, recorded: Recorded
) -> Array:
    """Return arrivals as of the usual moment of impact, in takes that agree with it.

    A trigger is more exact than any arrival in noise, and nobody's hand strikes many takes within
    a few samples.
    """
    if recorded.listeners is None or len(hits) < _MANY or len(hits) > len(recorded.takes):
        return times
    ways = np.array([recorded.distance(row.take, row.channel) for row in fitted.rows])
    impacts = times - ways / AIR.sound_speed
    moment = np.median(impacts)
    if np.median(np.abs(impacts - moment)) * _rate(fitted, recorded, hits[0]) > _SAMPLES:
        return times
    moved = times.copy()
    for rows, cost in zip(hits, costs, strict=True):
        best = int(np.argmin(cost))
        place = best + round(float(moment - impacts[rows[0]]) * _rate(fitted, recorded, rows))
        if 0 <= place < len(cost) and cost[place] - cost[best] < _DOUBTFUL:
            moved[rows] = moment + ways[rows] / AIR.sound_speed
    return moved


def travels(fitted: Fitted, recorded: Recorded) -> Array:
    """Return how much later each row's sound arrived than where its take heard it first, s."""
    if recorded.listeners is None:
        return np.zeros(len(fitted.rows))
    ways = [np.linalg.norm(each - recorded.centre, axis=1) for each in recorded.listeners]
    late = [ways[row.take][row.channel] - np.nanmin(ways[row.take]) for row in fitted.rows]
    return np.array(late) / AIR.sound_speed


def _costs(fitted: Fitted, recorded: Recorded, row: int, shift: int) -> Array:
    """Return what is left of a channel, over its noise, for each moment from the earliest on."""
    what = fitted.rows[row]
    take = recorded.takes[what.take]
    rate = take.sample_rate
    first = round((what.onset - _EARLIER) * rate) + shift
    last = max(round(what.time * rate) + shift, first + 2)
    inside = np.arange(first, last)
    known = (inside >= 0) & (inside < take.samples.shape[1])
    heard = np.zeros(len(inside))
    heard[known] = take.samples[what.channel, inside[known]]
    after = heard - fitted.ringing(row, first / rate, len(inside))
    earlier = _earlier(fitted, row)
    before = heard
    if earlier is not None:
        before = heard - fitted.ringing(earlier, first / rate, len(inside))
    noise = float(fitted.noise_in(row, np.array([20.0, 0.45 * rate]))[0])
    gained = (before**2 - after**2) / max(noise, 1e-300)
    return np.concatenate([[0.0], np.cumsum(gained)])


def _earlier(fitted: Fitted, row: int) -> int | None:
    """Return the row of the hit before in the same channel, None for the first."""
    own = fitted.rows[row]
    same = [
        number
        for number, each in enumerate(fitted.rows[:row])
        if (each.take, each.channel) == (own.take, own.channel)
    ]
    return same[-1] if same else None
