"""Table of jobs: which mesh files are analyzed with which options, and their models' names."""

from __future__ import annotations

import csv
import glob
import inspect
import io
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from struck.analysis.source_options import applicable
from struck.batch.job import MODEL, OPTIONS, BodyJob
from struck.errors import (
    ArgumentError,
    FileFormatError,
    OptionError,
    article,
    nearest,
    printable,
    require_choice,
)
from struck.files.atomic import is_file, is_folder
from struck.files.messages import FORMATS, READERS
from struck.files.toml_text import read_text, read_toml
from struck.model.arrays import UNITS
from struck.model.damping import require_band
from struck.model.material import Material
from struck.solids.resolution import level

_KINDS = {*FORMATS, *(suffix[1:] for suffix in READERS)}
_PACKED = {".gz", ".bz2", ".xz", ".zip"}
_COLUMNS = {"file", "output", "material", *OPTIONS}
_MAX_LISTED, _MAX_SHOWN = 3, 60  # names in a message, and characters of each
_MAX_TEXT = 300  # characters of a row in a message
Files = str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None
Table = str | os.PathLike[str] | Sequence[Mapping[str, Any]] | None


def jobs_of(
    files: Files,
    material: Material | str | None,
    table: Table,
    options: Mapping[str, Any],
    make: Callable[..., BodyJob] = BodyJob,
) -> list[BodyJob]:
    """Return the jobs of patterns and a table; OptionError on none, or two of one name."""
    # What is wrong with all files is refused at once.
    if material is not None:
        Material.of(material, options.get("damping", "own"))
    level(options.get("accuracy") or "standard")
    require_choice("units", options.get("units") or "m", UNITS)
    patterns = [files] if isinstance(files, str | os.PathLike) else list(files or ())
    others = [type(item).__name__ for item in patterns if not isinstance(item, str | os.PathLike)]
    if others:
        raise ArgumentError(
            f"files hold {article(others[0])}: give mesh files, folders or patterns, and "
            "objects to struck.analyze, one by one"
        )
    roots = {path: root for item in patterns for path, root in _matches(os.fspath(item))}
    rows: dict[str, list[Mapping[str, Any]]] = {}
    paths = {os.path.abspath(path): path for path in roots}  # noqa: PTH100 - links stay apart
    for row, root in _rows(table):
        path = os.path.normpath(root / row["file"])
        path = paths.setdefault(os.path.abspath(path), path)  # noqa: PTH100 - links stay apart
        roots.setdefault(path, root)
        rows.setdefault(path, []).append(row)
    if not roots:
        raise OptionError(
            f"no mesh file has the name {' or '.join(map(repr, patterns)) or '(none)'}: give a "
            "pattern as 'meshes/**/*.obj', in quotes in a shell"
        )
    jobs, jobs_by_output = [], {}
    for path, root in roots.items():
        arguments = {"material": material, **options}
        if not applicable(path, accuracy=None):
            arguments.pop("accuracy", None)  # which chooses the elements of the other files
        for row in rows.get(path, [{}]):
            job = _job(path, root, {**arguments, **row}, make)
            other = jobs_by_output.setdefault(job.output.casefold(), job)
            if other is not job:
                raise OptionError(
                    f"{other.file} and {path} would both become {job.output}{MODEL}: rename one, "
                    "or set the output of each in a table"
                )
            jobs.append(job)
    _require_sendable(jobs)
    return jobs


def _matches(pattern: str) -> Iterator[tuple[str, Path]]:
    """Yield the files of a pattern, a folder or a name, each with the folder it stands below."""
    path = Path(pattern)
    if is_folder(pattern) and pattern:
        every = sorted(item for item in path.rglob("*") if is_file(item))
        yield from ((str(item), path) for item in every if {*_suffix(item).split(".")} & _KINDS)
    elif is_file(pattern) or not glob.has_magic(pattern):
        yield from [(os.path.normpath(pattern), path.parent)] if pattern else ()
    else:
        first = next(i for i, part in enumerate(path.parts) if glob.has_magic(part))
        every = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207 - as shells read it
        root = Path(*path.parts[:first])
        yield from ((os.path.normpath(item), root) for item in every if is_file(item))


def _suffix(path: Path) -> str:
    """Return the ending of a mesh file's name in small letters, that of its packing with it."""
    is_packed = path.suffix.lower() in _PACKED
    return "".join(path.suffixes[-2:] if is_packed else path.suffixes[-1:]).lower()


def _job(path: str, root: Path, row: dict[str, Any], make: Callable[..., BodyJob]) -> BodyJob:
    relative_path = (
        Path(path).relative_to(root) if Path(path).is_relative_to(root) else Path(path).name
    )
    stem = Path(relative_path).as_posix()
    stem = stem[: len(stem) - len(_suffix(Path(path)))]
    named, material = row.pop("output", stem), row.pop("material")
    row.pop("file", None)
    output = Path(str(named).removesuffix(MODEL))
    if output.is_absolute() or ".." in output.parts or not output.parts:
        raise OptionError(f"output {named!r} of {path} does not lie in the folder: give a name")
    if material is None:
        raise OptionError(f"{path} has no material: give one for all, or in its row of the table")
    return make(file=path, output=output.as_posix(), material=material, options=row)


def _require_sendable(jobs: Sequence[BodyJob]) -> None:
    """Raise OptionError for options that cannot be pickled for another process."""
    values = [
        value
        for job in jobs
        for value in (*job.options.values(), getattr(job.strikes, "strikes", 0))
    ]
    try:
        pickle.dumps(values)
        functions = [value for value in values if callable(value)]  # of a module: with a name
        culprits = [f for f in functions if not inspect.isfunction(f) or f.__module__ == "__main__"]
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        culprits = [error]
    if culprits:
        raise OptionError(
            f"{culprits[0]!r} cannot be sent to other processes: give numbers, texts, or a "
            "function of a module that they can import"
        )


def require_known(names: Iterable[object], place: str, known: Iterable[str]) -> None:
    """Refuse names that are not known, with the nearest."""
    unknown = sorted({str(item) for item in names} - {*known})
    if unknown:
        texts = [printable(item)[:_MAX_SHOWN] for item in unknown[:_MAX_LISTED]]
        others = f" and {len(unknown) - len(texts)} more" * (len(unknown) > len(texts))
        suggestions = "".join(nearest(item, known) for item in texts)
        raise OptionError(
            f"{place} has no {', '.join(texts)}{others}: {suggestions}give some of "
            f"{', '.join(sorted(known))}"
        )


# Tables


def _rows(table: Table) -> Iterator[tuple[Mapping[str, Any], Path]]:
    """Yield the rows of a table, checked, each with the folder of its file."""
    if isinstance(table, str | os.PathLike):
        name, root, rows = os.fspath(table), Path(table).parent, table_rows(table)
    else:
        name, root, rows = "the table", Path(), table or ()
    for number, row in enumerate(rows, start=1):
        place = f"row {number} of {name}"
        file = row.get("file") if isinstance(row, Mapping) else None
        if not isinstance(file, str | os.PathLike) or not os.fspath(file):
            raise OptionError(f"{place} names no file: it is needed in each row")
        require_known(row, place, _COLUMNS)
        if any(isinstance(value, str) and "\0" in value for value in row.values()):
            raise OptionError(f"{place} has a text with a NUL character: take it out")
        given = {key: value for key, value in row.items() if value is not None and value != ""}
        try:
            read = {key: _READ[key](value) for key, value in given.items() if key in _READ}
            yield {**given, **read}, root
        except (ValueError, TypeError, KeyError, ArithmeticError) as error:
            text = printable(f"({error}): {dict(given)}")[:_MAX_TEXT]
            raise OptionError(f"{place} is not understood {text}: correct it there") from error


def table_rows(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Return the rows of a CSV file with names in its first line, or of the one array of a TOML."""
    if Path(path).suffix.lower() == ".toml":
        arrays = list(read_toml(path).values())
        if len(arrays) != 1 or not _is_table(arrays[0]):
            raise FileFormatError(f"{path} holds no table: give [[files]] for each row and no more")
        return arrays[0]
    text = read_text(path)
    named = text.partition("\n")[0]
    between = next((item for item in ";\t" if item in named and "," not in named), ",")
    try:
        lines = io.StringIO(text, newline="")
        return list(csv.DictReader(lines, delimiter=between, strict=True))
    except csv.Error as error:
        raise FileFormatError(
            f"{path} is no CSV table ({error}): give the names of its columns in the first line"
        ) from error


def _is_table(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(row, dict) for row in value)


def _count(value: Any) -> int:  # noqa: ANN401 - a cell of a table
    """Return a cell as a whole number."""
    if not float(value).is_integer():
        raise ValueError(f"{value} is no whole number")
    return int(float(value))


def _numbers(value: Any) -> Any:  # noqa: ANN401
    if callable(value):
        return value
    return tuple(np.asarray(_cells(value), np.float64).ravel().tolist())


def _cells(value: object) -> object:
    return value.replace(",", " ").split() if isinstance(value, str) else value


def _box(value: Any) -> Any:  # noqa: ANN401
    corners = _numbers(value)
    return corners if callable(corners) else (corners[:3], corners[3:])


# How the cells of a CSV table are read, by the name of their column.
_READ: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("size", "wall", "repair_seconds", "filled", "immersed"), float),
    "modes": _count,
    **dict.fromkeys(
        ("air", "repair", "recoil", "air_mass"),
        lambda value: {"true": True, "false": False}[str(value).lower()],
    ),
    "band": lambda value: require_band(_cells(value)),
    "fixed": _box,
}
