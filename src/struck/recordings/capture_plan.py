"""Plans of a measurement: which places are struck, heard from where, how, and how often."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from struck.errors import FileFormatError, OptionError, RecordingError
from struck.model.survey import SYMMETRIES
from struck.recordings.acceptance import Bounds
from struck.recordings.manifest import (
    LONGEST,
    MOST_HITS,
    RATES,
    Place,
    TomlTable,
    numbers,
    read_toml,
    toml_listeners,
)
from struck.recordings.survey_plan import SurveyPlan

# Programs that a measurement runs: one that moves a positioner, one that fires a solenoid.

PLACES = ("name", "hit", "contact", "listener", "u", "v", "x", "y", "z")
"""What an argument may hold in braces."""
_BRACED = re.compile(r"\{(\w*)\}")
_SHOWN = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """Programs with their arguments, none where nothing is to be run.

    Parameters
    ----------
    move : tuple of str
        Run before the takes of each point, which wait for its end.
    strike : tuple of str
        Run in each take when the lead-in is over.
    timeout : float
        After which a program is ended, s.
    folder : Path
        Where they run.
    """

    move: tuple[str, ...] = ()
    strike: tuple[str, ...] = ()
    timeout: float = 60.0
    folder: Path = Path()

    def run(self, which: str, facts: Mapping[str, str]) -> None:
        """Run "move" or "strike", if there is such a program, and wait for its end.

        Parameters
        ----------
        which : str
        facts : mapping
            What `PLACES` are now: put into arguments for ``{name}``, and given as variables
            ``STRUCK_NAME``.

        Raises
        ------
        RecordingError
            When it cannot be started, fails or takes too long.
        """
        command = self.move if which == "move" else self.strike
        if not command:
            return
        arguments = [_BRACED.sub(lambda braced: facts.get(braced[1], ""), each) for each in command]
        variables = {f"STRUCK_{name.upper()}": value for name, value in facts.items()}
        with tempfile.TemporaryFile() as said:
            trouble = self._outcome(arguments, {**os.environ, **variables}, said)
            if trouble:
                raise RecordingError(
                    f"the program of hooks.{which}, {' '.join(arguments)}, {trouble}{_tail(said)}; "
                    "what is recorded stays: mend it and start again to go on from here"
                )

    def _outcome(self, arguments: list[str], environment: dict[str, str], said: IO[bytes]) -> str:
        """Run a program; return what went wrong."""
        program = self._located(arguments[0])
        try:
            process = subprocess.Popen(  # noqa: S603 - what the plan says, without a shell
                [program, *arguments[1:]],
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,
            )
        except OSError as error:
            return f"cannot be started: {error.strerror or error}"
        try:
            code = process.wait(self.timeout)
        except subprocess.TimeoutExpired:
            return f"did not end within {self.timeout:g} s (hooks.timeout)"
        finally:
            _end(process)
        return f"ended with exit code {code}" if code else ""

    def _located(self, program: str) -> str:
        """Return a program given with folders as seen from the plan, another as it is."""
        return program if Path(program).name == program else str(self.folder / program)


def read_hooks(table: TomlTable, folder: Path) -> Hooks:
    """Return the programs that a table tells, to be run in a folder.

    Raises
    ------
    FileFormatError
        When arguments hold unknown words in braces, or the table what is unknown.
    """
    hooks = Hooks(
        move=table.texts("move"),
        strike=table.texts("strike"),
        timeout=table.number("timeout", 0.01, 86_400, 60.0),
        folder=folder,
    )
    table.require_known()
    for argument in (*hooks.move, *hooks.strike):
        for name in _BRACED.findall(argument):
            if name not in PLACES:
                raise FileFormatError(
                    f"{table.name}: {{{name}}} is not known: give one of "
                    f"{', '.join(f'{{{each}}}' for each in PLACES)}"
                )
    return hooks


def facts_of(
    name: str, hit: int, contact: Sequence[float], listeners: Sequence[Sequence[float]]
) -> dict[str, str]:
    """Return what programs are told: numbers as text; x, y, z of the first channel's listener."""
    axes = [*zip("uv", contact, strict=False)]
    if listeners:
        axes += zip("xyz", listeners[0], strict=True)
    return {
        "name": name,
        "hit": str(hit),
        "contact": ",".join(map(repr, contact)),
        "listener": ";".join(",".join(map(repr, place)) for place in listeners),
        **{axis: repr(value) for axis, value in axes},
    }


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a program that still runs, and all that it started."""
    if process.poll() is not None:
        return
    if os.name == "nt":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _tail(said: IO[bytes]) -> str:
    """Return the last of what a program wrote to its standard error."""
    said.seek(0, os.SEEK_END)
    said.seek(max(0, said.tell() - _SHOWN))
    text = " ".join(said.read().decode(errors="replace").split())
    return f": {text}" if text else ""


PAIRS = ("all", "P+Q")
PROMPTS = ("take", "contact", "never")
MOST_TAKES = 100_000
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,79}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedContact:
    """Coordinates u, or u and v, with a name."""

    name: str
    at: Place


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedListener:
    """A place (x, y, z), m, for each channel, with a name."""

    name: str
    at: tuple[Place, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """What is struck and heard from where, so many times.

    Parameters
    ----------
    name : str
        What the names of its files begin with.
    contact : tuple of numbers
        u, or u and v; empty where the plan tells none.
    listeners : tuple of (x, y, z)
        Of each channel, m; empty where the plan tells none.
    hits : int
    """

    name: str
    contact: Place
    listeners: tuple[Place, ...]
    hits: int

    def file(self, hit: int) -> str:
        """Return the name of the recording of a hit, from 1 on."""
        return f"{self.name}_{hit}.wav"


@dataclass(frozen=True, slots=True, kw_only=True)
class CapturePlan:
    """A measurement.

    Parameters
    ----------
    seconds : float
        Of sound kept after each hit.
    lead_in : float
        Of ambient sound kept before it, s: it tells what is noise.
    patience : float
        How long after its cue a hit may come, s.
    sample_rate : int or None
        Hz; None: the device's own.
    channels : int
        As many as each listener has places.
    device : int or str or None
        Number or part of the name; None: the default one.
    tries : int
        How often a take is tried before the measurement stops.
    prompt : str
        When a person is waited for: at each "take", when the "contact" changes, or "never".
    bounds : Bounds
        Which levels are taken.
    contacts, listeners : tuple
        What is combined; no listeners where their places do not matter.
    listed : tuple of Point
        Single points instead.
    pairs : str
        "all" contacts with all listeners; or "P+Q": one listener hears all contacts, then the best
        contact is heard by all other listeners (see `Plan`).
    hits : int
        Of each point.
    pivot : int or None
        Number of the listener that hears all contacts, with "P+Q"; None: chosen by `Plan`.
    symmetry, centre, coordinates
        As in `Manifest`.
    hooks : Hooks
        Programs that move or strike.

    Raises
    ------
    OptionError
        When there is nothing to record, or names, places and channels do not fit each other.
    """

    seconds: float
    lead_in: float = 0.5
    patience: float = 3.0
    sample_rate: int | None = None
    channels: int = 1
    device: int | str | None = None
    tries: int = 5
    prompt: str = "take"
    bounds: Bounds = field(default_factory=Bounds)
    contacts: tuple[PlannedContact, ...] = ()
    listeners: tuple[PlannedListener, ...] = ()
    listed: tuple[Point, ...] = ()
    pairs: str = "all"
    hits: int = 1
    pivot: int | None = None
    symmetry: str = "none"
    centre: Place = (0.0, 0.0, 0.0)
    coordinates: tuple[str, ...] = ()
    hooks: Hooks = field(default_factory=Hooks)

    def __post_init__(self) -> None:
        _require_something(self)
        _require_names(self)
        _require_places(self)

    @property
    def count(self) -> int:
        """How many takes there are in all."""
        if self.listed:
            return sum(point.hits for point in self.listed)
        struck, heard = len(self.contacts), max(1, len(self.listeners))
        if self.pairs == "all":
            return struck * heard * self.hits
        return (struck + heard - 1 + (struck > 1 and heard > 1)) * self.hits

    def every(self) -> Iterator[Point]:
        """Yield listed points, or all contacts with all listeners, contact after contact."""
        yield from self.listed
        for contact in self.contacts:
            if self.listeners:
                yield from (self.point(contact, listener) for listener in self.listeners)
            else:
                yield self.point(contact, None)

    def point(self, contact: PlannedContact, listener: PlannedListener | None) -> Point:
        """Return the point of a contact and a listener."""
        return Point(
            name=contact.name if listener is None else f"{contact.name}_{listener.name}",
            contact=contact.at,
            listeners=() if listener is None else listener.at,
            hits=self.hits,
        )

    def planning(self) -> SurveyPlan:
        """Return which P + Q recordings to make; a listener stands where its first channel is."""
        return SurveyPlan.of(
            np.array([contact.at for contact in self.contacts]),
            np.array([listener.at[0] for listener in self.listeners]),
            centre=np.array(self.centre),
            symmetry=self.symmetry,
            listener=self.pivot,
        )


def _require_something(plan: CapturePlan) -> None:
    if bool(plan.contacts) == bool(plan.listed):
        raise OptionError("give either contacts (and listeners), or [[points]]: one of them")
    if plan.listed and (plan.listeners or plan.pairs != "all"):
        raise OptionError("[[points]] name their own listeners: take listeners and pairs out")
    if plan.pairs == "P+Q" and not plan.listeners:
        raise OptionError("pairs is 'P+Q' and there are no listeners: give them, or pairs = 'all'")
    if not 0 < plan.count <= MOST_TAKES:
        raise OptionError(f"{plan.count} takes are planned: give 1 to {MOST_TAKES:,}")
    length = plan.lead_in + plan.patience + plan.seconds
    if length > LONGEST:
        raise OptionError(
            f"lead_in, patience and seconds are {length:g} s together: at most {LONGEST:g} s are "
            "recorded at once"
        )


def _require_names(plan: CapturePlan) -> None:
    for named in (plan.contacts, plan.listeners, plan.listed):
        names = [each.name for each in named]
        for name in names:
            if not _NAME.fullmatch(name):
                raise OptionError(
                    f"the name {name!r} cannot be part of a file's name: use letters without "
                    "accents, digits, dots and hyphens, at most 80"
                )
        _require_distinct([name.casefold() for name in names], "the name")


def _require_places(plan: CapturePlan) -> None:
    _require_distinct([contact.at for contact in plan.contacts], "the contact")
    _require_distinct([listener.at for listener in plan.listeners], "the listener")
    _require_distinct([(each.contact, each.listeners) for each in plan.listed], "the point")
    if len({len(each.at) for each in plan.contacts} | {len(p.contact) for p in plan.listed}) > 1:
        raise OptionError("some contacts have one coordinate and some two, or none: give all alike")
    heard = [listener.at for listener in plan.listeners] + [p.listeners for p in plan.listed]
    if plan.listed and 0 < sum(map(bool, heard)) < len(heard):
        raise OptionError("some points have a listener and some have none: give all alike")
    for places in filter(None, heard):
        if len(places) != plan.channels:
            raise OptionError(
                f"a listener has {len(places)} microphones, and channels is {plan.channels}: give "
                "a place for each channel"
            )


def _require_distinct(values: Iterable[object], what: str) -> None:
    known: set[object] = set()
    for value in values:
        if value in known:
            raise OptionError(f"{what} {value!r} occurs twice: give more hits instead")
        known.add(value)


# Plans of a measurement as TOML files.

SHORTEST = 0.05
"""Lead-in and sound, s: what a spectrum of the noise needs."""
MOST_CHANNELS = 64


def read_plan(path: str | os.PathLike[str]) -> CapturePlan:
    """Read a plan.

    Raises
    ------
    FileFormatError
        When it cannot be read, or asks for what is unknown, missing or out of bounds.
    """
    given = Path(path)
    table = read_toml(given)
    try:
        plan = _plan(table, given.resolve().parent)
    except OptionError as error:
        raise FileFormatError(f"{given}: {error}") from error
    table.require_known()
    return plan


def _plan(table: TomlTable, folder: Path) -> CapturePlan:
    hooks = read_hooks(table.table("hooks"), folder)
    listeners = _listeners(table)
    hits = table.count("hits", 1, MOST_HITS, default=1)
    return CapturePlan(
        seconds=table.number("seconds", SHORTEST, LONGEST),
        lead_in=table.number("lead_in", SHORTEST, 60, 0.5),
        patience=table.number("patience", 0, 60, 1.0 if hooks.strike else 3.0),
        sample_rate=table.count("sample_rate", *RATES, default=0) or None,
        channels=table.count("channels", 1, MOST_CHANNELS, default=1),
        device=_device(table),
        tries=table.count("tries", 1, 1000, default=5),
        prompt=table.choice("prompt", PROMPTS, "never" if hooks.strike else "take"),
        bounds=_bounds(table.table("levels")),
        contacts=_contacts(table),
        listeners=listeners,
        listed=tuple(_point(each, n, hits) for n, each in enumerate(table.tables("points"), 1)),
        pairs=table.choice("pairs", PAIRS, "all"),
        hits=hits,
        pivot=_pivot(table, listeners),
        symmetry=table.choice("symmetry", SYMMETRIES, "none"),
        centre=table.numbers("centre", 3) or (0.0, 0.0, 0.0),
        coordinates=table.texts("coordinates"),
        hooks=hooks,
    )


def _device(table: TomlTable) -> int | str | None:
    given = table.value("device")
    if isinstance(given, bool) or not isinstance(given, int | str | None):
        raise table.error(f"device is {given!r}: give its number, or part of its name")
    return given


def _bounds(table: TomlTable) -> Bounds:
    usual = Bounds()
    bounds = Bounds(
        quietest=table.number("quietest", -120, 0, usual.quietest),
        loudest=table.number("loudest", -60, 0, usual.loudest),
        above_noise=table.number("above_noise", 0, 120, usual.above_noise),
    )
    table.require_known()
    return bounds


def _contacts(table: TomlTable) -> tuple[PlannedContact, ...]:
    """Return the contacts: lists of coordinates, or tables of `name` and `at`."""
    found = []
    for number, given in enumerate(table.list("contacts"), 1):
        usual = f"contact{number}"
        if isinstance(given, dict):
            each = TomlTable(given, f"{table.name}, [[contacts]] {number}")
            at = each.numbers("at", 1, 2) or numbers(None, each, "at", 1, 2)
            found.append(PlannedContact(name=each.text("name", usual), at=at))
            each.require_known()
        else:
            found.append(
                PlannedContact(name=usual, at=numbers(given, table, "one of contacts", 1, 2))
            )
    return tuple(found)


def _listeners(table: TomlTable) -> tuple[PlannedListener, ...]:
    """Return the listeners: lists of x, y, z, or tables."""
    given = enumerate(table.list("listeners"), 1)
    return tuple(_listener(table, number, each) for number, each in given)


def _listener(table: TomlTable, number: int, given: Any) -> PlannedListener:  # noqa: ANN401 - of TOML
    usual = f"listener{number}"
    if not isinstance(given, dict):
        return PlannedListener(name=usual, at=(numbers(given, table, "one of listeners", 3),))
    each = TomlTable(given, f"{table.name}, [[listeners]] {number}")
    places = toml_listeners(each, "at", "microphones")
    if not places:
        raise each.error("it has no place: give at = [x, y, z], m")
    listener = PlannedListener(name=each.text("name", usual), at=places)
    each.require_known()
    return listener


def _point(table: TomlTable, number: int, hits: int) -> Point:
    point = Point(
        name=table.text("name", f"point{number}"),
        contact=table.numbers("contact", 1, 2),
        listeners=toml_listeners(table),
        hits=table.count("hits", 1, MOST_HITS, default=hits),
    )
    table.require_known()
    return point


def _pivot(table: TomlTable, listeners: tuple[PlannedListener, ...]) -> int | None:
    """Return the number of the listener that is called as `pivot` says."""
    name = table.text("pivot", "")
    names = [listener.name for listener in listeners]
    if name and name not in names:
        raise table.error(f"pivot is {name!r}: give one of {', '.join(names) or 'no listeners'}")
    return names.index(name) if name else None
