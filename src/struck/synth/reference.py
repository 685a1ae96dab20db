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
        self._fade = np.arange(1, block + 1) / block
        self._begin(poles)
        self._held_before = self._held
        # z c: what the first sample of the next block finds.
        self._ahead = np.zeros(len(poles.values), np.complex128)

    @property
    def states(self) -> Complex:
        """State c of each mode after the last block (M,)."""
        return self._ahead / np.exp(self._logs)

    def take(self, poles: Poles) -> None:
        """Replace the poles; the states of the modes stay."""
        states = self.states
        self._begin(poles)
        self._ahead = states * self._powers[1]
        self._held_before = self._held_before * (self._logs != 0)

    def _begin(self, poles: Poles) -> None:
        self._logs = poles.values / self._rate
        kept = self._logs != 0
        self._powers = np.exp(np.outer(np.arange(self._size + 1), self._logs)) * kept
        self._held = held_states(self._logs, self._rate)

    def next_block(self, pieces: Sequence[Piece], wanted: Complex | None) -> Array:
        """Return the next samples (points, block), with the outputs wanted at its end."""
        before, after = self.outputs, self.outputs if wanted is None else wanted
        pushes = list(_constant(pieces, self._fade))
        samples = self._heard(before, pushes)
        if wanted is not None:
            samples = samples + self._fade * (self._heard(after, pushes) - samples)
        samples = sum((self._direct(before, after, piece) for piece in pieces), samples)
        self._advance(pushes)
        self.outputs, self._held_before = after, self._held
        return samples

    def _heard(self, outputs: Complex, pushes: Sequence[tuple[Array, Array]]) -> Array:
        """Return the sound of the states and of the forces within their block (points, block)."""
        rung = np.imag(outputs @ (self._powers[:-1] * self._ahead).T)
        return sum((self._answered(outputs, *push) for push in pushes), rung)

    def _answered(self, outputs: Complex, force: Array, drive: Array) -> Array:
        answers: Array = np.imag(outputs @ (self._powers[:-1] * drive).T) / self._rate
        heard = [np.convolve(force, answer)[: self._size] for answer in answers]
        return np.array(heard, dtype=np.float64)

    def _direct(self, before: Complex, after: Complex, piece: Piece) -> Array:
        """Return the direct part of a force, which cancels its steady output (points, block)."""
        force, begin, end = piece
        first = _ended(before, begin, self._held_before)
        last = _ended(after, end, self._held)
        return (first[:, None] + np.outer(last - first, self._fade)) * force

    def _advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        self._ahead = self._ahead * self._powers[-1]
        for force, drive in pushes:
            self._ahead = self._ahead + drive * (force[::-1] @ self._powers[1:]) / self._rate


def _ended(outputs: Complex, drive: Array, held: Complex) -> Array:
    """Return minus the steady output under a constant unit force (points,)."""
    return -np.imag(outputs @ (held * drive))


def _constant(pieces: Sequence[Piece], fade: Array) -> Iterator[tuple[Array, Array]]:
    """Yield forces with drives that do not change within the block."""
    for force, begin, end in pieces:
        if begin is end:
            yield force, begin
        else:
            yield force * (1 - fade), begin
            yield force * fade, end


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
        self._bodies = [Tabled(each, **options) for each in poles]
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
                body.next_block(some, outputs.get(number))
                for number, (body, some) in enumerate(zip(self._bodies, pieces, strict=True))
            ]
        )

    def take_poles(self, body: int, poles: Poles) -> None:
        """Replace a body's poles; the states of its modes stay."""
        self._bodies[body].take(poles)
