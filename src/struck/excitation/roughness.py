"""Roughness: how high a surface is along a line, over metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from safetensors.numpy import load

from struck.errors import OptionError
from struck.excitation.excitation import (
    require_at_least_zero,
    require_known,
    require_positive,
    table_of,
)
from struck.model.arrays import Array, checked

_FEWEST, _MOST = 16, 1 << 18
# A fractal repeats after so many of its longest waves, and has so many points in its shortest.
_WAVES, _POINTS_A_WAVE = 64, 2.5
# Longer waves than this are form, which what slides over it follows in silence; the second widest
# cut-off of ISO 21920.
_WAVINESS = 2.5e-3
_SEAM = 0.05


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roughness:
    """A height profile that repeats.

    Parameters
    ----------
    heights : array (n,)
        m, their mean 0; the last is followed by the first.
    pitch : float
        Distance from one to the next, m.
    name : str
        What people call it.
    source : str
        Where it comes from.

    Raises
    ------
    OptionError
        On heights that are not finite, fewer than 16 or more than 262,144 of them, or a pitch
        that does not exceed 0.
    """

    heights: Array
    pitch: float
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        require_positive(pitch=self.pitch)
        heights = np.array(self.heights, dtype=np.float64)
        if heights.ndim != 1 or not _FEWEST <= len(heights) <= _MOST:
            raise OptionError(
                f"heights have shape {heights.shape}: give {_FEWEST} to {_MOST} in one row"
            )
        if not np.isfinite(heights).all():
            wrong = np.count_nonzero(~np.isfinite(heights))
            raise OptionError(f"{wrong} heights are not finite: fill the gaps first")
        heights -= heights.mean()
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @classmethod
    @checked
    def fractal(
        cls,
        *,
        rms: float,
        exponent: float,
        shortest: float,
        longest: float,
        seed: int = 0,
        name: str = "fractal",
        source: str = "",
    ) -> Roughness:
        """Make a random profile without a scale of its own between two wavelengths.

        Parameters
        ----------
        rms : float
            Root of the mean square height, m.
        exponent : float
            The power spectrum falls as the wavenumber to the power of -`exponent`: 0 is white, 2
            like a random walk.
        shortest, longest : float
            Bounds of its wavelengths, m.
        seed : int
            Of the random phases.
        name, source : str
            As in the class.

        Raises
        ------
        OptionError
            On numbers outside their bounds, or wavelengths too far apart for a table.
        """
        require_positive(rms=rms, shortest=shortest, longest=longest)
        require_at_least_zero(exponent=exponent, seed=seed)
        count = 2 * round(_WAVES * _POINTS_A_WAVE * longest / shortest / 2)
        if not shortest < longest or count > _MOST:
            raise OptionError(
                f"shortest is {shortest} m and longest {longest} m: longest must exceed shortest, "
                f"at most {_MOST / _WAVES / _POINTS_A_WAVE:.0f} times"
            )
        waves = np.arange(count // 2 + 1, dtype=np.float64)
        inside = (waves >= _WAVES) & (waves <= count / _POINTS_A_WAVE)
        sizes = np.where(inside, np.maximum(waves, 1) ** (-exponent / 2), 0.0)
        phases = np.random.default_rng(int(seed)).uniform(0, 2 * np.pi, len(waves))
        heights = np.fft.irfft(sizes * np.exp(1j * phases), count)
        heights *= rms / heights.std()
        pitch = shortest / _POINTS_A_WAVE
        return cls(heights=heights, pitch=pitch, name=name, source=source)

    @classmethod
    @checked
    def named(cls, name: str) -> Roughness:
        """Look a roughness up in ``roughness.toml``, in any case.

        Measured profiles lose waves longer than 2.5 mm, which are form rather than roughness, and
        are joined to repeat.

        Raises
        ------
        OptionError
            When there is none of that name; the nearest are offered.
        """
        return _known(require_known(name, roughnesses(), "roughness"))

    @property
    def length(self) -> float:
        """After which it repeats, m."""
        return len(self.heights) * self.pitch

    @property
    def rms(self) -> float:
        """Root of the mean square height, m."""
        return float(self.heights.std())

    def over(self, length: float, count: int) -> Array:
        """Return `count` heights over another `length`, m, joined so that they repeat after it."""
        places = np.arange(count, dtype=np.float64) * (length / count)
        seam = np.clip((places / length - 1 + _SEAM) / _SEAM, 0, 1) * (np.pi / 2)
        return np.cos(seam) * self._at(places) + np.sin(seam) * self._at(places - length)

    def _at(self, places: Array) -> Array:
        own = np.arange(len(self.heights)) * self.pitch
        return np.interp(places, own, self.heights, period=self.length)


def roughnesses() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of roughnesses by name."""
    return table_of("roughness")


def profile(roughness: str | Roughness) -> Roughness:
    """Return a roughness given by name or as it is."""
    return Roughness.named(roughness) if isinstance(roughness, str) else roughness


@cache
def _known(name: str) -> Roughness:
    entry = dict(roughnesses()[name])
    if "pitch" not in entry:
        return Roughness.fractal(name=name, **entry)
    data = resources.files("struck.excitation").joinpath("roughness.safetensors").read_bytes()
    heights = load(data)[name] * entry["step"]
    raw = Roughness(heights=heights, pitch=entry["pitch"])
    joined = raw.over(raw.length * (1 - _SEAM), round(len(heights) * (1 - _SEAM)))
    waves = np.fft.rfftfreq(len(joined), raw.pitch)
    return Roughness(
        heights=np.fft.irfft(np.fft.rfft(joined) * (waves >= 1 / _WAVINESS), len(joined)),
        pitch=raw.pitch,
        name=name,
        source=entry["source"],
    )
