"""Offline sound of whatever goes on pushing a body: block after block through its resonators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.hold import Hold
from struck.excitation.pulses import LEAD
from struck.excitation.pushing import Excitation, Pushing
from struck.model.model import ModalModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
LONGEST_UNSAID = 60.0
"""How long a sound of unsaid length waits for what pushes to end, s."""
LONGEST_RING = 10.0
"""How long it goes on after that at most, s."""
SHORTEST_RING = 0.1
"""How long it goes on at least, s."""
_QUIETEST = 10 ** (-40 / 20)
_SILENT = np.log(1000)
# Short, since drives go straight from block to block where a contact moves.
_BLOCK = 128


def resonators_for(*models: ModalModel, engine: str = "auto", **options: Any) -> Any:  # noqa: ANN401 - either kind
    """Return resonators for some bodies: compiled ones, or plain NumPy's where numba is missing."""
    try:
        from struck.synth.resonators import Resonators
    except ImportError:  # numba comes late to new versions of Python
        from struck.synth.reference import ReferenceResonators

        return ReferenceResonators(models, **options)
    return Resonators(models, engine=engine, **options)


@dataclass(kw_only=True)
class Driven:
    """A body that is pushed, and perhaps held.

    Parameters
    ----------
    model : ModalModel
    outputs : array (points, M), complex
        What is heard.
    excitations : sequence of Excitation
    holds : sequence of Hold
    sample_rate : int
        Hz.
    moving : callable or None
        Outputs at a time, s, where they change.
    """

    model: ModalModel
    outputs: Complex
    excitations: Sequence[Excitation]
    holds: Sequence[Hold]
    sample_rate: int
    moving: Callable[[float], Complex] | None = None
    _pushings: list[Pushing] = field(init=False)

    def __post_init__(self) -> None:
        # A hand may damp modes more than the block transform bears.
        engine = "stepped" if self.holds else "auto"
        options = {"sample_rate": self.sample_rate, "block": _BLOCK, "engine": engine}
        voices = max(1, len(self.excitations))
        points = len(self.outputs)
        self._resonators = resonators_for(self.model, points=points, voices=voices, **options)
        # Band-limited pulses begin some samples before their time.
        self._now = -LEAD
        self._pushings = [
            each.begin(self.model, self.sample_rate, start=self._now) for each in self.excitations
        ]
        self._raised = [hold.raised(self.model) for hold in self.holds]
        self._held: tuple[bool, ...] = (False,) * len(self.holds)
        self._decays = self.model.decays

    def samples(self, seconds: float | None, *, at_least: float) -> Array:
        """Return what is heard (points, samples).

        Parameters
        ----------
        seconds : float or None
            None: until all pushes have ended and what rings then has died away.
        at_least : float
            s, where seconds is None.

        Raises
        ------
        OptionError
            Where seconds is None and the pushes do not end within a minute.
        """
        blocks: list[Array] = []
        length = None if seconds is None else max(1, round(seconds * self.sample_rate))
        while length is None or self._now < length:
            blocks.append(self._next(first=not blocks))
            if length is None:
                length = self._length(at_least)
        return np.concatenate(blocks, axis=1)[:, LEAD : LEAD + length]

    def _next(self, *, first: bool) -> Array:
        self._take_holds()
        pushes = [
            replace(push, voice=voice)
            for voice, push in enumerate(each.advance(_BLOCK) for each in self._pushings)
            if push is not None
        ]
        self._now += _BLOCK
        if self.moving is not None:
            self.outputs = self.moving(self._now / self.sample_rate)
        given = first or self.moving is not None
        samples = self._resonators.process(pushes, [self.outputs] if given else ())
        return samples[0].copy()

    def _take_holds(self) -> None:
        held = tuple(hold.holds_at(self._now / self.sample_rate) for hold in self.holds)
        if held != self._held:
            raised = [more for more, now in zip(self._raised, held, strict=True) if now]
            decays = np.sum([self.model.decays, *raised], axis=0)
            self._decays = np.asarray(decays, np.float64)
            self._resonators.change(0, replace(self.model, decays=self._decays))
            self._held = held

    def _length(self, at_least: float) -> int | None:
        """Return how many samples the sound has, None as long as something still pushes."""
        now = self._now / self.sample_rate
        if all(each.finished for each in self._pushings):
            strengths = np.abs(self._resonators.states(0) * self.outputs).max(axis=0)
            passing = any(hold.seconds is not None for hold in self.holds)
            more = lasting(self.model.decays if passing else self._decays, strengths)
            return round(max(at_least, now + more) * self.sample_rate)
        if now > LONGEST_UNSAID:
            raise OptionError(
                f"what pushes has not ended after {LONGEST_UNSAID:g} s: say how long the sound "
                "shall be with seconds="
            )
        return None


def lasting(decays: Array, strengths: Array) -> float:
    """Return how long modes ring until the slowest of the loud ones has fallen by 60 dB, s.

    Loud is what is within 40 dB of the loudest. At most `LONGEST_RING`.
    """
    loud = decays[strengths >= _QUIETEST * strengths.max(initial=0.0)]
    slowest = loud.min(initial=np.inf)
    if slowest * LONGEST_RING < _SILENT:
        return LONGEST_RING
    return max(_SILENT / slowest, SHORTEST_RING)
