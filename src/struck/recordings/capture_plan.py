"""Plans of a measurement: which places are struck, heard from where, how, and how often."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from struck.errors import OptionError
from struck.recordings.acceptance import Bounds
from struck.recordings.capture.hooks import Hooks
from struck.recordings.manifests.entries import LONGEST, Place
from struck.recordings.survey_plan import Plan

PAIRS = ("all", "P+Q")
PROMPTS = ("take", "contact", "never")
MOST_TAKES = 100_000
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,79}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """Coordinates u, or u and v, with a name."""

    name: str
    at: Place


@dataclass(frozen=True, slots=True, kw_only=True)
class Listener:
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
    contacts: tuple[Contact, ...] = ()
    listeners: tuple[Listener, ...] = ()
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

    def point(self, contact: Contact, listener: Listener | None) -> Point:
        """Return the point of a contact and a listener."""
        return Point(
            name=contact.name if listener is None else f"{contact.name}_{listener.name}",
            contact=contact.at,
            listeners=() if listener is None else listener.at,
            hits=self.hits,
        )

    def planning(self) -> Plan:
        """Return which P + Q recordings to make; a listener stands where its first channel is."""
        return Plan.of(
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
