"""Ends of sounds: a fade if one is cut off, and a note on levels below hearing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, rounded
from struck.model.arrays import require_number

FADE = 0.01  # s, by default; a fade below 20 ms sounds like an end, not a decay
_DECAYED_RATIO = 10 ** (-60 / 20)  # level of the end over the peak, below which a sound has decayed
_END_SECONDS = 0.005  # s, from the end, of whose samples the root mean square is the level
_MIN_AUDIBLE_PEAK = 2.8e-4  # Pa, the peak of a tone of 20 dB SPL: softer than a quiet room
_REFERENCE_PRESSURE = 20e-6  # Pa, 0 dB SPL (ISO 1683)


def require_fade(fade: float | None, seconds: float | None) -> None:
    """Refuse a `fade`, s, that is negative, no number, or longer than the `seconds` of a sound."""
    if fade is None:
        return
    require_number("fade", fade, 0, hint="give seconds, as 0.01, or 0 for none", unit=" s")
    if seconds is not None and fade > seconds:
        raise OptionError(
            f"fade is {rounded(fade)} s and the sound lasts {rounded(seconds)} s: give a fade of "
            "at most that, or more seconds"
        )


def is_cut_off(samples: NDArray[np.floating], sample_rate: int) -> bool:
    """Return whether samples (C, n) end less than 60 dB below their peak."""
    peak = float(np.abs(samples).max(initial=0.0))
    end = samples[:, -max(1, round(_END_SECONDS * sample_rate)) :]
    levels = np.sqrt(np.square(end).mean(axis=1))
    return peak > 0 and float(levels.max()) > _DECAYED_RATIO * peak


def faded(
    samples: NDArray[np.floating], sample_rate: int, fade: float | None
) -> NDArray[np.floating]:
    """Return samples (C, n) whose last `fade` seconds go to 0; half of a sound shorter than 20 ms.

    The gain is cos^4: a tenth before the end it has fallen by 64 dB.
    """
    length = samples.shape[1]
    count = min(round(FADE * sample_rate), length // 2)
    count = count if fade is None else min(round(fade * sample_rate), length)
    if not count:
        return samples
    gains = np.cos(np.pi / 2 * np.arange(1, count + 1) / count) ** 4
    gains[-1] = 0.0
    result = samples.copy()
    result[:, length - count :] *= gains
    return result


def level_note(samples: NDArray[np.floating]) -> tuple[str, ...]:
    """Return a note on the level of samples, Pa, that are too soft to be heard, else ()."""
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= _MIN_AUDIBLE_PEAK:
        return ()
    if not peak:
        return ("it is silent: every sample is 0",)
    level = 20 * np.log10(peak / (np.sqrt(2) * _REFERENCE_PRESSURE))
    note = (
        f"it is too soft to be heard: its peak at the listener is {rounded(peak, 2)} Pa, that of a "
        f"tone of {level:.0f} dB SPL, and files saved at their peak level do not show that: strike "
        "harder or faster, with a harder striker, or come nearer"
    )
    return (note,)
