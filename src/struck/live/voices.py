"""Which excitation pushes in which voice, and what of that goes into a record."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.pushing import Changing, Push, Pushing
from struck.excitation.touch import Touching
from struck.live.pushes import Started
from struck.live.ring import BEGIN, MOVED, OF_BODY, ON, SILENT, STATE, Record
from struck.live.troubles import Troubles
from struck.model.model import ModalModel
from struck.synth.poles import STRONGEST

Array = NDArray[np.float64]


@dataclass(slots=True, kw_only=True, eq=False)
class _Voice:
    pushing: Pushing
    body: int
    key: Hashable
    drive: Array | None = None  # of the last block, None where there was no push in it


class Voices:
    """Room for so many excitations at once.

    Parameters
    ----------
    count : int
    troubles : Troubles
        Where it is noted why an excitation was stopped that could not go on.
    """

    def __init__(self, count: int, troubles: Troubles) -> None:
        self._troubles = troubles
        self._voices: list[_Voice | None] = [None] * count
        self._numbers: dict[Hashable, int] = {}

    @property
    def free(self) -> int:
        """How many more there is room for."""
        return self._voices.count(None)

    def find(self, key: Hashable) -> Pushing | None:
        """Return what pushes under a key."""
        number = self._numbers.get(key)
        voice = None if number is None else self._voices[number]
        return None if voice is None else voice.pushing

    def add(self, pushing: Pushing, body: int, key: Hashable) -> bool:
        """Take one more under a key of its own; False where there is no room."""
        if not self.free:
            return False
        number = self._voices.index(None)
        self._voices[number] = _Voice(pushing=pushing, body=body, key=key)
        self._numbers[key] = number
        return True

    def change(self, body: int, model: ModalModel) -> None:
        """Let what pushes a body go on when that has changed."""
        for number, voice in enumerate(self._voices):
            if voice is not None and voice.body == body and isinstance(voice.pushing, Changing):
                try:
                    voice.pushing.change(model)
                except Exception as trouble:  # noqa: BLE001 - told to whoever plays
                    self._give_up(number, trouble)

    def write(self, record: Record) -> None:
        """Write the forces of the next block, and the drives that have changed."""
        for number, voice in enumerate(self._voices):
            record.voices[number] = SILENT
            if voice is None:
                continue
            try:
                done = _write(voice, number, record)
            except Exception as trouble:  # noqa: BLE001 - of functions that were given, say
                record.voices[number] = SILENT
                self._give_up(number, trouble)
                continue
            if done:
                self._release(number)

    def _give_up(self, number: int, trouble: Exception) -> None:
        self._troubles.note(trouble)
        voice = self._release(number)
        if voice is not None and isinstance(voice.pushing, Started):
            voice.pushing.end()

    def _release(self, number: int) -> _Voice | None:
        voice = self._voices[number]
        self._voices[number] = None
        if voice is not None:
            del self._numbers[voice.key]
        return voice


def _write(voice: _Voice, number: int, record: Record) -> bool:
    """Write the next block of a voice; tell whether it is needed no longer."""
    push = voice.pushing.advance(record.forces.shape[1])
    if push is not None:
        _require_sound(push, voice.drive, record.drives.shape[1])
        _put(push, voice, number, record)
    voice.drive = None if push is None else push.drive
    rests = push is None and isinstance(voice.pushing, Touching) and voice.pushing.at_rest
    return rests or voice.pushing.finished


def _put(push: Push, voice: _Voice, number: int, record: Record) -> None:
    moved = push.drive is not voice.drive
    record.voices[number, STATE] = BEGIN if voice.drive is None else ON
    record.voices[number, OF_BODY] = voice.body
    record.voices[number, MOVED] = moved
    record.forces[number] = push.force
    record.loads[number] = voice.pushing.load if isinstance(voice.pushing, Touching) else 0.0
    if moved:
        record.drives[number, : len(push.drive)] = push.drive
        record.drives[number, len(push.drive) :] = 0.0


def _require_sound(push: Push, last: Array | None, width: int) -> None:
    """Raise an OptionError on a push that would spoil the modes' state for good."""
    force = push.force
    if not np.abs(force).max() <= STRONGEST:  # NaN neither
        raise OptionError(
            f"an excitation was stopped: its force reached {np.abs(force).max():g} N, and must be "
            f"finite and at most {STRONGEST:g} N"
        )
    if push.drive is not last and not (len(push.drive) <= width and np.isfinite(push.drive).all()):
        raise OptionError(
            "an excitation was stopped: its drive is not finite or does not fit; begin it anew "
            "on this model"
        )
