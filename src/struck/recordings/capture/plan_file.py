"""Plans of a measurement as TOML files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from struck.errors import FileFormatError, OptionError
from struck.model.survey import SYMMETRIES
from struck.recordings.acceptance import Bounds
from struck.recordings.capture.hooks import read_hooks
from struck.recordings.capture_plan import PAIRS, PROMPTS, CapturePlan, Contact, Listener, Point
from struck.recordings.manifests.entries import LONGEST, MOST_HITS, RATES, toml_listeners
from struck.recordings.manifests.toml_table import TomlTable, numbers, read_toml

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


def _contacts(table: TomlTable) -> tuple[Contact, ...]:
    """Return the contacts: lists of coordinates, or tables of `name` and `at`."""
    found = []
    for number, given in enumerate(table.list("contacts"), 1):
        usual = f"contact{number}"
        if isinstance(given, dict):
            each = TomlTable(given, f"{table.name}, [[contacts]] {number}")
            at = each.numbers("at", 1, 2) or numbers(None, each, "at", 1, 2)
            found.append(Contact(name=each.text("name", usual), at=at))
            each.require_known()
        else:
            found.append(Contact(name=usual, at=numbers(given, table, "one of contacts", 1, 2)))
    return tuple(found)


def _listeners(table: TomlTable) -> tuple[Listener, ...]:
    """Return the listeners: lists of x, y, z, or tables."""
    given = enumerate(table.list("listeners"), 1)
    return tuple(_listener(table, number, each) for number, each in given)


def _listener(table: TomlTable, number: int, given: Any) -> Listener:  # noqa: ANN401 - of TOML
    usual = f"listener{number}"
    if not isinstance(given, dict):
        return Listener(name=usual, at=(numbers(given, table, "one of listeners", 3),))
    each = TomlTable(given, f"{table.name}, [[listeners]] {number}")
    places = toml_listeners(each, "at", "microphones")
    if not places:
        raise each.error("it has no place: give at = [x, y, z], m")
    listener = Listener(name=each.text("name", usual), at=places)
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


def _pivot(table: TomlTable, listeners: tuple[Listener, ...]) -> int | None:
    """Return the number of the listener that is called as `pivot` says."""
    name = table.text("pivot", "")
    names = [listener.name for listener in listeners]
    if name and name not in names:
        raise table.error(f"pivot is {name!r}: give one of {', '.join(names) or 'no listeners'}")
    return names.index(name) if name else None
