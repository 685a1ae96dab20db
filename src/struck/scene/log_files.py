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
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import FileFormatError, OptionError, rounded
from struck.files.atomic import require_readable, write_bytes
from struck.files.contact_log import COLUMNS, POSE_COLUMNS, VECTORS, WIDTHS, columns_of
from struck.files.guard import read_foreign
from struck.files.messages import READING_SECONDS
from struck.model.arrays import checked, require_number
from struck.scene.contacts import Contacts, Poses


@checked
def load_contacts(path: str | os.PathLike[str], *, seconds: float = READING_SECONDS) -> Contacts:
    """Read a contact log, or the poses of bodies without contacts.

    Parameters
    ----------
    path : path
        Ending in ``.csv``, ``.jsonl`` or ``.npz``.
    seconds : float, default 10.0
        Processor time that reading may take, s, at most 3600. A million rows of text take about 20.

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
    kind = _kind(path)
    require_number("seconds", seconds, 0.0, 3600.0, above=True, hint="it must exceed 0")
    require_readable(path)
    advice = f"split it, or give more than seconds={rounded(seconds)}"
    try:
        log = read_foreign(
            "contacts", path, columns_of, advice=advice, options={"kind": kind}, seconds=seconds
        )
        poses = Poses(**log.poses) if log.poses else None
        return Contacts(names=log.names, poses=poses, notes=log.notes, **log.columns)
    except FileFormatError as error:
        raise FileFormatError(f"{path} is no contact log: {error}") from None
    except OptionError as error:
        raise type(error)(f"{path}: {error}") from None


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


def _arrays(contacts: Contacts) -> dict[str, Any]:
    names = ("time", "dt", "body0", "body1", "id", *VECTORS)
    arrays = {name: getattr(contacts, name) for name in names}
    arrays = {name: values for name, values in arrays.items() if values is not None}
    if contacts.poses is not None:
        for name in POSE_COLUMNS:
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
    columns = [(name, axis) for name in COLUMNS for axis in WIDTHS.get(name, ("",))]
    writer = csv.writer(stream)
    writer.writerow([f"{name}_{axis}" if axis else name for name, axis in columns])
    for row in rows:
        cells: list[object] = []
        for name in COLUMNS:
            axes = WIDTHS.get(name, ("",))
            value = row.get(name)
            cells += [""] * len(axes) if value is None else value if len(axes) > 1 else [value]
        writer.writerow(cells)
    return stream.getvalue()
