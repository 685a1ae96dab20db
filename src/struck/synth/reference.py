"""Resonators in plain NumPy: the reference for tests of the core, and its replacement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from struck.model.arrays import Array, Complex
from struck.synth.poles import Key, Poles, held_states

# Within a block c[k] = z^(k+1) c + the convolution of the force with z^k. Gains that change
# linearly are two constant ones: of a force that fades out and one that fades in, of a sound
# likewise.

Piece = tuple[Array, Array, Array]  # a force (block,), the drives (M,) at its begin and end


class Tabled:
    """The modes of one body, advanced by whole blocks with tables of the powers of z."""

    def __init__(self, poles: Poles, *, points: int, block: int, sample_rate: float) -> None:
        self._size, self._rate = block, sample_rate
        self.outputs: Complex = np.zeros((points, len(poles.values)), np.complex128)
        self._ramp = np.arange(1, block + 1) / block
        self._begin(poles)
        self._last_steady_states = self._steady_states
        # z c: the states at the first sample of the next block.
        self._next_states = np.zeros(len(poles.values), np.complex128)

    @property
    def states(self) -> Complex:
        """State c of each mode after the last block (M,)."""
        return self._next_states / np.exp(self._logs)

    def take(self, poles: Poles) -> None:
        """Replace the poles; the states of the modes stay."""
        states = self.states
        self._begin(poles)
        self._next_states = states * self._powers[1]
        self._last_steady_states = self._last_steady_states * (self._logs != 0)

    def _begin(self, poles: Poles) -> None:
        self._logs = poles.values / self._rate
        is_below_nyquist = self._logs != 0
        self._powers = np.exp(np.outer(np.arange(self._size + 1), self._logs)) * is_below_nyquist
        self._steady_states = held_states(self._logs, self._rate)

    def next_block(self, pieces: Sequence[Piece], new_outputs: Complex | None) -> Array:
        """Return the next samples (points, block), with the given outputs at its end."""
        start_outputs, end_outputs = (
            self.outputs,
            self.outputs if new_outputs is None else new_outputs,
        )
        pushes = list(_split_pieces(pieces, self._ramp))
        samples = self._sound_states(start_outputs, pushes)
        if new_outputs is not None:
            samples = samples + self._ramp * (self._sound_states(end_outputs, pushes) - samples)
        samples = sum(
            (self._direct(start_outputs, end_outputs, piece) for piece in pieces), samples
        )
        self._advance(pushes)
        self.outputs, self._last_steady_states = end_outputs, self._steady_states
        return samples

    def _sound_states(self, outputs: Complex, pushes: Sequence[tuple[Array, Array]]) -> Array:
        """Return the sound of the states and of the forces within their block (points, block)."""
        ringing = np.imag(outputs @ (self._powers[:-1] * self._next_states).T)
        return sum((self._convolve_force(outputs, *push) for push in pushes), ringing)

    def _convolve_force(self, outputs: Complex, force: Array, drive: Array) -> Array:
        responses: Array = np.imag(outputs @ (self._powers[:-1] * drive).T) / self._rate
        parts = [np.convolve(force, answer)[: self._size] for answer in responses]
        return np.array(parts, dtype=np.float64)

    def _direct(self, start_outputs: Complex, end_outputs: Complex, piece: Piece) -> Array:
        """Return the direct part of a force, which cancels its steady output (points, block)."""
        force, start_drive, end_drive = piece
        first = _steady_output(start_outputs, start_drive, self._last_steady_states)
        last = _steady_output(end_outputs, end_drive, self._steady_states)
        return (first[:, None] + np.outer(last - first, self._ramp)) * force

    def _advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        self._next_states = self._next_states * self._powers[-1]
        for force, drive in pushes:
            self._next_states = (
                self._next_states + drive * (force[::-1] @ self._powers[1:]) / self._rate
            )


def _steady_output(outputs: Complex, drive: Array, states: Complex) -> Array:
    """Return minus the steady output under a constant unit force (points,)."""
    return -np.imag(outputs @ (states * drive))


def _split_pieces(pieces: Sequence[Piece], ramp: Array) -> Iterator[tuple[Array, Array]]:
    """Yield forces with drives that do not change within the block."""
    for force, start_drive, end_drive in pieces:
        if start_drive is end_drive:
            yield force, start_drive
        else:
            yield force * (1 - ramp), start_drive
            yield force * ramp, end_drive


class Tables:
    """All bodies of a scene by tables: `struck.synth.resonators.Stepped` in plain NumPy.

    Nothing falls asleep.
    """

    def __init__(
        self,
        poles: Sequence[Poles],
        *,
        points: int,
        block: int,
        voices: int,
        sample_rate: float,
        quiet: float,
    ) -> None:
        del voices, quiet
        options = {"points": points, "block": block, "sample_rate": sample_rate}
        self._bodies = [Tabled(body_poles, **options) for body_poles in poles]
        self._drives: dict[Key, Array] = {}
        self._first = True
        self.asleep = np.zeros(len(poles), np.bool_)

    def states(self, body: int) -> Complex:
        """Return c of a body's modes after the last block."""
        return self._bodies[body].states

    def next_block(
        self, pushes: Mapping[Key, tuple[Array, Array]], outputs: Mapping[int, Complex]
    ) -> Array:
        """Return the next samples (bodies, points, block)."""
        pieces: list[list[Piece]] = [[] for _ in self._bodies]
        for key, (force, drive) in pushes.items():
            pieces[key[0]].append((force, self._drives.get(key, drive), drive))
        self._drives = {key: drive for key, (_, drive) in pushes.items()}
        if self._first:
            for body, gain in outputs.items():
                self._bodies[body].outputs = gain
            self._first = False
        return np.stack(
            [
                body.next_block(body_pieces, outputs.get(number))
                for number, (body, body_pieces) in enumerate(zip(self._bodies, pieces, strict=True))
            ]
        )

    def take_poles(self, body: int, poles: Poles) -> None:
        """Replace a body's poles; the states of its modes stay."""
        self._bodies[body].take(poles)
