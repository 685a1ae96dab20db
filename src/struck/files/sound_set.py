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

from struck.errors import ArgumentError, FileFormatError, OptionError, article
from struck.files.atomic import write_bytes
from struck.files.sound import PEAK, Sound
from struck.files.sound_formats import chosen, decoded
from struck.model.arrays import checked, require_number

TABLE = "set.csv"
# dB, within which a file keeps the level of its sound; coders leave out what is not heard.
_KEPT, _CODED = 0.1, 1.0
_OF_A_STRIKE = ("at", "striker", "speed", "impulse", "direction")
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
    """Write sounds with one common level, so that their differences of loudness stay.

    Parameters
    ----------
    sounds : mapping of str to Sound, or pairs of them
        By the names of their files, without an ending.
    folder : path
        Made where it is missing.
    strikes : sequence of Strike
        One for each sound, for the columns "at", "striker" and so on of the table "set.csv".
    level : float, optional
        Pressure that is full scale, Pa; else the loudest peak is 1 dB below it.
    encoding : str, optional
        "float32" (unless given, where the format has it), "int24" or "int16".
    ending : str
        ".wav", ".flac", ".ogg", ".aiff" or ".mp3".

    Returns
    -------
    list of dict
        The rows of the table: name, file, strike, seconds, peak and its unit, level of the peak in
        the file (dB of full scale, None for silence) and the pressure that is full scale.

    Raises
    ------
    OptionError
        On no sounds, two of one name, units that differ, or a file that would not keep its level
        within 0.1 dB, or in OGG and MP3, which leave out what is not heard, 1 dB.
    FileFormatError
        When the folder cannot be made or written.
    """
    given: Any = sounds.items() if isinstance(sounds, Mapping) else sounds
    pairs: list[tuple[str, Sound]] = _pairs(given)
    _require_names([name for name, _ in pairs])
    every = [sound for _, sound in pairs]
    if len({sound.calibrated for sound in every}) > 1:
        raise OptionError("some sounds are in Pa and some relative: save them as two sets")
    if strikes and len(strikes) != len(every):
        raise OptionError(f"{len(strikes)} strikes and {len(every)} sounds: give one for each")
    if level is None:
        level = max(sound.peak for sound in every) / PEAK or 1.0
    require_number("level", level, above=True, wanted="give a pressure above 0", unit=" Pa")
    written = Path(f"sound{ending if ending.startswith('.') else f'.{ending}'}")
    suffix, how = chosen(written, encoding)
    files = {f"{name}{suffix}": sound.encoded(1 / level, suffix, how) for name, sound in pairs}
    _require_levels(files, every, level, how)
    _make(Path(folder))
    for file, data in files.items():
        write_bytes(Path(folder) / file, data)
    rows = [
        {
            "name": name,
            "file": f"{name}{suffix}",
            **_columns(strikes[number] if strikes else None),
            "seconds": sound.duration,
            "peak": sound.peak,
            "unit": "Pa" if sound.calibrated else "relative",
            "level_db": 20 * float(np.log10(sound.peak / level)) if sound.peak else None,
            "full_scale": level,
        }
        for number, (name, sound) in enumerate(pairs)
    ]
    _write_table(rows, Path(folder) / TABLE)
    return rows


def _pairs(given: Any) -> list[tuple[str, Sound]]:  # noqa: ANN401 - a mapping or pairs, checked here
    pairs = list(given) if isinstance(given, Iterable) else [given]
    for each in pairs:
        named = isinstance(each, tuple | list) and len(each) == 2
        if not (named and isinstance(each[0], str) and isinstance(each[1], Sound)):
            raise ArgumentError(f"sounds hold {article(type(each).__name__)}: give {{name: Sound}}")
    return pairs


def _require_names(names: Sequence[str]) -> None:
    if not names:
        raise OptionError("there are 0 sounds: give at least one, by its name")
    taken: dict[str, str] = {}
    for name in names:
        if not _NAME.fullmatch(name) or name != name.strip(". "):
            raise OptionError(f"no file can be called {name!r}: give 1 to 120 letters, without /")
        other = taken.setdefault(name.casefold(), name)
        if list(names).count(name) > 1 or other != name:
            raise OptionError(f"two sounds are called {name!r} and {other!r}: rename one of them")


def _require_levels(
    files: Mapping[str, bytes], sounds: Sequence[Sound], level: float, encoding: str
) -> None:
    """Refuse files that do not keep the level of their sound, as read again."""
    if encoding == "float32":
        return
    for (file, data), sound in zip(files.items(), sounds, strict=True):
        kept = decoded(data, Path(file).suffix, file).samples.astype(np.float64) * level
        before, after = (
            float(np.sum(np.square(each, dtype=np.float64))) for each in (sound.samples, kept)
        )
        off = 10 * np.log10(max(after, 1e-300) / before) if before else 0.0
        most = _CODED if Path(file).suffix in {".ogg", ".mp3"} else _KEPT
        if abs(off) > most:
            below = 20 * np.log10(level / sound.peak)
            change = f"change its level by {off:+.2g} dB, more than {most:g}"
            raise OptionError(
                f"{file} peaks {below:.1f} dB below full scale ({level:.3g} Pa), and {encoding} "
                f"would {change if after else 'leave silence of it'}: save the set as WAV in "
                "float32, which holds any level, or its soft and its loud sounds as two sets"
            )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(
            f"the folder {folder} cannot be made ({reason}): give another name, "
            "in a folder that is there"
        ) from error


def _columns(strike: Any) -> dict[str, Any]:  # noqa: ANN401 - excitations of any kind
    """Return the columns of a strike, numbers of a place with spaces between."""
    told = {}
    for name in _OF_A_STRIKE:
        value: Any = getattr(strike, name, None)
        several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
        told[name] = " ".join(f"{each:.6g}" for each in value) if several else value
    return told


def _write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_bytes(path, text.getvalue().encode())
