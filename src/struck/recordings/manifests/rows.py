"""The takes of a manifest in CSV: a row for each file, or for each channel of one."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from struck.errors import FileFormatError
from struck.recordings.manifests.entries import LONGEST, MOST_HITS, RATES, Entry, Place, cartesian

_CARTESIAN = ("x", "y", "z")
_SPHERICAL = ("distance", "azimuth", "polar")
_DEGREES = ("distance", "azimuth_degrees", "polar_degrees")
_SYSTEMS = (_CARTESIAN, _SPHERICAL, _DEGREES)
_WHOLE: dict[str, tuple[int, int]] = {
    "channel": (1, MOST_HITS),
    "hit": (1, MOST_HITS),
    "sample_rate": RATES,
}
_TEXTS = ("file", "note")
COLUMNS = (
    "file",
    *_WHOLE,
    "u",
    "v",
    *dict.fromkeys(_CARTESIAN + _SPHERICAL + _DEGREES),
    "lead_in",
    "peak",
    "above_noise",
    "note",
)
"""Names that may stand in the first line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """A line: `contact` and `listener` are empty where it tells none; `others` by column."""

    file: str
    note: str
    contact: Place
    listener: Place
    others: Mapping[str, float]

    @property
    def channel(self) -> int:
        return int(self.others.get("channel", 1))


def csv_entries(text: str, name: str) -> tuple[Entry, ...]:
    """Return the takes that the rows of a CSV file tell; those of one file are its channels.

    Raises
    ------
    FileFormatError
        On unknown columns, missing cells, or cells that are no numbers.
    """
    lines = _lines(text, name)
    if not lines:
        raise FileFormatError(f"{name} is empty: begin it with a line as file,u,x,y,z")
    header = lines[0][1]
    _require_columns(header, name)
    by_file: dict[str, list[_Row]] = {}
    for number, cells in lines[1:]:
        row = _row(header, cells, f"{name}, line {number}")
        by_file.setdefault(row.file, []).append(row)
    return tuple(_joined(rows, name) for rows in by_file.values())


def _lines(text: str, name: str) -> list[tuple[int, list[str]]]:
    """Return the number and the cells of each line that is not empty."""
    lines = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        return [(lines.line_num, [cell.strip() for cell in row]) for row in lines if any(row)]
    except csv.Error as error:
        raise FileFormatError(
            f"{name}, line {lines.line_num}: it is no CSV ({error}): save it with commas"
        ) from error


def _require_columns(header: Sequence[str], name: str) -> None:
    strange = [column for column in header if column not in COLUMNS]
    if strange:
        hint = "separate names by commas, and " if len(header) == 1 else ""
        raise FileFormatError(
            f"{name}: the columns {', '.join(map(repr, strange))} are not known: {hint}use "
            f"{', '.join(COLUMNS)}"
        )
    twice = [column for column in dict.fromkeys(header) if header.count(column) > 1]
    if twice:
        raise FileFormatError(f"{name}: the column {twice[0]!r} occurs twice: take one out")
    if "file" not in header:
        raise FileFormatError(f"{name} has no column 'file': add the name of each recording")
    if "v" in header and "u" not in header:
        raise FileFormatError(f"{name} has a column v and no u: call a single coordinate u")
    used = {column for system in _SYSTEMS for column in system} & set(header)
    if used and used != set(_system(header)):
        ways = "; or ".join(", ".join(system) for system in _SYSTEMS)
        raise FileFormatError(
            f"{name} has the columns {', '.join(sorted(used))} for listeners: give {ways}"
        )


def _system(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns in which listeners stand; none where none do."""
    return next((each for each in _SYSTEMS if set(each) <= set(header)), ())


def _row(header: Sequence[str], cells: Sequence[str], where: str) -> _Row:
    if len(cells) > len(header):
        raise FileFormatError(
            f"{where}: it has {len(cells)} cells for {len(header)} columns: put texts with commas "
            'in "quotes"'
        )
    given = {column: cell for column, cell in zip(header, cells, strict=False) if cell}
    if "file" not in given:
        raise FileFormatError(f"{where}: it names no file: add it, or take the line out")
    values = {
        column: _number(cell, column, where)
        for column, cell in given.items()
        if column not in _TEXTS
    }
    axes = [column for column in ("u", "v") if column in header]
    return _Row(
        file=given["file"],
        note=given.get("note", ""),
        contact=_complete(values, axes, where),
        listener=_listener(values, _system(header), where),
        others=values,
    )


def _listener(values: dict[str, float], system: tuple[str, ...], where: str) -> Place:
    place = _complete(values, system, where)
    if place and system == _DEGREES:
        return cartesian((place[0], *map(math.radians, place[1:])))
    return cartesian(place) if place and system == _SPHERICAL else place


def _complete(values: dict[str, float], columns: Sequence[str], where: str) -> Place:
    """Take the numbers of some columns out: of all, or of none."""
    missing = [column for column in columns if column not in values]
    if missing and len(missing) < len(columns):
        raise FileFormatError(f"{where}: {', '.join(missing)} is missing: add it")
    return () if missing else tuple(values.pop(column) for column in columns)


def _number(cell: str, column: str, where: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if column in _WHOLE:
        low, high = _WHOLE[column]
        if not (low <= number <= high and number.is_integer()):
            raise FileFormatError(
                f"{where}: {column} is {cell!r}: give a whole number from {low} to {high}"
            )
    elif not math.isfinite(number) or (column == "lead_in" and not 0 <= number <= LONGEST):
        kind = f"seconds from 0 to {LONGEST:g}" if column == "lead_in" else "a finite number"
        raise FileFormatError(f"{where}: {column} is {cell!r}: give {kind}, as 0.5")
    return number


def _joined(rows: Sequence[_Row], name: str) -> Entry:
    """Return the take whose channels are some rows."""
    first, channels = rows[0], sorted(row.channel for row in rows)
    if channels != list(range(1, len(rows) + 1)):
        raise FileFormatError(
            f"{name}: {first.file} has lines for the channels {', '.join(map(str, channels))}: "
            "give a line for each channel from 1 on, or a single one"
        )
    if len({_shared(row) for row in rows}) > 1:
        raise FileFormatError(
            f"{name}: the channels of {first.file} differ in more than listener: make them alike"
        )
    ordered = sorted(rows, key=lambda row: row.channel)
    heard = tuple(row.listener for row in ordered if row.listener)
    if heard and len(heard) < len(rows):
        raise FileFormatError(f"{name}: a channel of {first.file} has no listener: add it")
    rate = first.others.get("sample_rate")
    return Entry(
        file=first.file,
        contact=first.contact,
        listeners=heard,
        hit=int(first.others.get("hit", 1)),
        sample_rate=None if rate is None else int(rate),
        lead_in=first.others.get("lead_in"),
        peak=first.others.get("peak"),
        above_noise=first.others.get("above_noise"),
        note=first.note,
    )


def _shared(row: _Row) -> tuple[object, ...]:
    """Return what all channels of a file have in common."""
    others = {name: value for name, value in row.others.items() if name != "channel"}
    return row.contact, row.note, tuple(sorted(others.items()))
