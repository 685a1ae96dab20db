"""A limiter between synthesis and a person's ears: no sample exceeds the ceiling, ever.

It looks ahead: samples leave late by `delay`, so the gain can fall before a peak instead of on it.
With r(n) = min(1, ceiling / loudest channel at n), each sample's gain takes four steps:

1. hold: m(n), the least r of the last D + 1 + hold samples (D the delay), by a monotonic queue
   (D. Lemire, "Streaming maximum-minimum filter using no more than three comparisons per
   element", Nordic Journal of Computing 13(4), 2006);
2. release: back towards m exponentially, down to m at once;
3. attack: two moving averages, D + 2 samples long together. All that they average at n + D is at
   most r(n), so their mean is too: the ceiling holds, and the gain has no corner;
4. the same gain for all channels: the image does not move.

The moving averages add and subtract whole numbers below 2^53, which float64 does exactly: nothing
drifts, and a gain that should be 1 is 1. Last, a fade opens or closes the output.

Peaks are sample peaks; true peaks between samples may be higher (ITU-R
BS.1770-5, annex 2).
"""

from __future__ import annotations

import math

import numpy as np

from struck.core import entry
from struck.errors import OptionError
from struck.model.arrays import Array

# Places in the state. All are float64, so that a scene's whole state can be one array.
CEILING, RELEASE, FADE_STEP = 0, 1, 2
CHANNELS, DELAY, HELD, FIRST_LENGTH, SECOND_LENGTH, UNIT = 3, 4, 5, 6, 7, 8
TIME, RELEASED, FIRST_SUM, SECOND_SUM, OPENING = 9, 10, 11, 12, 13
OLDEST, NEWEST = 14, 15  # of the queue, both only grow
REPLACED, LEAST_GAIN = 16, 17  # for the user's thread
_HEAD = 18

_EXACT_BITS = 53  # bits of a whole number that float64 holds
_OPEN_TOLERANCE = 1e-9  # the release ends here: -180 dB below a gain of 1


def limiter(
    *,
    sample_rate: float,
    channels: int,  # heard together
    ceiling: float = 0.89,  # -1 dB; rounded down to float32, to hold in a device's samples too
    look_ahead: float = 0.0015,  # s; how long the gain takes to fall, and how late samples leave
    hold: float = 0.010,  # s before the gain rises: half a period of the lowest unmodulated tone
    release: float = 0.2,  # s, time constant with which the gain rises again
    fade: float = 0.02,  # s in which the output opens or closes
) -> Array:
    """Return the state of a limiter at rest whose output is closed, for `limit` to change."""
    _check(sample_rate, channels, ceiling, look_ahead, hold, release, fade)
    delay = max(1, round(look_ahead * sample_rate))
    hold_length = delay + 1 + round(hold * sample_rate)
    first_length = (delay + 2) // 2
    second_length = delay + 2 - first_length
    state = np.zeros(_HEAD + first_length + second_length + 2 * hold_length + channels * delay)
    unit = 2.0 ** math.floor(_EXACT_BITS - math.log2(first_length * second_length))
    state[[CEILING, RELEASE, FADE_STEP]] = (
        rounded_down(ceiling),
        -math.expm1(-1 / (release * sample_rate)),
        1 / max(1, round(fade * sample_rate)),
    )
    state[CHANNELS : UNIT + 1] = channels, delay, hold_length, first_length, second_length, unit
    state[_HEAD : _HEAD + first_length] = unit
    state[_HEAD + first_length : _HEAD + first_length + second_length] = unit * first_length
    state[[RELEASED, LEAST_GAIN]] = 1
    state[[FIRST_SUM, SECOND_SUM]] = unit * first_length, unit * first_length * second_length
    return state


def rounded_down(ceiling: float) -> float:
    """Return the largest float32 that is not above a number."""
    single = np.float32(ceiling)
    return float(single if float(single) <= ceiling else np.nextafter(single, np.float32(0)))


def _check(sample_rate: float, channels: int, *amounts: float) -> None:
    if channels < 1:
        raise OptionError(f"a limiter of {channels} channels: give at least 1")
    ceiling, look_ahead, hold, release, fade = amounts
    positive_amounts = (sample_rate, ceiling, look_ahead, release, fade)
    if not (all(0 < amount < math.inf for amount in positive_amounts) and 0 <= hold < math.inf):
        raise OptionError(
            f"sample_rate {sample_rate} Hz, ceiling {ceiling}, look_ahead {look_ahead} s, hold "
            f"{hold} s, release {release} s, fade {fade} s: give finite numbers above 0 (hold may "
            "be 0)"
        )


def limit(state: Array, samples: Array, opened: bool) -> None:  # noqa: FBT001 - as the callback calls it
    """Limit samples (channels, block) in place while the output opens (or stays open) or closes.

    Samples that are not finite become 0 and are counted in `state[REPLACED]`.
    """
    if len(samples) != state[CHANNELS]:
        raise OptionError(f"{len(samples)} channels for a limiter of {int(state[CHANNELS])}")
    compiled_loop = entry("limiter_limit")
    if compiled_loop is None:
        limit_plainly(state, samples, opened)
    else:
        compiled_loop(state, state.size, samples, *samples.shape, opened)


def is_closed(state: Array) -> bool:
    """Return whether the sound has faded out completely."""
    return bool(state[OPENING] == 0.0)


def limit_plainly(state: Array, samples: Array, opened: bool) -> None:  # noqa: FBT001 - as `limit`
    """Limit samples as `limit` does, without the core."""
    state[LEAST_GAIN] = 1.0
    for sample in range(samples.shape[1]):
        peak = _find_peak(state, samples, sample)
        held_gain = _hold_gain(state, state[CEILING] / peak if peak > state[CEILING] else 1.0)
        gain = _smooth_gain(state, _release_gain(state, held_gain))
        state[LEAST_GAIN] = min(state[LEAST_GAIN], gain)
        _play(state, samples, sample, gain, _fade(state, opened))
        state[TIME] += 1


def _find_peak(state: Array, samples: Array, sample: int) -> float:
    peak = 0.0
    for channel in range(samples.shape[0]):
        if not np.isfinite(samples[channel, sample]):
            samples[channel, sample] = 0.0
            state[REPLACED] += 1
        peak = max(peak, abs(samples[channel, sample]))
    return peak


def _hold_gain(state: Array, gain: float) -> float:
    """Return the least of the recent gains; the queue holds times and gains that both rise."""
    size = int(state[HELD])
    first = _HEAD + int(state[FIRST_LENGTH]) + int(state[SECOND_LENGTH])
    times, gains = state[first : first + size], state[first + size : first + 2 * size]
    first_entry, end_entry = int(state[OLDEST]), int(state[NEWEST])
    if end_entry > first_entry and times[first_entry % size] <= state[TIME] - size:
        first_entry += 1
    while end_entry > first_entry and gains[(end_entry - 1) % size] >= gain:
        end_entry -= 1
    times[end_entry % size] = state[TIME]
    gains[end_entry % size] = gain
    state[OLDEST], state[NEWEST] = first_entry, end_entry + 1
    return gains[first_entry % size]


def _release_gain(state: Array, target: float) -> float:
    gain = state[RELEASED] + state[RELEASE] * (target - state[RELEASED])
    state[RELEASED] = target if target - gain < _OPEN_TOLERANCE else gain
    return state[RELEASED]


def _smooth_gain(state: Array, gain: float) -> float:
    """Return the mean of the means of the last gains."""
    first_length, second_length = int(state[FIRST_LENGTH]), int(state[SECOND_LENGTH])
    time = int(state[TIME])
    units = math.floor(gain * state[UNIT])
    place = _HEAD + time % first_length
    state[FIRST_SUM] += units - state[place]
    state[place] = units
    place = _HEAD + first_length + time % second_length
    state[SECOND_SUM] += state[FIRST_SUM] - state[place]
    state[place] = state[FIRST_SUM]
    return state[SECOND_SUM] / (first_length * second_length * state[UNIT])


def _fade(state: Array, opened: bool) -> float:  # noqa: FBT001
    """Return the next gain of the fade: a raised cosine, 0 to 1."""
    step = state[FADE_STEP] if opened else -state[FADE_STEP]
    state[OPENING] = min(1.0, max(0.0, state[OPENING] + step))
    if state[OPENING] == 1.0:
        return 1.0
    return math.sin(0.5 * math.pi * state[OPENING]) ** 2


def _play(state: Array, samples: Array, sample: int, gain: float, fade: float) -> None:
    """Exchange a sample of each channel for the one that entered the delay before it."""
    delay = int(state[DELAY])
    first = state.size - samples.shape[0] * delay + int(state[TIME]) % delay
    for channel in range(samples.shape[0]):
        place = first + channel * delay
        delayed_sample = state[place]
        state[place] = samples[channel, sample]
        limited_sample = min(state[CEILING], max(-state[CEILING], delayed_sample * gain))
        samples[channel, sample] = limited_sample * fade
