"""What is fitted: takes, and where each was struck and heard."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, RecordingError
from struck.files.sound import Sound
from struck.model.arrays import Array, Complex, Index
from struck.model.material import AIR
from struck.model.provenance import Progress, silent
from struck.model.survey import SYMMETRIES, Survey
from struck.recordings.alignment import aligned, averaged
from struck.recordings.manifest import KINDS, NAME, Manifest, read_manifest
from struck.recordings.poles.search import Fitted
from struck.recordings.takes import Take, force_channels

Recording = str | os.PathLike[str] | Sound | Take
"""What can be fitted: a file, or samples."""
_ONE = (str, os.PathLike, Sound, Take)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recorded:
    """Takes of one object with the places of their contacts and listeners."""

    takes: tuple[Take, ...]
    contacts: Array | None = None  # (takes, D), coordinates u or u and v; None: unknown
    listeners: tuple[Array, ...] | None = None  # (channels, 3) of each take, m; NaN: a force
    coordinates: tuple[str, ...] = ()  # names and units of a contact's coordinates
    # where the sound seems to come from, m
    centre: Array = field(default_factory=lambda: np.zeros(3))
    symmetry: str = "none"  # "none" or "axial", as in `Survey`

    def __post_init__(self) -> None:
        if self.symmetry not in SYMMETRIES:
            raise OptionError(f"symmetry is {self.symmetry!r}: give one of {', '.join(SYMMETRIES)}")
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all():
            raise OptionError(f"centre is {self.centre.tolist()}: give x, y, z, m")
        _require_contacts(self)
        if self.listeners is not None:
            object.__setattr__(self, "listeners", tuple(_of_all_channels(self)))

    def distance(self, take: int, channel: int) -> float:
        """Return how far from the centre a channel listened, m; 1 where unknown."""
        if self.listeners is None:
            return 1.0
        return float(np.linalg.norm(self.listeners[take][channel] - self.centre))

    @classmethod
    def of(
        cls,
        recordings: Recording | Sequence[Recording],
        *,
        contacts: ArrayLike | None = None,
        listeners: ArrayLike | Sequence[ArrayLike] | None = None,
        manifest: str | os.PathLike[str] | None = None,
        symmetry: str | None = None,
        centre: ArrayLike | None = None,
        progress: Progress = silent,
    ) -> Recorded:
        """Read recordings and their places; see `struck.recordings.fit.fit_recordings`."""
        several = _several(recordings)
        told = _manifest(several, manifest)
        if told is None:
            takes = tuple(_taken(several, progress))
            return cls(
                takes=takes,
                contacts=None if contacts is None else _columns(contacts),
                listeners=None if listeners is None else _microphones(listeners, takes),
                coordinates=() if contacts is None else ("u", "v")[: _columns(contacts).shape[1]],
                centre=np.zeros(3) if centre is None else _numbers("centre", centre),
                symmetry=symmetry or "none",
            )
        if contacts is not None or listeners is not None:
            raise OptionError(
                f"places are given, and {told.path} tells them too: leave one of them out"
            )
        return cls._told(told, symmetry, centre, progress)

    @classmethod
    def _told(
        cls,
        manifest: Manifest,
        symmetry: str | None,
        centre: ArrayLike | None,
        progress: Progress,
    ) -> Recorded:
        contacts = np.array([entry.contact for entry in manifest.entries])
        listeners = tuple(np.array(entry.listeners) for entry in manifest.entries)
        return cls(
            takes=tuple(_taken(manifest.files, progress)),
            contacts=contacts if manifest.has_contacts else None,
            listeners=listeners if manifest.has_listeners else None,
            coordinates=manifest.coordinates or ("u", "v")[: contacts.shape[1]],
            centre=_numbers("centre", manifest.centre if centre is None else centre),
            symmetry=symmetry or manifest.symmetry,
        )


def _manifest(
    recordings: list[Recording], manifest: str | os.PathLike[str] | None
) -> Manifest | None:
    """Return the manifest that was named, or that is itself the recording, or lies in a folder."""
    if not recordings:
        raise OptionError("there are no recordings: give at least one")
    files = [each for each in recordings if isinstance(each, str | os.PathLike)]
    paths = [Path(each).resolve() for each in files]
    twice = [str(path) for path in paths if paths.count(path) > 1]
    if twice:
        raise OptionError(f"{twice[0]} is given twice, as if it were two recordings: give it once")
    if manifest is not None:
        if len(files) < len(recordings):
            raise OptionError(f"{manifest} tells of files: give recordings as paths")
        return read_manifest(manifest).chosen(files)
    if len(files) != 1 or len(recordings) != 1:
        return None
    path = Path(files[0])
    if path.is_dir():
        if not (path / NAME).is_file():
            raise RecordingError(f"{path} has no {NAME}: give its recordings one by one")
        path = path / NAME
    return read_manifest(path) if path.suffix.lower() in KINDS else None


def _taken(recordings: Sequence[Recording], progress: Progress) -> Iterator[Take]:
    for number, each in enumerate(recordings):
        progress("reading", number / len(recordings))
        if isinstance(each, Take):
            yield each
        elif isinstance(each, Sound):
            yield Take.of(each, f"recording {number + 1}")
        else:
            yield Take.load(each)
    progress("reading", 1.0)


def _several(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    several = [recordings] if isinstance(recordings, _ONE) else recordings
    if not isinstance(several, Sequence) or not all(isinstance(each, _ONE) for each in several):
        raise OptionError(
            f"recordings are of type {type(recordings).__name__}: give files, or samples as "
            "struck.Sound(samples=..., sample_rate=...), one or several"
        )
    return list(several)


def _numbers(name: str, given: ArrayLike) -> Array:
    try:
        return np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {given!r}: give numbers, as many for each") from error


def _columns(contacts: ArrayLike) -> Array:
    given = np.atleast_1d(_numbers("contacts", contacts))
    return given[:, None] if given.ndim == 1 else given


def _microphones(
    listeners: ArrayLike | Sequence[ArrayLike], takes: Sequence[Take]
) -> tuple[Array, ...]:
    """Return the places of each take's channels: one place for all takes, or a set for each."""
    try:
        given = [np.asarray(each, np.float64) for each in listeners]  # type: ignore[union-attr] - an array or a list
    except (TypeError, ValueError) as error:
        raise OptionError(f"listeners are {listeners!r}: give x, y, z of each, m") from error
    if len(given) == 3 and all(each.ndim == 0 for each in given):
        return tuple(np.array([given]) for _ in takes)
    return tuple(each[None] if each.ndim == 1 else each for each in given)


def _require_contacts(recorded: Recorded) -> None:
    contacts, count = recorded.contacts, len(recorded.takes)
    if contacts is None:
        return
    if contacts.ndim != 2 or len(contacts) != count or contacts.shape[1] not in {1, 2}:
        raise OptionError(
            f"contacts have shape {contacts.shape}, and there are {count} recordings: give one or "
            "two coordinates for each"
        )
    if not np.isfinite(contacts).all():
        raise OptionError("a contact is not finite: give numbers")


def _of_all_channels(recorded: Recorded) -> Iterator[Array]:
    """Yield each take's places (channels, 3), NaN for channels that hold a force."""
    listeners, takes = recorded.listeners or (), recorded.takes
    if len(listeners) != len(takes):
        raise OptionError(
            f"listeners are given for {len(listeners)} recordings of {len(takes)}: give them for "
            "each, or one place for all"
        )
    for take, places in zip(takes, listeners, strict=True):
        sounding = ~force_channels(take)
        every = np.full((take.channels, 3), np.nan)
        told = places[sounding] if len(places) == take.channels else places
        if told.shape != (np.count_nonzero(sounding), 3) or not np.isfinite(told).all():
            raise OptionError(
                f"listeners of {take.name} have shape {places.shape}, and it has "
                f"{np.count_nonzero(sounding)} microphones: give x, y, z for each, m"
            )
        every[sounding] = told
        yield every


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
    shortest = min(map(len, costs))
    return np.sum([each[:shortest] for each in costs], axis=0)


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
                f"takes have {counts.min()} and {counts.max()} channels, and nobody told where "
                "their microphones were: give listeners, or the same number of channels in all"
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
    every = np.array(
        [
            recorded.listeners[take][channel]
            for take, channel in zip(told.takes, told.channels, strict=True)
        ]
    )
    places, number = np.unique(every, axis=0, return_inverse=True)
    return places, number.reshape(-1)
