"""Resonators in plain NumPy: what the kernels are tested against, and what plays without numba."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.excitation.pushing import Push
from struck.synth.poles import (
    Array,
    Complex,
    Key,
    Poles,
    Ringing,
    require_outputs,
    require_pushes,
    require_session,
    voices_for,
)
from struck.synth.whole_blocks import Index, Outputs, Piece, WholeBlocks


class Tabled(WholeBlocks):
    """One body, by tables of the powers of z."""

    def planned(self, poles: Complex) -> Index:
        """Work the table out."""
        logs = poles / self.rate
        self._powers = np.exp(np.outer(np.arange(self.size + 1), logs)) * (logs != 0)
        return np.arange(len(poles))

    def rung(self, outputs: Outputs) -> Array:
        """Return what the states sound like by themselves in the next block (points, block)."""
        return np.imag(outputs @ (self._powers[:-1] * self.ahead).T)

    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return what a force sounds like in its own block (points, block)."""
        answers: Array = np.imag(outputs @ (self._powers[:-1] * drive).T) / self.rate
        heard = [np.convolve(force, answer)[: self.size] for answer in answers]
        return np.array(heard, dtype=np.float64)

    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Move the states on by a block under forces with constant drives."""
        self.ahead = self.ahead * self._powers[-1]
        for force, drive in pushes:
            self.ahead = self.ahead + drive * (force[::-1] @ self._powers[1:]) / self.rate


class ReferenceResonators:
    """The interface of `struck.synth.resonators.Resonators`; nothing falls asleep."""

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
