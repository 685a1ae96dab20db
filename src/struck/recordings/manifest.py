"""Which recording was struck where and heard from where: the manifest of a set of takes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, RecordingError
from struck.model.survey import SYMMETRIES
from struck.recordings.manifests.entries import Entry, toml_entry
from struck.recordings.manifests.rows import csv_entries
from struck.recordings.manifests.toml_table import TomlTable, read_text, read_toml

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NAME = "manifest.toml"
"""What `struck record` calls a manifest."""
KINDS = (".toml", ".csv")
"""Endings of manifests."""
_HEAD = "# What was struck where and heard from where, m; `struck record` wrote it.\n"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manifest:
    """A set of takes with their places.

    Parameters
    ----------
    path : Path
        The manifest; files stand relative to its folder.
    entries : tuple of Entry
        One for each file.
    coordinates : tuple of str
        Names and units of a contact's coordinates, where they are told.
    centre : tuple of 3 numbers
        Where the sound seems to come from, body coordinates, m.
    symmetry : str
        "none" or "axial", as in `Survey`.

    Raises
    ------
    FileFormatError
        When a file or a place occurs twice, or some takes have places and others none.
    """

    path: Path
    entries: tuple[Entry, ...]
    coordinates: tuple[str, ...] = ()
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    symmetry: str = "none"

    def __post_init__(self) -> None:
        _require_alike(self.path, self.entries)
        _require_once(self.path, self.entries)

    @property
    def files(self) -> list[Path]:
        """The recordings, in order."""
        return [self.path.parent / entry.file for entry in self.entries]

    @property
    def has_contacts(self) -> bool:
        """Whether it says where each take was struck."""
        return bool(self.entries) and bool(self.entries[0].contact)

    @property
    def has_listeners(self) -> bool:
        """Whether it says from where each channel listened."""
        return bool(self.entries) and bool(self.entries[0].listeners)

    @property
    def contacts(self) -> Array:
        """Each contact once (P, D), in order of appearance; D is 0 where none is told."""
        return np.array(_distinct(entry.contact for entry in self.entries))

    @property
    def listeners(self) -> Array:
        """Each listener once (Q, 3), in order of appearance, m.

        Raises
        ------
        RecordingError
            Where none is told.
        """
        if not self.has_listeners:
            raise RecordingError(f"{self.path} tells no listeners: add x, y and z of each, m")
        return np.array(_distinct(place for entry in self.entries for place in entry.listeners))

    @property
    def pairs(self) -> Index:
        """Contact and listener of each channel of each file, in order (n, 2), as in `Survey`.

        Raises
        ------
        RecordingError
            Where no listeners are told.
        """
        contacts = {place: number for number, place in enumerate(map(tuple, self.contacts))}
        listeners = {place: number for number, place in enumerate(map(tuple, self.listeners))}
        numbers = [
            (contacts[entry.contact], listeners[place])
            for entry in self.entries
            for place in entry.listeners
        ]
        return np.array(numbers, np.int64)

    def chosen(self, files: Sequence[str | os.PathLike[str]]) -> Manifest:
        """Return the manifest of some files, in their order.

        Raises
        ------
        RecordingError
            When one of them has no entry.
        """
        known = {
            path.resolve(): entry for path, entry in zip(self.files, self.entries, strict=True)
        }
        missing = [str(each) for each in files if Path(each).resolve() not in known]
        if missing:
            raise RecordingError(
                f"{len(missing)} of {len(files)} recordings have no entry in {self.path}, the "
                f"first {missing[0]}: add them there, or leave them out"
            )
        return replace(self, entries=tuple(known[Path(each).resolve()] for each in files))

    def text(self) -> str:
        """Return the manifest as TOML, from which `read_manifest` makes the same."""
        head = {
            "symmetry": self.symmetry,
            "centre": list(self.centre),
            **({"coordinates": list(self.coordinates)} if self.coordinates else {}),
        }
        return _HEAD + _lines(head) + "".join(_entry_text(entry) for entry in self.entries)


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

    Raises
    ------
    FileFormatError
        When it cannot be read, a column is unknown, an entry is missing or no number, a file is
        missing, or a place occurs twice.
    """
    given = Path(path)
    kind = given.suffix.lower()
    if kind == ".csv":
        manifest = Manifest(path=given, entries=csv_entries(read_text(given), str(given)))
    elif kind == ".toml":
        manifest = _from_toml(given, read_toml(given))
    else:
        raise FileFormatError(f"{given} ends in {kind!r}: give a manifest in .toml or .csv")
    if not manifest.entries:
        raise FileFormatError(f"{given} has no takes: add one for each recording")
    _require_files(manifest)
    return manifest


def recorded_so_far(path: Path) -> Manifest:
    """Read a manifest that is being written; one without takes where there is none yet.

    Takes whose files have gone are left out.
    """
    if not path.exists():
        return Manifest(path=path, entries=())
    manifest = _from_toml(path, read_toml(path))
    there = zip(manifest.files, manifest.entries, strict=True)
    return replace(manifest, entries=tuple(entry for file, entry in there if file.is_file()))


def _from_toml(path: Path, table: TomlTable) -> Manifest:
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
    missing = [str(path) for path in manifest.files if not path.is_file()]
    if missing:
        raise FileFormatError(
            f"{manifest.path}: {len(missing)} of {len(manifest.entries)} recordings are missing, "
            f"the first {missing[0]}: put them there, or take their entries out"
        )


def _require_alike(path: Path, entries: tuple[Entry, ...]) -> None:
    """Refuse takes without places among others, or with other numbers of coordinates."""
    for what in ("contact", "listeners"):
        without = [entry.file for entry in entries if not getattr(entry, what)]
        if without and len(without) < len(entries):
            raise FileFormatError(
                f"{path}: {len(without)} of {len(entries)} takes have no {what}, the first "
                f"{without[0]}: add it, or take those of the others out"
            )
    counts = sorted({len(entry.contact) for entry in entries})
    if len(counts) > 1:
        raise FileFormatError(
            f"{path}: contacts have {counts[0]} and {counts[1]} coordinates: give all as many"
        )


def _require_once(path: Path, entries: tuple[Entry, ...]) -> None:
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


def _distinct(places: Iterable[tuple[float, ...]]) -> list[tuple[float, ...]]:
    return list(dict.fromkeys(places))


def _entry_text(entry: Entry) -> str:
    told = {
        "file": entry.file,
        "contact": list(entry.contact),
        "listeners": [list(place) for place in entry.listeners],
        "hit": entry.hit,
        "sample_rate": entry.sample_rate,
        "lead_in": entry.lead_in,
        "peak": entry.peak,
        "above_noise": entry.above_noise,
        "note": entry.note,
    }
    given = {key: value for key, value in told.items() if value not in (None, "", [])}
    return "\n[[takes]]\n" + _lines(given)


def _lines(values: dict[str, object]) -> str:
    """Return TOML of numbers, text and lists: JSON writes these alike, but for one character."""
    texts = (
        (key, json.dumps(value, ensure_ascii=False, allow_nan=False).replace("\x7f", "\\u007f"))
        for key, value in values.items()
    )
    return "".join(f"{key} = {text}\n" for key, text in texts)
