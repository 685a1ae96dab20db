"""Manifests: where each recording of a set was struck and heard, as TOML or CSV files."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from struck.errors import (
    FileFormatError,
    OptionError,
    RecordingError,
    counted,
    printable,
    require_choice,
    rounded,
)
from struck.files.atomic import is_file, real
from struck.files.toml_text import read_text, read_toml
from struck.model.arrays import Array, Index, checked
from struck.model.survey import SYMMETRIES, from_spherical

NAME = "manifest.toml"  # of the manifest that `struck record` writes
KINDS = (".toml", ".csv")
_HEAD = "# What was struck where and heard from where, m; `struck record` wrote it.\n"
RATES = (8_000, 192_000)  # Hz, of recordings
LONGEST = 600.0  # s, of a take
MOST_HITS = 1000
_LEVELS = (-400.0, 400.0)  # dB
_MAX_SHOWN = 200  # characters of unknown names in a message

Place = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestEntry:
    """A take of a manifest; places are empty, and numbers None, where they are unknown."""

    file: str  # name of the recording, relative to the manifest
    contact: Place = ()  # coordinates u, or u and v, of the place that was struck
    listeners: tuple[Place, ...] = ()  # (x, y, z) of each channel's microphone on the body, m
    hit: int = 1  # number among several hits of one place
    sample_rate: int | None = None  # Hz
    lead_in: float | None = None  # ambient sound before the hit, s
    peak: float | None = None  # of the loudest channel, dB of full scale
    above_noise: float | None = None  # peak over the ambient sound's rms, in the worst channel, dB
    note: str = ""  # anything else


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manifest:
    """A set of takes with their contacts and listeners.

    Parameters
    ----------
    path : Path
        Path of the manifest; names of files are relative to its folder.
    entries : tuple of ManifestEntry
        One for each file.
    coordinates : tuple of str, default ()
        Names and units of the coordinates of a contact, if known.
    centre : tuple of three floats, default (0, 0, 0)
        Acoustic centre in body coordinates, m.
    symmetry : {"none", "axial"}, default "none"
        Symmetry, as in `Survey`.

    Raises
    ------
    FileFormatError
        If a file or a position occurs twice, or only some takes have positions.
    """

    path: Path
    entries: tuple[ManifestEntry, ...]
    coordinates: tuple[str, ...] = ()
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    symmetry: str = "none"

    def __post_init__(self) -> None:
        _require_equal_fields(self.path, self.entries)
        _require_once(self.path, self.entries)

    @property
    def files(self) -> list[Path]:
        """Paths of the recordings, in order."""
        return [self.path.parent / entry.file for entry in self.entries]

    @property
    def has_contacts(self) -> bool:
        """Whether the manifest has a contact for each take."""
        return bool(self.entries) and bool(self.entries[0].contact)

    @property
    def has_listeners(self) -> bool:
        """Whether the manifest has a listener for each channel."""
        return bool(self.entries) and bool(self.entries[0].listeners)

    @property
    def contacts(self) -> Array:
        """Each contact once (P, D), in order of appearance; D is 0 without contacts."""
        return np.array(list(dict.fromkeys(entry.contact for entry in self.entries)))

    @property
    def listeners(self) -> Array:
        """Each listener once (Q, 3), in order of appearance, m; RecordingError without any."""
        if not self.has_listeners:
            raise RecordingError(f"{self.path} tells no listeners: add x, y and z of each, m")
        places = (place for entry in self.entries for place in entry.listeners)
        return np.array(list(dict.fromkeys(places)))

    @property
    def pairs(self) -> Index:
        """Contact and listener of each channel of each file, in order (n, 2), as in `Survey`."""
        contacts = {place: number for number, place in enumerate(map(tuple, self.contacts))}
        listeners = {place: number for number, place in enumerate(map(tuple, self.listeners))}
        rows = ((entry.contact, place) for entry in self.entries for place in entry.listeners)
        return np.array(
            [(contacts[contact], listeners[listener]) for contact, listener in rows], np.int64
        )

    def chosen(self, files: Sequence[str | os.PathLike[str]]) -> Manifest:
        """Select the entries of some files, in their order.

        Parameters
        ----------
        files : sequence of path
            The files.

        Returns
        -------
        Manifest
            The manifest of these files.

        Raises
        ------
        RecordingError
            If a file has no entry.
        """
        entries_by_path = {
            real(path): entry for path, entry in zip(self.files, self.entries, strict=True)
        }
        missing = [str(file) for file in files if real(file) not in entries_by_path]
        if missing:
            raise RecordingError(
                f"{len(missing)} of {len(files)} recordings have no entry in {self.path}, the "
                f"first {missing[0]}: add them there, or leave them out"
            )
        return replace(self, entries=tuple(entries_by_path[real(file)] for file in files))

    def text(self) -> str:
        """Return the manifest as TOML.

        Returns
        -------
        str
            TOML, from which `read_manifest` makes the same.
        """
        head: dict[str, object] = {"symmetry": self.symmetry, "centre": self.centre}
        if self.coordinates:
            head["coordinates"] = self.coordinates
        return _HEAD + _lines(head) + "".join(_entry_text(entry) for entry in self.entries)


@checked
def read_manifest(path: str | os.PathLike[str]) -> Manifest:
    """Read a manifest, TOML or CSV.

    Parameters
    ----------
    path : path
        Ending in ``.toml`` or ``.csv``. A CSV file has commas and a first line of names: `file`,
        and of `channel`, `u`, `v`, `x`, `y`, `z`, `distance`, `azimuth`, `polar`,
        `azimuth_degrees`, `polar_degrees`, `hit`, `sample_rate`, `lead_in`, `note` those that are
        known. A TOML file has the same in tables ``[[takes]]``, contacts and listeners as lists.

    Returns
    -------
    Manifest
        The manifest.

    Raises
    ------
    FileFormatError
        If the file cannot be read, a column is unknown, an entry is missing or not a number, a file
        is missing, or a position occurs twice.
    """
    source = Path(path)
    kind = source.suffix.lower()
    if kind == ".csv":
        manifest = Manifest(path=source, entries=csv_entries(read_text(source), str(source)))
    elif kind == ".toml":
        manifest = _manifest_of_table(source, TomlTable.read(source))
    else:
        raise FileFormatError(f"{source} ends in {kind!r}: give a manifest in .toml or .csv")
    if not manifest.entries:
        raise FileFormatError(f"{source} has no takes: add one for each recording")
    _require_files(manifest)
    table = TomlTable({}, str(source))
    require_named(manifest.coordinates, manifest.entries[0].contact, table.error)
    return manifest


def manifest_in(folder: Path) -> Path:
    """Return the manifest in a folder: `NAME`, or else the one list of takes that lies there."""
    lists = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in KINDS]
    return lists[0] if len(lists) == 1 else folder / NAME


def recorded_so_far(path: Path) -> Manifest:
    """Read a manifest that is being written, without takes whose files have gone."""
    if not os.path.lexists(path):
        return Manifest(path=path, entries=())
    manifest = _manifest_of_table(path, TomlTable.read(path))
    files_and_entries = zip(manifest.files, manifest.entries, strict=True)
    return replace(
        manifest, entries=tuple(entry for file, entry in files_and_entries if is_file(file))
    )


def require_named(
    coordinates: tuple[str, ...], contact: Place, error: Callable[[str], Exception] = OptionError
) -> None:
    """Refuse names of coordinates that are not as many as the numbers of a contact."""
    if coordinates and len(coordinates) != len(contact):
        raise error(
            f"coordinates names {len(coordinates)}, {', '.join(coordinates)}, and each contact has "
            f"{counted(len(contact), 'number')}: name one for each number, or leave coordinates out"
        )


def _manifest_of_table(path: Path, table: TomlTable) -> Manifest:
    manifest = Manifest(
        path=path,
        symmetry=table.choice("symmetry", SYMMETRIES, "none"),
        centre=table.numbers("centre", 3) or (0.0, 0.0, 0.0),
        coordinates=table.texts("coordinates"),
        entries=tuple(map(toml_entry, table.tables("takes"))),
    )
    table.require_known()
    return manifest


def _require_files(manifest: Manifest) -> None:
    missing = [str(path) for path in manifest.files if not is_file(path)]
    if missing:
        raise FileFormatError(
            f"{manifest.path}: {len(missing)} of {len(manifest.entries)} recordings are missing, "
            f"the first {missing[0]}: put them there, or take their entries out"
        )


def _require_equal_fields(path: Path, entries: tuple[ManifestEntry, ...]) -> None:
    """Refuse takes without places among others, or with other numbers of coordinates."""
    for field in ("contact", "listeners"):
        incomplete_files = [entry.file for entry in entries if not getattr(entry, field)]
        if incomplete_files and len(incomplete_files) < len(entries):
            raise FileFormatError(
                f"{path}: {len(incomplete_files)} of {len(entries)} takes have no {field}, the "
                f"first {incomplete_files[0]}: add it, or take those of the others out"
            )
    counts = sorted({len(entry.contact) for entry in entries})
    if len(counts) > 1:
        raise FileFormatError(
            f"{path}: contacts have {counts[0]} and {counts[1]} coordinates: give all as many"
        )


def _require_once(path: Path, entries: tuple[ManifestEntry, ...]) -> None:
    files: set[str] = set()
    places: dict[object, str] = {}
    for entry in entries:
        if entry.file in files:
            raise FileFormatError(f"{path}: {entry.file} occurs twice: take one of them out")
        files.add(entry.file)
        place = (entry.contact, entry.listeners, entry.hit)
        if place in places and (entry.contact or entry.listeners):
            raise FileFormatError(
                f"{path}: {places[place]} and {entry.file} have the same contact, listener and "
                "hit: correct one of them, or number several hits of one place by hit"
            )
        places[place] = entry.file


def _entry_text(entry: ManifestEntry) -> str:
    values = {key: value for key, value in asdict(entry).items() if value not in (None, "", ())}
    return "\n[[takes]]\n" + _lines(values)


def _lines(values: dict[str, object]) -> str:
    """Return TOML of numbers, text and lists: as in JSON, except for one character."""
    texts = (
        (key, json.dumps(value, ensure_ascii=False, allow_nan=False).replace("\x7f", "\\u007f"))
        for key, value in values.items()
    )
    return "".join(f"{key} = {text}\n" for key, text in texts)


def toml_entry(table: TomlTable) -> ManifestEntry:
    """Return the take of a table."""
    entry = ManifestEntry(
        file=table.text("file"),
        contact=table.numbers("contact", 1, 2),
        listeners=toml_listeners(table),
        hit=table.count("hit", 1, MOST_HITS, default=1),
        sample_rate=table.count("sample_rate", *RATES, default=0) or None,
        lead_in=table.maybe("lead_in", 0, LONGEST),
        peak=table.maybe("peak", *_LEVELS),
        above_noise=table.maybe("above_noise", *_LEVELS),
        note=table.text("note", default=""),
    )
    table.require_known()
    return entry


def toml_listeners(
    table: TomlTable, single: str = "listener", many: str = "listeners"
) -> tuple[Place, ...]:
    """Return the listeners of a table, m: one, or one for each channel; or none.

    Under the key `single` (x, y, z), m, under "spherical" (distance, azimuth, polar angle), m and
    rad, or under "spherical_degrees"; under the key `many` a list of (x, y, z).
    """
    one = table.numbers(single, 3)
    radians = table.numbers("spherical", 3)
    degrees = table.numbers("spherical_degrees", 3)
    places = table.list(many)
    if sum(map(bool, (one, radians, degrees, places))) > 1:
        raise table.error(
            f"its listeners are given twice: give one of {single}, spherical, spherical_degrees "
            f"and {many}"
        )
    if degrees:
        radians = (degrees[0], *map(math.radians, degrees[1:]))
    if radians:
        one = to_cartesian(radians)
    if one:
        return (one,)
    return tuple(numbers(place, table, f"one of {many}", 3) for place in places)


def to_cartesian(coordinates: Place) -> Place:
    """Return (x, y, z), m, by distance, azimuth and polar angle, m and rad, as `from_spherical`."""
    return tuple(from_spherical(*coordinates)[0].tolist())


class TomlTable:
    """A table of a TOML file whose keys are read one by one: unknown ones can be reported."""

    def __init__(self, values: Mapping[str, Any], name: str) -> None:
        self.name = name
        self._values = values
        self._known: list[str] = []

    @classmethod
    def read(cls, path: Path) -> TomlTable:
        """Return the table of a TOML file."""
        return cls(read_toml(path), str(path))

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def value(self, key: str) -> Any:  # noqa: ANN401 - whatever TOML holds
        """Return the value of a key, or None."""
        self._known.append(key)
        return self._values.get(key)

    def number(self, key: str, low: float, high: float, default: float | None = None) -> float:
        """Return a number from `low` to `high`; without a default it has to be there."""
        value = self.value(key)
        if value is None and default is not None:
            return default
        if not (_is_number(value) and low <= value <= high):
            raise self.error(
                f"{key} is {_format_value(value)}: give a number from {rounded(low)} to "
                f"{rounded(high)}"
            )
        return float(value)

    def maybe(self, key: str, low: float, high: float) -> float | None:
        """Return a number from `low` to `high`, or None."""
        return self.number(key, low, high) if key in self._values else self.value(key)

    def count(self, key: str, low: int, high: int, *, default: int) -> int:
        """Return a whole number from `low` to `high`."""
        value = float(self.number(key, low, high, default))
        if not value.is_integer():
            raise self.error(f"{key} is {rounded(value)}: give a whole number from {low} to {high}")
        return int(value)

    def text(self, key: str, default: str | None = None) -> str:
        """Return text; without a default it has to be there and not be empty."""
        value = self.value(key)
        if value is None and default is not None:
            return default
        if not isinstance(value, str) or not (value or default is not None):
            raise self.error(f'{key} is {_format_value(value)}: give text, as {key} = "..."')
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; empty if the key is missing."""
        value = self.value(key)
        if value is None:
            return ()
        if not (isinstance(value, list) and value and all(isinstance(item, str) for item in value)):
            raise self.error(
                f'{key} is {_format_value(value)}: give a list of texts, as ["...", "..."]'
            )
        return tuple(value)

    def choice(self, key: str, names: tuple[str, ...], default: str) -> str:
        """Return the value of a key, if it is one of some names."""
        value = self.text(key, default)
        require_choice(key, value, names, self.error)
        return value

    def numbers(self, key: str, *counts: int) -> tuple[float, ...]:
        """Return a list of finite numbers, of one of some lengths; empty if the key is missing."""
        value = self.value(key)
        return () if value is None else numbers(value, self, key, *counts)

    def table(self, key: str) -> TomlTable:
        """Return a table of this TOML file by its key; an empty one if it is missing."""
        value = self.value(key)
        if not isinstance(value, dict | None):
            raise self.error(f"{key} is {_format_value(value)}: give a table, as [{key}]")
        return TomlTable(value or {}, f"{self.name}, [{key}]")

    def list(self, key: str) -> list[Any]:
        """Return a list of this TOML file by its key; an empty one if it is missing."""
        value = self.value(key)
        if not isinstance(value, list | None):
            raise self.error(f"{key} is {_format_value(value)}: give a list")
        return value or []

    def tables(self, key: str) -> list[TomlTable]:
        """Return the tables written as [[key]]."""
        items = self.list(key)
        if not all(isinstance(item, dict) for item in items):
            raise self.error(f"{key} holds what is no table: write each as [[{key}]]")
        return [
            TomlTable(item, f"{self.name}, [[{key}]] {number}")
            for number, item in enumerate(items, 1)
        ]

    def require_known(self) -> None:
        """Raise FileFormatError on keys that the format does not have."""
        unknown_keys = sorted(set(self._values) - set(self._known))
        if unknown_keys:
            names = printable(", ".join(unknown_keys))[:_MAX_SHOWN]
            raise self.error(f"{names} is not known here: use {', '.join(sorted(self._known))}")

    def error(self, trouble: str) -> FileFormatError:
        """Return an error whose message names the table."""
        return FileFormatError(f"{self.name}: {trouble}")


def numbers(value: object, table: TomlTable, key: str, *counts: int) -> tuple[float, ...]:
    """Return a list of finite numbers, of one of some lengths; FileFormatError on other values."""
    if (
        not (isinstance(value, list) and len(value) in counts)
        or not all(map(_is_number, value))
        or not all(map(math.isfinite, value))
    ):
        lengths = " or ".join(map(str, counts))
        raise table.error(
            f"{key} is {_format_value(value)}: give a list of {lengths} finite numbers"
        )
    return tuple(map(float, value))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _format_value(value: object) -> str:
    return "missing" if value is None else repr(value)[:80]


# Columns of a CSV file, which has a row for each file, or for each channel of one.
_CARTESIAN_COLUMNS = ("x", "y", "z")
_SPHERICAL_COLUMNS = ("distance", "azimuth", "polar")
_DEGREES = ("distance", "azimuth_degrees", "polar_degrees")
_SYSTEMS = (_CARTESIAN_COLUMNS, _SPHERICAL_COLUMNS, _DEGREES)
_INTEGER_COLUMNS = {"channel": (1, MOST_HITS), "hit": (1, MOST_HITS), "sample_rate": RATES}
_TEXTS = ("file", "note")
_PLACES = ("u", "v", *dict.fromkeys(_CARTESIAN_COLUMNS + _SPHERICAL_COLUMNS + _DEGREES))
COLUMNS = ("file", *_INTEGER_COLUMNS, *_PLACES, "lead_in", "peak", "above_noise", "note")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """A line of a CSV file."""

    file: str
    note: str
    contact: Place  # empty if unknown
    listener: Place  # m, empty if unknown
    others: Mapping[str, float]  # by column

    @property
    def channel(self) -> int:
        return int(self.others.get("channel", 1))


def csv_entries(text: str, name: str) -> tuple[ManifestEntry, ...]:
    """Return the takes of a CSV file; rows of one file are its channels."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as error:
        raise FileFormatError(
            f"{name}, line {reader.line_num}: it is no CSV ({error}): save it with commas"
        ) from error
    if not lines:
        raise FileFormatError(f"{name} is empty: begin it with a line as file,u,x,y,z")
    header = lines[0][1]
    _require_columns(header, name)
    by_file: dict[str, list[_Row]] = {}
    for number, cells in lines[1:]:
        row = _row(header, cells, f"{name}, line {number}")
        by_file.setdefault(row.file, []).append(row)
    return tuple(_join_rows(rows, name) for rows in by_file.values())


def _require_columns(header: Sequence[str], name: str) -> None:
    unknown_columns = [column for column in header if column not in COLUMNS]
    if unknown_columns:
        hint = "separate names by commas, and " if len(header) == 1 else ""
        names = printable(", ".join(map(repr, unknown_columns)))[:_MAX_SHOWN]
        raise FileFormatError(
            f"{name}: the columns {names} are not known: {hint}use {', '.join(COLUMNS)}"
        )
    repeated_columns = [column for column in dict.fromkeys(header) if header.count(column) > 1]
    if repeated_columns:
        raise FileFormatError(
            f"{name}: the column {repeated_columns[0]!r} occurs twice: take one out"
        )
    if "file" not in header:
        raise FileFormatError(f"{name} has no column 'file': add the name of each recording")
    if "v" in header and "u" not in header:
        raise FileFormatError(f"{name} has a column v and no u: call a single coordinate u")
    listener_columns = {column for system in _SYSTEMS for column in system} & set(header)
    if listener_columns and listener_columns != set(_system(header)):
        systems = "; or ".join(", ".join(system) for system in _SYSTEMS)
        raise FileFormatError(
            f"{name} has the columns {', '.join(sorted(listener_columns))} for listeners: "
            f"give {systems}"
        )


def _system(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of listeners' coordinates, if there are any."""
    return next((system for system in _SYSTEMS if set(system) <= set(header)), ())


def _row(header: Sequence[str], cells: Sequence[str], location: str) -> _Row:
    if len(cells) > len(header):
        raise FileFormatError(
            f"{location}: it has {len(cells)} cells for {len(header)} columns: put texts with "
            'commas in "quotes"'
        )
    cells_by_column = {column: cell for column, cell in zip(header, cells, strict=False) if cell}
    if "file" not in cells_by_column:
        raise FileFormatError(f"{location}: it names no file: add it, or take the line out")
    values = {
        column: _number(cell, column, location)
        for column, cell in cells_by_column.items()
        if column not in _TEXTS
    }
    axes = [column for column in ("u", "v") if column in header]
    return _Row(
        file=cells_by_column["file"],
        note=cells_by_column.get("note", ""),
        contact=_take_columns(values, axes, location),
        listener=_listener(values, _system(header), location),
        others=values,
    )


def _listener(values: dict[str, float], system: tuple[str, ...], location: str) -> Place:
    place = _take_columns(values, system, location)
    if place and system == _DEGREES:
        return to_cartesian((place[0], *map(math.radians, place[1:])))
    return to_cartesian(place) if place and system == _SPHERICAL_COLUMNS else place


def _take_columns(values: dict[str, float], columns: Sequence[str], location: str) -> Place:
    """Take the numbers of some columns out: of all, or of none."""
    missing = [column for column in columns if column not in values]
    if missing and len(missing) < len(columns):
        raise FileFormatError(f"{location}: {', '.join(missing)} is missing: add it")
    return () if missing else tuple(values.pop(column) for column in columns)


def _number(cell: str, column: str, location: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if column in _INTEGER_COLUMNS:
        low, high = _INTEGER_COLUMNS[column]
        if not (low <= number <= high and number.is_integer()):
            raise FileFormatError(
                f"{location}: {column} is {cell!r}: give a whole number from {low} to {high}"
            )
    elif not math.isfinite(number) or (column == "lead_in" and not 0 <= number <= LONGEST):
        kind = f"seconds from 0 to {LONGEST:g}" if column == "lead_in" else "a finite number"
        raise FileFormatError(f"{location}: {column} is {cell!r}: give {kind}, as 0.5")
    return number


def _join_rows(rows: Sequence[_Row], name: str) -> ManifestEntry:
    """Return the take whose channels are some rows."""
    first, channels = rows[0], sorted(row.channel for row in rows)
    if channels != list(range(1, len(rows) + 1)):
        raise FileFormatError(
            f"{name}: {first.file} has lines for the channels {', '.join(map(str, channels))}: "
            "give a line for each channel from 1 on, or a single one"
        )
    if len({_shared(row) for row in rows}) > 1:
        raise FileFormatError(
            f"{name}: the channels of {first.file} differ in more than listener: make them equal"
        )
    sorted_rows = sorted(rows, key=lambda row: row.channel)
    listeners = tuple(row.listener for row in sorted_rows if row.listener)
    if listeners and len(listeners) < len(rows):
        raise FileFormatError(f"{name}: a channel of {first.file} has no listener: add it")
    return ManifestEntry(
        file=first.file,
        contact=first.contact,
        listeners=listeners,
        hit=int(first.others.get("hit", 1)),
        sample_rate=int(first.others.get("sample_rate", 0)) or None,
        note=first.note,
        **{name: first.others.get(name) for name in ("lead_in", "peak", "above_noise")},
    )


def _shared(row: _Row) -> tuple[object, ...]:
    """Return the contact, note and other columns that all channels of a recording share."""
    others = sorted(item for item in row.others.items() if item[0] != "channel")
    return row.contact, row.note, tuple(others)
