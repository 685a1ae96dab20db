"""Contact logs as columns: CSV, JSON lines and npz, read in the process that reads foreign files.

The formats are described in `struck.scene.log_files`, which makes `Contacts` of the columns.
"""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from array import array
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import FileFormatError, nearest
from struck.files.archives import require_ratio
from struck.files.atomic import read_bytes
from struck.files.messages import Answer, Frame, ReadingLimits
from struck.model.arrays import UNITS, AnyArray, Array

VECTORS = ("position", "normal", "impulse", "velocity")
_AXES = ("x", "y", "z")
_ROTATION = ("w", "x", "y", "z")
_REQUIRED_VECTORS = ("position", "impulse")
WIDTHS: Mapping[str, Sequence[str]] = {**dict.fromkeys(VECTORS, _AXES), "rotation": _ROTATION}
_IN_METRES = ("position", "velocity")  # scaled by the unit of length
COLUMNS = ("time", "dt", "body0", "body1", *VECTORS, "id", "body", "rotation")
POSE_COLUMNS = ("time", "body", "position", "rotation")
_MAX_SHOWN = 5  # names of columns in a message
_DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$")
_DAMAGED = (UnicodeDecodeError, csv.Error, zipfile.BadZipFile, KeyError, ValueError)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogColumns:
    """Columns of a contact log, not checked yet."""

    names: list[str]  # of bodies
    columns: dict[str, Any]  # of the contacts, arrays (K,) or (K, 3)
    poses: dict[str, Any]  # of the poses; none where the log has none
    notes: tuple[str, ...]


def columns_of(frame: Frame) -> LogColumns:
    """Return the columns that an answer holds."""
    content, arrays = frame.content, iter(frame.arrays)
    columns, poses = (
        {name: next(arrays).reshape(shape) for name, shape in content[part]}
        for part in ("columns", "poses")
    )
    return LogColumns(
        names=content["names"], columns=columns, poses=poses, notes=tuple(content["notes"])
    )


def answer(path: Path, limits: ReadingLimits, *, kind: str) -> Answer:
    """Return the columns of a contact log.

    The content has `names` of bodies, names and shapes of the `columns` of contacts and of those of
    the `poses`, whose arrays follow in this order, and `notes`.
    """
    data = read_bytes(path, most=limits.size)
    try:
        if kind == "npz":
            return _read_arrays(data)
        text = data.decode("utf-8-sig")
        lines = _csv_lines(text) if kind == "csv" else _json_lines(text)
        return _Table(lines).answer()
    except _DAMAGED as error:
        raise FileFormatError(
            f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        ) from None


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
    for name, axes in WIDTHS.items():
        lacking = [f"{name}_{axis}" for axis in axes if f"{name}_{axis}" not in columns]
        if 0 < len(lacking) < len(axes):
            others = [column for column in columns if column.rpartition("_")[0] not in WIDTHS]
            suggestion = nearest(lacking[0], [column for column in others if column not in COLUMNS])
            suggestion = suggestion.replace("did you mean", "is it").strip()
            raise ValueError(f"its columns lack {', '.join(lacking)}: {suggestion or 'give all'}")


def _parse_cells(columns: Sequence[str], cells: Sequence[str]) -> Mapping[str, Any]:
    """Return the cells of a line by column, vectors as lists; empty ones are left out."""
    values: dict[str, Any] = {}
    for column, cell in zip(columns, cells, strict=True):
        if not cell:
            continue
        name, _, axis = column.rpartition("_")
        axes = WIDTHS.get(name, ())
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


class _Rows:
    """Lines of one kind, contacts or poses, column by column: a few bytes for each number."""

    def __init__(
        self, bodies: Sequence[str], scalars: Sequence[str], vectors: Sequence[str]
    ) -> None:
        self._bodies: dict[str, tuple[dict[str, int], array[int]]] = {
            name: ({}, array("q")) for name in bodies
        }
        self._numbers = {name: array("d") for name in (*scalars, *vectors)}
        self._scalars, self._vectors = scalars, vectors
        self._lacking: dict[str, int] = {}  # by column: the first line without it
        self.columns: dict[str, None] = {}  # that any line has, in their order
        self.count = 0

    def add(self, number: int, line: Mapping[str, Any]) -> None:
        """Take in the line of that number."""
        if not line.keys() <= self.columns.keys():
            self.columns |= dict.fromkeys(line)
        for name, (codes, column) in self._bodies.items():
            if name in line:
                column.append(codes.setdefault(str(line[name]), len(codes)))
            else:
                self._lacking.setdefault(name, number)
        for name in self._scalars:
            self._take(number, name, [line.get(name)], line.get(name) is not None)
        for name in self._vectors:
            self._take(number, name, line.get(name), line.get(name) is not None)
        self.count += 1

    def _take(self, number: int, name: str, values: Any, is_present: bool) -> None:  # noqa: ANN401, FBT001 - of JSON
        """Take in the numbers of a cell, NaN where it is empty."""
        column, width = self._numbers[name], len(WIDTHS.get(name, " "))
        if not is_present:
            self._lacking.setdefault(name, number)
            column.extend([np.nan] * width)
            return
        if not isinstance(values, Sequence) or len(values) != width:
            raise ValueError(f"line {number} has {name} {values!r}: give {width} numbers")
        try:
            column.extend(map(float, values))
        except (TypeError, ValueError, OverflowError):
            wrong = next(value for value in values if not _is_number(value))
            text = repr(wrong)[:60]
            raise ValueError(f"line {number} has {name} {text}: give a number") from None

    def bodies(self, name: str, names: dict[str, int]) -> Array:
        """Return the numbers of bodies in a column; new names are added to `names`."""
        if name in self._lacking:
            raise ValueError(
                f"line {self._lacking[name]} has no {name}: name the two bodies that touch"
            )
        codes, column = self._bodies[name]
        numbers = [names.setdefault(body, len(names)) for body in codes]
        return np.array(numbers, np.float64)[np.array(column, np.int64)]

    def scalars(self, name: str, default: float | None = None) -> Array:
        """Return a column of numbers."""
        values = np.array(self._numbers[name], np.float64)
        if name in self._lacking:
            if default is None:
                raise ValueError(f"line {self._lacking[name]} has {name} None: give a number")
            values[np.isnan(values)] = default
        return values

    def vectors(self, name: str, scale: float) -> Array | None:
        """Return a column of vectors; None where no line has it."""
        if name not in self.columns or not self.count:
            return None
        width = len(WIDTHS[name])
        if name in self._lacking:
            raise ValueError(f"line {self._lacking[name]} has {name} None: give {width} numbers")
        values = np.array(self._numbers[name], np.float64).reshape(-1, width)
        return scale * values if name in _IN_METRES else values


class _Table:
    """Values of the lines of a log."""

    def __init__(self, lines: Iterable[Line]) -> None:
        self.names: dict[str, int] = {}
        self.length = 1.0
        self.rows = _Rows(("body0", "body1"), ("time", "dt", "id"), VECTORS)
        self.poses = _Rows(("body",), ("time",), ("position", "rotation"))
        for number, line in lines:
            if "names" in line or "length" in line:
                self._take_head(number, line)
            elif "body" in line:
                self.poses.add(number, line)
            else:
                self.rows.add(number, line)

    def _take_head(self, number: int, line: Mapping[str, Any]) -> None:
        """Read the names or the unit of length of a line."""
        names, unit = line.get("names", []), line.get("length", "m")
        if not isinstance(names, list):
            raise ValueError(  # noqa: TRY004 - of the file, not of an argument
                f"line {number} has names {str(names)[:60]!r}: give a list of them"
            )
        for name in names:
            self.names.setdefault(str(name), len(self.names))
        if not isinstance(unit, str) or unit not in UNITS:
            raise ValueError(
                f"line {number} gives lengths in {unit!r}: {', '.join(UNITS)} are known"
            )
        self.length = UNITS[unit]

    def answer(self) -> Answer:
        """Return the columns of the log, as `answer` says."""
        rows, poses = self.rows, self.poses
        if not (rows.count or poses.count or self.names):
            raise ValueError(
                "it holds no contacts and no poses: name the bodies that touch nothing, in a line "
                "as save_contacts writes it"
            )
        _require_columns(rows.columns)
        columns: dict[str, Array | None] = {
            "time": rows.scalars("time"),
            "dt": rows.scalars("dt", 0.0),
            **{name: rows.bodies(name, self.names) for name in ("body0", "body1")},
            **{name: rows.vectors(name, self.length) for name in VECTORS},
        }
        for name in _REQUIRED_VECTORS:
            if columns[name] is None:
                columns[name] = np.zeros((0, 3))
        if "id" in rows.columns:
            columns["id"] = rows.scalars("id", -1.0)
        notes = _note_unused({*rows.columns, *poses.columns})
        return _answer_of(list(self.names), columns, self._motion(), notes)

    def _motion(self) -> dict[str, Array]:
        """Return the columns of the poses in the log file, none where it has no pose."""
        if not self.poses.count:
            return {}
        position, rotation = (
            self.poses.vectors(name, self.length) for name in ("position", "rotation")
        )
        if position is None or rotation is None:
            raise ValueError("a line has a body without position and rotation: give both")
        bodies = self.poses.bodies("body", self.names)
        times = self.poses.scalars("time")
        return {"time": times, "body": bodies, "position": position, "rotation": rotation}


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
    unknown_columns = sorted({*columns} - {*COLUMNS})
    text = f"columns that are not used: {', '.join(unknown_columns[:_MAX_SHOWN])}"
    remainder = (
        f" and {len(unknown_columns) - _MAX_SHOWN} more"
        if len(unknown_columns) > _MAX_SHOWN
        else ""
    )
    return (f"{text}{remainder}; {_suggest_names(columns)}there are {', '.join(COLUMNS)}",) * bool(
        unknown_columns
    )


def _suggest_names(columns: Collection[str]) -> str:
    free = [name for name in COLUMNS if name not in columns]
    names = (re.sub("_[wxyz]$", "", name) for name in columns if name not in COLUMNS)
    return "".join(dict.fromkeys(nearest(name, free) for name in names))


def _is_number(value: Any) -> bool:  # noqa: ANN401 - of JSON
    try:
        float(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return True


# Arrays.


def _read_arrays(data: bytes) -> Answer:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        unpacked, packed = (
            sum(getattr(each, size) for each in members) for size in ("file_size", "compress_size")
        )
        require_ratio(unpacked, packed)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        columns: dict[str, Any] = {name: file[name] for name in file.files}
    poses = {}
    if "pose_time" in columns:
        poses = {name: columns[f"pose_{name}"] for name in POSE_COLUMNS}
    columns = {name: values for name, values in columns.items() if not name.startswith("pose_")}
    _require_columns(columns)
    names = [str(name) for name in np.atleast_1d(columns.pop("names"))]
    unknown_names = sorted(columns.keys() - {"time", "dt", "body0", "body1", "id", *VECTORS})
    if unknown_names:
        raise ValueError(
            f"it holds {', '.join(unknown_names[:_MAX_SHOWN])}, which are no columns of a log"
        )
    return _answer_of(names, columns, poses, ())


def _answer_of(
    names: list[str],
    columns: Mapping[str, AnyArray | None],
    poses: Mapping[str, AnyArray],
    notes: Sequence[str],
) -> Answer:
    """Return columns as an answer: arrays of one row or column, all of them two-dimensional."""
    present = {name: values for name, values in columns.items() if values is not None}
    content = {
        "names": names,
        "columns": [[name, list(values.shape)] for name, values in present.items()],
        "poses": [[name, list(values.shape)] for name, values in poses.items()],
        "notes": list(notes),
    }
    return content, [_as_row(values) for values in (*present.values(), *poses.values())]


def _as_row(array: AnyArray) -> AnyArray:
    """Return all numbers of an array in a row (1, n), in double precision or 64 bits."""
    if array.dtype.kind not in "biuf":
        raise ValueError(f"it holds an array of {array.dtype}: give numbers")
    plain = array.astype(np.float64 if array.dtype.kind == "f" else np.int64)
    return plain.reshape(1, plain.size)
