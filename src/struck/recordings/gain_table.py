"""Gain table: fitted rows brought to their arrivals, equal hits and one row a pair of places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from struck.errors import RecordingError
from struck.model.arrays import Array, Complex, Index
from struck.model.material import AIR
from struck.model.survey import Survey
from struck.recordings.poles.search import PoleFit
from struck.recordings.takes import RecordingSet

# The steepest rise is off by some samples in noise. The fit knows better: run backwards, its modes
# explain the samples up to the moment of the hit, and only earlier modes explain those before it.

_MAX_ADVANCE = 0.003  # earliest arrival before the steepest rise, s
_MIN_TRIGGERED_TAKES = 4
_SAMPLES = 3.0  # largest median deviation of the moments of impact, samples
_MAX_COST = 100.0  # a moment is possible up to this residual energy over the least, noise being 1


def arrivals(fit: PoleFit, recording_set: RecordingSet) -> Array:
    """Return when the sound of each row arrived (rows,), s in its take.

    The channels of a hit share one moment, corrected for their distances. Triggered takes share the
    moment of impact, too, except for takes whose residual excludes it.
    """
    times = np.array([row.onset for row in fit.rows])
    extra_times = travels(fit, recording_set)
    numbers = np.array([(row.take, row.hit) for row in fit.rows])
    hits = [np.flatnonzero((numbers == hit).all(axis=1)) for hit in np.unique(numbers, axis=0)]
    costs = [_shared_costs(fit, recording_set, rows, extra_times[rows]) for rows in hits]
    for rows, cost in zip(hits, costs, strict=True):
        times[rows] += (
            np.argmin(cost) / _rate(fit, recording_set, rows) - _MAX_ADVANCE + extra_times[rows]
        )
    return _align_to_trigger(times, hits, costs, fit, recording_set)


def _rate(fit: PoleFit, recording_set: RecordingSet, rows: Index) -> int:
    return recording_set.takes[fit.rows[rows[0]].take].sample_rate


def _shared_costs(
    fit: PoleFit, recording_set: RecordingSet, rows: Index, extra_times: Array
) -> Array:
    """Return the residual energy of a hit for each moment of its arrival, earliest first."""
    shifts = np.round(extra_times * _rate(fit, recording_set, rows)).astype(int)
    costs = [
        _costs(fit, recording_set, int(row), int(shift))
        for row, shift in zip(rows, shifts, strict=True)
    ]
    return np.sum([row_costs[: min(map(len, costs))] for row_costs in costs], axis=0)


def _align_to_trigger(
    times: Array, hits: list[Index], costs: list[Array], fit: PoleFit, recording_set: RecordingSet
) -> Array:
    """Return arrivals moved to the median moment of impact, in takes that agree with it.

    A trigger is more exact than any arrival in noise; no hand strikes many takes within samples.
    """
    if (
        recording_set.listeners is None
        or len(hits) < _MIN_TRIGGERED_TAKES
        or len(hits) > len(recording_set.takes)
    ):
        return times
    distances = np.array([recording_set.distance(row.take, row.channel) for row in fit.rows])
    impacts = times - distances / AIR.sound_speed
    moment = np.median(impacts)
    if np.median(np.abs(impacts - moment)) * _rate(fit, recording_set, hits[0]) > _SAMPLES:
        return times
    moved_times = times.copy()
    for rows, cost in zip(hits, costs, strict=True):
        best_index = int(np.argmin(cost))
        place = best_index + round(
            float(moment - impacts[rows[0]]) * _rate(fit, recording_set, rows)
        )
        if 0 <= place < len(cost) and cost[place] - cost[best_index] < _MAX_COST:
            moved_times[rows] = moment + distances[rows] / AIR.sound_speed
    return moved_times


def travels(fit: PoleFit, recording_set: RecordingSet) -> Array:
    """Return how much later than at its take's nearest microphone each row's sound arrived, s."""
    if recording_set.listeners is None:
        return np.zeros(len(fit.rows))
    distances = [
        np.linalg.norm(points - recording_set.centre, axis=1) for points in recording_set.listeners
    ]
    extra_distances = [
        distances[row.take][row.channel] - np.nanmin(distances[row.take]) for row in fit.rows
    ]
    return np.array(extra_distances) / AIR.sound_speed


def _costs(fit: PoleFit, recording_set: RecordingSet, row: int, shift: int) -> Array:
    """Return a channel's residual energy over its noise for each arrival from the earliest on."""
    entry = fit.rows[row]
    take = recording_set.takes[entry.take]
    rate = take.sample_rate
    first = round((entry.onset - _MAX_ADVANCE) * rate) + shift
    indices = np.arange(first, max(round(entry.time * rate) + shift, first + 2))
    is_recorded = (indices >= 0) & (indices < take.samples.shape[1])
    samples = np.zeros(len(indices))
    samples[is_recorded] = take.samples[entry.channel, indices[is_recorded]]
    fit_residual = samples - fit.ringing(row, first / rate, len(indices))
    earlier_row = _find_earlier_row(fit, row)
    earlier_residual = samples
    if earlier_row is not None:
        earlier_residual = samples - fit.ringing(earlier_row, first / rate, len(indices))
    noise = float(fit.noise_in(row, np.array([20.0, 0.45 * rate]))[0])
    return np.concatenate(
        [[0.0], np.cumsum((earlier_residual**2 - fit_residual**2) / max(noise, 1e-300))]
    )


def _find_earlier_row(fit: PoleFit, row: int) -> int | None:
    """Return the row of the hit before in the same channel, None for the first."""
    entry = fit.rows[row]
    channels = ((other_row.take, other_row.channel) for other_row in fit.rows[:row])
    rows = [
        number for number, channel in enumerate(channels) if channel == (entry.take, entry.channel)
    ]
    return rows[-1] if rows else None


_MIN_RELATIVE_ERROR = 1e-6  # least error of a gain over the largest of its mode
_MAX_GROWTH = 1.0  # nepers a gain is followed back to its hit; beyond, its error is set to its size
_MIN_DECAY = 0.02  # 1/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainTable:
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
    def of(cls, fit: PoleFit, recording_set: RecordingSet) -> GainTable:
        """Gather the rows of a fit."""
        rows = fit.rows
        arrival_times = arrivals(fit, recording_set)
        elapsed_times = np.array([row.time for row in rows]) - arrival_times
        lead = float(np.median(elapsed_times))
        growth = np.outer(elapsed_times - lead, fit.decays)
        phases = np.outer(elapsed_times - lead, 2 * np.pi * fit.frequencies)
        propagators = np.exp(np.minimum(growth, _MAX_GROWTH) - 1j * phases)
        gains = np.asarray(fit.gains * propagators, np.complex128)
        errors = fit.gain_errors * np.abs(propagators)
        errors = np.where(growth > _MAX_GROWTH, np.maximum(errors, np.abs(gains)), errors)
        min_errors = _MIN_RELATIVE_ERROR * np.maximum(
            np.abs(gains).max(axis=0, initial=0.0), 1e-300
        )
        hits = list(dict.fromkeys((row.take, row.hit) for row in rows))
        return cls(
            gains=gains,
            errors=np.maximum(errors, min_errors),
            poles=-fit.decays + 2j * np.pi * fit.frequencies,
            hits=np.array([hits.index((row.take, row.hit)) for row in rows]),
            takes=np.array([row.take for row in rows]),
            channels=np.array([row.channel for row in rows]),
            arrivals=arrival_times,
            lead=lead,
        )

    @property
    def energies(self) -> Array:
        """Energies (n, M) of the modes over their duration."""
        return np.abs(self.gains) ** 2 / (2 * np.maximum(-self.poles.real, _MIN_DECAY))

    @property
    def range(self) -> float:
        """How much louder the loudest take is than the softest, dB, by the loudest hit of each."""
        hits = np.bincount(self.hits, self.energies.sum(axis=1))
        max_energies = np.zeros(self.takes.max() + 1)
        np.maximum.at(max_energies, self.takes, hits[self.hits])
        return float(
            10 * np.log10(max_energies.max() / max(max_energies[max_energies > 0].min(), 1e-300))
        )

    def survey(self, recording_set: RecordingSet) -> Survey:
        """Return gains over contact and listener, one for each pair.

        Unknown listeners count as one place 1 m away, unknown contacts as one contact.
        """
        table = self if recording_set.listeners is not None else self.in_one_channel()
        places, contact = _contacts(recording_set, table.takes)
        microphones, listener = _listeners(recording_set, table)
        gains, errors = align_hits(
            table.gains, table.errors, table.hits, contact, listener, table.poles
        )
        pairs, gains, errors = average_pairs(gains, errors, np.stack([contact, listener], axis=1))
        return Survey(
            contacts=places,
            listeners=microphones,
            pairs=pairs,
            gains=gains,
            frequencies=table.poles.imag / (2 * np.pi),
            errors=errors,
            centre=recording_set.centre,
            symmetry=recording_set.symmetry,
        )

    def in_one_channel(self) -> GainTable:
        """Return one row for each hit: in each mode that of the channel with the most energy.

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
        best_channels, modes = energies.argmax(axis=0), np.arange(self.gains.shape[1])
        level = np.sqrt(energies.mean(axis=0) / np.maximum(energies[best_channels, modes], 1e-300))
        chosen = rows[:, best_channels], modes
        return GainTable(
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
        loudest_hit = int(energies.argmax())
        energy_fractions = np.abs(one.gains) ** 2 / energies[:, None]
        is_sure = one.errors < np.abs(one.gains)
        is_sure[loudest_hit] |= ~is_sure.any(axis=0)
        mean = (energy_fractions * is_sure).sum(axis=0) / is_sure.sum(axis=0)
        phase_factors = one.gains[loudest_hit] / np.maximum(np.abs(one.gains[loudest_hit]), 1e-300)
        phases = np.where(one.gains[loudest_hit] == 0, 1.0, phase_factors)
        return np.asarray(np.sqrt(mean * energies[loudest_hit]) * phases, np.complex128)


def _contacts(recording_set: RecordingSet, takes: Index) -> tuple[Array, Index]:
    """Return each contact once, and the number of that of each row."""
    if recording_set.contacts is None:
        return np.zeros((1, 1)), np.zeros(len(takes), np.int64)
    places, number = np.unique(recording_set.contacts, axis=0, return_inverse=True)
    return places, number.reshape(-1)[takes]


def _listeners(recording_set: RecordingSet, table: GainTable) -> tuple[Array, Index]:
    """Return each listener once, m, and the number of that of each row."""
    if recording_set.listeners is None:
        return recording_set.centre + np.array([[1.0, 0.0, 0.0]]), np.zeros(
            len(table.takes), np.int64
        )
    rows = zip(table.takes, table.channels, strict=True)
    positions = np.array([recording_set.listeners[take][channel] for take, channel in rows])
    places, number = np.unique(positions, axis=0, return_inverse=True)
    return places, number.reshape(-1)


# Strength and time of each hit, which differ from hit to hit. Two hits of one contact, recorded at
# one place, differ by a factor that is smooth over frequency: strength, duration of the contact,
# and error of their start. Contacts recorded at one place differ in their drives,
# which are real: a phase difference in proportion to frequency is an error of the moment
# again.

_MAX_DELAY = 1e-3  # largest error of a moment, s
_DELAY_DEVIATION = 3e-4  # usual error of a moment, s
_FINENESS = 8  # delays tried in a period of the highest mode
_REFINEMENTS = 3  # refinements of the best delay
_MIN_ENERGY = 100.0  # energy over that of its standard error from which a ratio of gains counts
_MIN_STANDARD_ERRORS = 3.0  # standard errors from which a gain counts for loudness
# scatter of modes between hits of a contact; usual b at the highest mode
_SCATTER, _SLOPE = 0.05, 1.0
_MIN_MODES = 2  # least modes that show a moment


def align_hits(
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
    hit_delays = np.zeros(len(gains))
    leaders = hits.copy()
    for first, second in _iterate_comparisons(gains, errors, hits, contacts, listeners):
        rows = np.flatnonzero(hits == hits[second[0]])
        is_repeated = contacts[first[0]] == contacts[second[0]]
        delay = _delay(gains, errors, first, second, frequencies, turned=not is_repeated)
        hit_delays[rows], leaders[rows] = delay, leaders[first[0]]
        gains[rows] *= np.exp(poles * delay)
        if is_repeated:
            strength = _strength(gains, errors, first, second, frequencies)
            gains[rows] /= strength
            errors[rows] /= strength
    return gains * np.exp(-poles * _median_delays(hit_delays, hits, leaders)[:, None]), errors


def _median_delays(hit_delays: Array, hits: Index, leaders: Index) -> Array:
    """Return the median delay (n,) of the hits that follow the same first one."""
    medians = np.zeros(len(hit_delays))
    for leader in np.unique(leaders):
        is_follower = leaders == leader
        _, first_rows = np.unique(hits[is_follower], return_index=True)
        medians[is_follower] = np.median(hit_delays[is_follower][first_rows])
    return medians


def _iterate_comparisons(
    gains: Complex, errors: Array, hits: Index, contacts: Index, listeners: Index
) -> Iterator[tuple[Index, Index]]:
    """Yield, hit by hit, the rows already in the table and the next hit's at their listeners."""
    energies = np.where(np.abs(gains) > _MIN_STANDARD_ERRORS * errors, np.abs(gains) ** 2, 0.0).sum(
        axis=1
    )
    numbers = np.unique(hits)
    loudness = [energies[hits == number].sum() for number in numbers]
    table_rows: list[int] = []
    for number in numbers[np.argsort(loudness, kind="stable")[::-1]]:
        rows = np.flatnonzero(hits == number)
        shared = [row for row in table_rows if listeners[row] in listeners[rows]]
        repeated_rows = [row for row in shared if contacts[row] == contacts[rows[0]]]
        chosen = {int(listeners[row]): row for row in reversed(repeated_rows or shared)}
        if chosen:
            second = [rows[np.argmax(listeners[rows] == place)] for place in chosen]
            yield np.array(list(chosen.values())), np.array(second)
        table_rows += rows.tolist()


def average_pairs(gains: Complex, errors: Array, pairs: Index) -> tuple[Index, Complex, Array]:
    """Return each pair (contact, listener) once, with the weighted mean of its gains and errors."""
    distinct_pairs, number = np.unique(pairs, axis=0, return_inverse=True)
    membership = np.eye(len(distinct_pairs))[number.reshape(-1)].T
    weights = 1 / errors**2
    total_weights = membership @ weights
    return (
        distinct_pairs,
        (membership @ (weights * gains)) / total_weights,
        1 / np.sqrt(total_weights),
    )


def _ratios(gains: Complex, errors: Array, rows: Index, other_rows: Index) -> tuple[Complex, Array]:
    """Return least-squares ratios of the second's gains to the first's, and their clarity (M,)."""
    weights = 1 / (errors[rows] ** 2 + errors[other_rows] ** 2)
    first_energies = (weights * np.abs(gains[rows]) ** 2).sum(axis=0)
    second_energies = (weights * np.abs(gains[other_rows]) ** 2).sum(axis=0)
    ratios = (weights * gains[rows].conj() * gains[other_rows]).sum(axis=0) / np.maximum(
        first_energies, 1e-300
    )
    clear = np.minimum(first_energies, second_energies)
    return ratios, np.where(clear > _MIN_ENERGY, clear, 0.0)


def _strength(
    gains: Complex, errors: Array, first: Index, second: Index, frequencies: Array
) -> Array:
    """Return the second hit's strength over the first's (M,), smooth over frequency."""
    ratios, clear = _ratios(gains, errors, first, second)
    is_clear = (clear > 0) & (ratios != 0)
    if not is_clear.any():
        return np.full(len(frequencies), _level_ratio(gains[first], gains[second]))
    squares = (frequencies / frequencies.max()) ** 2
    columns = np.stack(
        [np.ones_like(squares), np.minimum(squares, squares[is_clear].max())], axis=1
    )
    # Modes scatter by more than noise, since hits differ in position.
    weights = np.sqrt(np.minimum(clear[is_clear], 1 / _SCATTER**2))
    levels = weights * np.log(np.abs(ratios[is_clear]))
    design = np.vstack([columns[is_clear] * weights[:, None], [0.0, 1 / _SLOPE]])
    slopes, *_ = np.linalg.lstsq(design, np.append(levels, 0.0), rcond=None)
    return np.exp(columns @ slopes)


def _level_ratio(first: Complex, second: Complex) -> float:
    """Return the ratio of total strengths; 1 where either is silent."""
    one, other = np.linalg.norm(first), np.linalg.norm(second)
    return float(other / one) if one and other else 1.0


def _delay(
    gains: Complex, errors: Array, first: Index, second: Index, frequencies: Array, *, turned: bool
) -> float:
    """Return how late the second hit is, s: phases are 0 or, if `turned`, 0 or pi."""
    ratios, clear = _ratios(gains, errors, first, second)
    phase_factors = ratios / np.maximum(np.abs(ratios), 1e-300)
    times = 2 if turned else 1
    return _find_delay(phase_factors**times, np.sqrt(clear), times * frequencies)


def _find_delay(phase_factors: Complex, weights: Array, frequencies: Array) -> float:
    """Return the delay that makes phase factors (M,) most nearly 1, s; small ones are likelier."""
    if np.count_nonzero(weights) < _MIN_MODES:
        return 0.0
    step = 1 / (_FINENESS * frequencies.max())
    delays = np.arange(-np.ceil(_MAX_DELAY / step), np.ceil(_MAX_DELAY / step) + 1) * step
    priors = np.exp(-0.5 * (delays / _DELAY_DEVIATION) ** 2)
    scores = _agreement(phase_factors, weights, frequencies, delays) * priors
    best_delay = float(delays[np.argmax(scores)])
    for _ in range(_REFINEMENTS):
        near_delays = best_delay + step * np.linspace(-1, 1, 2 * _FINENESS + 1)
        best_delay = float(
            near_delays[np.argmax(_agreement(phase_factors, weights, frequencies, near_delays))]
        )
        step /= _FINENESS
    return best_delay


def _agreement(phase_factors: Complex, weights: Array, frequencies: Array, delays: Array) -> Array:
    waves = np.exp(2j * np.pi * np.outer(delays, frequencies))
    return np.asarray((waves @ (weights * phase_factors)).real, np.float64)
