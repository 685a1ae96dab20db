"""Acceptance of a take: one clean hit after a quiet lead-in, neither clipped nor cut short."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import rounded
from struck.files.sound import Sound
from struck.model.arrays import Array

MARGIN = 0.01  # s, between the lead-in that is kept and the hit
FULL = 0.9995  # share of full scale from which a sample counts as clipped
_BLOCK = 0.001  # s, in which an onset is found
_ONSET_OVER_NOISE, _ONSET_UNDER_PEAK = 12.0, 30.0  # dB
_BURST_RISE, _BURST_UNDER_PEAK = 15.0, 40.0  # dB, of a noise in the lead-in
_SECOND_BLOCK, _SECOND_HISTORY = 0.005, 8  # s and blocks; a second hit exceeds all blocks before it
_SECOND_RISE, _SECOND_UNDER_PEAK = 6.0, 30.0  # dB
_MIN_FLAT_SAMPLES, _MIN_TOPS = 4, 3  # samples at the very same maximum, and how often
_DROPOUT_TIME = 0.005  # s of exact zeros
_MIN_AMPLITUDE = 1e-12  # of full scale: keeps logarithms finite


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Levels at which a take is accepted."""

    quietest: float = -40.0  # of its peak in every channel, dB of full scale
    loudest: float = -1.0  # the same
    above_noise: float = 20.0  # of its peak, over the root mean square of the ambient sound, dB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TakeVerdict:
    """Verdict on a take."""

    reason: str = ""  # of a refusal, and the way out; empty when the take is accepted
    sound: Sound | None = (
        None  # the part that is stored: lead-in, `MARGIN` and the sound from the hit on
    )
    peak: float = 0.0  # dB of full scale, of the loudest channel
    above_noise: float = 0.0  # dB, peak over ambient sound in the worst channel


def examine_take(
    sound: Sound, *, lead_in: float, seconds: float, bounds: Bounds, channels: int = 1
) -> TakeVerdict:
    """Return the verdict on a recording of one hit after `lead_in` seconds or more of noise.

    `seconds` of sound are kept after the hit; full scale is 1.0.
    """
    samples = sound.samples.astype(np.float64)
    rate, lead_length = sound.sample_rate, round(lead_in * sound.sample_rate)
    if len(samples) != channels:
        return TakeVerdict(reason=f"it has {len(samples)} channels instead of {channels}")
    if samples.shape[1] <= lead_length:
        return TakeVerdict(
            reason=f"it is cut short: it lasts {sound.duration:.2f} s, the lead-in alone "
            f"{rounded(lead_in)} s; look whether the device still records"
        )
    hit = _find_onset(samples, lead_length, rate)
    checks = (
        _check_clipping(samples),
        _check_lead_in(samples, lead_length, rate),
        _check_levels(samples, lead_length, bounds),
        _check_duration(hit, samples.shape[1], rate, seconds),
        "" if hit is None else _check_dropouts(samples, lead_length, hit, rate),
        "" if hit is None else _check_single_hit(samples, hit, rate),
    )
    reason = next(filter(None, checks), "")
    if reason or hit is None:
        return TakeVerdict(reason=reason)
    excerpt = samples[
        :, max(0, hit - lead_length - round(MARGIN * rate)) : hit + round(seconds * rate)
    ]
    return TakeVerdict(
        sound=Sound(samples=excerpt.astype(np.float32), sample_rate=rate),
        peak=float(_peaks(samples).max()),
        above_noise=float(
            (_peaks(samples[:, lead_length:]) - _level(samples[:, :lead_length])).min()
        ),
    )


def _find_onset(samples: Array, lead_length: int, rate: int) -> int | None:
    """Return the first sample of the hit in the first channel that hears it, or None."""
    size = max(1, round(_BLOCK * rate))
    noises = _level(samples[:, :lead_length])
    levels = _blocks(samples[:, lead_length:], size)
    thresholds = np.maximum(
        noises + _ONSET_OVER_NOISE, levels.max(axis=1, initial=-np.inf) - _ONSET_UNDER_PEAK
    )
    block_numbers = np.flatnonzero((levels >= thresholds[:, None]).any(axis=0))
    return lead_length + int(block_numbers[0]) * size if len(block_numbers) else None


def _check_clipping(samples: Array) -> str:
    """Return a reason on samples at full scale, or on tops that are flat below it."""
    for number, channel in enumerate(np.abs(samples), 1):
        full_count = np.count_nonzero(channel >= FULL)
        if full_count:
            return (
                f"channel {number} is clipped: {full_count} samples at full scale; turn the gain "
                "down, or strike more softly"
            )
        top = channel.max()
        runs = _runs(channel == top) if top > 0 else np.zeros(0, int)
        if np.count_nonzero(runs >= _MIN_FLAT_SAMPLES) >= _MIN_TOPS:
            return (
                f"channel {number} is clipped before the converter: {np.count_nonzero(runs)} tops "
                f"are flat at {20 * np.log10(top):.1f} dB; turn the preamplifier down"
            )
    return ""


def _check_lead_in(samples: Array, lead_length: int, rate: int) -> str:
    """Return a reason on a noise in the lead-in, such as a hit before its cue."""
    levels = _blocks(samples[:, :lead_length], max(1, round(10 * _BLOCK * rate)))
    if levels.shape[1] < 2:
        return ""
    loudest_blocks = levels.argmax(axis=1)
    rises = levels.max(axis=1) - np.percentile(levels, 20, axis=1)
    depths = _peaks(samples) - levels.max(axis=1)
    disturbed_channels = np.flatnonzero((rises > _BURST_RISE) & (depths < _BURST_UNDER_PEAK))
    if not len(disturbed_channels):
        return ""
    return (
        f"something sounds {0.01 * loudest_blocks[disturbed_channels[0]]:.2f} s into the lead-in, "
        "which has to hold ambient sound alone: keep still, and strike after the cue"
    )


def _check_levels(samples: Array, lead_length: int, bounds: Bounds) -> str:
    """Return a reason on a channel without a hit, or with one too quiet or too loud."""
    peaks = _peaks(samples[:, lead_length:])
    noises = _level(samples[:, :lead_length])
    for number, (peak, noise) in enumerate(zip(peaks, noises, strict=True), 1):
        channel_name = f"channel {number}"
        if peak - noise < bounds.above_noise:
            return (
                f"{channel_name} hears no hit: its peak is {peak - noise:.0f} dB over the ambient "
                f"sound, and {rounded(bounds.above_noise)} dB are needed; strike harder, come "
                "nearer, or quiet the room"
            )
        if peak < bounds.quietest:
            return (
                f"{channel_name} is too quiet: its peak is {peak:.1f} dB of full scale, below "
                f"{rounded(bounds.quietest)} dB; turn the gain up"
            )
        if peak > bounds.loudest:
            return (
                f"{channel_name} is too loud: its peak is {peak:.1f} dB of full scale, above "
                f"{rounded(bounds.loudest)} dB; turn the gain down"
            )
    return ""


def _check_duration(hit: int | None, length: int, rate: int, seconds: float) -> str:
    """Return a reason where no hit was found, or too little sound is left after it."""
    if hit is None:
        return "no hit was found after the lead-in: strike at the cue, harder or nearer"
    seconds_left = (length - hit) / rate
    if round(seconds_left * rate) >= round(seconds * rate):
        return ""
    return (
        f"it ends {seconds_left:.2f} s after the hit, and {rounded(seconds)} s are planned: strike "
        "sooner after the cue, or plan more patience or fewer seconds"
    )


def _check_dropouts(samples: Array, lead_length: int, hit: int, rate: int) -> str:
    """Return a reason on stretches of zeros that the ambient sound does not have."""
    for number, channel in enumerate(samples, 1):
        lead_run = _runs(channel[:lead_length] == 0).max(initial=0)
        longest = _runs(channel[hit:] == 0).max(initial=0)
        if lead_run < lead_length and longest > max(_DROPOUT_TIME * rate, 4 * lead_run):
            return (
                f"channel {number} has lost samples: {1000 * longest / rate:.0f} ms are exact "
                "zeros; close other programs, or use larger buffers"
            )
    return ""


def _check_single_hit(samples: Array, hit: int, rate: int) -> str:
    """Return a reason on a second hit: a 5 ms block far louder than all of the 40 ms before it."""
    levels = _blocks(np.diff(samples[:, hit:]), round(_SECOND_BLOCK * rate)).max(axis=0)
    first = _SECOND_HISTORY
    if len(levels) <= first:
        return ""
    windows = np.lib.stride_tricks.sliding_window_view(levels[:-1], first)
    rises = levels[first:] - windows.max(axis=1)
    is_loud = levels[first:] > levels.max() - _SECOND_UNDER_PEAK
    second_hits = np.flatnonzero((rises > _SECOND_RISE) & is_loud)
    if not len(second_hits):
        return ""
    return (
        f"it is struck twice, {(second_hits[0] + first) * _SECOND_BLOCK:.2f} s apart: let the "
        "hammer bounce off, and strike once"
    )


def _peaks(samples: Array) -> Array:
    """Return the peak of each channel, dB of full scale."""
    return 20 * np.log10(np.abs(samples).max(axis=1, initial=0.0) + _MIN_AMPLITUDE)


def _level(samples: Array) -> Array:
    """Return the root mean square of each channel, dB of full scale."""
    return 20 * np.log10(np.sqrt(np.square(samples).mean(axis=1)) + _MIN_AMPLITUDE)


def _blocks(samples: Array, size: int) -> Array:
    """Return the level of each whole block of each channel, dB (C, blocks)."""
    whole_blocks = samples[:, : samples.shape[1] // size * size]
    powers = np.square(whole_blocks.reshape(len(samples), -1, size)).mean(axis=2)
    return 10 * np.log10(powers + _MIN_AMPLITUDE**2)


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the lengths of all stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges[1::2] - edges[::2]
