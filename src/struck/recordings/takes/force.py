"""Channels that hold the force of the blow instead of sound: an instrumented hammer's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.recordings.takes.take import Take

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PULSE, _AFTER = 0.002, 0.1
"""A blow lasts so long on either side of its peak, and so long after it all is quiet again, s."""
_SHORT = 0.8
"""Of the energy, in the pulse."""
_PUSHED = 0.8
"""Of the pulse's energy, what is of one sign more than of the other: a blow does not pull."""


def force_channels(take: Take) -> Mask:
    """Return which channels (C,) hold pulses of one sign and no ringing; never all."""
    found = np.array([_is_force(channel, take.sample_rate) for channel in take.samples])
    return found & ~found.all()


def without_force(take: Take) -> Take:
    """Return a take of the microphones alone."""
    force = force_channels(take)
    if not force.any():
        return take
    return Take(samples=take.samples[~force], sample_rate=take.sample_rate, name=take.name)


def _is_force(channel: Array, sample_rate: int) -> bool:
    centred = channel - np.median(channel)
    energy = centred**2
    peak = int(np.argmax(energy))
    width = round(_PULSE * sample_rate)
    first = max(0, peak - width)
    pulse, whole = energy[first : peak + width], energy[first : peak + round(_AFTER * sample_rate)]
    one_sided = np.abs((np.sign(centred[first : peak + width]) * pulse).sum())
    return bool(pulse.sum() > _SHORT * whole.sum() and one_sided > _PUSHED * pulse.sum())
