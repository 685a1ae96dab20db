"""Measurements: each planned point is prompted, struck, recorded, judged and kept, or repeated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, RecordingError
from struck.files import wav
from struck.files.atomic import is_file, make_folder, read_bytes, write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array, Complex, checked
from struck.model.provenance import Progress, silent
from struck.recordings.acceptance import MARGIN, TakeVerdict, examine_take
from struck.recordings.capture_plan import CapturePlan, Point
from struck.recordings.manifest import NAME, ManifestEntry, recorded_so_far

_MAX_LINES = 64  # of a spectrum, by which the best contact is chosen
_MAX_DEPTH = 50.0  # dB under the strongest line
_MAX_SECONDS = 1.0  # s of a spectrum


@dataclass(frozen=True, slots=True, kw_only=True)
class CapturedTake:
    """One attempt, from 1 on, at one hit, from 1 on, of a point."""

    point: Point
    hit: int
    attempt: int

    @property
    def file(self) -> str:
        """Name of the take's sound file."""
        return self.point.file(self.hit)

    @property
    def facts(self) -> dict[str, str]:
        """Places of the take as texts, for programs."""
        return self.point.facts(self.hit)

    def __str__(self) -> str:
        facts = self.facts
        places = [f"{key} {facts[key]}" for key in ("contact", "listener") if facts[key]]
        attempt_text = f", attempt {self.attempt}" if self.attempt > 1 else ""
        hit = f"{self.point.name}, hit {self.hit} of {self.point.hits}"
        return f"{hit}{attempt_text}: {'; '.join(places)}"


class Recorder(Protocol):
    """A device that records takes, or a stand-in for one."""

    def record(
        self, take: CapturedTake, seconds: float, lead_in: float, cue: Callable[[], None]
    ) -> Sound:
        """Record some seconds; call `cue` once `lead_in` seconds of them are recorded.

        A sound with notes on disturbances of the recording is refused.
        """
        ...


class Operator(Protocol):
    """The person or program that strikes the body, or watches a measurement."""

    def ready(self, text: str) -> None:
        """Announce the next hit, and return when it may begin."""

    def tell(self, text: str) -> None:
        """Show a message about the present step."""


class SilentOperator:
    """An operator without a screen or keyboard: shows no text and never waits."""

    def ready(self, text: str) -> None:
        """Return at once, without waiting for a person."""

    def tell(self, text: str) -> None:
        """Drop the text: no person reads it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A take that was refused, and why."""

    file: str
    attempt: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Takes of a measurement, accepted and refused ones."""

    manifest: Path  # for `read_manifest`
    recorded: int  # takes of this run
    earlier: int  # takes of earlier runs, which were not recorded again
    refusals: tuple[Refusal, ...]


@checked
def capture(
    plan: CapturePlan,
    folder: Path,
    recorder: Recorder,
    *,
    operator: Operator | None = None,
    progress: Progress = silent,
) -> Outcome:
    """Make the measurement of a plan, or the missing part of it.

    Parameters
    ----------
    plan : CapturePlan
        The plan.
    folder : Path
        Where takes and their manifest are or will be. A take is a WAV file of the lead-in, 10 ms
        and the sound from the hit on; it is written as a whole, then the manifest. What is there
        is not recorded again.
    recorder : Recorder
        What records.
    operator : Operator, optional
        Who moves and strikes. Default: `SilentOperator`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``. Default: silent.

    Returns
    -------
    Outcome
        Accepted and refused takes.

    Raises
    ------
    RecordingError
        When a take is refused too often, a program fails, or the folder holds another measurement.
    FileFormatError
        When takes cannot be written.
    DeviceError
        When the device fails.

    Notes
    -----
    The measuring system of 2007 (section 3): 0.5 s of ambient sound before each hit, a hook that
    moves the microphone, and one that fires a solenoid.
    """
    session = _Session(plan, folder, recorder, operator or SilentOperator(), progress)
    for point in session.points():
        session.visit(point)
    progress("recording", 1.0)
    return session.outcome()


class _Session:
    """One run of a measurement."""

    def __init__(
        self,
        plan: CapturePlan,
        folder: Path,
        recorder: Recorder,
        operator: Operator,
        progress: Progress,
    ) -> None:
        self._plan, self._log = plan, TakeLog(plan, folder)
        self._recorder, self._operator, self._progress = recorder, operator, progress
        self._new_count, self._earlier_count, self._refusals = 0, 0, list[Refusal]()
        self._last: Point | None = None

    def points(self) -> Iterator[Point]:
        """Yield the points in order; for plans P+Q, the second part once the first is recorded."""
        plan = self._plan
        if plan.pairs == "all":
            yield from plan.every()
            return
        planning = plan.planning()
        first = [plan.point(plan.contacts[c], plan.listeners[q]) for c, q in planning.first]
        yield from first
        sounds = [self._log.sounds(point) for point in first]
        chosen = planning.after(estimate_gains(sounds, plan.lead_in + MARGIN))
        yield from (plan.point(plan.contacts[c], plan.listeners[q]) for c, q in chosen.rest)

    def visit(self, point: Point) -> None:
        """Record the hits of a point that are missing."""
        missing = [hit for hit in range(1, point.hits + 1) if not self._log.has(point, hit)]
        self._earlier_count += point.hits - len(missing)
        if not missing:
            return
        self._tell_progress(point)
        self._plan.hooks.run("move", point.facts(missing[0]))
        for hit in missing:
            self._tell_progress(point)
            self._log.add(point, hit, self._taken(point, hit))
            self._new_count += 1

    def outcome(self) -> Outcome:
        """Return the result so far."""
        return Outcome(
            manifest=self._log.path,
            recorded=self._new_count,
            earlier=self._earlier_count,
            refusals=tuple(self._refusals),
        )

    def _taken(self, point: Point, hit: int) -> TakeVerdict:
        """Repeat a take until one is accepted."""
        reason = ""
        for attempt in range(1, self._plan.tries + 1):
            take = CapturedTake(point=point, hit=hit, attempt=attempt)
            verdict = self._tried(take)
            if not verdict.reason:
                return verdict
            reason = verdict.reason
            self._refusals.append(Refusal(file=take.file, attempt=attempt, reason=reason))
            self._operator.tell(f"{take.file} is refused: {reason}")
        raise RecordingError(
            f"{point.file(hit)} was refused {self._plan.tries} times (tries), the last time since "
            f"{reason}. Finished takes are saved: start again to record the rest"
        )

    def _tried(self, take: CapturedTake) -> TakeVerdict:
        plan = self._plan
        self._ask(take)
        lead_in = plan.lead_in + MARGIN
        length = lead_in + plan.patience + plan.seconds
        sound = self._recorder.record(take, length, lead_in, lambda: self._cue(take))
        self._require_rate(sound)
        if sound.notes:
            return TakeVerdict(reason="; ".join(sound.notes))
        return examine_take(
            sound,
            lead_in=plan.lead_in,
            seconds=plan.seconds,
            bounds=plan.bounds,
            channels=plan.channels,
        )

    def _ask(self, take: CapturedTake) -> None:
        last, self._last = self._last, take.point
        has_moved = last is None or last.contact != take.point.contact
        if self._plan.prompt == "take" or (self._plan.prompt == "contact" and has_moved):
            self._operator.ready(str(take))

    def _cue(self, take: CapturedTake) -> None:
        if self._plan.hooks.strike:
            self._plan.hooks.run("strike", take.facts)
        else:
            self._operator.tell("strike now")

    def _require_rate(self, sound: Sound) -> None:
        planned_rate = self._plan.sample_rate
        if planned_rate not in (None, sound.sample_rate):
            raise RecordingError(
                f"the device records at {sound.sample_rate} Hz and the plan says "
                f"{planned_rate} Hz: change one of them"
            )

    def _tell_progress(self, point: Point) -> None:
        finished_count = self._new_count + self._earlier_count
        self._progress(f"recording {point.name}", finished_count / self._plan.count)


class SimulatedRecorder:
    """A recorder that plays WAV files of a folder, called as the takes: a rehearsal.

    A second attempt is given "name.2.wav" where there is one, a third "name.3.wav" ...; else the
    same again.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def record(
        self, take: CapturedTake, seconds: float, lead_in: float, cue: Callable[[], None]
    ) -> Sound:
        """Return the file of a take, at most `seconds` of it; RecordingError when it is missing."""
        del lead_in
        first_path = self.folder / take.file
        attempt_path = first_path.with_suffix(f".{take.attempt}.wav")
        path = attempt_path if is_file(attempt_path) else first_path
        try:
            data = read_bytes(path)
        except FileFormatError as error:
            raise RecordingError(f"{error}; a rehearsal needs a WAV file for each take") from error
        cue()
        recording = wav.decode(data, str(path))
        length = round(seconds * recording.sample_rate)
        return Sound(samples=recording.samples[:, :length], sample_rate=recording.sample_rate)


class TakeLog:
    """A folder of takes with a manifest, from an earlier run or new; each is written whole."""

    def __init__(self, plan: CapturePlan, folder: Path) -> None:
        make_folder(folder)
        self._plan = plan
        self._manifest = recorded_so_far(folder / NAME)
        if plan.sample_rate is not None:
            self._require_rate(plan.sample_rate)

    @property
    def path(self) -> Path:
        """Path of the manifest."""
        return self._manifest.path

    def has(self, point: Point, hit: int) -> bool:
        """Return whether a take is recorded; RecordingError if its file is of other places."""
        entries = {entry.file: entry for entry in self._manifest.entries}
        entry = entries.get(point.file(hit))
        if entry is None:
            return False
        if (entry.contact, entry.listeners) != (point.contact, point.listeners):
            raise RecordingError(
                f"{self.path} has {entry.file} with contact {entry.contact} and listeners "
                f"{entry.listeners}, and the plan says {point.contact} and {point.listeners}: name "
                "the places in the plan, or record into another folder"
            )
        return True

    def add(self, point: Point, hit: int, verdict: TakeVerdict) -> None:
        """Write an accepted take, then the manifest: a kill leaves both whole."""
        sound = verdict.sound
        if sound is None:
            raise RecordingError(f"{point.file(hit)} was refused: {verdict.reason}")
        self._require_rate(sound.sample_rate)
        data = wav.encode(wav.Recording(samples=sound.samples, sample_rate=sound.sample_rate))
        write_bytes(self.path.with_name(point.file(hit)), data)
        entry = ManifestEntry(
            file=point.file(hit),
            contact=point.contact,
            listeners=point.listeners,
            hit=hit,
            sample_rate=sound.sample_rate,
            lead_in=self._plan.lead_in,
            peak=round(verdict.peak, 2),
            above_noise=round(verdict.above_noise, 2),
        )
        others = (present for present in self._manifest.entries if present.file != entry.file)
        self._manifest = replace(
            self._manifest,
            entries=(*others, entry),
            symmetry=self._plan.symmetry,
            centre=self._plan.centre,
            coordinates=self._plan.coordinates,
        )
        write_bytes(self.path, self._manifest.text().encode("utf-8"))

    def sounds(self, point: Point) -> list[Sound]:
        """Return the takes of a point."""
        paths = [self.path.with_name(point.file(hit)) for hit in range(1, point.hits + 1)]
        recordings = [wav.decode(read_bytes(path), str(path)) for path in paths]
        return [
            Sound(samples=recording.samples, sample_rate=recording.sample_rate)
            for recording in recordings
        ]

    def _require_rate(self, rate: int) -> None:
        rates = {entry.sample_rate for entry in self._manifest.entries} - {None, rate}
        if rates:
            raise RecordingError(
                f"{self.path} has takes of {rates.pop()} Hz, and now {rate} Hz are recorded: give "
                "that sample_rate in the plan, or record into another folder"
            )


def estimate_gains(takes: Sequence[Sequence[Sound]], lead_in: float) -> Complex:
    """Return the strength of spectral lines at each contact (P, M), to choose the best by.

    Root mean squares over hits at the local maxima of the spectrum of all contacts' first channels,
    heard by one listener after `lead_in` seconds; phases are unknown and 0, as `SurveyPlan.after`
    needs powers alone. RecordingError when nothing rings.
    """
    rates = {sound.sample_rate for hits in takes for sound in hits}
    if len(rates) != 1:
        raise RecordingError(f"takes have rates of {sorted(rates)} Hz: record all at one rate")
    first = round(lead_in * rates.pop())
    min_length = min(sound.samples.shape[1] for hits in takes for sound in hits) - first
    powers = np.array([_mean_power(hits, first, min_length) for hits in takes])
    lines = _maxima(powers.max(axis=0))
    if not len(lines):
        raise RecordingError("no line stands out of the spectra of the takes: strike harder")
    return np.sqrt(powers[:, lines]).astype(np.complex128)


def _mean_power(hits: Sequence[Sound], first: int, length: int) -> Array:
    """Return the power spectrum after the hit, mean over hits."""
    count = max(2, min(length, round(_MAX_SECONDS * hits[0].sample_rate)))
    window = np.hanning(count)
    excerpts = [sound.samples[0, first : first + count].astype(np.float64) for sound in hits]
    return np.mean(
        [np.square(np.abs(np.fft.rfft(window * excerpt))) for excerpt in excerpts], axis=0
    )


def _maxima(power: Array) -> NDArray[np.int64]:
    """Return the strongest local maxima over two bins to each side: a window's main lobe."""
    padded_power = np.pad(power, 2, constant_values=np.inf)
    neighbourhoods = np.lib.stride_tricks.sliding_window_view(padded_power, 5)
    is_deep = power > power[2:-2].max(initial=0.0) * 10 ** (-_MAX_DEPTH / 10)
    lines = np.flatnonzero((power >= neighbourhoods.max(axis=1)) & is_deep & (power > 0))
    return lines[np.argsort(-power[lines], kind="stable")][:_MAX_LINES]
