"""Plans of a measurement: which places are struck, heard from where, how, and how often."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from struck.errors import FileFormatError, OptionError, RecordingError, require_choice, rounded
from struck.files.atomic import real
from struck.model import arrays
from struck.model.arrays import Array, Complex, Index, brief, checked
from struck.model.survey import SYMMETRIES
from struck.recordings.acceptance import Bounds
from struck.recordings.manifest import (
    LONGEST,
    MOST_HITS,
    RATES,
    Place,
    TomlTable,
    numbers,
    require_named,
    toml_listeners,
)

PAIRS = ("all", "P+Q")
PROMPTS = ("take", "contact", "never")
MOST_TAKES = 100_000
MOST_CHANNELS = 64
SHORTEST = 0.05  # s, of lead-in and sound: a spectrum of the noise needs as much
SILENT = -20.0  # dB under a mode's loudest contact from which a contact counts as silent
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,79}")
# Words in braces of a program's arguments.
PLACES = ("name", "hit", "contact", "listener", "u", "v", "x", "y", "z")
_BRACED = re.compile(r"\{(\w*)\}")
_MAX_ERROR_BYTES = 300  # bytes of a program's standard error


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """Programs, with their arguments, that are run during a capture; empty for none."""

    move: tuple[str, ...] = ()  # before the takes of each point, which wait for its end
    strike: tuple[str, ...] = ()  # in each take when the lead-in is over
    timeout: float = 60.0  # after which a program is ended, s
    folder: Path = Path()  # where they run

    def run(self, which: str, facts: Mapping[str, str]) -> None:
        """Run "move" or "strike", if there is such a program, and wait for its end.

        The facts of `PLACES` replace ``{name}`` in its arguments, and are variables
        ``STRUCK_NAME``. RecordingError when it cannot be started, fails or takes too long.
        """
        command = self.move if which == "move" else self.strike
        if not command:
            return
        arguments = [
            _BRACED.sub(lambda braced: facts.get(braced[1], ""), argument) for argument in command
        ]
        variables = {f"STRUCK_{name.upper()}": value for name, value in facts.items()}
        with tempfile.TemporaryFile() as stderr:
            trouble = self._outcome(arguments, {**os.environ, **variables}, stderr)
            if trouble:
                raise RecordingError(
                    f"the program of hooks.{which}, {' '.join(arguments)}, {trouble}{_tail(stderr)}"
                    "; finished takes are saved: mend it and start again to record the rest"
                )

    def _outcome(self, arguments: list[str], environment: dict[str, str], stderr: IO[bytes]) -> str:
        """Run a program; return its failure as text, "" for none."""
        program = arguments[0]
        if Path(program).name != program:  # one with folders is as seen from the plan
            program = str(self.folder / program)
        try:
            process = subprocess.Popen(  # noqa: S603 - what the plan says, without a shell
                [program, *arguments[1:]],
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                start_new_session=True,
            )
        except OSError as error:
            return f"cannot be started: {error.strerror or error}"
        try:
            code = process.wait(self.timeout)
        except subprocess.TimeoutExpired:
            return f"did not end within {rounded(self.timeout)} s (hooks.timeout)"
        finally:
            _end(process)
        return f"ended with exit code {code}" if code else ""


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


def _tail(stderr: IO[bytes]) -> str:
    """Return the last words of a program's standard error."""
    stderr.seek(0, os.SEEK_END)
    stderr.seek(max(0, stderr.tell() - _MAX_ERROR_BYTES))
    text = " ".join(stderr.read().decode(errors="replace").split())
    return f": {text}" if text else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyPlan:
    """P + Q recordings in place of P Q, since the gains of a mode (P, Q) have rank one.

    First the pivot listener hears all contacts. That shows which contact drives all modes: the
    pivot contact, which all other listeners hear then. One pair more, of another contact and
    another listener, checks that contact and listener do separate.

    Parameters
    ----------
    contacts : array (P, D)
        Contact coordinates, as in `Survey`.
    listeners : array (Q, 3)
        Positions in body coordinates, m.
    listener : int
        Number of the pivot listener.
    contact : int or None, default None
        Number of the pivot contact; None until `after` chooses it.
    check : int or None, default None
        Number of the contact that checks the separation; None until `after` chooses it.
    silent : array of int, optional
        Modes that the pivot contact hardly drives, which the plan will not measure. Default: none.
    """

    __repr__ = brief
    contacts: Array
    listeners: Array
    listener: int
    contact: int | None = None
    check: int | None = None
    silent: Index = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    @checked
    def of(
        cls,
        contacts: Array,
        listeners: Array,
        *,
        centre: Array | None = None,
        symmetry: str = "none",
        listener: int | None = None,
    ) -> SurveyPlan:
        """Plan the recordings of P contacts and Q listeners.

        Parameters
        ----------
        contacts : array (P, D)
            Contact coordinates.
        listeners : array (Q, 3)
            Positions in body coordinates, m.
        centre : array (3,), optional
            Acoustic centre, m. Default: the origin.
        symmetry : {"none", "axial"}, default "none"
            Symmetry, as in `Survey`.
        listener : int, optional
            Number of the pivot listener. Default: one that no mode avoids by symmetry. With axial
            symmetry that is the nearest to the direction of the contacts, azimuth 0 in the plane z
            = 0, otherwise the farthest from the planes x = 0, y = 0 and z = 0.

        Returns
        -------
        SurveyPlan
            The plan.

        Raises
        ------
        OptionError
            If there is no such listener.
        """
        places = arrays.numbers("listeners", listeners, width=3)
        places = places - (np.zeros(3) if centre is None else centre)
        pivot = _generic(places, symmetry) if listener is None else listener
        if not 0 <= pivot < len(listeners):
            raise OptionError(f"listener is {pivot}: there are 0 to {len(listeners) - 1}")
        return cls(contacts=contacts, listeners=listeners, listener=pivot)

    def after(self, gains: Complex) -> SurveyPlan:
        """Choose the pivot contact from the gains of the first recordings.

        It is the one at which modes are strongest over all, compared to where each is loudest: with
        the least mean of the noise that dividing by their drives there would bring.

        Parameters
        ----------
        gains : array (P, M), complex
            Gains of all contacts at the pivot listener.

        Returns
        -------
        SurveyPlan
            The plan with its pivot contact.
        """
        powers = np.square(np.abs(gains))
        relative_powers = powers / np.maximum(powers.max(axis=0), np.finfo(np.float64).tiny)
        silent = 10 ** (SILENT / 10)
        order = np.argsort(
            (1 / np.maximum(relative_powers, silent / 4)).mean(axis=1), kind="stable"
        )
        return replace(
            self,
            contact=int(order[0]),
            check=int(order[1]) if len(order) > 1 else None,
            silent=np.flatnonzero(relative_powers[order[0]] < silent),
        )

    @property
    def first(self) -> Index:
        """Contact and listener of the recordings to begin with (P, 2)."""
        numbers = np.arange(len(self.contacts))
        return np.stack([numbers, np.full_like(numbers, self.listener)], axis=1)

    @property
    def rest(self) -> Index:
        """Contact and listener of the takes that follow the choice of the pivot (at most Q, 2).

        Raises
        ------
        OptionError
            Before the pivot contact was chosen.
        """
        if self.contact is None:
            raise OptionError("the pivot contact is not chosen yet: record `first`, then `after`")
        others = np.delete(np.arange(len(self.listeners)), self.listener)
        row = np.stack([np.full_like(others, self.contact), others], axis=1)
        if self.check is None or not len(others):
            return row
        gaps = np.linalg.norm(self.listeners - self.listeners[self.listener], axis=1)
        return np.append(row, [[self.check, int(gaps.argmax())]], axis=0)

    @property
    def pairs(self) -> Index:
        """Contact and listener of all recordings (P + Q, 2)."""
        return np.concatenate([self.first, self.rest])


def _generic(places: Array, symmetry: str) -> int:
    """Return the number of the listener least likely to be where some mode is silent."""
    distances = np.linalg.norm(places, axis=1)
    directions = places / np.where(distances > 0, distances, np.inf)[:, None]
    if symmetry == "axial":
        return int(directions[:, 0].argmax())
    return int(np.abs(directions).min(axis=1).argmax())


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
    """A contact and its listeners, heard in some hits."""

    name: str  # with which the names of its files begin
    contact: Place  # u, or u and v; empty where the plan has none
    listeners: tuple[Place, ...]  # (x, y, z) of each channel, m; or empty
    hits: int

    def file(self, hit: int) -> str:
        """Return the name of the recording of a hit, from 1 on."""
        return f"{self.name}_{hit}.wav"

    def facts(self, hit: int) -> dict[str, str]:
        """Return the point's `PLACES` for programs, as text; x, y, z are of the first channel."""
        axes = [*zip("uv", self.contact, strict=False)]
        if self.listeners:
            axes += zip("xyz", self.listeners[0], strict=True)
        return {
            "name": self.name,
            "hit": str(hit),
            "contact": ",".join(map(repr, self.contact)),
            "listener": ";".join(",".join(map(repr, place)) for place in self.listeners),
            **{axis: repr(value) for axis, value in axes},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class CapturePlan:
    """Plan of a measurement: contacts, listeners and number of hits.

    Parameters
    ----------
    seconds : float
        Duration of the sound after each hit, s.
    lead_in : float, default 0.5
        Duration of the ambient sound before it, s, from which the noise is estimated.
    patience : float, default 3.0
        Maximum time from the cue to the hit, s.
    sample_rate : int or None, default None
        Sample rate, Hz. None: that of the device.
    channels : int, default 1
        Number of positions of each listener.
    device : int, str or None, default None
        Number of the device, or a part of its name. None: the default device.
    tries : int, default 5
        Maximum number of tries of a take.
    prompt : {"take", "contact", "never"}, default "take"
        When to wait for a person: at each take, when the contact changes, or never.
    bounds : Bounds, optional
        Levels at which a take is accepted.
    contacts : tuple of PlannedContact, optional
        Contacts that are combined with all listeners.
    listeners : tuple of PlannedListener, optional
        Listeners; none if their positions do not matter.
    listed : tuple of Point, default ()
        Single points instead of contacts and listeners.
    pairs : {"all", "P+Q"}, default "all"
        "all": all contacts with all listeners. "P+Q": all contacts with one listener, then the best
        contact with all other listeners (see `SurveyPlan`).
    hits : int, default 1
        Number of hits of each point.
    pivot : int or None, default None
        Number of the listener of all contacts, for "P+Q". None: chosen by `SurveyPlan`.
    symmetry : str, default "none"
        Symmetry, as in `Manifest`.
    centre : tuple of three floats, default (0, 0, 0)
        Acoustic centre, m, as in `Manifest`.
    coordinates : tuple of str, optional
        Names and units of the coordinates, as in `Manifest`.
    hooks : Hooks, optional
        Programs that move or strike.

    Raises
    ------
    OptionError
        If there is nothing to record, or names, positions and channels do not fit each other.
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
        """Number of takes of the whole plan."""
        if self.listed:
            return sum(point.hits for point in self.listed)
        contact_count, listener_count = len(self.contacts), max(1, len(self.listeners))
        if self.pairs == "all":
            return contact_count * listener_count * self.hits
        return (
            contact_count + listener_count - 1 + (contact_count > 1 and listener_count > 1)
        ) * self.hits

    def every(self) -> Iterator[Point]:
        """Yield listed points, then all contacts with all listeners, contact by contact.

        Returns
        -------
        iterator of Point
            The points.
        """
        yield from self.listed
        for contact in self.contacts:
            if self.listeners:
                yield from (self.point(contact, listener) for listener in self.listeners)
            else:
                yield self.point(contact, None)

    def point(self, contact: PlannedContact, listener: PlannedListener | None) -> Point:
        """Return the point of a contact and a listener.

        Parameters
        ----------
        contact : PlannedContact
            The contact.
        listener : PlannedListener or None
            The listener, or None.

        Returns
        -------
        Point
            The point, with its name and number of hits.
        """
        return Point(
            name=contact.name if listener is None else f"{contact.name}_{listener.name}",
            contact=contact.at,
            listeners=() if listener is None else listener.at,
            hits=self.hits,
        )

    def planning(self) -> SurveyPlan:
        """Return the plan of P + Q recordings.

        The position of a listener is that of its first channel.

        Returns
        -------
        SurveyPlan
            The plan.
        """
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
            f"lead_in, patience and seconds are {rounded(length)} s together: at most {LONGEST:g} "
            "s are recorded at once"
        )


def _require_names(plan: CapturePlan) -> None:
    for groups in (plan.contacts, plan.listeners, plan.listed):
        names = [item.name for item in groups]
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
    _require_distinct([(point.contact, point.listeners) for point in plan.listed], "the point")
    contact_places = [contact.at for contact in plan.contacts] + [
        point.contact for point in plan.listed
    ]
    if len(set(map(len, contact_places))) > 1:
        raise OptionError(
            "some contacts have one coordinate and some two, or none: give all as many"
        )
    require_named(plan.coordinates, contact_places[0])
    listener_places = [listener.at for listener in plan.listeners] + [
        p.listeners for p in plan.listed
    ]
    if plan.listed and 0 < sum(map(bool, listener_places)) < len(listener_places):
        raise OptionError("some points have a listener and some have none: give all one, or none")
    for places in filter(None, listener_places):
        if len(places) != plan.channels:
            raise OptionError(
                f"a listener has {len(places)} microphones, and channels is {plan.channels}: give "
                "a place for each channel"
            )


def _require_distinct(values: Iterable[object], label: str) -> None:
    earlier_values: set[object] = set()
    for value in values:
        if value in earlier_values:
            raise OptionError(f"{label} {value!r} occurs twice: give more hits instead")
        earlier_values.add(value)


@checked
def read_plan(path: str | os.PathLike[str]) -> CapturePlan:
    """Read a capture plan from a TOML file.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    CapturePlan
        The plan.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or a key is unknown, missing or out of range.
    """
    source = Path(path)
    table = TomlTable.read(source)
    try:
        plan = _plan(table, real(source).parent)
    except OptionError as error:
        table.require_known()  # a misspelt key leaves out what is missing
        raise FileFormatError(f"{source}: {error}") from error
    table.require_known()
    return plan


def _plan(table: TomlTable, folder: Path) -> CapturePlan:
    hooks = read_hooks(table.table("hooks"), folder)
    numbered_entries = enumerate(table.list("listeners"), 1)
    listeners = tuple(_listener(table, number, entry) for number, entry in numbered_entries)
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
        listed=tuple(_point(entry, n, hits) for n, entry in enumerate(table.tables("points"), 1)),
        pairs=table.choice("pairs", PAIRS, "all"),
        hits=hits,
        pivot=_pivot(table, listeners),
        symmetry=table.choice("symmetry", SYMMETRIES, "none"),
        centre=table.numbers("centre", 3) or (0.0, 0.0, 0.0),
        coordinates=table.texts("coordinates"),
        hooks=hooks,
    )


def _device(table: TomlTable) -> int | str | None:
    value = table.value("device")
    if isinstance(value, bool) or not isinstance(value, int | str | None):
        raise table.error(f"device is {value!r}: give its number, or part of its name")
    return value


def _bounds(table: TomlTable) -> Bounds:
    defaults = Bounds()
    bounds = Bounds(
        quietest=table.number("quietest", -120, 0, defaults.quietest),
        loudest=table.number("loudest", -60, 0, defaults.loudest),
        above_noise=table.number("above_noise", 0, 120, defaults.above_noise),
    )
    table.require_known()
    return bounds


def _contacts(table: TomlTable) -> tuple[PlannedContact, ...]:
    """Return the contacts: lists of coordinates, or tables of `name` and `at`."""
    contacts = []
    for number, entry in enumerate(table.list("contacts"), 1):
        default_name = f"contact{number}"
        if isinstance(entry, dict):
            subtable = TomlTable(entry, f"{table.name}, [[contacts]] {number}")
            at = subtable.numbers("at", 1, 2) or numbers(None, subtable, "at", 1, 2)
            contacts.append(PlannedContact(name=subtable.text("name", default_name), at=at))
            subtable.require_known()
        else:
            at = numbers(entry, table, "one of contacts", 1, 2)
            contacts.append(PlannedContact(name=default_name, at=at))
    return tuple(contacts)


def _listener(table: TomlTable, number: int, entry: Any) -> PlannedListener:  # noqa: ANN401 - of TOML
    default_name = f"listener{number}"
    if not isinstance(entry, dict):
        return PlannedListener(
            name=default_name, at=(numbers(entry, table, "one of listeners", 3),)
        )
    subtable = TomlTable(entry, f"{table.name}, [[listeners]] {number}")
    places = toml_listeners(subtable, "at", "microphones")
    if not places:
        raise subtable.error("it has no place: give at = [x, y, z], m")
    listener = PlannedListener(name=subtable.text("name", default_name), at=places)
    subtable.require_known()
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
    if name:
        require_choice("pivot", name, names or ("no listeners",), table.error)
    return names.index(name) if name else None


def read_hooks(table: TomlTable, folder: Path) -> Hooks:
    """Return the programs of a table, to be run in a folder."""
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
                    f"{', '.join(f'{{{place}}}' for place in PLACES)}"
                )
    return hooks
