"""Sound of bodies in space at a listener's ears, block after block."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.ears.delay_lines import DelayLines
from struck.ears.listeners import Listener, is_listener
from struck.ears.propagation import STRETCH, Emitter, Pose, Propagation
from struck.ears.room import Room
from struck.errors import OptionError
from struck.model.arrays import Array, checked, require_sample_rate


@checked
class Hearing:
    """The ears of a listener among bodies: all that remembers sound on its way.

    Parameters
    ----------
    emitters : sequence of Emitter
        Sources, one per body.
    listener : Listener
        The listener.
    sample_rate : float
        Sample rate, Hz.
    room : Room or None, default None
        Room whose walls reflect.
    brief : bool, default False
        Shorten measured responses, for live playing.

    Attributes
    ----------
    propagation : Propagation
        From bodies to ears.

    Raises
    ------
    ContactError
        Where the listener is inside a body.
    OptionError
        On directions or distances that cannot be.

    Notes
    -----
    At time t an ear gets what a body sent at t - r / c, where r is the distance between the ear's
    place at t and the body's place when it sent.
    """

    def __init__(
        self,
        emitters: Sequence[Emitter],
        listener: Listener,
        *,
        sample_rate: float,
        room: Room | None = None,
        brief: bool = False,
    ) -> None:
        require_sample_rate(sample_rate)
        if not is_listener(listener):
            raise TypeError(f"listener is {listener!r}: give Mono, Stereo or Binaural")
        if not len(emitters):
            raise OptionError("there are 0 emitters: give one at least")
        self.propagation = Propagation(
            emitters,
            Pose.of(listener, emitters),
            listener.filters(sample_rate, brief=brief),
            sample_rate=sample_rate,
            room=room,
        )
        paths = self.propagation.paths
        self._lines = DelayLines(
            lines=self.propagation.lines,
            paths=len(paths.lines),
            block=STRETCH,
            longest=float(paths.delays.max()),
            taps=paths.after.shape[1],
        )
        self._since = 0 if self.propagation.still else STRETCH

    @property
    def lines(self) -> int:
        """Rows that `next_block` takes: one for each body, or for each ear with a timbre field."""
        return self.propagation.lines

    @property
    def lead(self) -> int:
        """Samples by which the sound of `next_block` is late."""
        return self.propagation.lead

    def next_block(self, samples: Array) -> Array:
        """Compute the next block of sound at the ears, `lead` samples late.

        Parameters
        ----------
        samples : array (lines, n)
            Sound of the bodies at 1 m; with a timbre field, at each ear without the propagation
            delay.

        Returns
        -------
        array (ears, n)
            Sound at the ears.
        """
        blocks, position = [], 0
        while position < samples.shape[1]:
            if self._since == STRETCH:
                self._go_on()
            count = min(samples.shape[1] - position, STRETCH - self._since)
            part = samples[:, position : position + count]
            paths, ears = self.propagation.paths, self.propagation.ears
            blocks.append(self._lines.next_block(part, paths, ears, since=self._since))
            self._since += count
            position += count
        return np.concatenate(blocks, axis=1)

    def _go_on(self) -> None:
        self._since = 0
        if not self.propagation.still:
            self._lines.lengthen(float(self.propagation.go_on().delays.max()))
