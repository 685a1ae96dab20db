"""Sets of sounds: files of one common level, with a table of their names and strikes."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import ArgumentError, OptionError, article, rounded
from struck.files.atomic import make_folder, write_bytes
from struck.files.sound import PEAK, Sound
from struck.files.sound_formats import chosen, decoded
from struck.model.arrays import checked, require_number

TABLE = "set.csv"
# dB, within which a file keeps the level of its sound; coders leave out what is not heard.
_LEVEL_TOLERANCE, _CODED_TOLERANCE = 0.1, 1.0
_OF_A_STRIKE = ("at", "striker", "speed", "impulse", "direction")
# Columns of strikes that are written if one has a value, and their defaults.
_OPTIONAL_COLUMNS: dict[str, Any] = {
    "energy": None,
    "duration": None,
    "shape": "half-sine",
    "listener": None,
}
_OPTIONAL_COLUMNS |= dict.fromkeys(("patch", "transient", "time", "seed"), 0)
OF_A_SOUND = ("file", "seconds", "peak", "unit", "level_db", "full_scale")
_NAME = re.compile(r"[^\\/:*?\"<>|\x00-\x1f]{1,120}")


@checked
def save_set(
    sounds: Mapping[str, Sound] | Iterable[tuple[str, Sound]],
    folder: str | os.PathLike[str],
    *,
    strikes: Sequence[Any] = (),
    level: float | None = None,
    encoding: str | None = None,
    ending: str = ".wav",
) -> list[dict[str, Any]]:
    """Write sounds with one common level, which keeps their differences of loudness.

    Parameters
    ----------
    sounds : mapping of str to Sound, or iterable of pairs
        Sounds by the names of their files, without an ending.
    folder : path
        Folder, which is created if it does not exist.
    strikes : sequence of Strike, or of (Strike, listener position), default ()
        One for each sound, for the columns of the table "set.csv", which `struck render --strikes`
        reads: "at", "striker" and other arguments that were given.
    level : float, optional
        Pressure of full scale, Pa. Default: the loudest peak is 1 dB below full scale.
    encoding : {"float32", "int24", "int16"}, optional
        Encoding. Default: "float32", if the format has it.
    ending : str, default ".wav"
        ".wav", ".flac", ".ogg", ".aiff" or ".mp3".

    Returns
    -------
    list of dict
        The rows of the table: name, file, strike, seconds, peak and its unit, level of the peak in
        the file (dB of full scale, None for silence) and the pressure that is full scale.

    Raises
    ------
    OptionError
        If there are no sounds, two have one name, units differ, or a file would not keep its level
        within 0.1 dB (1 dB in OGG and MP3, which omit inaudible parts).
    FileFormatError
        If the folder cannot be created or written.
    """
    items: Any = sounds.items() if isinstance(sounds, Mapping) else sounds
    pairs: list[tuple[str, Sound]] = _pairs(items)
    require_names([name for name, _ in pairs])
    sound_list = [sound for _, sound in pairs]
    if len({sound.calibrated for sound in sound_list}) > 1:
        raise OptionError("some sounds are in Pa and some relative: save them as two sets")
    if strikes and len(strikes) != len(sound_list):
        raise OptionError(f"{len(strikes)} strikes and {len(sound_list)} sounds: give one for each")
    if level is None:
        level = max(sound.peak for sound in sound_list) / PEAK or 1.0
    require_number("level", level, above=True, hint="give a pressure above 0", unit=" Pa")
    example = Path(f"sound{ending if ending.startswith('.') else f'.{ending}'}")
    suffix, sound_encoding = chosen(example, encoding)
    files = {
        f"{name}{suffix}": sound.encoded(1 / level, suffix, sound_encoding) for name, sound in pairs
    }
    _require_levels(files, sound_list, level, sound_encoding)
    place = make_folder(folder)
    for file, data in files.items():
        write_bytes(place / file, data)
    rows = []
    for (name, sound), columns in zip(pairs, _columns(strikes or [None] * len(pairs)), strict=True):
        unit = "Pa" if sound.calibrated else "relative"
        peak_level = 20 * float(np.log10(sound.peak / level)) if sound.peak else None
        values = (f"{name}{suffix}", sound.duration, sound.peak, unit, peak_level, level)
        file, *others = zip(OF_A_SOUND, values, strict=True)
        rows.append({"name": name, **dict([file]), **columns, **dict(others)})
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([rows[0], *(row.values() for row in rows)])
    write_bytes(place / TABLE, text.getvalue().encode())
    return rows


def _pairs(sounds: Any) -> list[tuple[str, Sound]]:  # noqa: ANN401 - a mapping or pairs, checked here
    pairs = list(sounds) if isinstance(sounds, Iterable) else [sounds]
    for pair in pairs:
        is_pair = isinstance(pair, tuple | list) and len(pair) == 2
        if not (is_pair and isinstance(pair[0], str) and isinstance(pair[1], Sound)):
            raise ArgumentError(f"sounds hold {article(type(pair).__name__)}: give {{name: Sound}}")
    return pairs


def require_names(names: Sequence[str], kind: str = "sound", table: str = "") -> None:
    """Refuse names that no file can have, and two of one name, by the numbers of their rows."""
    if not names:
        raise OptionError("there are 0 sounds: give at least one, by its name")
    numbers: dict[str, int] = {}
    for number, name in enumerate(names, start=1):
        row = f"{kind} {number}{table}"
        if not _NAME.fullmatch(name) or name != name.strip(". "):
            raise OptionError(
                f"no file can be called {name!r}, as {row} is: give 1 to 120 letters, without /"
            )
        first = numbers.setdefault(name.casefold(), number)
        if first != number:
            raise OptionError(
                f"{kind} {first} is called {names[first - 1]!r} and {row} {name!r}, which are "
                "one file: rename one of them"
            )


def _require_levels(
    files: Mapping[str, bytes], sounds: Sequence[Sound], level: float, encoding: str
) -> None:
    """Refuse files that do not keep the level of their sound, as read again."""
    if encoding == "float32":
        return
    for (file, data), sound in zip(files.items(), sounds, strict=True):
        samples = decoded(data, Path(file).suffix, file).samples.astype(np.float64) * level
        energy, coded_energy = (
            float(np.sum(np.square(values, dtype=np.float64)))
            for values in (sound.samples, samples)
        )
        change_db = 10 * np.log10(max(coded_energy, 1e-300) / energy) if energy else 0.0
        tolerance = _CODED_TOLERANCE if Path(file).suffix in {".ogg", ".mp3"} else _LEVEL_TOLERANCE
        if abs(change_db) > tolerance:
            depth = 20 * np.log10(level / sound.peak)
            decibels = rounded(change_db, 3, sign=True)
            change = f"change its level by {decibels} dB, more than {rounded(tolerance)}"
            loss = change if coded_energy else "leave silence of it"
            raise OptionError(
                f"{file} peaks {depth:.1f} dB below full scale ({rounded(level, 3)} Pa), and "
                f"{encoding} would {loss}: save the set as WAV in float32, which holds any level, "
                "or its soft and its loud sounds as two sets"
            )


def _columns(strikes: Sequence[Any]) -> list[dict[str, Any]]:
    """Return the columns of strikes, numbers of a place with spaces between."""
    rows = []
    for item in strikes:
        strike, listener = item if isinstance(item, tuple) else (item, None)
        columns: dict[str, Any] = dict.fromkeys(_OF_A_STRIKE) | _OPTIONAL_COLUMNS
        columns = {name: getattr(strike, name, default) for name, default in columns.items()}
        columns["listener"] = listener
        for name, value in columns.items():
            is_sequence = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
            columns[name] = " ".join(f"{float(n)!r}" for n in value) if is_sequence else value
        rows.append(columns)
    unused_names = {
        name
        for name, default in _OPTIONAL_COLUMNS.items()
        if all(row[name] == default for row in rows)
    }
    return [{name: row[name] for name in row if name not in unused_names} for row in rows]
