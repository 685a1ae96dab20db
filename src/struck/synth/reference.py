"""Resonators in plain NumPy: what the kernels are tested against, and what plays without numba."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from struck.excitation.excitation import Push
from struck.model.arrays import Array, Complex, Index
from struck.synth.poles import (
    Key,
    Poles,
    Ringing,
    require_outputs,
    require_pushes,
    require_session,
    voices_for,
)

# Within a block c[k] = z^(k+1) c + the convolution of the force with z^k. Gains that change
# linearly are two constant ones: of a force that fades out and one that fades in, of a sound
# likewise.

Gain = TypeVar("Gain", Array, Complex)
Outputs = Complex | Array  # gains (points, M), real where all are
Piece = tuple[Array, Array, Array]  # a force (block,), the drives (M,) at its begin and end

KEPT = 64  # results kept for gains that come again: at least those of one block
# Blocks without a push after which it is looked whether a body may sleep.
_PATIENCE = 8


class WholeBlocks(ABC):
    """The modes of one body, advanced by whole blocks."""

    def __init__(
        self, poles: Poles, *, points: int, block: int, sample_rate: float, quiet: float = 0.0
    ) -> None:
        self.size, self.rate = block, sample_rate
        self.outputs: Outputs = np.zeros((points, len(poles.values)))
        self.asleep, self._quiet, self._loudest, self._slept = False, quiet, 0.0, 0
        self._unpushed = 0
        self._fade = np.arange(1, block + 1) / block
        self._begin(poles)
        # z c: what the first sample of the next block finds.
        self.ahead = np.zeros(len(poles.values), np.complex128)

    def arranged(self, outputs: Complex) -> Outputs:
        """Return outputs (points, M) in the order of `order`, as real numbers where they are."""
        arranged = outputs[..., self.order]
        return arranged if arranged.imag.any() else arranged.real.copy()

    def kept(self, drive: Gain) -> Gain:
        """Return values of modes (..., M) in this order, zero for modes that are left out."""
        kept = drive[self.order]
        kept[self.logs == 0] = 0
        return kept

    def _as_given(self, values: Complex | Array) -> Complex:
        given = np.empty(values.shape, np.complex128)
        given[..., self.order] = values
        return given

    @property
    def states(self) -> Complex:
        """State c of each mode after the last block (M,)."""
        self.wake()
        return self._as_given(self.ahead / np.exp(self.logs))

    def take(self, poles: Poles) -> None:
        """Replace the poles; states stay."""
        states, outputs = self.states, self._as_given(self.outputs)
        held = self._as_given(self._held_before)
        self._begin(poles)
        self.outputs = self.arranged(outputs)
        self._held_before = self.kept(held)
        self.ahead = self.kept(states) * np.exp(self.logs)

    def _begin(self, poles: Poles) -> None:
        self.poles = poles
        # By the gains that made them, which are kept so that no others come to have their names.
        self._levels: dict[tuple[int, int], tuple[Outputs, Array, Array]] = {}
        self.order = self.planned(poles.values)
        self.logs = poles.values[self.order] / self.rate
        held, kept = -np.expm1(self.logs) * self.rate, self.logs != 0
        self._held = np.divide(1, held, out=np.zeros_like(held), where=kept)
        self._held_before = self._held

    def wake(self) -> None:
        """Advance states that slept to the present."""
        if self._slept:
            self.ahead = self.ahead * np.exp(self.logs * self._slept)
        self.asleep, self._slept = False, 0

    @abstractmethod
    def planned(self, poles: Complex) -> Index:
        """Prepare whatever depends on the poles; return the order of modes to work in (M,)."""

    @abstractmethod
    def rung(self, outputs: Outputs) -> Array:
        """Return the sound of the states alone in the next block (points, block)."""

    @abstractmethod
    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return the sound of a force within its own block (points, block)."""

    @abstractmethod
    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Advance the states by a block under forces with constant drives."""

    def next_block(self, pieces: Sequence[Piece], wanted: Outputs | None) -> Array:
        """Return the next samples (points, block), with the outputs wanted at its end."""
        before, after = self.outputs, self.outputs if wanted is None else wanted
        if self.asleep and not pieces and wanted is None:
            self._slept += self.size
            return np.zeros((len(before), self.size))
        self.wake()
        self.outputs = after
        samples = self._heard(before, pieces)
        if wanted is not None:
            samples = samples + self._fade * (self._heard(after, pieces) - samples)
        samples = sum((self._direct(before, after, piece) for piece in pieces), samples)
        self.advance(list(_constant(pieces, self._fade)))
        self.asleep, self._held_before = not pieces and self._may_sleep(), self._held
        return samples

    def _heard(self, outputs: Outputs, pieces: Sequence[Piece]) -> Array:
        answers = (self.answered(outputs, *push) for push in _constant(pieces, self._fade))
        return sum(answers, self.rung(outputs))

    def _direct(self, before: Outputs, after: Outputs, piece: Piece) -> Array:
        """Return the direct part of a force, which cancels its steady output (points, block)."""
        force, begin, end = piece
        first, last = self._still(before, begin), self._still(after, end)
        if self._held_before is not self._held:
            first = _ended(before, begin, self._held_before)
        if first is last:
            return first[:, None] * force
        return (first[:, None] + np.outer(last - first, self._fade)) * force

    def _still(self, outputs: Outputs, drive: Array) -> Array:
        """Return minus the steady output under a constant unit force (points,)."""
        pair = id(outputs), id(drive)
        if pair not in self._levels:
            while len(self._levels) >= KEPT:
                self._levels.pop(next(iter(self._levels)))
            self._levels[pair] = outputs, drive, _ended(outputs, drive, self._held)
        return self._levels[pair][2]

    def _may_sleep(self) -> bool:
        self._unpushed = (self._unpushed + 1) % _PATIENCE
        if self._unpushed:
            return False
        sizes = np.abs(self.ahead.real) + np.abs(self.ahead.imag)
        bound = float(sizes @ np.abs(self.outputs).max(axis=0))
        self._loudest = max(self._loudest, bound)
        return bound <= self._quiet * self._loudest


def _ended(outputs: Outputs, drive: Array, held: Complex) -> Array:
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


class Tabled(WholeBlocks):
    """The modes of one body by tables of the powers of z."""

    def planned(self, poles: Complex) -> Index:
        """Compute the table."""
        logs = poles / self.rate
        self._powers = np.exp(np.outer(np.arange(self.size + 1), logs)) * (logs != 0)
        return np.arange(len(poles))

    def rung(self, outputs: Outputs) -> Array:
        """Return the sound of the states alone in the next block."""
        return np.imag(outputs @ (self._powers[:-1] * self.ahead).T)

    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return the sound of a force within its own block."""
        answers: Array = np.imag(outputs @ (self._powers[:-1] * drive).T) / self.rate
        heard = [np.convolve(force, answer)[: self.size] for answer in answers]
        return np.array(heard, dtype=np.float64)

    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Advance the states by a block."""
        self.ahead = self.ahead * self._powers[-1]
        for force, drive in pushes:
            self.ahead = self.ahead + drive * (force[::-1] @ self._powers[1:]) / self.rate


class ReferenceResonators:
    """`struck.synth.resonators.Resonators` in plain NumPy; nothing falls asleep."""

    def __init__(
        self,
        models: Sequence[Ringing],
        *,
        sample_rate: float = 48000,
        block: int = 128,
        points: int = 1,
        voices: int | None = None,
    ) -> None:
        require_session(sample_rate, block, points)
        self.sample_rate, self.block, self.points = sample_rate, block, points
        self._voices = voices_for(len(models), voices)
        self._bodies = [
            Tabled(
                Poles.of(model, sample_rate), points=points, block=block, sample_rate=sample_rate
            )
            for model in models
        ]
        self._pushes: dict[Key, tuple[Array, Array]] = {}
        self._first = True

    @property
    def dropped(self) -> tuple[int, ...]:
        """How many modes of each body lie at or above half the sample rate."""
        return tuple(body.poles.dropped for body in self._bodies)

    def states(self, body: int) -> Complex:
        """Return c of a body's modes after the last block."""
        return self._bodies[body].states

    def process(
        self, pushes: Sequence[Push] = (), outputs: Sequence[NDArray[np.generic] | None] = ()
    ) -> Array:
        """Make the next block (bodies, points, block)."""
        poles = [body.poles for body in self._bodies]
        checked = require_pushes(pushes, poles, self.block, self._voices, self._pushes)
        gains = require_outputs(outputs, poles, self.points)
        pieces: list[list[Piece]] = [[] for _ in self._bodies]
        for key, (force, drive) in checked.items():
            pieces[key[0]].append((force, self._pushes.get(key, (force, drive))[1], drive))
        self._pushes = checked
        if self._first:
            for body, gain in gains.items():
                self._bodies[body].outputs = gain
            self._first = False
        return np.stack(
            [
                body.next_block(some, gains.get(number))
                for number, (body, some) in enumerate(zip(self._bodies, pieces, strict=True))
            ]
        )

    def change(self, body: int, model: Ringing) -> None:
        """Let a body go on with other frequencies and decays, from the states that it has."""
        poles = Poles.of(model, self.sample_rate)
        self._bodies[body].poles.require_size(poles.values, "the changed model")
        self._bodies[body].take(poles)
