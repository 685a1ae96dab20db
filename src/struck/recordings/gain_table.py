"""Gain table: fitted rows brought to their arrivals, equal hits and one row a pair of places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from struck.errors import RecordingError
from struck.model.arrays import Array, Complex, Index
from struck.model.material import AIR
from struck.model.survey import Survey
from struck.recordings.poles.search import Fitted
from struck.recordings.takes import Recorded

# The steepest rise is off by some samples in noise. The fit knows better: run backwards, its modes
# go on to explain the samples up to the moment of the hit, and before it only what rang already
# does.

_EARLIER = 0.003  # earliest arrival before the steepest rise, s
_MANY, _SAMPLES = 4, 3.0  # takes of a trigger at least, and how far off half may be, samples
_DOUBTFUL = 100.0  # a moment is possible up to this residual energy over the least, noise being 1


def arrivals(fitted: Fitted, recorded: Recorded) -> Array:
    """Return when the sound of each row arrived (rows,), s in its take.

    The channels of a hit share one moment but for their distances. Takes that a trigger fired share
    the moment of impact, too, where no take plainly speaks against it.
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
    """Return the residual energy of a hit for each moment of its arrival, earliest first."""
    shifts = np.round(late * _rate(fitted, recorded, rows)).astype(int)
    costs = [
        _costs(fitted, recorded, int(row), int(shift))
        for row, shift in zip(rows, shifts, strict=True)
    ]
    return np.sum([each[: min(map(len, costs))] for each in costs], axis=0)


def _triggered(
    times: Array, hits: list[Index], costs: list[Array], fitted: Fitted, recorded: Recorded
) -> Array:
    """Return arrivals moved to the median moment of impact, in takes that agree with it.

    A trigger is more exact than any arrival in noise; no hand strikes many takes within samples.
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
    """Return how much later than at its take's nearest microphone each row's sound arrived, s."""
    if recorded.listeners is None:
        return np.zeros(len(fitted.rows))
    ways = [np.linalg.norm(each - recorded.centre, axis=1) for each in recorded.listeners]
    late = [ways[row.take][row.channel] - np.nanmin(ways[row.take]) for row in fitted.rows]
    return np.array(late) / AIR.sound_speed


def _costs(fitted: Fitted, recorded: Recorded, row: int, shift: int) -> Array:
    """Return a channel's residual energy over its noise for each arrival from the earliest on."""
    what = fitted.rows[row]
    take = recorded.takes[what.take]
    rate = take.sample_rate
    first = round((what.onset - _EARLIER) * rate) + shift
    inside = np.arange(first, max(round(what.time * rate) + shift, first + 2))
    known = (inside >= 0) & (inside < take.samples.shape[1])
    heard = np.zeros(len(inside))
    heard[known] = take.samples[what.channel, inside[known]]
    after = heard - fitted.ringing(row, first / rate, len(inside))
    earlier = _earlier(fitted, row)
    before = heard
    if earlier is not None:
        before = heard - fitted.ringing(earlier, first / rate, len(inside))
    noise = float(fitted.noise_in(row, np.array([20.0, 0.45 * rate]))[0])
    return np.concatenate([[0.0], np.cumsum((before**2 - after**2) / max(noise, 1e-300))])


def _earlier(fitted: Fitted, row: int) -> int | None:
    """Return the row of the hit before in the same channel, None for the first."""
    own = fitted.rows[row]
    before = ((each.take, each.channel) for each in fitted.rows[:row])
    same = [number for number, channel in enumerate(before) if channel == (own.take, own.channel)]
    return same[-1] if same else None


_FINEST = 1e-6  # least error of a gain over the largest of its mode
_MOST_GROWN = 1.0  # nepers a gain is followed back to its hit; beyond, it is hardly known
_SLOWEST = 0.02  # 1/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gathered:
    """Gains of each channel of each hit, all as of the same time after the sound's arrival."""

    gains: Complex  # (n, M)
    errors: Array  # (n, M), standard errors of the gains' sizes
    poles: Complex  # (M,), 1/s
    hits: Index  # (n,), counted on from take to take
    takes: Index  # (n,)
    channels: Index  # (n,)
    arrivals: Array  # (n,), when the sound of each row arrived, s in its take
    lead: float  # from the arrival of a hit to the moment of the gains, s: it is still being struck

    @classmethod
    def of(cls, fitted: Fitted, recorded: Recorded) -> Gathered:
        """Gather the rows of a fit."""
        rows = fitted.rows
        arrived = arrivals(fitted, recorded)
        later = np.array([row.time for row in rows]) - arrived
        lead = float(np.median(later))
        growth = np.outer(later - lead, fitted.decays)
        turns = np.outer(later - lead, 2 * np.pi * fitted.frequencies)
        turned = np.exp(np.minimum(growth, _MOST_GROWN) - 1j * turns)
        gains = np.asarray(fitted.gains * turned, np.complex128)
        errors = fitted.gain_errors * np.abs(turned)
        errors = np.where(growth > _MOST_GROWN, np.maximum(errors, np.abs(gains)), errors)
        finest = _FINEST * np.maximum(np.abs(gains).max(axis=0, initial=0.0), 1e-300)
        hits = list(dict.fromkeys((row.take, row.hit) for row in rows))
        return cls(
            gains=gains,
            errors=np.maximum(errors, finest),
            poles=-fitted.decays + 2j * np.pi * fitted.frequencies,
            hits=np.array([hits.index((row.take, row.hit)) for row in rows]),
            takes=np.array([row.take for row in rows]),
            channels=np.array([row.channel for row in rows]),
            arrivals=arrived,
            lead=lead,
        )

    @property
    def energies(self) -> Array:
        """Energies (n, M) of the modes over their duration."""
        return np.abs(self.gains) ** 2 / (2 * np.maximum(-self.poles.real, _SLOWEST))

    @property
    def range(self) -> float:
        """How much louder the loudest take is than the softest, dB, by the loudest hit of each."""
        hits = np.bincount(self.hits, self.energies.sum(axis=1))
        loudest = np.zeros(self.takes.max() + 1)
        np.maximum.at(loudest, self.takes, hits[self.hits])
        return float(10 * np.log10(loudest.max() / max(loudest[loudest > 0].min(), 1e-300)))

    def survey(self, recorded: Recorded) -> Survey:
        """Return gains over contact and listener, one for each pair.

        Unknown listeners count as one place 1 m away, unknown contacts as one contact.
        """
        told = self if recorded.listeners is not None else self.in_one_channel()
        places, contact = _contacts(recorded, told.takes)
        microphones, listener = _listeners(recorded, told)
        gains, errors = aligned(told.gains, told.errors, told.hits, contact, listener, told.poles)
        pairs, gains, errors = averaged(gains, errors, np.stack([contact, listener], axis=1))
        return Survey(
            contacts=places,
            listeners=microphones,
            pairs=pairs,
            gains=gains,
            frequencies=told.poles.imag / (2 * np.pi),
            errors=errors,
            centre=recorded.centre,
            symmetry=recorded.symmetry,
        )

    def in_one_channel(self) -> Gathered:
        """Return one row for each hit: in each mode that of the channel that hears it best.

        Its size is the root mean square over channels, in the mean over hits.
        """
        counts = np.bincount(self.hits)
        if np.ptp(counts):
            raise RecordingError(
                f"takes have {counts.min()} and {counts.max()} channels, and their "
                "microphones have no places: give listeners, or the same number of channels in all"
            )
        rows = np.argsort(self.hits, kind="stable").reshape(len(counts), -1)  # of a hit in order
        energies = self.energies[rows].sum(axis=0)
        best, modes = energies.argmax(axis=0), np.arange(self.gains.shape[1])
        level = np.sqrt(energies.mean(axis=0) / np.maximum(energies[best, modes], 1e-300))
        chosen = rows[:, best], modes
        return Gathered(
            gains=self.gains[chosen] * level,
            errors=self.errors[chosen] * level,
            poles=self.poles,
            hits=self.hits[rows[:, 0]],
            takes=self.takes[rows[:, 0]],
            channels=self.channels[rows[:, 0]],
            arrivals=self.arrivals[rows[:, 0]],
            lead=self.lead,
        )

    def in_one_point(self) -> Complex:
        """Return gains (M,) of one contact heard at one place: the average sound of the object.

        The size of each mode is its root mean square over hits, each brought to the strength of the
        loudest one; phases are that one's.
        """
        one = self.in_one_channel()
        energies = one.energies.sum(axis=1)
        loudest = int(energies.argmax())
        shares = np.abs(one.gains) ** 2 / energies[:, None]
        sure = one.errors < np.abs(one.gains)
        sure[loudest] |= ~sure.any(axis=0)
        mean = (shares * sure).sum(axis=0) / sure.sum(axis=0)
        turns = one.gains[loudest] / np.maximum(np.abs(one.gains[loudest]), 1e-300)
        phases = np.where(one.gains[loudest] == 0, 1.0, turns)
        return np.asarray(np.sqrt(mean * energies[loudest]) * phases, np.complex128)


def _contacts(recorded: Recorded, takes: Index) -> tuple[Array, Index]:
    """Return each contact once, and the number of that of each row."""
    if recorded.contacts is None:
        return np.zeros((1, 1)), np.zeros(len(takes), np.int64)
    places, number = np.unique(recorded.contacts, axis=0, return_inverse=True)
    return places, number.reshape(-1)[takes]


def _listeners(recorded: Recorded, told: Gathered) -> tuple[Array, Index]:
    """Return each listener once, m, and the number of that of each row."""
    if recorded.listeners is None:
        return recorded.centre + np.array([[1.0, 0.0, 0.0]]), np.zeros(len(told.takes), np.int64)
    rows = zip(told.takes, told.channels, strict=True)
    every = np.array([recorded.listeners[take][channel] for take, channel in rows])
    places, number = np.unique(every, axis=0, return_inverse=True)
    return places, number.reshape(-1)


# How hard and when each hit was. Nobody strikes twice alike. Two hits of one contact, heard at one
# place, differ by a factor that is smooth over frequency: strength, length of the contact, and the
# moment that was taken for their beginning. Contacts heard at one place differ in their drives,
# which are real: what turns all their phases in proportion to frequency is an error of the moment
# again.

_LATEST = 1e-3  # largest error of a moment, s
_LIKELY = 3e-4  # usual error of a moment, s
_FINENESS = 8  # delays tried in a period of the highest mode
_ZOOMS = 3  # refinements of the best delay
_CLEAR = 100.0  # energy over that of its standard error from which a ratio of gains counts
_SURE = 3.0  # standard errors from which a gain counts for loudness
# scatter of modes between hits of a contact; usual b at the highest mode
_SCATTER, _SLOPE = 0.05, 1.0
_TWO = 2  # least modes that show a moment


def aligned(
    gains: Complex, errors: Array, hits: Index, contacts: Index, listeners: Index, poles: Complex
) -> tuple[Complex, Array]:
    """Return gains and errors (n, M) as if a contact's hits were equal and their moments right.

    Gains are those of n recorded channels, with numbers (n,) of their hits, contacts and listeners
    and poles (M,), 1/s. From the loudest hit on, each is compared with those before it that share a
    listener: with hits of the same contact if there are any, where strength over frequency is a
    constant times exp(b f^2), else with those of other contacts, whose strengths stay.
    """
    gains, errors = gains.copy(), errors.copy()
    frequencies = poles.imag / (2 * np.pi)
    late = np.zeros(len(gains))
    leaders = hits.copy()
    for first, second in _compared(gains, errors, hits, contacts, listeners):
        own = np.flatnonzero(hits == hits[second[0]])
        repeated = contacts[first[0]] == contacts[second[0]]
        delay = _delay(gains, errors, first, second, frequencies, turned=not repeated)
        late[own], leaders[own] = delay, leaders[first[0]]
        gains[own] *= np.exp(poles * delay)
        if repeated:
            strength = _strength(gains, errors, first, second, frequencies)
            gains[own] /= strength
            errors[own] /= strength
    return gains * np.exp(-poles * _usual_delays(late, hits, leaders)[:, None]), errors


def _usual_delays(late: Array, hits: Index, leaders: Index) -> Array:
    """Return the median delay (n,) of the hits that follow the same first one."""
    usual = np.zeros(len(late))
    for leader in np.unique(leaders):
        own = leaders == leader
        _, once = np.unique(hits[own], return_index=True)
        usual[own] = np.median(late[own][once])
    return usual


def _compared(
    gains: Complex, errors: Array, hits: Index, contacts: Index, listeners: Index
) -> Iterator[tuple[Index, Index]]:
    """Yield, hit by hit, the rows already in the table and the next hit's at their listeners."""
    energies = np.where(np.abs(gains) > _SURE * errors, np.abs(gains) ** 2, 0.0).sum(axis=1)
    numbers = np.unique(hits)
    loudness = [energies[hits == number].sum() for number in numbers]
    known: list[int] = []
    for number in numbers[np.argsort(loudness, kind="stable")[::-1]]:
        own = np.flatnonzero(hits == number)
        shared = [row for row in known if listeners[row] in listeners[own]]
        alike = [row for row in shared if contacts[row] == contacts[own[0]]]
        chosen = {int(listeners[row]): row for row in reversed(alike or shared)}
        if chosen:
            second = [own[np.argmax(listeners[own] == place)] for place in chosen]
            yield np.array(list(chosen.values())), np.array(second)
        known += own.tolist()


def averaged(gains: Complex, errors: Array, pairs: Index) -> tuple[Index, Complex, Array]:
    """Return each pair (contact, listener) once, with the weighted mean of its gains and errors."""
    distinct, number = np.unique(pairs, axis=0, return_inverse=True)
    share = np.eye(len(distinct))[number.reshape(-1)].T
    weights = 1 / errors**2
    total = share @ weights
    return distinct, (share @ (weights * gains)) / total, 1 / np.sqrt(total)


def _ratios(gains: Complex, errors: Array, first: Index, second: Index) -> tuple[Complex, Array]:
    """Return least-squares ratios of the second's gains to the first's, and their clarity (M,)."""
    weights = 1 / (errors[first] ** 2 + errors[second] ** 2)
    own = (weights * np.abs(gains[first]) ** 2).sum(axis=0)
    other = (weights * np.abs(gains[second]) ** 2).sum(axis=0)
    ratios = (weights * gains[first].conj() * gains[second]).sum(axis=0) / np.maximum(own, 1e-300)
    clear = np.minimum(own, other)
    return ratios, np.where(clear > _CLEAR, clear, 0.0)


def _strength(
    gains: Complex, errors: Array, first: Index, second: Index, frequencies: Array
) -> Array:
    """Return the second hit's strength over the first's (M,), smooth over frequency."""
    ratios, clear = _ratios(gains, errors, first, second)
    kept = (clear > 0) & (ratios != 0)
    if not kept.any():
        return np.full(len(frequencies), _overall(gains[first], gains[second]))
    squares = (frequencies / frequencies.max()) ** 2
    columns = np.stack([np.ones_like(squares), np.minimum(squares, squares[kept].max())], axis=1)
    # Modes scatter by more than noise: nobody strikes the same spot twice.
    weights = np.sqrt(np.minimum(clear[kept], 1 / _SCATTER**2))
    levels = weights * np.log(np.abs(ratios[kept]))
    design = np.vstack([columns[kept] * weights[:, None], [0.0, 1 / _SLOPE]])
    slopes, *_ = np.linalg.lstsq(design, np.append(levels, 0.0), rcond=None)
    return np.exp(columns @ slopes)


def _overall(first: Complex, second: Complex) -> float:
    """Return the ratio of total strengths; 1 where either is silent."""
    one, other = np.linalg.norm(first), np.linalg.norm(second)
    return float(other / one) if one and other else 1.0


def _delay(
    gains: Complex, errors: Array, first: Index, second: Index, frequencies: Array, *, turned: bool
) -> float:
    """Return how late the second hit is, s: phases are 0 or, if `turned`, 0 or half a turn."""
    ratios, clear = _ratios(gains, errors, first, second)
    turns = ratios / np.maximum(np.abs(ratios), 1e-300)
    times = 2 if turned else 1
    return _best_delay(turns**times, np.sqrt(clear), times * frequencies)


def _best_delay(turns: Complex, weights: Array, frequencies: Array) -> float:
    """Return the delay that makes phase factors (M,) most nearly 1, s; small ones are likelier."""
    if np.count_nonzero(weights) < _TWO:
        return 0.0
    step = 1 / (_FINENESS * frequencies.max())
    delays = np.arange(-np.ceil(_LATEST / step), np.ceil(_LATEST / step) + 1) * step
    likely = np.exp(-0.5 * (delays / _LIKELY) ** 2)
    scores = _agreement(turns, weights, frequencies, delays) * likely
    best = float(delays[np.argmax(scores)])
    for _ in range(_ZOOMS):
        near = best + step * np.linspace(-1, 1, 2 * _FINENESS + 1)
        best = float(near[np.argmax(_agreement(turns, weights, frequencies, near))])
        step /= _FINENESS
    return best


def _agreement(turns: Complex, weights: Array, frequencies: Array, delays: Array) -> Array:
    waves = np.exp(2j * np.pi * np.outer(delays, frequencies))
    return np.asarray((waves @ (weights * turns)).real, np.float64)
