"""Sound files by their ending: WAV by our own writer, FLAC, OGG, AIFF and MP3 by soundfile.

WAV needs no package, and keeps the factor of its level in a comment that every program leaves be.
"""

from __future__ import annotations

import io
import os
import re
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from struck.errors import FileFormatError, MissingDependencyError, OptionError, rounded
from struck.files import wav
from struck.files.atomic import ended, open_ordinary, read_bytes, require_readable
from struck.files.guard import read_foreign
from struck.files.messages import Answer, Frame, ReadingLimits
from struck.model.arrays import AnyArray

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
_FRAMES_AT_ONCE = 2**18
_Result = TypeVar("_Result")


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

    def encode(is_stopped: Callable[[], bool]) -> None:
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
            for start in range(0, samples.shape[1], _FRAMES_AT_ONCE):
                if is_stopped():
                    return
                file.write(samples[:, start : start + _FRAMES_AT_ONCE].T)

    try:
        _run_in_thread(encode)
    except RuntimeError as error:
        reason = re.sub("Error opening <.*?>: |Error : ", "", str(error)).rstrip(".")
        raise OptionError(
            f"{name} does not take {len(samples)} channels at {recording.sample_rate} Hz "
            f"({reason}): give one or two at 44100 or 48000 Hz, or end the file in .wav"
        ) from error
    return data.getvalue()


def decoded(data: bytes, ending: str, name: str = "the file") -> wav.Recording:
    """Return the samples in the bytes that `encoded` made."""
    if ending == ".wav":
        return wav.decode(data, name)
    soundfile = _soundfile(_FORMATS[ending][0])

    def decode(_is_stopped: Callable[[], bool]) -> wav.Recording:
        with soundfile.SoundFile(io.BytesIO(data)) as file:
            samples = np.ascontiguousarray(file.read(dtype="float32", always_2d=True).T)
            rate, comment = int(file.samplerate), str(file.comment)
        return wav.Recording(samples=samples, sample_rate=rate, comment=comment)

    return _run_in_thread(decode)


def _run_in_thread(work: Callable[[Callable[[], bool]], _Result]) -> _Result:
    """Return the result of work in a thread; the argument of `work` returns whether to stop.

    Signals interrupt the main thread alone: soundfile drops what is raised in its callbacks.
    """
    from concurrent.futures import ThreadPoolExecutor

    stop = threading.Event()
    with ThreadPoolExecutor(1) as threads:
        try:
            result = threads.submit(work, stop.is_set)
        except RuntimeError:  # while Python ends there are no new threads
            return work(stop.is_set)
        try:
            return result.result()
        finally:
            stop.set()


def load_recording(path: str | os.PathLike[str]) -> wav.Recording:
    """Read a sound file; FileFormatError on a damaged or another file, or beyond the limits."""
    ending = Path(path).suffix.lower()
    if ending not in _FORMATS or ending == ".wav":
        return wav.decode(read_bytes(path), str(path))
    require_readable(path)
    try:
        sound = read_coded(path, "float32")
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    if sound.problem:
        raise FileFormatError(f"{path} cannot be read as a sound ({sound.problem}): copy it again")
    return wav.Recording(
        samples=sound.samples, sample_rate=sound.sample_rate, comment=sound.comment
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CodedSound:
    """What soundfile reads from a file."""

    samples: AnyArray  # (C, n), in single or double precision
    sample_rate: int  # Hz
    comment: str
    frames: int  # number of samples of a channel that the file states
    problem: str  # why it is no sound; "" where it is one


def read_coded(path: str | os.PathLike[str], precision: str) -> CodedSound:
    """Read a file by soundfile, in the process that reads foreign files.

    FileFormatError, without the file's name, on one beyond the limits.
    """
    _soundfile(_FORMATS.get(Path(path).suffix.lower(), ("other", {}))[0])
    return read_foreign(
        "sound", path, _sound_of, advice="cut it into parts", options={"precision": precision}
    )


def _sound_of(frame: Frame) -> CodedSound:
    """Return the sound that an answer holds."""
    (samples,), content = frame.arrays, frame.content
    return CodedSound(
        samples=samples,
        sample_rate=int(content["rate"]),
        comment=str(content["comment"]),
        frames=int(content["frames"]),
        problem=str(content["problem"]),
    )


def answer(path: Path, limits: ReadingLimits, *, precision: str) -> Answer:
    """Return the samples of a sound file as an answer, in `precision`, a name of NumPy's."""
    dtype = np.dtype(precision)
    content: dict[str, Any] = {"rate": 0, "comment": "", "frames": 0, "problem": ""}
    soundfile = _soundfile("these")
    try:
        with open_ordinary(path) as raw, soundfile.SoundFile(raw) as file:
            channels, largest = file.channels, limits.answer // dtype.itemsize
            content |= {"rate": int(file.samplerate), "frames": int(file.frames)}
            content["comment"] = str(file.comment)
            # A file may state more than it holds, and pack silence a thousand to one.
            pieces: list[AnyArray] = []
            size = 0
            while len(piece := file.read(_FRAMES_AT_ONCE, dtype=precision, always_2d=True)):
                size += piece.size
                if size > largest:
                    raise FileFormatError(
                        f"it holds more than {largest:,} samples of its {channels} channels, and "
                        "no more are read: cut it into parts"
                    )
                pieces.append(piece.T)
    except (RuntimeError, TypeError) as error:  # soundfile's errors, and of raw samples
        reason = re.sub("Error opening <.*?>: |Error : ", "", str(error)).rstrip(".")
        return {**content, "problem": reason}, [np.zeros((0, 0), dtype)]
    samples = np.empty((channels, size // channels), dtype)
    start = 0
    while pieces:  # each piece is let go as soon as it is copied
        piece = pieces.pop(0)
        samples[:, start : start + piece.shape[1]] = piece
        start += piece.shape[1]
    return content, [samples]


def _soundfile(name: str) -> Any:  # noqa: ANN401 - a module
    try:
        import soundfile
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"{name} files need soundfile: pip install 'struck[recordings]', or end it in .wav"
        ) from error
    return soundfile
