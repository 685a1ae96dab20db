"""How loud a pascal is in a device's samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.strike import Strike
from struck.live.played import Played
from struck.synth.resonators import Resonators

Array = NDArray[np.float64]

STRIKE_PEAK = 10 ** (-12 / 20)
"""What a default strike peaks at, of full scale."""
_LISTENED = 0.25  # s
_BLOCK = 256


def full_scale(bodies: Sequence[Played], listener: Array, sample_rate: float) -> float:
    """Return what a Pa (or a relative unit) is of full scale.

    With it the loudest of the bodies, each struck by `Strike()`, peaks at -12 dB.

    Raises
    ------
    OptionError
        Where none of them is heard.
    """
    peak = max(_peak(body, listener, sample_rate) for body in bodies)
    if not peak > 0:
        raise OptionError(
            "none of the bodies is heard at the listener: look at the models' gains, or give "
            "another listener="
        )
    return STRIKE_PEAK / peak


def _peak(body: Played, listener: Array, sample_rate: float) -> float:
    outputs = [body.outputs(listener)[None]]
    modes = Resonators(
        [body.model], sample_rate=sample_rate, block=_BLOCK, voices=1, engine="stepped"
    )
    pushing = Strike().begin(body.model, sample_rate)
    peak = 0.0
    for _ in range(round(_LISTENED * sample_rate / _BLOCK)):
        push = pushing.advance(_BLOCK)
        peak = max(peak, float(np.abs(modes.process([push] if push else [], outputs)).max()))
    return peak
