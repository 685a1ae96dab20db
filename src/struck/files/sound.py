"""Sound: samples that travel with their rate."""

from __future__ import annotations

import base64
import html
import os
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, rounded
from struck.files import wav
from struck.files.atomic import write_bytes
from struck.model.arrays import Array, checked, require_number

LARGEST = float(np.finfo(np.float32).max)  # of a sample
_CHANNELS = 256  # more than any sound has
FULL_SCALE = 20.0  # Pa, that level="absolute" writes as 1.0
_SOFTEST_SCALE = 1e-12  # Pa, the least that may be full scale
PEAK = 10 ** (-1 / 20)  # of level="peak": -1 dB of full scale


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sound:
    """Samples with their sample rate.

    Parameters
    ----------
    samples : array (channels, n) or (n,), float32
        Pressure, Pa if `calibrated`, otherwise relative.
    sample_rate : int
        Sample rate, Hz.
    calibrated : bool, default False
        Whether the samples are in Pa.
    notes : tuple of str, optional
        Remarks for the listener, such as which modes were left out.

    Raises
    ------
    OptionError
        If samples are not finite or not of this shape, or the sample rate is below 1 Hz.

    Examples
    --------
    >>> time = np.arange(48_000) / 48_000
    >>> tone = struck.Sound(samples=0.1 * np.sin(2 * np.pi * 440 * time), sample_rate=48_000)
    >>> tone.samples.shape, round(tone.peak, 3)
    ((1, 48000), 0.1)
    >>> factor = tone.save("tone.wav")
    >>> struck.Sound.load("tone.wav").sample_rate
    48000
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
        if self.sample_rate < 1:
            raise OptionError(f"sample_rate is {self.sample_rate}: give a whole number of Hz")
        samples.setflags(write=False)
        object.__setattr__(self, "samples", samples)

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> Sound:
        """Read a sound file: WAV (32-bit float, 24 or 16 bit), FLAC, OGG, AIFF or MP3.

        A file that was written by `save` has its original unit, by the factor in its comment. In
        others, 1.0 is full scale.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Sound
            The sound.

        Raises
        ------
        FileFormatError
            If the file cannot be read or is not such a sound.
        MissingDependencyError
            If soundfile, which reads all but WAV, is not installed.
        """
        from struck.files.sound_formats import load_recording

        recording = load_recording(path)
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
        """Write a sound file, completely or not at all.

        Parameters
        ----------
        path : path
            The file, in a folder that exists. Its ending selects the format: .wav, or .flac, .ogg,
            .aiff or .mp3, which soundfile writes.
        level : str or float, default "peak"
            "peak": scale the maximum to -1 dB of full scale (silence stays silence), so that soft
            and hard strikes are equally loud. A number: pressure of full scale, Pa (for several
            sounds see `struck.files.save_set`). "absolute": 20 Pa.
        encoding : {"float32", "int24", "int16"}, optional
            Encoding of the samples, if the format has it. Default: the best of the format.

        Returns
        -------
        float
            Factor of the samples, which is also written to the comment of the file.

        Raises
        ------
        OptionError
            If the ending, level or encoding is unknown, an absolute level is requested for a sound
            that is not calibrated, or the encoding would clip samples or reduce them to silence.
        FileFormatError
            If the file cannot be written.
        MissingDependencyError
            If soundfile is needed and not installed.
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
        """Encode the sound as the bytes of a file.

        Parameters
        ----------
        factor : float
            Factor of the samples.
        ending : str, default ".wav"
            Format, as in `save`.
        encoding : str, default "float32"
            Encoding of the samples, as in `save`.

        Returns
        -------
        bytes
            Content of the file.
        """
        from struck.files.sound_formats import encoded

        recording = wav.Recording(
            samples=(self.samples * np.float64(factor)).astype(np.float32),
            sample_rate=self.sample_rate,
            comment=_LEVEL.format(factor=factor, unit="Pa" if self.calibrated else "relative"),
        )
        return encoded(recording, ending, encoding)

    def spectrum(self) -> tuple[Array, Array]:
        """Compute the magnitude of the Fourier transform.

        Returns
        -------
        tuple of array (B,), array (channels, B)
            Frequencies, Hz, and magnitudes, Pa s.
        """
        values: Array = np.abs(np.fft.rfft(self.samples.astype(np.float64))) / self.sample_rate
        return _bins(self.samples.shape[1], self.sample_rate), values

    @checked
    def spectrogram(self, window: float = 0.04, step: float = 0.005) -> tuple[Array, Array, Array]:
        """Compute the spectrum over time, with a Hann window.

        Parameters
        ----------
        window : float, default 0.04
            Duration of the window, s. Frequencies closer than 2 / `window` are not resolved.
        step : float, default 0.005
            Interval of the windows, s.

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
