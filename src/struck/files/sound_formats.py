"""Sound files by their ending: WAV by our own writer, FLAC, OGG, AIFF and MP3 by soundfile.

WAV needs no package, and keeps the factor of its level in a comment that every program leaves be.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, MissingDependencyError, OptionError, rounded
from struck.files import wav
from struck.files.atomic import ended

# By ending: the format's name, and its encodings as libsndfile calls them, the best one first.
_INTEGERS = {"int24": "PCM_24", "int16": "PCM_16"}
_FORMATS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    ".wav": ("WAV", {"float32": "FLOAT", **_INTEGERS}),
    ".flac": ("FLAC", _INTEGERS),
    ".ogg": ("OGG", {"vorbis": "VORBIS"}),
    ".aiff": ("AIFF", {"float32": "FLOAT", **_INTEGERS}),
    ".aif": ("AIFF", {"float32": "FLOAT", **_INTEGERS}),
    ".mp3": ("MP3", {"mp3": "MPEG_LAYER_III"}),
}
ENDINGS = tuple(_FORMATS)


def chosen(path: str | os.PathLike[str], encoding: str | None = None) -> tuple[str, str]:
    """Return the ending of a sound file and its encoding, by default the format's best.

    Raises
    ------
    OptionError
        On an ending of no sound, or an encoding that the format does not have.
    MissingDependencyError
        Where soundfile is needed and not installed, or too old.
    """
    ending = Path(path).suffix.lower()
    if ending not in _FORMATS:
        raise OptionError(
            f"{os.fspath(path)} {ended(path)}: sounds end in {', '.join(ENDINGS)}, as "
            f"{Path(path).stem or 'sound'}.wav"
        )
    name, encodings = _FORMATS[ending]
    if encoding is not None and encoding not in encodings:
        raise OptionError(f"encoding is {encoding!r}: for {name} give {' or '.join(encodings)}")
    if ending != ".wav" and name not in _soundfile(name).available_formats():
        raise MissingDependencyError(
            f"the soundfile that is installed writes no {name}: pip install -U soundfile, or end "
            "the file in .wav"
        )
    return ending, encoding or next(iter(encodings))


def encoded(recording: wav.Recording, ending: str, encoding: str) -> bytes:
    """Return the bytes of a sound file of an ending and an encoding that `chosen` returned."""
    if ending == ".wav":
        return wav.encode(recording, encoding)
    name, encodings = _FORMATS[ending]
    samples = recording.samples.astype(np.float64)
    peak, bits = float(np.abs(samples).max(initial=0.0)), {"int24": 24, "int16": 16}
    if encoding in bits:  # rounded as in WAV files, so that both hold the same numbers
        full_scale = 2.0 ** (bits[encoding] - 1)
        samples = np.rint(samples * full_scale) / full_scale
    if encoding != "float32" and peak > 1 - 2.0**-15:
        raise OptionError(
            f"the peak is {rounded(peak, 4)} times full scale, which {name} would clip: save with "
            "level='peak' or a higher one in Pa, or as WAV in float32"
        )
    soundfile, data = _soundfile(name), io.BytesIO()
    try:
        with soundfile.SoundFile(
            data,
            "w",
            samplerate=recording.sample_rate,
            channels=len(samples),
            format=name,
            subtype=encodings[encoding],
        ) as file:
            with suppress(RuntimeError):  # not all formats have comments
                file.comment = recording.comment
            file.write(samples.T)
    except RuntimeError as error:
        reason = re.sub("Error opening <.*?>: |Error : ", "", str(error)).rstrip(".")
        raise OptionError(
            f"{name} does not take {len(samples)} channels at {recording.sample_rate} Hz "
            f"({reason}): give one or two at 44100 or 48000 Hz, or end the file in .wav"
        ) from error
    return data.getvalue()


def decoded(data: bytes, ending: str, name: str = "the file") -> wav.Recording:
    """Return the samples in the bytes of a sound file; FileFormatError if they are damaged."""
    if ending not in _FORMATS or ending == ".wav":
        return wav.decode(data, name)
    soundfile = _soundfile(_FORMATS[ending][0])
    try:
        with soundfile.SoundFile(io.BytesIO(data)) as file:
            samples: NDArray[np.float32] = file.read(dtype="float32", always_2d=True).T
            rate, comment = int(file.samplerate), str(file.comment)
    except RuntimeError as error:
        raise FileFormatError(
            f"{name} cannot be read as a sound ({error}): copy it again"
        ) from None
    return wav.Recording(samples=np.ascontiguousarray(samples), sample_rate=rate, comment=comment)


def _soundfile(name: str) -> Any:  # noqa: ANN401 - a module
    try:
        import soundfile
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"{name} files need soundfile: pip install 'struck[recordings]', or end it in .wav"
        ) from error
    return soundfile
