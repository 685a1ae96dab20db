"""Contact logs as files: CSV, JSON lines and npz, simple enough for a writer of ten lines.

CSV has a line of column names and a line for each contact. Cells are separated by commas,
semicolons or tabs; with the latter two numbers may have decimal commas. Bodies are named by text;
`time`, `body0`, `body1`, `position_x` to `_z` and `impulse_x` to `_z` must be there, `dt`,
`normal_x` to `_z`, `velocity_x` to `_z` and `id` may. Poses are in the same file: lines that have
`body` in place of `body0` and `body1`, with `position_x` to `_z` and `rotation_w` to `_z`. Lines
that begin with # are comments; ``# length: mm`` says in which unit lengths are.

JSON lines has an object a line with the same names, where `position`, `normal`, `impulse`,
`velocity` and `rotation` are lists; an object with only `names` or `length` sets these.

npz has the columns as arrays, `body0` and `body1` as numbers that count the array `names`, and
poses as `pose_time`, `pose_body`, `pose_position` and `pose_rotation`.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import FileFormatError, OptionError, nearest
from struck.files.atomic import read_bytes, write_bytes
from struck.model.arrays import UNITS, Array, checked
from struck.scene.contacts import Contacts, Poses

_AXES = ("x", "y", "z")
_ROTATION = ("w", "x", "y", "z")
_REQUIRED_VECTORS = ("position", "impulse")
_VECTORS = ("position", "normal", "impulse", "velocity")
_WIDTHS: Mapping[str, Sequence[str]] = {**dict.fromkeys(_VECTORS, _AXES), "rotation": _ROTATION}
_IN_METRES = ("position", "velocity")  # scaled by the unit of length
_COLUMNS = ("time", "dt", "body0", "body1", *_VECTORS, "id", "body", "rotation")
_MAX_NAMES = 5
_DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$")


@checked
def load_contacts(path: str | os.PathLike[str]) -> Contacts:
    """Read a contact log, or the poses of bodies without contacts.

    Parameters
    ----------
    path : path
        Ending in ``.csv``, ``.jsonl`` or ``.npz``.

    Returns
    -------
    Contacts

    Raises
    ------
    FileFormatError
        On a file that cannot be read or has another format, with the wrong line.
    OptionError
        On numbers that cannot be; see `Contacts`.
    """
    data, kind = read_bytes(path), _kind(path)
    try:
        if kind == "npz":
            return _read_arrays(data)
        text = data.decode("utf-8-sig")
        lines = _csv_lines(text) if kind == "csv" else _json_lines(text)
        return _Table.of(lines).contacts()
    except (UnicodeDecodeError, csv.Error, zipfile.BadZipFile, KeyError, ValueError) as error:
        if isinstance(error, OptionError):
            raise type(error)(f"{path}: {error}") from None
        problem = f"it lacks {error}" if isinstance(error, KeyError) else error
        raise FileFormatError(f"{path} is no contact log: {problem}") from None


@checked
def save_contacts(contacts: Contacts, path: str | os.PathLike[str]) -> None:
    """Write a contact log with its poses, completely or not at all.

    Parameters
    ----------
    contacts : Contacts
        The log.
    path : path
        The file, ending in ``.csv``, ``.jsonl`` or ``.npz``. All of them keep the log exactly.

    Raises
    ------
    FileFormatError
        If the ending is another, or the file cannot be written.
    """
    kind = _kind(path)
    if kind == "npz":
        stream = io.BytesIO()
        np.savez_compressed(stream, **_arrays(contacts))
        write_bytes(path, stream.getvalue())
        return
    rows = _rows(contacts)
    if kind == "csv":
        write_bytes(path, _csv(contacts, rows).encode())
        return
    head = json.dumps({"names": list(contacts.names), "length": "m"})
    write_bytes(path, "\n".join([head, *map(json.dumps, rows), ""]).encode())


def _kind(path: str | os.PathLike[str]) -> str:
    ending = Path(path).suffix[1:].lower()
    if ending not in {"csv", "jsonl", "npz"}:
        raise FileFormatError(f"{path} ends in {ending!r}: a contact log is .csv, .jsonl or .npz")
    return ending


# Lines of text, from either format as mappings of columns.

Line = tuple[int, Mapping[str, Any]]


def _csv_lines(text: str) -> Iterator[Line]:
    """Yield the number and the columns of each line, and the text of comments."""
    columns: Sequence[str] = ()
    delimiter = ","
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            key, _, value = line.lstrip("# ").partition(":")
            if key.strip() == "length":
                yield number, {"length": value.strip()}
            elif key.strip() == "names":
                yield number, {"names": json.loads(value)}
            continue
        if not columns:
            delimiter = next((mark for mark in ";\t" if mark in line and "," not in line), ",")
        cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
        if not any(cells):
            continue
        if delimiter != ",":
            cells = [_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in cells]
        if not columns:
            columns = cells
            _require_axes(columns)
        elif len(cells) != len(columns):
            raise ValueError(f"line {number} has {len(cells)} cells, and there are {len(columns)}")
        else:
            yield number, _parse_cells(columns, cells)


def _require_axes(columns: Sequence[str]) -> None:
    """Refuse columns of which a vector lacks some axes."""
    for name, axes in _WIDTHS.items():
        lacking = [f"{name}_{axis}" for axis in axes if f"{name}_{axis}" not in columns]
        if 0 < len(lacking) < len(axes):
            others = [column for column in columns if column.rpartition("_")[0] not in _WIDTHS]
            suggestion = nearest(
                lacking[0], [column for column in others if column not in _COLUMNS]
            )
            suggestion = suggestion.replace("did you mean", "is it").strip()
            raise ValueError(f"its columns lack {', '.join(lacking)}: {suggestion or 'give all'}")


def _parse_cells(columns: Sequence[str], cells: Sequence[str]) -> Mapping[str, Any]:
    """Return the cells of a line by column, vectors as lists; empty ones are left out."""
    values: dict[str, Any] = {}
    for column, cell in zip(columns, cells, strict=True):
        if not cell:
            continue
        name, _, axis = column.rpartition("_")
        axes = _WIDTHS.get(name, ())
        if axis in axes:
            values.setdefault(name, [""] * len(axes))[axes.index(axis)] = cell
        else:
            values[column] = cell
    return values


def _json_lines(text: str) -> Iterator[Line]:
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
        except ValueError as error:
            raise ValueError(f"line {number} is no JSON ({error})") from None
        if not hasattr(record, "keys"):
            raise ValueError(f"line {number} is no object: give {{...}} in each line")
        yield number, record


@dataclass(kw_only=True, eq=False)
class _Table:
    """Values of the lines of a log, column by column."""

    names: dict[str, int] = field(default_factory=dict)
    length: float = 1.0
    rows: list[Line] = field(default_factory=list)
    poses: list[Line] = field(default_factory=list)

    @classmethod
    def of(cls, lines: Iterable[Line]) -> _Table:
        table = cls()
        for number, line in lines:
            if "names" in line or "length" in line:
                table.take_head(number, line)
            elif "body" in line:
                table.poses.append((number, line))
            else:
                table.rows.append((number, line))
        return table

    def take_head(self, number: int, line: Mapping[str, Any]) -> None:
        """Read the names or the unit of length of a line."""
        for name in line.get("names", ()):
            self.number(str(name))
        unit = line.get("length", "m")
        if unit not in UNITS:
            raise ValueError(
                f"line {number} gives lengths in {unit!r}: {', '.join(UNITS)} are known"
            )
        self.length = UNITS[unit]

    def number(self, name: str) -> int:
        """Return the number of a body, a new one for a new name."""
        return self.names.setdefault(name, len(self.names))

    def contacts(self) -> Contacts:
        """Return the contacts of the log file."""
        if not (self.rows or self.poses or self.names):
            raise ValueError(
                "it holds no contacts and no poses: name the bodies that touch nothing, in a line "
                "as save_contacts writes it"
            )
        _require_columns(dict.fromkeys(name for _, line in self.rows for name in line))
        ends = [self.bodies(name) for name in ("body0", "body1")]
        vectors = {name: self.vectors(self.rows, name, 3) for name in _VECTORS}
        for name in _REQUIRED_VECTORS:
            if vectors[name] is None:
                vectors[name] = np.zeros((0, 3))
        poses = self.motion()
        notes = _note_unused({name for _, line in self.rows + self.poses for name in line})
        columns: dict[str, Any] = {
            "time": self.scalars(self.rows, "time"),
            "dt": self.scalars(self.rows, "dt", 0.0),
            "body0": ends[0],
            "body1": ends[1],
            **{name: values for name, values in vectors.items() if values is not None},
        }
        if any("id" in line for _, line in self.rows):
            columns["id"] = self.scalars(self.rows, "id", -1.0)
        return Contacts(names=tuple(self.names), poses=poses, notes=notes, **columns)

    def bodies(self, name: str) -> Array:
        """Return the body numbers in a column of a log."""
        missing = [number for number, line in self.rows if name not in line]
        if missing:
            raise ValueError(f"line {missing[0]} has no {name}: name the two bodies that touch")
        return np.array([self.number(str(line[name])) for _, line in self.rows], np.float64)

    def motion(self) -> Poses | None:
        """Return the poses of the log file."""
        if not self.poses:
            return None
        position = self.vectors(self.poses, "position", 3)
        rotation = self.vectors(self.poses, "rotation", 4)
        if position is None or rotation is None:
            raise ValueError(f"line {self.poses[0][0]} has a body without position and rotation")
        return Poses(
            time=self.scalars(self.poses, "time"),
            body=np.array([self.number(str(line["body"])) for _, line in self.poses]),
            position=position,
            rotation=rotation,
        )

    def scalars(self, lines: Sequence[Line], name: str, default: float | None = None) -> Array:
        """Return a column of numbers."""
        try:
            return np.array([float(line.get(name, default)) for _, line in lines], np.float64)
        except (TypeError, ValueError):
            for number, line in lines:
                _require_number(number, name, line.get(name, default))
            raise

    def vectors(self, lines: Sequence[Line], name: str, width: int) -> Array | None:
        """Return a column of vectors; None where no line has it."""
        entries = [line.get(name) for _, line in lines]
        if not any(entry is not None for entry in entries):
            return None
        scale = self.length if name in _IN_METRES else 1.0
        try:
            table = np.array(entries, np.float64)
        except (TypeError, ValueError):
            table = np.zeros(0)
        if table.shape != (len(lines), width):
            for number, line in lines:
                values = line.get(name)
                if not isinstance(values, Sequence) or len(values) != width:
                    raise ValueError(f"line {number} has {name} {values!r}: give {width} numbers")
                for value in values:
                    _require_number(number, name, value)
        return scale * table


def _require_columns(columns: Collection[str]) -> None:
    """Refuse the columns of a log, if it has any, where needed ones are missing."""
    lacking = [
        name for name in ("time", "body0", "body1", *_REQUIRED_VECTORS) if name not in columns
    ]
    if columns and lacking:
        axes = " (in CSV position_x, _y, _z and so on)" if {*lacking} & {*_REQUIRED_VECTORS} else ""
        force = any(column.startswith("force") for column in columns) and "impulse" in lacking
        suggestion = "an impulse is force times dt, in N s; " if force else _suggest_names(columns)
        raise ValueError(
            f"its columns are {', '.join(columns)}: {', '.join(lacking)} are missing; "
            f"{suggestion}give time, body0, body1, {', '.join(_REQUIRED_VECTORS)}{axes} and, "
            "if known, dt, normal, velocity, id"
        )


def _note_unused(columns: Collection[str]) -> tuple[str, ...]:
    """Return a note of the columns of a log that are not used."""
    unknown_columns = sorted({*columns} - {*_COLUMNS})
    text = f"columns that are not used: {', '.join(unknown_columns[:_MAX_NAMES])}"
    remainder = (
        f" and {len(unknown_columns) - _MAX_NAMES} more"
        if len(unknown_columns) > _MAX_NAMES
        else ""
    )
    return (f"{text}{remainder}; {_suggest_names(columns)}there are {', '.join(_COLUMNS)}",) * bool(
        unknown_columns
    )


def _suggest_names(columns: Collection[str]) -> str:
    free = [name for name in _COLUMNS if name not in columns]
    names = (re.sub("_[wxyz]$", "", name) for name in columns if name not in _COLUMNS)
    return "".join(dict.fromkeys(nearest(name, free) for name in names))


def _require_number(number: int, name: str, value: object) -> None:
    try:
        float(str(value))
    except ValueError:
        raise ValueError(f"line {number} has {name} {value!r}: give a number") from None


# Arrays.


def _read_arrays(data: bytes) -> Contacts:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        columns = {name: file[name] for name in file.files if not name.startswith("pose_")}
        poses = None
        if "pose_time" in file.files:
            poses = Poses(
                **{name: file[f"pose_{name}"] for name in ("time", "body", "position", "rotation")}
            )
    _require_columns(columns)
    names = [str(name) for name in np.atleast_1d(columns.pop("names"))]
    unknown_names = sorted(columns.keys() - {"time", "dt", "body0", "body1", "id", *_VECTORS})
    if unknown_names:
        raise ValueError(
            f"it holds {', '.join(unknown_names[:_MAX_NAMES])}, which are no columns of a log"
        )
    return Contacts(names=names, poses=poses, **columns)


def _arrays(contacts: Contacts) -> dict[str, Any]:
    names = ("time", "dt", "body0", "body1", "id", *_VECTORS)
    arrays = {name: getattr(contacts, name) for name in names}
    arrays = {name: values for name, values in arrays.items() if values is not None}
    if contacts.poses is not None:
        for name in ("time", "body", "position", "rotation"):
            arrays[f"pose_{name}"] = getattr(contacts.poses, name)
    return {"names": np.array(contacts.names), **arrays}


# Rows.


def _rows(contacts: Contacts) -> Iterator[dict[str, Any]]:
    """Yield the contacts, then the poses, each as a mapping of columns."""
    names, arrays = contacts.names, _arrays(contacts)
    lists = {name: values.tolist() for name, values in arrays.items() if name != "names"}
    contact_columns = [name for name in lists if not name.startswith("pose_")]
    for row in range(len(contacts)):
        line = {name: lists[name][row] for name in contact_columns}
        yield line | {end: names[line[end]] for end in ("body0", "body1")}
    for row in range(len(lists.get("pose_time", ()))):
        line = {name[5:]: lists[name][row] for name in lists if name.startswith("pose_")}
        yield line | {"body": names[line["body"]]}


def _csv(contacts: Contacts, rows: Iterable[Mapping[str, Any]]) -> str:
    stream = io.StringIO(newline="")
    stream.write(f"# length: m\n# names: {json.dumps(contacts.names)}\n")
    columns = [(name, axis) for name in _COLUMNS for axis in _WIDTHS.get(name, ("",))]
    writer = csv.writer(stream)
    writer.writerow([f"{name}_{axis}" if axis else name for name, axis in columns])
    for row in rows:
        cells: list[object] = []
        for name in _COLUMNS:
            axes = _WIDTHS.get(name, ("",))
            value = row.get(name)
            cells += [""] * len(axes) if value is None else value if len(axes) > 1 else [value]
        writer.writerow(cells)
    return stream.getvalue()
