"""Short pulses of force: their shapes, their spectra, and the samples that carry them.

A pulse lasts from 0 to its duration T. Half-sine and Hertz are powers of a sine, sin(pi t / T)^m
with m = 1 and 3/2, the forces of a linear spring and of the contact of two spheres (Johnson 1985,
section 11.4). The Gaussian has a standard deviation of T / 6, is cut at three of them, and has the
weakest treble of the three.

Samples cannot carry what lies above half their rate, and merely reading the force off at the
sample times would fold it down. So a pulse is read through a short low-pass,
F[k] = integral of F(t) h(k / rate - t) dt, which begins `LEAD` samples before the pulse does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np
from scipy.special import erf, gamma, gammaln, rgamma, wofz

from struck.errors import require_choice
from struck.model.arrays import Array, Complex

LEAD = 7  # samples that a sampled pulse begins before its onset
SOFTNESS = 3e-3  # s: six standard deviations of the Gaussian of 2002, whose width is not published

_FLATNESS = 7.5  # of the Kaiser window: 75 dB beyond 2/3 of the rate, flat up to 1/3
_OVERSAMPLING = 8
_GAUSSIAN_WIDTHS = 6.0  # standard deviations in a duration
_EDGE = _GAUSSIAN_WIDTHS / 2 / np.sqrt(2)
# Spectra are tabulated over frequency times duration; beyond the end they are below -95 dB.
_STEP, _TABLE_END = 1 / 128, 512.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """A force, sample by sample."""

    first: int  # number of its first sample; may be negative
    force: Array  # (n,), N


def sampled(
    shape: str, *, impulse: float, onset: float, duration: float, sample_rate: float
) -> Samples:
    """Return the band-limited samples of a pulse of area `impulse`, N s, at any onset, s."""
    # True to the analytic spectrum within 0.1 dB to a third of the rate; aliases below that are at
    # least 60 dB under the impulse.
    require_choice("shape", shape, SPECTRA)
    length = duration * sample_rate
    first = int(np.floor(onset * sample_rate)) - LEAD
    offset = onset * sample_rate - first
    count = int(np.ceil(offset + length)) + LEAD
    size = max(64, 1 << (count - 1).bit_length())
    bins = np.arange(size, dtype=np.float64)
    strengths = np.interp(bins * (length / size), *_table(shape), right=0.0)
    strengths *= low_pass_spectrum(size)
    delay: Complex = np.exp((-2j * np.pi / size * (offset + length / 2)) * bins)
    values = np.fft.irfft(_fold_spectrum(strengths * delay), size)[:count]
    return Samples(first=first, force=values * (impulse * sample_rate))


def softened(force: Samples, *, shape: str, duration: float, sample_rate: float) -> Samples:
    """Return a force each sample of which is spread over a pulse that begins with it.

    The impulse stays as it is (O'Brien et al. 2002, section 3.4: soft collisions).
    """
    from scipy.signal import oaconvolve

    pulse = sampled(shape, impulse=1.0, onset=0.0, duration=duration, sample_rate=sample_rate)
    forces = oaconvolve(force.force, pulse.force / pulse.force.sum())
    return Samples(first=force.first + pulse.first, force=np.asarray(forces, np.float64))


def low_pass(positions: Array) -> Array:
    """Return the low-pass h at positions in samples: a sinc in a Kaiser window of +-`LEAD`."""
    window_argument = np.clip(1 - np.square(positions / LEAD), 0, None)
    window = np.i0(_FLATNESS * np.sqrt(window_argument)) / np.i0(_FLATNESS)
    return np.where(np.abs(positions) < LEAD, np.sinc(positions) * window, 0.0)


@cache
def low_pass_spectrum(size: int) -> Array:
    """Return the spectrum of the low-pass at 0, 1/size, ... (size - 1)/size of the rate."""
    positions = np.arange(-LEAD * _OVERSAMPLING, LEAD * _OVERSAMPLING + 1) / _OVERSAMPLING
    fine = np.zeros(size * _OVERSAMPLING)
    fine[np.round(positions * _OVERSAMPLING).astype(int)] = low_pass(positions)
    spectrum = np.fft.rfft(fine).real[:size]
    return spectrum / spectrum[0]


def _fold_spectrum(spectrum: Complex) -> Complex:
    """Return the spectrum of samples (half the rate) from one up to the rate, aliases added."""
    half = len(spectrum) // 2
    half_spectrum = spectrum[: half + 1].copy()
    half_spectrum[1:] += np.conj(spectrum[: half - 1 : -1])
    return half_spectrum


@cache
def _table(shape: str) -> tuple[Array, Array]:
    """Return frequencies times duration, and the spectrum of a pulse of unit area there."""
    cycles = np.arange(0, _TABLE_END + _STEP, _STEP)
    return cycles, SPECTRA[shape](cycles)


def _sine_spectrum(power: float) -> Callable[[Array], Array]:
    """Return the real spectrum, about its middle, of sin^power of unit area over f T."""
    # With b = 2 f T and m the power, the integral of F(t) exp(-2 pi i f t) dt is
    # Gamma(1 + m/2)^2 / (Gamma(1 + (m + b)/2) Gamma(1 + (m - b)/2)) exp(-i pi b / 2)
    # (Gradshteyn & Ryzhik, 3.631).
    scale = gamma(1 + power / 2) ** 2

    def spectrum(cycles: Array) -> Array:
        low_cycles = np.minimum(cycles, 2.0)
        low = rgamma(1 + power / 2 + low_cycles) * rgamma(1 + power / 2 - low_cycles)
        # Far out one of the two overflows: Gamma(x) Gamma(1 - x) = pi / sin(pi x) replaces it.
        high_cycles = np.maximum(cycles, 2.0)
        fall = np.exp(gammaln(high_cycles - power / 2) - gammaln(1 + power / 2 + high_cycles))
        high = fall * np.sin(np.pi * (high_cycles - power / 2)) / np.pi
        return scale * np.where(cycles < 2, low, high)

    return spectrum


def _gaussian_spectrum(cycles: Array) -> Array:
    """Return exp(-y^2) Re erf(x + i y) / erf(x), written with w(z) so that no term overflows."""
    rise = np.sqrt(2) * np.pi * cycles / _GAUSSIAN_WIDTHS
    cut = np.exp(-(_EDGE**2) - 2j * _EDGE * rise) * wofz(1j * _EDGE - rise)
    return (np.exp(-(rise**2)) - cut.real) / erf(_EDGE)


SPECTRA = MappingProxyType(
    {"half-sine": _sine_spectrum(1.0), "hertz": _sine_spectrum(1.5), "gaussian": _gaussian_spectrum}
)
