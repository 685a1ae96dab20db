"""Surfaces: how uneven a finish is, as the law of a random texture or as a measured profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from safetensors.numpy import load
from scipy.optimize import least_squares

from struck.errors import OptionError
from struck.excitation.excitation import require_known, require_positive
from struck.excitation.texture import Layers, fit_layers, variance
from struck.model.arrays import Array, checked, require_number
from struck.model.provenance import table_of

_MIN_HEIGHTS, _MAX_HEIGHTS = 16, 1 << 18
_MIN_RMS = 1e-13  # m: a thousandth of an atom; squares of far smaller heights are 0
_MIN_SLOPE, _MAX_SLOPE = -4.0, -1.2  # slopes
_MAX_WAVE_RATIO = 1e5  # times that the longest wave may exceed the shortest
_WAVES_PER_LENGTH = 16  # shortest waves per correlation length, by default
_WAVE_SPACING = 1.4  # spacing of a layer whose covariance is as wide as exp(-(s / length)^2)
# Abrasive paper: heights and correlation lengths in grains.
_GRAIN_HEIGHT, _GRAIN_LENGTH = 0.43, 1 / 3
# Longer waves than this are form, which what slides over it follows in silence; the second widest
# cut-off of ISO 21920.
_FORM_LENGTH = 2.5e-3
_SEAM_RATIO = 0.05
_MIN_POWER_RATIO = 3e-3  # of the power of the strongest waves: weaker ones are left out


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Roughness:
    """A surface finish: random heights on two scales, which never repeat.

    Roughness proper has the spectrum along a line

        S(k) = S0 (1 + (2 pi k correlation_length)^2)^(slope / 2),  k below 1 / shortest

    (the K-correlation or ABC model of profilometry: Church & Takacs, Proc. SPIE 1165, 136 (1989)),
    level for long waves and self-affine for short ones, of Hurst exponent -(1 + slope) / 2.
    Waviness has heights correlated as exp(-(s / waviness_length)^2). The numbers are those of an
    acoustic surface in the draft glTF extension ``KHR_audio_rigid_bodies`` (2026), in metres
    whatever the size of the body.

    Parameters
    ----------
    rms : float
        Root mean square height of the roughness, m.
    correlation_length : float
        Correlation length of the roughness, m.
    slope : float, default -2.4
        Exponent of its spectrum for short waves, -4 to -1.2.
    shortest : float or None, default None
        Shortest wavelength, m. None: a sixteenth of the correlation length.
    waviness : float, default 0.0
        Root mean square height of the waviness, m.
    waviness_length : float, default 0.002
        Correlation length of the waviness, m.
    name : str, default ""
        Name of the finish.
    source : str, default ""
        Source of the values.

    Raises
    ------
    OptionError
        If a number is out of range.

    Examples
    --------
    >>> finish = struck.Roughness.named("sandpaper")
    >>> finish.rms > struck.Roughness.named("steel").rms
    True
    >>> waves = np.geomspace(1e-2, 1e6, 20_000)  # cycles/m
    >>> variance = np.trapezoid(finish.spectrum(waves), waves)
    >>> bool(abs(variance / finish.rms**2 - 1) < 0.01)
    True
    """

    rms: float
    correlation_length: float
    slope: float = -2.4
    shortest: float | None = None
    waviness: float = 0.0
    waviness_length: float = 2e-3
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        require_number("rms", self.rms, _MIN_RMS, 1e-2)
        require_number("correlation_length", self.correlation_length, 1e-8, 1.0)
        require_number("slope", self.slope, _MIN_SLOPE, _MAX_SLOPE)
        require_number("waviness", self.waviness, 0.0, 1e-1)
        require_number("waviness_length", self.waviness_length, 1e-8, 10.0)
        longest = self.longest
        require_number("shortest", self.finest, longest / _MAX_WAVE_RATIO, longest)

    @classmethod
    @checked
    def named(cls, name: str) -> Roughness:
        """Look up a finish in ``roughness.toml``, in any case.

        Parameters
        ----------
        name : str
            Name, as listed by `struck.excitation.roughnesses`.

        Returns
        -------
        Roughness
            The finish.

        Raises
        ------
        OptionError
            If there is no such name. The nearest names are offered.
        """
        return _load_finish(require_known(name, roughnesses(), "roughness"))

    @classmethod
    def of(cls, given: str | Roughness) -> Roughness:
        """Return a finish, or look it up by name.

        Parameters
        ----------
        given : str or Roughness
            Finish, or its name.

        Returns
        -------
        Roughness
            The finish.
        """
        return cls.named(given) if isinstance(given, str) else given

    @property
    def finest(self) -> float:
        """The shortest wave of the texture, m."""
        return (
            self.correlation_length / _WAVES_PER_LENGTH if self.shortest is None else self.shortest
        )

    @property
    def longest(self) -> float:
        """The wave about which the spectrum bends, m."""
        return 2 * np.pi * self.correlation_length

    def spectrum(self, wavenumbers: Array) -> Array:
        """Compute the one-sided power spectral density of the roughness.

        Its integral is the mean square height.

        Parameters
        ----------
        wavenumbers : array (n,)
            Wavenumbers, cycles/m.

        Returns
        -------
        array (n,)
            Density, m^2 per cycle/m.
        """
        waves = np.concatenate([[0.0], np.geomspace(1e-4 / self.longest, 1 / self.finest, 2000)])
        integral = np.trapezoid(self._shape(waves), waves)
        wave_array = np.asarray(wavenumbers, np.float64)
        return np.where(
            wave_array <= 1 / self.finest, self.rms**2 / integral * self._shape(wave_array), 0.0
        )

    def _shape(self, wavenumbers: Array) -> Array:
        return (1 + np.square(wavenumbers * self.longest)) ** (self.slope / 2)

    def layers(self, seed: int = 0) -> Layers:
        """Generate the random texture of this finish.

        Parameters
        ----------
        seed : int, default 0
            Seed of the texture.

        Returns
        -------
        Layers
            The texture.
        """
        spacings, heights = _fit_layers(self)
        return Layers.of(spacings, heights, int(seed))


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """Heights along a line, measured or made, that are read as they are and so repeat.

    Parameters
    ----------
    heights : array (n,)
        Heights, m, with the mean 0; the last is followed by the first.
    pitch : float
        Distance between neighbouring heights, m.
    name : str, default ""
        Name of the profile.
    source : str, default ""
        Source of the heights.

    Raises
    ------
    OptionError
        If heights are not finite, fewer than 16 or more than 262,144, or the pitch is not positive.

    Examples
    --------
    >>> from struck.excitation import Profile
    >>> grooves = Profile(heights=1e-5 * np.sin(2 * np.pi * np.arange(64) / 16), pitch=1e-4)
    >>> scrape = struck.Scrape(path=["middle", "end"], speed=0.1, load=1.0, roughness=grooves)
    >>> scrape.roughness.pitch * len(scrape.roughness.heights)  # m, after which it repeats
    0.0064
    """

    heights: Array
    pitch: float
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        require_positive(pitch=self.pitch)
        heights = np.array(self.heights, dtype=np.float64)
        if heights.ndim != 1 or not _MIN_HEIGHTS <= len(heights) <= _MAX_HEIGHTS:
            raise OptionError(
                f"heights have shape {heights.shape}: give {_MIN_HEIGHTS} to {_MAX_HEIGHTS} in one "
                "row"
            )
        if not np.isfinite(heights).all():
            invalid_count = np.count_nonzero(~np.isfinite(heights))
            raise OptionError(f"{invalid_count} heights are not finite: fill the gaps first")
        heights -= heights.mean()
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @classmethod
    @checked
    def named(cls, name: str) -> Profile:
        """Look up a measured profile in ``profiles.toml``, in any case.

        Waves longer than 2.5 mm, which are form rather than roughness, are removed, and the ends
        are joined.

        Parameters
        ----------
        name : str
            Name, as listed by `struck.excitation.profiles`.

        Returns
        -------
        Profile
            The profile.

        Raises
        ------
        OptionError
            If there is no such name. The nearest names are offered.
        """
        return _load_profile(require_known(name, profiles(), "profile"))

    @property
    def length(self) -> float:
        """Length after which the profile repeats, m."""
        return len(self.heights) * self.pitch

    @property
    def rms(self) -> float:
        """Root of the mean square height, m."""
        return float(self.heights.std())

    def roughness(self) -> Roughness:
        """Estimate the finish whose spectrum is nearest to that of the profile.

        Returns
        -------
        Roughness
            The finish, which never repeats.

        Raises
        ------
        OptionError
            If the profile is flat.
        """
        if not self.rms:
            raise OptionError(f"the {len(self.heights)} heights are all the same: give a profile")
        from scipy.signal import welch

        waves, power = welch(self.heights, 1 / self.pitch, nperseg=min(len(self.heights), 8192))
        bins = np.digitize(waves, np.geomspace(waves[1] / 2, waves[-1], 60))
        groups = [bins == number for number in np.unique(bins[1:])]
        means = np.array([(waves[group].mean(), power[group].mean()) for group in groups])
        centres, powers = means[means[:, 1] > _MIN_POWER_RATIO * means[:, 1].max()].T
        levels = np.log(powers)

        def residuals(guess: Array) -> Array:
            top, length, slope = guess
            bend = np.log1p(np.square(2 * np.pi * np.exp(length) * centres))
            return top + slope / 2 * bend - levels

        min_log_length, max_log_length = np.log([self.pitch, self.length / 16])
        solution = least_squares(
            residuals,
            [levels.max(), (min_log_length + max_log_length) / 2, -2.0],
            bounds=([-np.inf, min_log_length, _MIN_SLOPE], [np.inf, max_log_length, _MAX_SLOPE]),
        )
        return Roughness(
            rms=self.rms,
            correlation_length=float(np.exp(solution.x[1])),
            slope=float(solution.x[2]),
            shortest=float(1 / centres.max()),
            name=self.name,
            source=self.source,
        )


Finish = Roughness | Profile


def roughnesses() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of finishes.

    Returns
    -------
    mapping of str to mapping
        Entries of ``roughness.toml`` by name.

    Examples
    --------
    >>> "sandpaper" in struck.excitation.roughnesses()
    True
    """
    return table_of("struck.excitation", "roughness")


def profiles() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of measured profiles.

    Returns
    -------
    mapping of str to mapping
        Entries of ``profiles.toml`` by name.
    """
    return table_of("struck.excitation", "profiles")


@cache
def _load_finish(name: str) -> Roughness:
    entry = dict(roughnesses()[name])
    grain = entry.pop("grain", None)
    if grain is not None:
        entry["rms"], entry["correlation_length"] = _GRAIN_HEIGHT * grain, _GRAIN_LENGTH * grain
    return Roughness(name=name, **entry)


@cache
def _fit_layers(finish: Roughness) -> tuple[Array, Array]:
    """Return spacings and heights (O,), m, of the layers of a finish."""
    spacings, heights = fit_layers(finish.spectrum, finish.finest, finish.longest)
    heights *= finish.rms / np.sqrt(variance() * np.square(heights).sum())
    if not finish.waviness:
        return spacings, heights
    waves = _WAVE_SPACING * finish.waviness_length, finish.waviness / np.sqrt(variance())
    return np.append(spacings, waves[0]), np.append(heights, waves[1])


@cache
def _load_profile(name: str) -> Profile:
    entry = dict(profiles()[name])
    data = resources.files("struck.excitation").joinpath("roughness.safetensors").read_bytes()
    heights = load(data)[name] * entry["step"]
    raw = Profile(heights=heights, pitch=entry["pitch"])
    joined_heights = _join_ends(
        raw, raw.length * (1 - _SEAM_RATIO), round(len(heights) * (1 - _SEAM_RATIO))
    )
    waves = np.fft.rfftfreq(len(joined_heights), raw.pitch)
    return Profile(
        heights=np.fft.irfft(
            np.fft.rfft(joined_heights) * (waves >= 1 / _FORM_LENGTH), len(joined_heights)
        ),
        pitch=raw.pitch,
        name=name,
        source=entry["source"],
    )


def _join_ends(profile: Profile, length: float, count: int) -> Array:
    """Return heights (count,) over another length, m, joined so that they repeat after it."""
    profile_positions = np.arange(len(profile.heights)) * profile.pitch
    positions = np.arange(count, dtype=np.float64) * (length / count)
    end_heights, start_heights = (
        np.interp(at, profile_positions, profile.heights, period=profile.length)
        for at in (positions, positions - length)
    )
    seam = np.clip((positions / length - 1 + _SEAM_RATIO) / _SEAM_RATIO, 0, 1) * (np.pi / 2)
    return np.cos(seam) * end_heights + np.sin(seam) * start_heights


def finish(source: str | Finish) -> Finish:
    """Return the finish for a name, or a given finish unchanged."""
    return Roughness.named(source) if isinstance(source, str) else source
