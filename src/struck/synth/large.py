"""A body of thousands of modes, by the block transform."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.synth.block_transform import BlockTransform
from struck.synth.nufft_bounds import BLOCKS, suits, wins
from struck.synth.poles import Array, Complex, Poles
from struck.synth.whole_blocks import KEPT, Index, Outputs, WholeBlocks


def fits_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether the transform can make a body's blocks: none of its modes dies within one."""
    suited = suits(poles.values, sample_rate, block)
    return BLOCKS[0] <= block <= BLOCKS[1] and bool(suited.all())


def gains_by_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether it can, and faster than sample by sample."""
    return wins(len(poles.values), block) and fits_transform(poles, sample_rate, block)


class Transformed(WholeBlocks):
    """One body, by one `BlockTransform`."""

    def planned(self, poles: Complex) -> Index:
        """Plan the transform."""
        self._transform = BlockTransform(poles, self.rate, self.size)
        # The outputs for which the next block's ringing is summed up already.
        self._summed: Outputs | None = None
        # Impulse responses, as `_levels`.
        self._answers: dict[tuple[int, int], tuple[Outputs, Array, Array]] = {}
        return self._transform.order

    def rung(self, outputs: Outputs) -> Array:
        """Return what the states sound like by themselves in the next block (points, block)."""
        into = np.zeros((len(outputs), self.size))
        if outputs is self._summed:
            self._transform.summed(into)
        else:
            self._transform.ringing(self.ahead, outputs, into)
        self._summed = None
        return into

    def wake(self) -> None:
        """Bring the states to where they would be by now."""
        if self.asleep:
            self._summed = None
        super().wake()

    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return what a force sounds like in its own block (points, block)."""
        into = np.zeros((len(outputs), self.size))
        for answer, samples in zip(self._answer(outputs, drive), into, strict=True):
            self._transform.pushed(force, answer, samples)
        return into

    def _answer(self, outputs: Outputs, drive: Array) -> Array:
        """Return impulse responses within a block; those of the last gains are kept."""
        pair = id(outputs), id(drive)
        if pair not in self._answers:
            while len(self._answers) >= KEPT:
                self._answers.pop(next(iter(self._answers)))
            weights = outputs * (drive / self.rate)
            answers = np.array([self._transform.answer(each) for each in weights])
            self._answers[pair] = outputs, drive, answers
        return self._answers[pair][2]

    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Move the states on by a block under forces with constant drives."""
        scaled = [(force / self.rate, drive) for force, drive in pushes]
        if len(scaled) <= 1:
            self._transform.step(self.ahead, next(iter(scaled), None), self.outputs)
            self._summed = self.outputs
            return
        self._transform.advance(self.ahead)
        for force, drive in scaled:
            self._transform.absorb(self.ahead, force, drive)
