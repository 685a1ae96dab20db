"""Takes: what was recorded, from files or samples."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from struck.errors import FileFormatError, MissingDependencyError, RecordingError
from struck.files import wav
from struck.files.sound import Sound
from struck.model.arrays import Array, Mask

_RATES = (4000, 400_000)  # Hz
_SHORTEST = 0.1  # s
_TABLE = "a list of recordings, not one: give it alone, or as manifest= (--manifest)"
_OTHERS = {
    ".csv": _TABLE,
    ".toml": _TABLE,
    ".struck": "a model, not a recording of one: give sound files",
    ".sofa": "a file of gains or responses, not a recording: give sound files",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Take:
    """Samples of one or several microphones, with one hit or several.

    Parameters
    ----------
    samples : array (channels, n)
        In any unit; for files 1.0 is full scale. One channel may come as (n,).
    sample_rate : int
        Hz.
    name : str
        What to call it in messages.

    Raises
    ------
    RecordingError
        When samples are not (channels, n) finite numbers, are silent or shorter than 0.1 s, or the
        rate is none that sound is recorded at.
    """

    samples: Array
    sample_rate: int
    name: str = "the take"

    def __post_init__(self) -> None:
        samples = np.array(self.samples, dtype=float, ndmin=2)
        object.__setattr__(self, "samples", samples)
        _require_sound(samples, self.sample_rate, self.name)
        samples.setflags(write=False)

    @classmethod
    def of(cls, sound: Sound, name: str = "the take") -> Take:
        """Take a sound."""
        return cls(samples=sound.samples.astype(float), sample_rate=sound.sample_rate, name=name)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Take:
        """Read a WAV, FLAC or AIFF file.

        Raises
        ------
        FileFormatError
            When it cannot be read, is cut short or is no such file.
        MissingDependencyError
            When it is none of the WAV files that struck reads itself, and soundfile is missing.
        RecordingError
            When no model can come from what it holds.
        """
        samples, sample_rate = _read(Path(path))
        return cls(samples=samples, sample_rate=sample_rate, name=str(path))

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.samples.shape[1] / self.sample_rate

    @property
    def channels(self) -> int:
        """Number of microphones."""
        return len(self.samples)


def require_one_rate(takes: list[Take]) -> None:
    """Refuse takes of different sample rates."""
    for take in takes[1:]:
        if take.sample_rate != takes[0].sample_rate:
            raise RecordingError(
                f"{take.name} was recorded at {take.sample_rate} Hz, {takes[0].name} at "
                f"{takes[0].sample_rate}: fit them one by one, or convert one of them"
            )


def _require_sound(samples: Array, sample_rate: float, name: str) -> None:
    if not _RATES[0] <= sample_rate <= _RATES[1]:
        raise RecordingError(
            f"{name} has a sample rate of {sample_rate} Hz: give one of {_RATES[0]} to {_RATES[1]}"
        )
    if samples.ndim != 2 or samples.shape[1] < _SHORTEST * sample_rate:
        raise RecordingError(
            f"{name} has shape {samples.shape}: give (channels, n) with at least {_SHORTEST} s, "
            f"n = {_SHORTEST * sample_rate:.0f}"
        )
    wrong = np.count_nonzero(~np.isfinite(samples))
    if wrong:
        first = int(np.argmax(~np.isfinite(samples).all(axis=0)))
        raise RecordingError(
            f"{wrong} samples of {name} are not finite numbers, the first at "
            f"{first / sample_rate:.4f} s: record or export it again"
        )
    silent = [str(number) for number, channel in enumerate(samples, 1) if not np.ptp(channel)]
    if silent:
        raise RecordingError(
            f"{name} is silent in channel {', '.join(silent)}: leave the channel out, or check the "
            "microphone and record again"
        )


def _read(path: Path) -> tuple[Array, int]:
    """Return samples (C, n) and rate; plain WAV without soundfile, which accepts cut files."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {error.strerror or error}") from error
    _require_lossless(path, data[:3])
    if data[:4] == b"RIFF":
        recording, rest = _read_wav(data, path)
        if recording is not None:
            return recording.samples.astype(float), recording.sample_rate
    else:
        rest = f"{path} is no WAV file"
    return _read_other(path, rest)


def _require_lossless(path: Path, head: bytes) -> None:
    """Refuse models, lists, gains and MP3 before a sound library looks at them."""
    kind = path.suffix.lower()
    if kind in _OTHERS:
        raise FileFormatError(f"{path} is {_OTHERS[kind]}")
    synchronised = len(head) > 1 and head[0] == 0xFF and head[1] >= 0xE0
    if kind == ".mp3" or head == b"ID3" or synchronised:
        raise FileFormatError(
            f"{path} is an MP3 file, which leaves out what rings softly: record WAV or FLAC, or "
            "convert it to one of them"
        )


def _read_wav(data: bytes, path: Path) -> tuple[wav.Recording | None, str]:
    """Return what a WAV file holds, or why soundfile has to read it."""
    try:
        return wav.decode(data, str(path)), ""
    except FileFormatError as error:
        if "convert it to one of" not in str(error):
            raise
        return None, str(error)


def _read_other(path: Path, reason: str) -> tuple[Array, int]:
    try:
        import soundfile
    except ImportError as error:
        raise MissingDependencyError(
            f"{reason}; to read others: pip install struck[recordings]"
        ) from error
    try:
        with soundfile.SoundFile(path) as file:
            announced, rate = file.frames, file.samplerate
            samples = np.asarray(file.read(dtype="float64", always_2d=True), float).T
    except (soundfile.SoundFileError, RuntimeError, TypeError) as error:
        raise FileFormatError(
            f"{path} is no sound file that is read ({error}): convert it to WAV or FLAC"
        ) from error
    if samples.shape[1] < announced:
        raise FileFormatError(
            f"{path} is cut short: it should have {announced} samples and has {samples.shape[1]}"
        )
    return samples, rate


_PULSE, _AFTER = 0.002, 0.1  # half of a blow, and from its peak until all is quiet again, s
_SHORT = 0.8  # least share of the energy in the pulse
_PUSHED = 0.8  # least share of one sign: a blow does not pull


def force_channels(take: Take) -> Mask:
    """Return which channels (C,) hold the force of a hammer: pulses of one sign; never all."""
    found = np.array([_is_force(channel, take.sample_rate) for channel in take.samples])
    return found & ~found.all()


def without_force(take: Take) -> Take:
    """Return a take without its force channels."""
    force = force_channels(take)
    if not force.any():
        return take
    return Take(samples=take.samples[~force], sample_rate=take.sample_rate, name=take.name)


def _is_force(channel: Array, sample_rate: int) -> bool:
    centred = channel - np.median(channel)
    energy = centred**2
    peak = int(np.argmax(energy))
    width = round(_PULSE * sample_rate)
    first = max(0, peak - width)
    pulse, whole = energy[first : peak + width], energy[first : peak + round(_AFTER * sample_rate)]
    one_sided = np.abs((np.sign(centred[first : peak + width]) * pulse).sum())
    return bool(pulse.sum() > _SHORT * whole.sum() and one_sided > _PUSHED * pulse.sum())
