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
from struck.excitation.pulses import SOFTNESS, Samples, softened
from struck.excitation.roughness import Finish
from struck.excitation.scraping_force import Reader, Tool, force_variation
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
    """A given force over time at one contact of a body.

    A simulated force is harder than that of soft bodies, and smoother than that of rough
    ones. `kernel` smooths the force, and `roughness` adds the noise of a surface that moves
    past the contact (O'Brien et al. 2002, section 3.4).

    Parameters
    ----------
    force : array-like (n,), str or Path
        The force, or a WAV file of one channel.
    at : str, array-like or None, default None
        Contact: a point in body coordinates, m, or a name such as "top", "rim" or "vertex:120".
        None: the playing place of the body (see `ModalModel.contact`).
    sample_rate : float or None, default None
        Sample rate, Hz, which an array needs. None: that of the file.
    gain : float, default 1.0
        N per 1.0 of the array, or per full scale of the file.
    time : float, default 0.0
        Start, s, rounded to the nearest sample.
    direction : array-like (3,) or None, default None
        Direction of a positive force, of any length. None: straight into the surface.
    patch : float, default 0.0
        Radius of the area of contact, m; 0 for a point.
    kernel : {"gaussian", "half-sine", "hertz"} or None, default None
        Pulse over which each sample of the force is spread, at the sample rate of the sound. It
        begins with its sample, and the impulse stays. None: the force as it is.
    softness : float or None, default None
        Duration of the kernel, s; six standard deviations of a Gaussian. None: 3 ms.
    roughness : str, Roughness, Profile or None, default None
        Finish of a surface that moves past the contact while the track pushes: its noise, as of a
        `Scrape` whose load is the force of the track, is added. Negative forces have none.
    speed : float, (times, values), function or None, default None
        Speed of that surface, m/s (see `struck.excitation.excitation`).
    striker : str, default "steel"
        Striker whose material and radius the tip on that surface has.
    radius : float or None, default None
        Radius of the tip, m. None: that of the striker.
    seed : int, default 0
        Seed of that surface.

    Raises
    ------
    OptionError
        If forces are not finite, the sample rate is missing, a name is unknown, a number is out of
        range, there is a softness without a kernel, or only one of roughness and speed.
    FileFormatError
        If the file cannot be read, is not a WAV file, or has several channels.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> push = 5.0 * np.hanning(480)
    >>> track = struck.ForceTrack(force=push, sample_rate=48_000, at="middle")
    >>> sound = struck.render(model, track, seconds=0.5)
    >>> sound.peak > 0
    True
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
        """Begin the excitation on a model.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate of the forces, Hz.
        start : int, default 0
            Number of the first sample; negative for a prelude.

        Returns
        -------
        Burst
            The excitation at work, which returns its pushes block by block.

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
        """Resample the force, without frequencies above half the sample rate.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.

        Returns
        -------
        Samples
            The force, N.
        """
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
