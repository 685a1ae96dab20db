"""Voices: active excitations, strikes at the same place, and their part of each record."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import numpy as np

from struck.errors import OptionError, StruckError, rounded
from struck.excitation.excitation import Changing, Push, Pushing
from struck.excitation.pulses import Samples
from struck.excitation.touch import Touching
from struck.live.ring import BEGIN, MOVED, OF_BODY, ON, SILENT, STATE, Record
from struck.model.arrays import Array, Complex
from struck.model.model import ModalModel
from struck.synth.poles import MAX_FORCE

MAX_BLOWS = 256  # strikes at one place that may be under way
_FADE_SECONDS = 5e-3  # s


class Blows:
    """Excitation of all strikes at one place, each added as it comes."""

    def __init__(self, drive: Array, *, start: int, ideal: bool = False) -> None:
        self.drive, self.ideal = drive, ideal  # ideal: without duration
        self._next_sample = start
        self._blows: list[Samples] = []

    def add(self, blow: Samples) -> bool:
        """Add a blow; return False if there are too many."""
        if len(self._blows) >= MAX_BLOWS:
            return False
        self._blows.append(blow)
        return True

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        force = np.zeros(length)
        parts = [_add(blow, force, self._next_sample) for blow in self._blows]
        self._next_sample += length
        self._blows = [
            blow for blow in self._blows if blow.first + len(blow.force) > self._next_sample
        ]
        return Push(force=force, drive=self.drive) if any(parts) else None

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return not self._blows


def _add(blow: Samples, force: Array, block_start: int) -> bool:
    """Add the part of a blow that falls in a block; return whether there is any."""
    first = max(blow.first - block_start, 0)
    part = blow.force[
        max(block_start - blow.first, 0) : max(block_start + len(force) - blow.first, 0)
    ]
    force[first : first + len(part)] += part
    return len(part) > 0


class Started:
    """An active excitation; `stop` ends it within 5 ms."""

    def __init__(self, pushing: Pushing, sample_rate: float, *, ideal: bool = False) -> None:
        self._pushing, self.ideal = pushing, ideal  # a blow without duration
        self._fade_samples = max(1, round(_FADE_SECONDS * sample_rate))
        self._left: int | None = None

    def stop(self) -> None:
        """Release the body; more than once does no harm."""
        if self._left is None:
            self._left = self._fade_samples

    def end(self) -> None:
        """End the excitation at once, because it found no voice or failed."""
        self._left = 0

    def change(self, model: ModalModel) -> None:
        """Continue, if possible, on a body that has changed."""
        if isinstance(self._pushing, Changing):
            self._pushing.change(model)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._left == 0 or self._pushing.finished

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        left = self._left  # `stop` may be called from another thread
        push = self._pushing.advance(length)
        if left is None:
            return push
        self._left = max(0, left - length)
        if push is None:
            return None
        shares = np.clip((left - np.arange(1, length + 1)) / self._fade_samples, 0.0, 1.0)
        return Push(force=push.force * np.square(np.sin(np.pi / 2 * shares)), drive=push.drive)


class LastError:
    """The last exception in the thread that feeds the voices, until the caller raises it."""

    def __init__(self) -> None:
        self._last: Exception | None = None

    def keep(self, failure: Exception) -> None:
        """Keep an exception in place of an older one."""
        self._last = failure

    def raise_again(self) -> None:
        """Raise the last exception, if any: a StruckError as it is, others as an OptionError."""
        failure, self._last = self._last, None
        if failure is None:
            return
        if isinstance(failure, StruckError):
            raise failure
        raise OptionError(
            f"an excitation was stopped: it raised {failure!r}; look at the functions of time that "
            "it was given, and start it again"
        ) from failure


@dataclass(slots=True, kw_only=True, eq=False)
class _Voice:
    pushing: Pushing
    body: int
    key: Hashable
    drive: Array | None = None  # of the last block, None where there was no push in it


class Voices:
    """A fixed number of excitations at once, and their part of each record."""

    def __init__(self, count: int, error: LastError) -> None:
        self._error = error
        self._voices: list[_Voice | None] = [None] * count
        self._numbers: dict[Hashable, int] = {}

    @property
    def free(self) -> int:
        """Number of voices that are free."""
        return self._voices.count(None)

    def find(self, key: Hashable) -> Pushing | None:
        """Return the excitation under a key."""
        number = self._numbers.get(key)
        voice = None if number is None else self._voices[number]
        return None if voice is None else voice.pushing

    def add(self, pushing: Pushing, body: int, key: Hashable) -> bool:
        """Add an excitation under a new key; False if all voices are in use."""
        if not self.free:
            return False
        number = self._voices.index(None)
        self._voices[number] = _Voice(pushing=pushing, body=body, key=key)
        self._numbers[key] = number
        return True

    def change(self, body: int, model: ModalModel) -> None:
        """Change the model of the excitations of a body."""
        for number, voice in enumerate(self._voices):
            if voice is not None and voice.body == body and isinstance(voice.pushing, Changing):
                try:
                    voice.pushing.change(model)
                except Exception as failure:  # noqa: BLE001 - raised in the user's thread
                    self._give_up(number, failure)

    def write(self, record: Record, steady: Mapping[int, Complex]) -> None:
        """Write the forces of the next block, and the drives that have changed.

        The steady response that is subtracted from each mode's output, `steady` (points, N) for 1
        N, is added again for ideal blows, which have no steady part.
        """
        record.voices[:] = SILENT
        for number, voice in enumerate(self._voices):
            if voice is None:
                continue
            try:
                is_free = _write(voice, number, record, steady)
            except Exception as failure:  # noqa: BLE001 - of functions that were given, say
                record.voices[number] = SILENT
                self._give_up(number, failure)
                continue
            if is_free:
                self._release(number)

    def _give_up(self, number: int, failure: Exception) -> None:
        self._error.keep(failure)
        voice = self._release(number)
        if voice is not None and isinstance(voice.pushing, Started):
            voice.pushing.end()

    def _release(self, number: int) -> _Voice | None:
        voice = self._voices[number]
        self._voices[number] = None
        if voice is not None:
            del self._numbers[voice.key]
        return voice


def _write(voice: _Voice, number: int, record: Record, steady: Mapping[int, Complex]) -> bool:
    """Write the next block of a voice; return whether the voice is free afterwards."""
    push = voice.pushing.advance(record.forces.shape[1])
    if push is not None:
        _require_sound(push, voice.drive, record.drives.shape[1])
        _put(push, voice, number, record)
        if getattr(voice.pushing, "ideal", False):
            gains = steady[voice.body][:, : len(push.drive)] @ push.drive
            record.beside[voice.body, : len(gains)] += np.outer(gains.imag, push.force)
    voice.drive = None if push is None else push.drive
    is_resting = push is None and isinstance(voice.pushing, Touching) and voice.pushing.at_rest
    return is_resting or voice.pushing.finished


def _put(push: Push, voice: _Voice, number: int, record: Record) -> None:
    is_moved = push.drive is not voice.drive
    record.voices[number, STATE] = BEGIN if voice.drive is None else ON
    record.voices[number, OF_BODY] = voice.body
    record.voices[number, MOVED] = is_moved
    record.forces[number] = push.force
    record.loads[number] = voice.pushing.load if isinstance(voice.pushing, Touching) else 0.0
    if is_moved:
        record.drives[number, : len(push.drive)] = push.drive
        record.drives[number, len(push.drive) :] = 0.0


def _require_sound(push: Push, last: Array | None, width: int) -> None:
    """Raise an OptionError on a push that would spoil the modes' state permanently."""
    force = push.force
    if not np.abs(force).max() <= MAX_FORCE:  # NaN neither
        raise OptionError(
            f"an excitation was stopped: its force reached {rounded(np.abs(force).max())} N, and "
            f"must be finite and at most {rounded(MAX_FORCE)} N"
        )
    if push.drive is not last and not (len(push.drive) <= width and np.isfinite(push.drive).all()):
        raise OptionError(
            "an excitation was stopped: its drive is not finite or does not fit; begin it again "
            "on this model"
        )
