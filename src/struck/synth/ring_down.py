"""How modes answer short pushes: in closed form, exact at every sample and between samples.

A mode is a complex pole s = -d + 2 pi i f with a gain g; its answer to a unit impulse is
Im[g exp(s t)]. A half-sine push of duration T and unit area gives, with w = pi / T,

    c(t) = (w / 2) * integral from 0 to t of sin(w u) exp(s (t - u)) du    while it lasts,
    c(T) exp(s (t - T))                                                    afterwards.

Motion radiates, bending does not: a body that merely follows a slow push is silent. The sound is
therefore Im[g c'(t) / s], with c' = s c + F under the force F. Once the push is over that is Im[g
c(t)], as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import Array, Complex

_MODES_AT_ONCE = 1024
_VALUES_AT_ONCE = 1 << 20
# The least |s - i u| / u of a mode s and a pulse of the frequency u. The closed form loses digits
# nearer to it, so that the mode is moved away by as much.
_RESONANCE_DISTANCE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pulse:
    """A half-sine push, with the gain of each mode."""

    gains: Complex  # (M,), gain of each mode times the impulse
    onset: float  # s; sample 0 is at 0 s
    duration: float  # s; 0 is an ideal impulse

    @property
    def release(self) -> float:
        """Time at which the body is left to itself, s."""
        return self.onset + self.duration


def below_nyquist(frequencies: Array, sample_rate: float) -> NDArray[np.bool_]:
    """Return which modes lie below half the sample rate (M,); others would alias."""
    return np.asarray(frequencies) < sample_rate / 2


def ring_down(
    frequencies: Array, decays: Array, pulses: Sequence[Pulse], *, sample_rate: float, length: int
) -> Array:
    """Return the sound of modes (M,) under all pulses at 0, 1, 2 ... / sample_rate."""
    samples = np.zeros(length)
    if not pulses:
        return samples
    poles = -np.asarray(decays) + 2j * np.pi * np.asarray(frequencies)
    for first in range(0, len(poles), _MODES_AT_ONCE):
        modes = slice(first, first + _MODES_AT_ONCE)
        _add_pushes(samples, poles[modes], pulses, modes, sample_rate)
        _add_ringing(samples, poles[modes], pulses, modes, sample_rate)
    return samples


def pushed(poles: Complex, elapsed: Array | float, duration: float) -> Complex:
    """Return c(t) of modes under a half-sine push of unit area, `elapsed` s after it began."""
    # The sine is split into exp(i w u) and exp(-i w u), so that each integral is a divided
    # difference of exp: no cancellation where s is close to i w.
    sine_pole = 1j * np.pi / duration
    rising = np.exp(sine_pole * elapsed) * _growth((poles - sine_pole) * elapsed)
    falling = np.exp(-sine_pole * elapsed) * _growth((poles + sine_pole) * elapsed)
    return sine_pole / -4 * elapsed * (rising - falling)


def half_sine(elapsed: Array, duration: float) -> Array:
    """Return the force of a push of unit area at times since it began, 1/s."""
    return np.pi / (2 * duration) * np.sin(np.pi * elapsed / duration)


def released(poles: Complex, duration: float) -> Complex:
    """Return c(T): the state in which a half-sine push of unit area leaves the modes (M,)."""
    return pushed(poles, duration, duration) if duration else np.ones_like(poles)


def pulse_work(poles: Complex, duration: float) -> Array:
    """Return the work (M,) of a half-sine push of unit area on modes at rest of unit drive, J."""
    if not duration:
        return np.full(len(poles), 0.5)
    rate = np.pi / duration
    moved_poles = move_poles(poles, rate)
    factors = 1 - 1j * moved_poles.real / moved_poles.imag
    # The integral of F c, where c is the sum of three exponentials, of poles s, i u and -i u.
    squares = np.square(moved_poles) + rate**2
    growth = rate**2 * (1 + np.exp(moved_poles * duration)) / squares - moved_poles * duration / 2
    return np.real(factors * rate**2 / 4 * growth / squares)


def move_poles(poles: Complex, rate: float) -> Complex:
    """Return poles, those that a push of a rate, rad/s, meets moved away by a small step."""
    is_resonant = np.abs(poles - 1j * rate) < _RESONANCE_DISTANCE * rate
    return np.where(is_resonant, poles + 1j * _RESONANCE_DISTANCE * rate, poles)


def _growth(exponents: Complex) -> Complex:
    """Return (exp(z) - 1) / z, which is 1 at z = 0."""
    nonzero = np.where(exponents == 0, 1, exponents)
    return np.where(exponents == 0, 1, np.expm1(nonzero) / nonzero)


def _first_sample(time: float, sample_rate: float) -> int:
    """Return the first sample at or after a time; one that rounding moved past it still counts."""
    return int(np.ceil(time * sample_rate - 1e-9))


def _add_pushes(
    samples: Array, poles: Complex, pulses: Sequence[Pulse], modes: slice, sample_rate: float
) -> None:
    for pulse in pulses:
        first = _first_sample(pulse.onset, sample_rate)
        last = min(_first_sample(pulse.release, sample_rate), len(samples))
        for rows in _blocks(first, last, max(1, _VALUES_AT_ONCE // len(poles))):
            elapsed = np.arange(rows.start, rows.stop) / sample_rate - pulse.onset
            states = pushed(poles, elapsed[:, None], pulse.duration)
            moving = states + half_sine(elapsed, pulse.duration)[:, None] / poles
            samples[rows] += (moving @ pulse.gains[modes]).imag


def _blocks(first: int, last: int, size: int) -> Iterator[slice]:
    for start in range(first, last, size):
        yield slice(start, min(start + size, last))


def _add_ringing(
    samples: Array, poles: Complex, pulses: Sequence[Pulse], modes: slice, sample_rate: float
) -> None:
    """Carry one state through all releases and let it ring freely between them."""
    ordered_pulses = sorted(pulses, key=lambda pulse: pulse.release)
    start_samples = [_first_sample(pulse.release, sample_rate) for pulse in ordered_pulses]
    stops = [min(start, len(samples)) for start in start_samples[1:]] + [len(samples)]
    state, state_time = np.zeros_like(poles), 0.0
    for pulse, start, end in zip(ordered_pulses, start_samples, stops, strict=True):
        if start >= len(samples):
            break
        start_time = start / sample_rate
        release_states = pulse.gains[modes] * released(poles, pulse.duration)
        state = state * np.exp(poles * (start_time - state_time))
        state = state + release_states * np.exp(poles * (start_time - pulse.release))
        state_time = start_time
        samples[start:end] += _ring(state, poles, end - start, sample_rate)


def _ring(state: Complex, poles: Complex, length: int, sample_rate: float) -> Array:
    """Return Im[sum of state exp(s t)] by exp(s (p B + q)) = exp(s p B) exp(s q): one product.

    With B near the root of `length` only about 2 sqrt(length) exponentials a mode are needed.
    """
    block = max(1, int(np.sqrt(length)))
    blocks = -(-length // block)
    coarse: Complex = state * np.exp(np.outer(np.arange(blocks) * (block / sample_rate), poles))
    fine: Complex = np.exp(np.outer(poles, np.arange(block) / sample_rate))
    product = np.hstack([coarse.real, coarse.imag]) @ np.vstack([fine.imag, fine.real])
    return product.ravel()[:length]
