"""A force track: a force that was recorded, computed elsewhere, or made up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, OptionError
from struck.excitation.excitation import (
    Burst,
    Course,
    follow,
    freeze_place,
    frozen,
    require_at_least_zero,
    require_finite,
    require_kernel,
    require_positive,
)
from struck.excitation.friction import Reader, Tool, force_variation
from struck.excitation.pulses import SOFTNESS, Samples, softened
from struck.excitation.roughness import Finish
from struck.excitation.texture import CHUNK
from struck.files.atomic import read_bytes
from struck.files.wav import decode
from struck.model.arrays import Array, checked
from struck.model.contact import Place
from struck.model.model import ModalModel

# Samples of silence put before a track, so that resampling may ring ahead of it.
_LEAD_SAMPLES = 16
_MAX_DENOMINATOR = 1 << 16
_BLOCK_SAMPLES = 750 * CHUNK  # samples of a surface that are read at once


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceTrack:
    """A given force at one place of a body.

    The force of a simulation is harder than soft bodies are, and smoother than rough ones. `kernel`
    spreads it, and `roughness` adds what a surface that moves past adds to it (O'Brien et al. 2002,
    section 3.4).

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
    kernel : str or None
        The pulse that each sample of the force is spread over, at the sample rate of the sound:
        "gaussian", "half-sine" or "hertz" (`struck.excitation.pulses`). It begins with its sample,
        and the impulse stays. None leaves the force as it is.
    softness : float or None
        How long the kernel lasts, s; of a Gaussian, six standard deviations. None takes 3 ms.
    roughness : str, Roughness, Profile or None
        Of a surface that moves past the place while the track pushes: its noise, as of a `Scrape`
        whose load is the force of the track, is added. Pulls have none.
    speed : float, (times, values), function or None
        How fast that surface moves past, m/s; see `struck.excitation.excitation`.
    striker : str
        Of what the tip on that surface is, a name in ``strikers.toml``.
    radius : float or None
        Of the tip, m; None takes the striker's.
    seed : int
        Which surface of this finish it is.

    Raises
    ------
    OptionError
        On forces that are not finite, no sample rate, an unknown name, a number outside its bound,
        a softness without a kernel, or one of roughness and speed without the other.
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
    kernel: str | None = None
    softness: float | None = None
    roughness: str | Finish | None = None
    speed: Course | None = None
    striker: str = "steel"
    radius: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        freeze_place(self, "direction")
        object.__setattr__(self, "kernel", require_kernel(self.kernel, self.softness))
        self._require_surface()
        require_positive(sample_rate=self.sample_rate)
        require_finite(gain=self.gain)
        require_at_least_zero(time=self.time, patch=self.patch)
        samples, rate = _read_force(self.force, self.sample_rate)
        samples.setflags(write=False)
        object.__setattr__(self, "force", samples)
        object.__setattr__(self, "sample_rate", rate)

    def _require_surface(self) -> None:
        tool = self._tool()
        if self.roughness is not None and self.speed is None:
            raise OptionError(
                f"roughness is {self.roughness!r} and nothing moves: give the speed= at which the "
                "surface moves past, in m/s"
            )
        for name, value in (("speed", self.speed), ("radius", self.radius)):
            if self.roughness is None and value is not None:
                raise OptionError(
                    f"{name} is {value}, but on which surface? add a roughness, such as "
                    "roughness='wood', or leave it out"
                )
        if self.speed is not None:
            object.__setattr__(self, "roughness", tool.roughness)
            object.__setattr__(self, "speed", frozen("speed", self.speed))

    def _tool(self) -> Tool:
        """Return the tip, and the surface that moves past it; wood if no roughness is given."""
        roughness = "wood" if self.roughness is None else self.roughness
        return Tool(roughness=roughness, striker=self.striker, radius=self.radius, seed=self.seed)

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
        if self.speed is not None:
            noise = self._noise(samples, model, sample_rate)
            samples = replace(samples, force=samples.force + noise)
        return Burst.at(contact, samples, model, patch=self.patch, start=start)

    def sampled(self, sample_rate: float) -> Samples:
        """Return the force at a `sample_rate`, Hz, in N, without frequencies above its half."""
        forces = np.asarray(self.force, np.float64) * self.gain
        lead_count, values = _resample(forces, float(self.sample_rate or sample_rate), sample_rate)
        track = Samples(first=round(self.time * sample_rate) - lead_count, force=values)
        if self.kernel is None:
            return track
        duration = self.softness or SOFTNESS
        return softened(track, shape=self.kernel, duration=duration, sample_rate=sample_rate)

    def _noise(self, samples: Samples, model: ModalModel, sample_rate: float) -> Array:
        """Return the force of the surface under the pushes of the track, N (n,)."""
        loads = np.maximum(samples.force, 0.0)
        start_samples = np.arange(0, len(loads), CHUNK)
        # The largest load around a control point counts, so that no blow falls between two of them.
        max_loads = np.maximum.reduceat(loads, start_samples)
        control_loads = np.maximum(np.append(max_loads, 0.0), np.append(0.0, max_loads))
        control_samples = np.append(start_samples, start_samples[-1] + CHUNK)
        times = np.maximum(0.0, (samples.first + control_samples) / sample_rate - self.time)
        speed = follow("speed", self.speed or 0.0)
        speeds = np.array([speed(time) for time in times.tolist()])
        reader = Reader(self._tool().on(model), sample_rate)
        compressions, distance = np.empty(len(loads)), 0.0
        for first in range(0, len(loads), _BLOCK_SAMPLES):
            numbers = np.arange(first, min(first + _BLOCK_SAMPLES, len(loads)))
            rows = slice(first // CHUNK, numbers[-1] // CHUNK + 2)
            paces = np.interp(numbers, control_samples[rows], speeds[rows])
            distances = distance + np.cumsum(paces) / sample_rate
            points = np.zeros((len(distances), 3))
            points[:, 0] = distances
            compressions[numbers] = reader.compressions(
                0, points, distances, speeds[rows], control_loads[rows]
            )
            distance = float(distances[-1])
        return force_variation(compressions, loads)


def _read_force(force: ArrayLike | str | Path, sample_rate: float | None) -> tuple[Array, float]:
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
        raise OptionError(
            "sample_rate is missing: give the number of forces per second in the array"
        )
    samples = np.array(force, dtype=np.float64)
    if samples.ndim != 1 or not len(samples):
        raise OptionError(f"force has shape {samples.shape}: give a row of forces in N")
    invalid_count = np.count_nonzero(~np.isfinite(samples))
    if invalid_count:
        raise OptionError(
            f"{invalid_count} of {len(samples)} forces are not finite: mend the gaps first"
        )
    return samples, float(sample_rate)


def _resample(samples: Array, source_rate: float, target_rate: float) -> tuple[int, Array]:
    """Return how many samples before the track it now begins, and the samples."""
    if source_rate == target_rate:
        return 0, samples
    from scipy.signal import resample_poly

    ratio = Fraction(target_rate / source_rate).limit_denominator(_MAX_DENOMINATOR)
    periods = -(-_LEAD_SAMPLES // ratio.denominator)
    silence = np.zeros(periods * ratio.denominator)
    padded_samples = np.concatenate([silence, samples, silence])
    values = resample_poly(
        padded_samples, ratio.numerator, ratio.denominator, window=("kaiser", 9.0)
    )
    return periods * ratio.numerator, np.asarray(values, np.float64)
