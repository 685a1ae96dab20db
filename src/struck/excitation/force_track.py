"""A force track: a force that was recorded, computed elsewhere, or made up."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, OptionError
from struck.excitation.excitation import (
    Burst,
    freeze_place,
    require_at_least_zero,
    require_finite,
    require_positive,
)
from struck.excitation.pulses import Samples
from struck.files.atomic import read_bytes
from struck.files.wav import decode
from struck.model.arrays import Array, checked
from struck.model.contact import Place
from struck.model.model import ModalModel

# Samples of silence put before a track, so that resampling may ring ahead of it.
_AHEAD = 16
_COARSEST_RATIO = 1 << 16


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceTrack:
    """A given force at one place of a body.

    Parameters
    ----------
    at : array-like, str or None
        Place, as for a strike.
    force : array-like (n,), str or Path
        The force, or a WAV file of one channel.
    sample_rate : float or None
        Of an array, Hz; a file knows its own.
    gain : float
        N for each 1.0 of the array, or for full scale of the file.
    time : float
        When it begins, s; moved to the nearest sample.
    direction : array-like (3,) or None
        Which way a positive force pushes, of any length; None is straight into the surface.
    patch : float
        Radius of the area of contact, m; 0 is a point.

    Raises
    ------
    OptionError
        On forces that are not finite, no sample rate, or a number outside its bound.
    FileFormatError
        When the file cannot be read, is no WAV file, or has several channels.
    """

    force: ArrayLike | str | Path
    at: Place = None
    sample_rate: float | None = None
    gain: float = 1.0
    time: float = 0.0
    direction: Place = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        freeze_place(self, "direction")
        require_positive(sample_rate=self.sample_rate)
        require_finite(gain=self.gain)
        require_at_least_zero(time=self.time, patch=self.patch)
        samples, rate = _given(self.force, self.sample_rate)
        samples.setflags(write=False)
        object.__setattr__(self, "force", samples)
        object.__setattr__(self, "sample_rate", rate)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`.

        Raises
        ------
        ContactError
            When it touches no body.
        """
        require_positive(sample_rate=sample_rate)
        contact = model.contact(self.at, self.direction)
        samples = self.sampled(sample_rate)
        return Burst.at(contact, samples, model, patch=self.patch, start=start)

    def sampled(self, sample_rate: float) -> Samples:
        """Return the force at another sample rate, N; what that cannot carry is left out."""
        own = np.asarray(self.force, np.float64) * self.gain
        ahead, values = _resampled(own, float(self.sample_rate or sample_rate), sample_rate)
        return Samples(first=round(self.time * sample_rate) - ahead, force=values)


def _given(force: ArrayLike | str | Path, sample_rate: float | None) -> tuple[Array, float]:
    if isinstance(force, str | Path):
        if sample_rate is not None:
            raise OptionError(f"sample_rate is {sample_rate}: leave it out, {force} has its own")
        path = Path(force)
        recording = decode(read_bytes(path), path.name)
        channels = len(recording.samples)
        if channels != 1:
            raise FileFormatError(f"{path.name} has {channels} channels: a force has one; keep one")
        return recording.samples[0].astype(np.float64), float(recording.sample_rate)
    if sample_rate is None:
        raise OptionError("sample_rate is missing: say how many forces a second the array holds")
    samples = np.array(force, dtype=np.float64)
    if samples.ndim != 1 or not len(samples):
        raise OptionError(f"force has shape {samples.shape}: give a row of forces in N")
    wrong = np.count_nonzero(~np.isfinite(samples))
    if wrong:
        raise OptionError(f"{wrong} of {len(samples)} forces are not finite: mend the gaps first")
    return samples, float(sample_rate)


def _resampled(samples: Array, own: float, wanted: float) -> tuple[int, Array]:
    """Return how many samples before the track it now begins, and the samples."""
    if own == wanted:
        return 0, samples
    from scipy.signal import resample_poly

    ratio = Fraction(wanted / own).limit_denominator(_COARSEST_RATIO)
    periods = -(-_AHEAD // ratio.denominator)
    silence = np.zeros(periods * ratio.denominator)
    padded = np.concatenate([silence, samples, silence])
    values = resample_poly(padded, ratio.numerator, ratio.denominator, window=("kaiser", 9.0))
    return periods * ratio.numerator, np.asarray(values, np.float64)
