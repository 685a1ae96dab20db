"""Which modes may be the room's: those that die away as fast as it does, or faster.

A room answers a hit with thousands of modes of its own, each about as short-lived as its
reverberation. Modes of the object that last clearly longer cannot be mistaken for them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, RecordingError
from struck.files.sound import Sound
from struck.recordings.gain_table import Recording
from struck.recordings.onsets import find_hits
from struck.recordings.takes.take import Take

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TRUSTED = 0.6
"""Of the room's decay rate: slower modes are the object's."""
_FROM, _TO = -5.0, -25.0
"""Of the decay curve that tells the reverberation time, dB (ISO 3382-1: T20)."""
_EARLY = 0.02
"""So long after the clap it is to be so far above the noise, s."""
_MEDIAN = 0.4549
"""Of the squares of Gaussian noise, over their mean."""


def may_be_of_room(decays: Array, seconds: float) -> Mask:
    """Return which modes (M,) with decay rates (M,), 1/s, a room of this T60 might have, s."""
    return decays > TRUSTED * np.log(1000) / seconds


def reverberation(room: float | Recording) -> float:
    """Return the reverberation time T60 of a room, s.

    Parameters
    ----------
    room : float, path, Sound or Take
        The time itself, or a recording of a clap in the room, a burst balloon or the like.

    Raises
    ------
    OptionError
        On a time that no room has.
    RecordingError
        When the recording holds no clap, or none that falls by 25 dB.
    """
    if isinstance(room, int | float):
        if not 0.01 <= room <= 30:
            raise OptionError(f"room is {room}: give its reverberation time, 0.01 to 30 s")
        return float(room)
    return _clapped(_take(room))


def _take(room: Recording) -> Take:
    if isinstance(room, Take):
        return room
    return Take.of(room, "the clap") if isinstance(room, Sound) else Take.load(room)


def _clapped(take: Take) -> float:
    """Return T60 by backward integration (Schroeder 1965) of the loudest channel's first hit."""
    hits = find_hits(take)
    if not hits:
        raise RecordingError(f"no clap was found in {take.name}: clap once in the empty room")
    loudest = take.samples[int((take.samples**2).sum(axis=1).argmax())]
    energy = loudest[hits[0].onset : hits[0].end] ** 2
    noise = float(np.median(energy[-len(energy) // 10 :])) / _MEDIAN
    early = energy[: round(_EARLY * take.sample_rate)].mean()
    energy = energy - noise
    curve = np.cumsum(energy[::-1])[::-1]
    levels = 10 * np.log10(np.maximum(curve / curve[0], 1e-12))
    first, last = np.argmax(levels < _FROM), np.argmax(levels < _TO)
    if not 0 < first < last or early < noise * 10 ** (-_TO / 10):
        raise RecordingError(
            f"the clap in {take.name} does not fall by {-_TO:g} dB before the noise: clap louder"
        )
    times = np.arange(first, last) / take.sample_rate
    slope = np.polyfit(times, levels[first:last], 1)[0]
    return float(-60 / slope)
