"""A measurement: each planned point is prompted, struck, recorded, judged and kept, or repeated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from struck.errors import RecordingError
from struck.files.sound import Sound
from struck.progress import Progress, silent
from struck.recordings.acceptance import MARGIN, Verdict, examined
from struck.recordings.capture.hooks import facts_of
from struck.recordings.capture.pivot import rough_gains
from struck.recordings.capture.take_log import TakeLog
from struck.recordings.capture_plan import CapturePlan, Point


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """One attempt, from 1 on, at one hit, from 1 on, of a point."""

    point: Point
    hit: int
    attempt: int

    @property
    def file(self) -> str:
        """Name of its recording."""
        return self.point.file(self.hit)

    @property
    def facts(self) -> dict[str, str]:
        """What programs are told of it."""
        return facts_of(self.point.name, self.hit, self.point.contact, self.point.listeners)

    def __str__(self) -> str:
        told = self.facts
        places = [f"{what} {told[what]}" for what in ("contact", "listener") if told[what]]
        again = f", attempt {self.attempt}" if self.attempt > 1 else ""
        return f"{self.point.name}, hit {self.hit} of {self.point.hits}{again}: {'; '.join(places)}"


class Recorder(Protocol):
    """What records."""

    def record(self, take: Take, seconds: float, lead_in: float, cue: Callable[[], None]) -> Sound:
        """Record so many seconds; call `cue` once `lead_in` seconds of them are recorded.

        What spoilt the recording stands in the notes of the sound: then it is refused.
        """
        ...


class Operator(Protocol):
    """Who strikes, or looks on."""

    def ready(self, text: str) -> None:
        """Tell what comes, and return when it may begin."""

    def tell(self, text: str) -> None:
        """Tell what happens."""


class Nobody:
    """Nobody looks on, and nobody is waited for."""

    def ready(self, text: str) -> None:
        """Return at once."""

    def tell(self, text: str) -> None:
        """Tell nobody."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A take that was refused, and why."""

    file: str
    attempt: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a measurement did.

    Parameters
    ----------
    manifest : Path
        What `read_manifest` reads.
    recorded, kept : int
        Takes of this run, and of earlier ones.
    refusals : tuple of Refusal
    """

    manifest: Path
    recorded: int
    kept: int
    refusals: tuple[Refusal, ...]


def capture(
    plan: CapturePlan,
    folder: Path,
    recorder: Recorder,
    *,
    operator: Operator | None = None,
    progress: Progress = silent,
) -> Outcome:
    """Make the measurement that a plan describes, or what is missing of it.

    Parameters
    ----------
    plan : CapturePlan
    folder : Path
        Where takes and their manifest are or will be. A take is a WAV file of the lead-in, 10 ms
        and the sound from the hit on; it is written as a whole, then the manifest. What is there
        is not recorded again.
    recorder : Recorder
    operator : Operator, optional
        Nobody unless given.
    progress : callable

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
    session = _Session(plan, folder, recorder, operator or Nobody(), progress)
    for point in session.points():
        session.visit(point)
    progress("record", 1.0)
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
        self._recorded, self._kept, self._refusals = 0, 0, list[Refusal]()
        self._last: Point | None = None

    def points(self) -> Iterator[Point]:
        """Yield the points in order; with P+Q those that follow once the first are recorded."""
        plan = self._plan
        if plan.pairs == "all":
            yield from plan.every()
            return
        planning = plan.planning()
        first = [plan.point(plan.contacts[c], plan.listeners[q]) for c, q in planning.first]
        yield from first
        heard = [self._log.sounds(point) for point in first]
        chosen = planning.after(rough_gains(heard, plan.lead_in + MARGIN))
        yield from (plan.point(plan.contacts[c], plan.listeners[q]) for c, q in chosen.rest)

    def visit(self, point: Point) -> None:
        """Record the hits of a point that are missing."""
        missing = [hit for hit in range(1, point.hits + 1) if not self._log.has(point, hit)]
        self._kept += point.hits - len(missing)
        if not missing:
            return
        here = Take(point=point, hit=missing[0], attempt=1)
        self._tell_progress(point)
        self._plan.hooks.run("move", here.facts)
        for hit in missing:
            self._tell_progress(point)
            self._log.add(point, hit, self._taken(point, hit))
            self._recorded += 1

    def outcome(self) -> Outcome:
        """Return what was done."""
        return Outcome(
            manifest=self._log.path,
            recorded=self._recorded,
            kept=self._kept,
            refusals=tuple(self._refusals),
        )

    def _taken(self, point: Point, hit: int) -> Verdict:
        """Try until a take is taken."""
        reason = ""
        for attempt in range(1, self._plan.tries + 1):
            take = Take(point=point, hit=hit, attempt=attempt)
            verdict = self._tried(take)
            reason = verdict.reason
            if not reason:
                return verdict
            self._refusals.append(Refusal(file=take.file, attempt=attempt, reason=reason))
            self._operator.tell(f"{take.file} is refused: {reason}")
        raise RecordingError(
            f"{point.file(hit)} was refused {self._plan.tries} times (tries), the last time since "
            f"{reason}. What is recorded stays: start again to go on from here"
        )

    def _tried(self, take: Take) -> Verdict:
        plan = self._plan
        self._ask(take)
        before = plan.lead_in + MARGIN
        length = before + plan.patience + plan.seconds
        sound = self._recorder.record(take, length, before, lambda: self._cue(take))
        self._require_rate(sound)
        if sound.notes:
            return Verdict(reason="; ".join(sound.notes))
        return examined(
            sound,
            lead_in=plan.lead_in,
            seconds=plan.seconds,
            bounds=plan.bounds,
            channels=plan.channels,
        )

    def _ask(self, take: Take) -> None:
        last, self._last = self._last, take.point
        moved = last is None or last.contact != take.point.contact
        if self._plan.prompt == "take" or (self._plan.prompt == "contact" and moved):
            self._operator.ready(str(take))

    def _cue(self, take: Take) -> None:
        if self._plan.hooks.strike:
            self._plan.hooks.run("strike", take.facts)
        else:
            self._operator.tell("strike now")

    def _require_rate(self, sound: Sound) -> None:
        wanted = self._plan.sample_rate
        if wanted not in (None, sound.sample_rate):
            raise RecordingError(
                f"the device records at {sound.sample_rate} Hz and the plan says {wanted} Hz: "
                "change one of them"
            )

    def _tell_progress(self, point: Point) -> None:
        done = self._recorded + self._kept
        self._progress(f"record {point.name}", done / self._plan.count)
