"""Sound: samples that travel with their rate."""

from __future__ import annotations

import base64
import html
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, rounded
from struck.files import wav
from struck.files.atomic import read_bytes, write_bytes
from struck.model.arrays import Array, checked, require_number

LARGEST = float(np.finfo(np.float32).max)  # of a sample
_CHANNELS = 256  # more than any sound has
FULL_SCALE = 20.0  # Pa, that level="absolute" writes as 1.0
_SOFTEST_SCALE = 1e-12  # Pa, the least that may be full scale
PEAK = 10 ** (-1 / 20)  # of level="peak": -1 dB of full scale


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sound:
    """Samples with their rate.

    Parameters
    ----------
    samples : array (channels, n), float32
        Pressure in Pa when `calibrated`, else relative. One channel may come as (n,).
    sample_rate : int
        Hz.
    calibrated : bool
        Whether the samples are Pa.
    notes : tuple of str
        What a listener should know: what was left out, and how much.

    Raises
    ------
    OptionError
        On samples that are not finite or not (channels, n), or a sample rate below 1.
    """

    samples: NDArray[np.float32]
    sample_rate: int
    calibrated: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):
            samples = np.array(self.samples, dtype=np.float32, ndmin=2)
        if samples.ndim != 2 or not samples.size:
            raise OptionError(
                f"samples have shape {samples.shape}: give (channels, n) with at least one sample"
            )
        if len(samples) > _CHANNELS > samples.shape[1]:
            raise OptionError(
                f"samples have shape {samples.shape}, and channels come first: give samples.T"
            )
        bad_count = np.count_nonzero(~np.isfinite(samples))
        if bad_count:
            raise OptionError(
                f"{bad_count} of {samples.size} samples are not finite, or beyond the range of "
                f"32-bit numbers ({rounded(LARGEST, 2)}): fill the gaps, or scale the samples"
            )
        if not (self.sample_rate >= 1 and float(self.sample_rate).is_integer()):
            raise OptionError(f"sample_rate is {self.sample_rate}: give a whole number of Hz")
        samples.setflags(write=False)
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "sample_rate", int(self.sample_rate))

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> Sound:
        """Read the sound file at `path`: WAV (32-bit float, 24 or 16 bit), FLAC, OGG, AIFF or MP3.

        A file that `save` wrote comes back in its own unit, by the factor in its comment; of any
        other 1.0 is full scale.

        Raises
        ------
        FileFormatError
            When the file cannot be read or is no such sound.
        MissingDependencyError
            When soundfile, which reads all but WAV, is not installed.
        """
        from struck.files.sound_formats import decoded

        recording = decoded(read_bytes(path), Path(path).suffix.lower(), str(path))
        factor, calibrated = _read_level(recording.comment)
        # The factor of a sound near the least 32-bit number is itself beyond their range.
        samples = (recording.samples / np.float64(factor)).astype(np.float32)
        return cls(samples=samples, sample_rate=recording.sample_rate, calibrated=calibrated)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.samples.shape[0]

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.samples.shape[1] / self.sample_rate

    @property
    def peak(self) -> float:
        """Largest absolute sample, Pa or relative; 0 for silence."""
        return float(np.abs(self.samples).max(initial=0.0))

    @checked
    def save(
        self, path: str | os.PathLike[str], level: str | float = "peak", encoding: str | None = None
    ) -> float:
        """Write a sound file of the kind that its ending says, whole or not at all.

        Parameters
        ----------
        path : path
            Where to; its folder must exist. Its ending is .wav, or .flac, .ogg, .aiff or .mp3,
            which soundfile writes.
        level : str or float
            "peak" puts the maximum at -1 dB of full scale (silence stays silence), so that soft
            and hard blows come out equally loud; a pressure in Pa is full scale, 1.0 (for several
            sounds see `struck.files.save_set`); "absolute" takes 20 Pa.
        encoding : str, optional
            "float32", "int24" or "int16" where the format has them; its best unless given.

        Returns
        -------
        float
            What the samples were multiplied by; the file's comment holds it too.

        Raises
        ------
        OptionError
            On an unknown ending, level or encoding, an absolute level for a sound that is not
            calibrated, or samples that an encoding would clip or leave silence of.
        FileFormatError
            When the file cannot be written.
        MissingDependencyError
            When soundfile is needed and not installed.
        """
        from struck.files.sound_formats import chosen

        ending, encoding_name = chosen(path, encoding)
        factor = self._factor(level)
        step = {"int16": 2.0**-15, "int24": 2.0**-23}.get(encoding_name, 0.0)
        if 0 < self.peak * factor < step / 2:
            peak, smallest = 20 * np.log10(self.peak * factor), 20 * np.log10(step)
            raise OptionError(
                f"{encoding_name} would leave silence of it: its peak is at {peak:.0f} dB of full "
                f"scale, and a step of {encoding_name} at {smallest:.0f} dB: give "
                "encoding='float32', or another level="
            )
        write_bytes(path, self.encoded(factor, ending, encoding_name))
        return factor

    def encoded(self, factor: float, ending: str = ".wav", encoding: str = "float32") -> bytes:
        """Return a file's bytes: samples times `factor`; `ending` and `encoding` as in `save`."""
        from struck.files.sound_formats import encoded

        recording = wav.Recording(
            samples=(self.samples * np.float64(factor)).astype(np.float32),
            sample_rate=self.sample_rate,
            comment=_LEVEL.format(factor=factor, unit="Pa" if self.calibrated else "relative"),
        )
        return encoded(recording, ending, encoding)

    def spectrum(self) -> tuple[Array, Array]:
        """Return frequencies, Hz (B,), and the Fourier transform's modulus, Pa s (channels, B)."""
        values: Array = np.abs(np.fft.rfft(self.samples.astype(np.float64))) / self.sample_rate
        return _bins(self.samples.shape[1], self.sample_rate), values

    @checked
    def spectrogram(self, window: float = 0.04, step: float = 0.005) -> tuple[Array, Array, Array]:
        """Return how the spectrum goes on in time, through a Hann window.

        Parameters
        ----------
        window : float
            Length of the window, s: frequencies closer than 2 / `window` run together.
        step : float
            From one window to the next, s.

        Returns
        -------
        times : array (T,)
            Middles of the windows, s; the sound is taken as silent before and after.
        frequencies : array (B,)
            Hz.
        amplitudes : array (channels, B, T)
            A steady sine of amplitude a shows as a.
        """
        size, hop = _samples(self, window=window), _samples(self, step=step)
        count = -(-self.samples.shape[1] // hop) + 1
        padded_samples = np.zeros((self.channels, (count - 1) * hop + size))
        padded_samples[:, size // 2 : size // 2 + self.samples.shape[1]] = self.samples
        hann = np.sin(np.pi * np.arange(size) / size) ** 2
        pieces = np.lib.stride_tricks.sliding_window_view(padded_samples, size, axis=1)[:, ::hop]
        amplitudes = np.abs(np.fft.rfft(pieces * hann)) * 2 / hann.sum()
        times: Array = np.arange(count) * hop / self.sample_rate
        return times, _bins(size, self.sample_rate), amplitudes.swapaxes(1, 2)

    def _factor(self, level: str | float) -> float:
        if level == "peak":
            return PEAK / self.peak if self.peak else 1.0
        hint = "give 'peak', 'absolute', or the pressure in Pa that is full scale"
        if isinstance(level, str) and level != "absolute":
            raise OptionError(f"level is {level!r}: {hint}")
        full_scale = FULL_SCALE if level == "absolute" else level
        require_number("level", full_scale, _SOFTEST_SCALE, hint=hint, unit=" Pa")
        if not self.calibrated:
            raise OptionError(
                "this sound is relative, so it has no absolute level: save with level='peak', or "
                "render a model that is calibrated"
            )
        return 1 / float(full_scale)

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.encoded(self._factor("peak"), encoding="int16")).decode()
        notes = "".join(f"<br>{html.escape(note)}" for note in self.notes)
        unit = f"{rounded(self.peak, 3)} Pa" if self.calibrated else "relative level"
        return (
            f'<audio controls src="data:audio/wav;base64,{data}"></audio><br><small>'
            f"{self.duration:.2f} s at {self.sample_rate} Hz, peak: {unit}{notes}</small>"
        )


_LEVEL = "struck: samples are pressure ({unit}) times {factor!r}"
_LEVEL_PATTERN = re.compile(r"struck: samples are pressure \((Pa|relative)\) times (\S+)")


def _read_level(comment: str) -> tuple[float, bool]:
    """Return the factor from samples to Pa in a WAV file's comment, and whether it is in Pa."""
    match = _LEVEL_PATTERN.fullmatch(comment)
    try:
        factor = float(match[2]) if match else 1.0
    except ValueError:
        return 1.0, False
    if not (np.isfinite(factor) and factor > 0):
        return 1.0, False
    return factor, match is not None and match[1] == "Pa"


_LONGEST_WINDOW = 60.0  # s


def _samples(sound: Sound, **seconds: float) -> int:
    ((name, value),) = seconds.items()
    hint = "it must hold at least one sample"
    require_number(name, value, 1 / sound.sample_rate, _LONGEST_WINDOW, hint=hint, unit=" s")
    return round(value * sound.sample_rate)


def _bins(length: int, sample_rate: int) -> Array:
    return np.arange(length // 2 + 1, dtype=np.float64) * (sample_rate / length)
