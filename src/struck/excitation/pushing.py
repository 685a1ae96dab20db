"""What every excitation has in common: once begun on a model it pushes, block after block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from struck.model.model import ModalModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """A force on one place of a body during one block.

    Parameters
    ----------
    force : array (block,)
        N, at each sample; band-limited to half the sample rate.
    drive : array (M,)
        How strongly each mode answers at the place where the block ends, kg^-1/2. Within the
        block it is ramped to from the last one of the same body and voice. The very same array
        means that nothing moved: do not write to it afterwards.
    body : int
        Its number in the scene.
    voice : int
        Pushes of the same body and voice in one block after the other are one contact that moves.
    """

    force: Array
    drive: Array
    body: int = 0
    voice: int = 0


class Pushing(Protocol):
    """An excitation at work on one model; it alone keeps where it is."""

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        ...

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        ...


@runtime_checkable
class Changing(Protocol):
    """A `Pushing` that can go on when its body changes; one that cannot keeps the old drives."""

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed."""
        ...


class Excitation(Protocol):
    """What pushes a body: constant, and the same again for the same seed."""

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Pushing:
        """Begin on a model at sample number `start` (may be negative: a prelude).

        Raises
        ------
        ContactError
            When it touches no body.
        """
        ...
