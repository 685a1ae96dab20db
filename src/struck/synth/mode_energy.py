"""Energy of modes under forces: work of the forces, and energy in the sound.

A mode of mass 1 kg obeys q'' + 2 d q' + w0^2 q = f, with the modal force f = drive * force. With
the pole s = -d + i w and the state c' = s c + f, its velocity is q' = Re[(1 + i d / w) c] and its
displacement q = Im[c] / w. The work of the force is the integral of f q', and losses take 2 d times
the integral of q'^2: both are the same once the mode is at rest again.

The rendered sound of the mode is Im[g x] with x = c + f / s, in which a steady force is silent
(`struck.synth.ring_down`). Its energy, over all directions, follows from the integrals of |x|^2 and
of x^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.model.arrays import Array, Complex
from struck.synth.poles import held_states
from struck.synth.ring_down import Pulse, move_poles, released

_SMALL = 1e-3  # of |z t|, below which a series gives (exp(z t) - 1) / z to 1e-10


@dataclass(slots=True, kw_only=True, eq=False)
class ModeEnergies:
    """Integrals over time of modes that forces set moving."""

    inputs: Array  # (M,), energy that the forces put into each mode, J
    powers: Array  # (M,), integral of |x|^2, J
    squares: Complex  # (M,), integral of x^2, J
    hold_losses: Array  # (M,), lost to hands that hold the body, J
    sound_integral: float = 0.0  # Pa^2 s, of the sound of all modes squared, mean over directions

    @classmethod
    def none(cls, count: int) -> ModeEnergies:
        """Return the integrals of modes at rest."""
        inputs, powers, hold_losses = np.zeros((3, count))
        return cls(
            inputs=inputs,
            powers=powers,
            squares=np.zeros(count, np.complex128),
            hold_losses=hold_losses,
        )

    def radiated_energies(self, decays: Array, coherences: Complex) -> Array:
        """Return the energy in the sound of each mode alone (M,), J.

        `decays` (M,), 1/s, are those by sound. `coherences` (M,) are the means over directions of
        g^2, divided by those of |g|^2, of the gains g.
        """
        energies = self.powers - np.real(coherences * self.squares)
        return np.multiply(decays, energies, out=np.zeros_like(decays), where=decays > 0)


def energies_of_pulses(poles: Complex, pulses: Sequence[Pulse], outputs: Complex) -> ModeEnergies:
    """Return the energies of modes (M,) under half-sine pushes until they are at rest.

    The gains of the pulses are drive times impulse, kg^1/2 m/s; `outputs` (D, M) are those at
    listeners in D directions.
    """
    return _PulsedModes(poles, pulses, outputs).run()


class _PulsedModes:
    """Modes and the pushes on them, from one beginning or end of a push to the next.

    The motion x between two of them is a sum of exponentials, whose poles are those of the modes
    and of the pushes.
    """

    def __init__(self, poles: Complex, pulses: Sequence[Pulse], outputs: Complex) -> None:
        self._pulses = sorted(pulses, key=lambda pulse: pulse.onset)
        self._poles = poles
        for duration in {pulse.duration for pulse in pulses if pulse.duration}:
            self._poles = move_poles(self._poles, np.pi / duration)
        self._factors = 1 - 1j * poles.real / poles.imag
        self._outputs = outputs
        self._states = np.zeros_like(poles)  # of pushes that are over
        self._sums = ModeEnergies.none(len(poles))

    def run(self) -> ModeEnergies:
        """Return the energies until all is at rest."""
        edges = sorted({time for p in self._pulses for time in (p.onset, p.release)})
        waiting_pulses, active_pulses = self._pulses[::-1], list[Pulse]()
        for start, end in zip(edges, [*edges[1:], np.inf], strict=True):
            for pulse in [pulse for pulse in active_pulses if pulse.release <= start]:
                active_pulses.remove(pulse)
                self._states += pulse.gains * released(self._poles, pulse.duration)
            while waiting_pulses and waiting_pulses[-1].onset <= start:
                pulse = waiting_pulses.pop()
                if pulse.duration:
                    active_pulses.append(pulse)
                else:
                    self._take_impulse(pulse)
            self._pass(active_pulses, start, end)
        return self._sums

    def _take_impulse(self, pulse: Pulse) -> None:
        impulses = pulse.gains.real
        velocities = np.real(self._factors * self._states)
        self._sums.inputs += impulses * (velocities + impulses / 2)
        self._states = self._states + impulses

    def _pass(self, active_pulses: Sequence[Pulse], start: float, end: float) -> None:
        """Add the integrals from one time to the next, s, the last of which is infinite."""
        poles, seconds = self._poles, end - start
        modal_parts = self._states.copy()
        exponents, forced_parts, forces = [], [], []
        for pulse in active_pulses:
            rate, elapsed_time = np.pi / pulse.duration, start - pulse.onset
            scale = rate / 2 * pulse.gains / (np.square(poles) + rate**2)
            modal_parts += rate * scale * np.exp(poles * elapsed_time)
            for sign in (1, -1):
                phase_factor = np.exp(1j * sign * rate * elapsed_time)
                exponents.append(1j * sign * rate)
                forced_parts.append(
                    phase_factor * scale * rate / 2 * (-1 - 1j * sign * rate / poles)
                )
                forces.append(phase_factor * rate / (4j * sign) * pulse.gains)
        # Row 0 is of the modes' own poles, the others are of the pushes.
        parts = np.stack([modal_parts, *forced_parts])
        columns = np.stack([poles, *(np.full(len(poles), exponent) for exponent in exponents)])
        for first, exponent in zip(parts, columns, strict=True):
            for second_part, second_exponent in zip(parts, columns, strict=True):
                conjugate = np.conj(second_exponent)
                with np.errstate(invalid="ignore"):  # 0 or a real part times infinity
                    overlap = np.asarray(
                        first * np.conj(second_part) * _integral(exponent + conjugate, seconds)
                    )
                self._sums.powers += np.where(first * second_part == 0, 0.0, np.real(overlap))
                self._sums.squares += (
                    first * second_part * _integral(exponent + second_exponent, seconds)
                )
            for force, second_exponent in zip(forces, exponents, strict=True):
                overlap = first * force * _integral(exponent + second_exponent, seconds)
                self._sums.inputs += np.real(self._factors * overlap)
        self._add_sound(parts, exponents, seconds)
        if np.isfinite(seconds):
            self._states = self._states * np.exp(poles * seconds)

    def _add_sound(self, parts: Complex, exponents: Sequence[complex], seconds: float) -> None:
        """Add the sound of all modes together, in which those of a push have the same pole."""
        pulse_pressures = [self._outputs @ part for part in parts[1:]]
        pressures = np.concatenate(
            [self._outputs * parts[0], *(part[:, None] for part in pulse_pressures)], axis=1
        )
        all_poles = np.concatenate([self._poles, np.array(exponents, np.complex128)])
        self._sums.sound_integral += integrate_sound(
            pressures,
            _integral(all_poles[:, None] + np.conj(all_poles), seconds),
            _integral(all_poles[:, None] + all_poles, seconds),
        )


def integrate_sound(pressures: Complex, overlaps: Complex, squares: Complex) -> float:
    """Return the integral of the squared sound, a mean over directions, from overlaps (N, N).

    The sound in each of D directions is the imaginary part of the sum of N exponentials with the
    factors `pressures` (D, N). Overlaps are the integrals of products of an exponential with
    another's conjugate, squares of products without it.
    """
    count = len(pressures)
    means = pressures.T @ np.conj(pressures) / count, pressures.T @ pressures / count
    with np.errstate(invalid="ignore"):
        products = [
            np.where(m == 0, 0, m * i) for m, i in zip(means, (overlaps, squares), strict=True)
        ]
    return float(np.real(products[0] - products[1]).sum() / 2)


def _integral(exponents: Complex, seconds: float) -> Complex:
    """Return the integrals of exp(z t) from 0 to a time, s, which may be infinite."""
    if np.isinf(seconds):
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(exponents == 0, np.inf, -1 / exponents)
    phases = exponents * seconds
    is_small = np.abs(phases) < _SMALL
    safe_exponents = np.where(is_small, 1.0, exponents)
    series = seconds * (1 + phases / 2 * (1 + phases / 3))
    return np.where(is_small, series, (np.exp(phases) - 1) / safe_exponents)


class SampledMotion:
    """Motion of modes under sampled forces, as resonators step it."""

    def __init__(self, poles: Complex, sample_rate: float) -> None:
        self._rate = sample_rate
        self.states = np.zeros(len(poles), np.complex128)  # at the last sample
        self.take(poles)

    def take(self, poles: Complex) -> None:
        """Replace the poles; the states stay."""
        self.poles = poles
        self.factors = np.exp(poles / self._rate)
        self.steady_states = held_states(poles / self._rate, self._rate)

    def advance(self, forces: Array) -> Complex:
        """Return the states (n, M) at the samples of modal forces (n, M)."""
        from scipy.signal import lfilter  # takes a second to import, and strikes need none

        states = np.empty(forces.shape, np.complex128)
        for mode, factor in enumerate(self.factors):
            start = np.array([factor * self.states[mode]])
            states[:, mode], _ = lfilter(
                [1 / self._rate], [1.0, -factor], forces[:, mode], zi=start
            )
        self.states = states[-1]
        return states

    def rest(self, samples: float) -> Complex:
        """Go on by a number of samples without force, or infinitely many; return the states."""
        states = self.states
        if np.isinf(samples):
            self.states = np.zeros_like(states)
        else:
            self.states = states * self.factors**samples
        return states

    def sums(self, poles: Array | Complex, samples: float) -> Complex:
        """Return the sums of exp(z n) over the samples n from 1 on, of sums of poles z, in s.

        From the poles, as those without losses add to exactly 0, and factors to 1 by rounding only.
        """
        exponents = np.asarray(poles, np.complex128) / self._rate
        is_steady = exponents == 0
        safe_exponents = np.where(is_steady, -1.0, exponents)
        last = -1.0 if np.isinf(samples) else np.expm1(samples * safe_exponents)
        sums = np.exp(safe_exponents) * last / np.expm1(safe_exponents) / self._rate
        return np.where(is_steady, samples / self._rate, sums)


class SampledModes:
    """Modes under sampled forces, and their energies so far."""

    def __init__(self, poles: Complex, sample_rate: float, outputs: Complex) -> None:
        self._rate, self._outputs = sample_rate, outputs  # (D, M), in D directions
        self._motion = SampledMotion(poles, sample_rate)
        self._decays = -poles.real
        self.energies = ModeEnergies.none(len(poles))
        self._inputs, self._start_energies = np.zeros((2, len(poles)))  # since decays last changed

    def take(self, poles: Complex) -> None:
        """Replace the poles, as where a hand comes or goes; the states stay."""
        self._settle()
        self._motion.take(poles)
        self._start_energies = self._stored_energies()

    def advance(self, forces: Array, ideal_forces: Array) -> None:
        """Advance by modal forces (n, M), of which the ideal ones have no steady part."""
        motion, rate = self._motion, self._rate
        factors = 1 - 1j * motion.poles.real / motion.poles.imag
        states = motion.advance(forces)
        soft_forces = forces - ideal_forces
        # An impulse acts on the mean of the velocities before and after it. A steady force does no
        # work, and what sampling makes of it is taken off.
        velocities = np.real(factors * (states - forces / (2 * rate)))
        velocities -= np.real(factors * (motion.steady_states - 1 / (2 * rate))) * soft_forces
        self._inputs += np.einsum("nm,nm->m", forces, velocities) / rate
        moving = states - motion.steady_states * soft_forces
        self.energies.powers += np.square(np.abs(moving)).sum(axis=0) / rate
        self.energies.squares += np.square(moving).sum(axis=0) / rate
        pressures = np.imag(moving @ self._outputs.T)
        self.energies.sound_integral += float(np.square(pressures).sum()) / (
            rate * len(self._outputs)
        )

    def rest(self, samples: float) -> None:
        """Go on by a number of samples without force, or infinitely many."""
        motion, energies = self._motion, self.energies
        poles, states = motion.poles, motion.rest(samples)
        is_moving = states != 0
        squares = np.square(np.abs(states[is_moving]))
        energies.powers[is_moving] += squares * motion.sums(2 * poles[is_moving].real, samples).real
        energies.squares += np.square(states) * motion.sums(2 * poles, samples)
        energies.sound_integral += integrate_sound(
            self._outputs * states,
            motion.sums(poles[:, None] + np.conj(poles), samples),
            motion.sums(poles[:, None] + poles, samples),
        )
        if np.isinf(samples):
            self._settle()

    def _settle(self) -> None:
        """Book the work and the losses since the decay rates last changed."""
        losses = self._inputs + self._start_energies - self._stored_energies()
        decays = -self._motion.poles.real
        fractions = np.divide(
            self._decays, decays, out=np.ones_like(decays), where=decays > self._decays
        )
        self.energies.inputs += self._inputs
        self.energies.hold_losses += losses * (1 - fractions)
        self._inputs = np.zeros(len(losses))

    def _stored_energies(self) -> Array:
        """Return the kinetic and potential energy of each mode (M,), J."""
        poles, states = self._motion.poles, self._motion.states
        velocities = np.real((1 - 1j * poles.real / poles.imag) * states)
        return (np.square(velocities) + np.square(np.abs(poles) / poles.imag * states.imag)) / 2
