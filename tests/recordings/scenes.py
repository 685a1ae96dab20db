"""Synthetic takes of struck objects whose modes are known, and how well a fit finds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.signal import fftconvolve

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 44100
LEAD = RATE // 2
"""Samples of ambient noise before the hit."""
DETECTABLE = 16.0
"""Energy of a mode over the noise from which a matched filter detects it, dB."""
CLEAR = 19.0
"""The same from which it is measured."""
_RANGE = (120.0, 14000.0)
_SPLIT = (0.3, 5.0)
_HUM = (50.0, 100.0, 240.0, 480.0, 1440.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """Modes: Hz (M,), 1/s (M,), complex gains (channels, M), noise (channels,) rms."""

    frequencies: Array
    decays: Array
    gains: Complex
    noise: Array

    @property
    def poles(self) -> Complex:
        return -self.decays + 2j * np.pi * self.frequencies

    def detectable(self, least: float = DETECTABLE) -> NDArray[np.bool_]:
        """Return which modes have enough energy over white noise of the same level, dB."""
        energies = np.abs(self.gains) ** 2 / (4 * self.decays) * RATE
        return 10 * np.log10((energies / self.noise[:, None] ** 2).sum(axis=0)) > least


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Samples (channels, n) with a lead-in of `LEAD` samples, and the truth."""

    samples: Array
    truth: Truth


def scene(
    modes: int,
    level: float,
    chance: Generator,
    *,
    channels: int = 1,
    fan: bool = False,
    seconds: float = 2.0,
) -> Scene:
    """Return a take of a body of so many modes, three in ten beside another, at a level in dB."""
    frequencies, decays, gains = body(modes, chance)
    return recorded(
        frequencies,
        decays,
        _at_microphones(gains, channels, chance),
        level,
        chance,
        fan=fan,
        seconds=seconds,
    )


def pairs(decay: float, split: float, level: float, chance: Generator) -> Scene:
    """Return a take of four isolated pairs of one decay, 1/s, and one split, Hz."""
    low = _apart(4, (400.0, 6000.0), 100.0, chance)
    gains = np.ones(4)
    partners = 10 ** (chance.uniform(-8, 8, 4) / 20)
    frequencies = np.column_stack((low, low + split)).ravel()
    both = np.column_stack((gains, partners)).ravel()
    decays = np.full(8, decay)
    return recorded(frequencies, decays, both[None].astype(complex), level, chance)


def recorded(
    frequencies: Array,
    decays: Array,
    gains: Complex,
    level: float,
    chance: Generator,
    *,
    fan: bool = False,
    seconds: float = 2.0,
) -> Scene:
    """Return a take with noise so far, dB, under the mean rms of the first 100 ms."""
    sound = ringing(frequencies, decays, gains, round(seconds * RATE))
    peak = np.abs(sound).max()
    loud = np.sqrt((sound[:, : RATE // 10] ** 2).mean(axis=1)).mean()
    samples = np.pad(sound, ((0, 0), (LEAD, 0)))
    make = _fan if fan else _white
    noise = np.stack([make(samples.shape[1], chance) for _ in samples])
    rms = loud * 10 ** (-level / 20)
    truth = Truth(
        frequencies=frequencies,
        decays=decays,
        gains=gains / peak,
        noise=np.full(len(gains), rms / peak),
    )
    return Scene(samples=(samples + rms * noise) / peak, truth=truth)


def over_noise(frequencies: Array, energies: Array, chance: Generator) -> Array:
    """Return a take (1, n) of modes that decay by 6 1/s, of these energies over its noise, dB."""
    decays = np.full(len(frequencies), 6.0)
    noise = 0.01 * chance.standard_normal((1, LEAD + RATE))
    gains = 0.01 * np.sqrt(4 * decays * 10 ** (energies / 10) / RATE)
    sound = ringing(frequencies, decays, gains[None].astype(complex), RATE)
    return noise + np.pad(sound, ((0, 0), (LEAD, 0)))


def ringing(frequencies: Array, decays: Array, gains: Complex, length: int) -> Array:
    """Return the sum of Im[g exp(-d t + 2 pi i f t)], (channels, length)."""
    sound = np.zeros((len(gains), length))
    for pole, gain in zip(-decays + 2j * np.pi * frequencies, gains.T, strict=True):
        sound += np.imag(np.outer(gain, _wave(pole, length)))
    return sound


def _wave(pole: complex, length: int) -> Complex:
    """Return exp(s n / rate): every exponential is the product of a coarse and a fine one."""
    coarse = np.exp(pole / RATE * 512 * np.arange(-(-length // 512)))
    return np.outer(coarse, np.exp(pole / RATE * np.arange(512))).ravel()[:length]


def body(modes: int, chance: Generator) -> tuple[Array, Array, Array]:
    """Return frequencies, decays and gains (M,) of a body, three modes in ten beside another."""
    alone = round(0.85 * modes)
    low = _apart(alone, _RANGE, 6.0 if alone < 120 else 0.0, chance)
    decays = (
        1.5 + 2.5e-7 * low**2 * np.exp(chance.normal(0, 0.4, alone)) + chance.uniform(0, 0.3, alone)
    )
    decays *= np.exp(chance.normal(0, 0.25, alone))
    gains = 10 ** (chance.normal(0, 8, alone) / 20) * np.sqrt(1000 / np.maximum(low, 1000))
    doubled = chance.permutation(alone)[: modes - alone]
    count = len(doubled)
    partners = low[doubled] + np.exp(chance.uniform(*np.log(_SPLIT), count))
    frequencies = np.r_[low, partners]
    decays = np.r_[decays, decays[doubled] * np.exp(chance.normal(0, 0.1, count))]
    gains = np.r_[gains, gains[doubled] * 10 ** (chance.uniform(-8, 8, count) / 20)]
    order = np.argsort(frequencies)
    return frequencies[order], decays[order], gains[order]


def _apart(count: int, between: tuple[float, float], gap: float, chance: Generator) -> Array:
    """Return frequencies drawn log-uniformly, those closer than the gap drawn anew."""
    drawn = np.sort(np.exp(chance.uniform(*np.log(between), count)))
    while (close := np.flatnonzero(np.diff(drawn) < gap)).size:
        drawn[close] = np.exp(chance.uniform(*np.log(between), close.size))
        drawn.sort()
    return drawn


def _at_microphones(gains: Array, channels: int, chance: Generator) -> Complex:
    if channels == 1:
        return gains[None].astype(complex)
    shape = (channels, len(gains))
    spread = 10 ** (chance.normal(0, 6, shape) / 20) * chance.choice([-1, 1], shape)
    silent = np.where(chance.random(shape) < 0.15, 0.03, 1.0)
    return (gains * spread * silent).astype(complex)


def _white(length: int, chance: Generator) -> Array:
    return chance.standard_normal(length)


def _fan(length: int, chance: Generator) -> Array:
    """Return pink-like noise with the tones of a motor, of rms 1."""
    bins = np.fft.rfftfreq(length, 1 / RATE)
    spectrum = np.fft.rfft(_white(length, chance)) / np.sqrt(1 + (bins / 200) ** 1.6)
    noise = np.fft.irfft(spectrum, length)
    noise /= noise.std()
    times = np.arange(length) / RATE
    for index, tone in enumerate(_HUM):
        phase = chance.uniform(0, 2 * np.pi)
        noise += 0.5 * 10 ** (-index / 10) * np.sin(2 * np.pi * tone * times + phase)
    return noise / noise.std()


def hummed(take: Scene, level: float, chance: Generator) -> Scene:
    """Return a scene in mains hum of eight harmonics, so many dB under its first 100 ms.

    The mains are 0.02 Hz off, and the hum swells and fades by a tenth.
    """
    times = np.arange(take.samples.shape[1]) / RATE
    hum = np.zeros(len(times))
    for harmonic in range(1, 9):
        turns = 50.02 * harmonic * times + chance.random()
        hum += 10 ** ((1 - harmonic) / 10) * np.sin(2 * np.pi * turns)
    hum *= 1 + 0.1 * np.sin(0.6 * np.pi * times)
    loud = np.std(take.samples[:, LEAD : LEAD + RATE // 10])
    whole = take.samples + loud * 10 ** (level / 20) * hum / hum.std()
    return Scene(samples=whole / np.abs(whole).max(), truth=take.truth)


def struck_softly(modes: int, level: float, chance: Generator, *, push: float = 3e-3) -> Scene:
    """Return a scene under a half-sine push of so many seconds, with the gains that it leaves."""
    frequencies, decays, gains = body(modes, chance)
    count = round(push * RATE)
    force = np.sin(np.pi * np.arange(count) / count)
    rung = ringing(frequencies, decays, gains[None].astype(complex), 2 * RATE)
    sound = fftconvolve(rung, force[None], axes=1)[:, : 2 * RATE]
    poles = -decays + 2j * np.pi * frequencies
    gains = gains * (force[:, None] * np.exp(-np.outer(np.arange(count), poles) / RATE)).sum(axis=0)
    return with_noise(sound, frequencies, decays, gains[None], level, chance)


def in_room(
    modes: int, level: float, chance: Generator, *, seconds: float, distance: float
) -> Scene:
    """Return a scene in a room with this T60, heard from so many metres.

    Its answer is noise that dies away and is as loud as what comes directly at 0.6 m.
    """
    frequencies, decays, gains = body(modes, chance)
    dry = ringing(frequencies, decays, gains[None].astype(complex), 2 * RATE)
    times = np.arange(round(1.2 * seconds * RATE)) / RATE
    tail = chance.standard_normal(len(times)) * 1000 ** (-times / seconds) * (times > 0.003)
    tail *= distance / 0.6 / np.linalg.norm(tail)
    wet = dry + fftconvolve(dry, tail[None], axes=1)[:, : 2 * RATE]
    return with_noise(wet, frequencies, decays, gains[None].astype(complex), level, chance)


def with_noise(
    sound: Array, frequencies: Array, decays: Array, gains: Complex, level: float, chance: Generator
) -> Scene:
    """Return a take of a sound (channels, n) after `LEAD` samples, in white noise so far down, dB.

    The gains (channels, M) are those of the sound's modes.
    """
    loud = np.sqrt((sound[:, : RATE // 10] ** 2).mean())
    peak, rms = np.abs(sound).max(), loud * 10 ** (-level / 20)
    samples = np.pad(sound, ((0, 0), (LEAD, 0)))
    samples = samples + rms * chance.standard_normal(samples.shape)
    noise = np.full(len(gains), rms / peak)
    truth = Truth(frequencies=frequencies, decays=decays, gains=gains / peak, noise=noise)
    return Scene(samples=samples / peak, truth=truth)


def gain_controlled(
    take: Scene, threshold: float, ratio: float, *, attack: float = 5e-3, release: float = 0.15
) -> Scene:
    """Return a scene through a compressor that takes back up to 12 dB over a threshold, dB."""
    levels = 20 * np.log10(np.abs(take.samples[0]) / np.abs(take.samples).max() + 1e-9)
    wanted = np.clip((levels - threshold) * (1 - 1 / ratio), 0, 12)
    falls, rises = np.exp(-1 / (attack * RATE)), np.exp(-1 / (release * RATE))
    taken, gains = 0.0, np.zeros(len(wanted))
    for place, each in enumerate(wanted.tolist()):
        share = falls if each > taken else rises
        taken = share * taken + (1 - share) * each
        gains[place] = -taken
    return Scene(samples=take.samples * 10 ** (gains / 20), truth=take.truth)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """How a fit compares with the truth; errors are medians over the modes found.

    found, detected: shares of all and of the detectable modes; false: modes that are none; merged:
    those of them that stand for two which nobody could tell apart; cents, decay (relative), gain
    (dB).
    """

    found: float
    detected: float
    false: int
    merged: int
    cents: float
    decay: float
    gain: float


def paired(truth: Truth, poles: Complex, gains: Complex) -> tuple[NDArray[np.intp], ...]:
    """Return indices of true modes and of the fitted ones that are them, one to one.

    A mode is found when its frequency is right within 0.5 Hz or 10 cents, whichever is more, but
    within 0.45 of the distance to the next mode, and its gain (the largest over channels) within
    12 dB.
    """
    return _assigned(truth, poles, gains, reaches(truth.frequencies))


def score(
    truth: Truth, poles: Complex, gains: Complex, resolvable: NDArray[np.bool_] | None = None
) -> Score:
    """Compare fitted poles (-d + 2 pi i f) and gains (channels, M) with the truth.

    A false mode within 0.5 Hz or 10 cents of one that is not `resolvable` is merged; without that
    argument none is.
    """
    if not poles.size:
        return Score(
            found=0, detected=0, false=0, merged=0, cents=np.nan, decay=np.nan, gain=np.nan
        )
    rows, columns = paired(truth, poles, gains)
    hit = np.isin(np.arange(len(truth.frequencies)), rows)
    over = np.setdiff1d(np.arange(len(poles)), columns)
    merged = 0
    if resolvable is not None and over.size:
        reach = np.where(hit | resolvable, 1e-9, _widest(truth.frequencies))
        merged = len(_assigned(truth, poles[over], gains[:, over], reach)[0])
    fitted = poles.imag / (2 * np.pi)
    ratios = np.abs(gains).max(axis=0)[columns] / np.abs(truth.gains).max(axis=0)[rows]
    return Score(
        found=float(hit.mean()),
        detected=float(hit[truth.detectable()].mean()),
        false=len(over),
        merged=merged,
        cents=float(np.median(1200 * np.abs(np.log2(fitted[columns] / truth.frequencies[rows])))),
        decay=float(np.median(np.abs(-poles.real[columns] / truth.decays[rows] - 1))),
        gain=float(np.median(np.abs(20 * np.log10(ratios)))),
    )


def _assigned(
    truth: Truth, poles: Complex, gains: Complex, reach: Array
) -> tuple[NDArray[np.intp], ...]:
    fitted = poles.imag / (2 * np.pi)
    away = np.abs(truth.frequencies[:, None] - fitted) / reach[:, None]
    levels = [20 * np.log10(np.abs(each).max(axis=0) + 1e-15) for each in (truth.gains, gains)]
    off = np.abs(levels[0][:, None] - levels[1]) / 12
    possible = (away < 1) & (off < 1)
    rows, columns = linear_sum_assignment(np.where(possible, away + off, 1e3))
    right = possible[rows, columns]
    return rows[right], columns[right]


def _widest(frequencies: Array) -> Array:
    return np.maximum(0.5, frequencies * (2 ** (10 / 1200) - 1))


def reaches(frequencies: Array) -> Array:
    """Return how far a fitted frequency may be off to be that of a mode, Hz."""
    gaps = np.r_[np.inf, np.diff(frequencies), np.inf]
    spacings = np.minimum(gaps[:-1], gaps[1:])
    return np.maximum(np.minimum(_widest(frequencies), 0.45 * spacings), 0.02)


def repeated(
    count: int, chance: Generator, *, noise: float = 50.0
) -> tuple[Array, NDArray[np.int64], Truth]:
    """Return a take (1, n) of so many hits of one body, their first samples, and the truth.

    Hits differ by up to 18 dB and in the levels of their modes, and come every 0.25 to 0.9 s, on
    the tails of those before. The gains (hits, M) are those that each hit adds.
    """
    frequencies, decays, gains = body(30, chance)
    own = gains * 10 ** (chance.uniform(-18, 0, (count, 1)) / 20)
    own = own * 10 ** (chance.normal(0, 3, (count, len(gains))) / 20)
    gaps = chance.uniform(0.25, 0.9, count)
    starts = LEAD + np.round(np.cumsum(gaps) * RATE).astype(int) - round(gaps[0] * RATE)
    length = int(starts[-1]) + 2 * RATE
    sound = np.zeros(length)
    for pole, each in zip(-decays + 2j * np.pi * frequencies, own.T, strict=True):
        wave = _wave(pole, length).imag
        for start, gain in zip(starts, each, strict=True):
            sound[start:] += gain * wave[: length - start]
    peak = np.abs(sound).max()
    rms = 10 ** (-noise / 20)
    truth = Truth(
        frequencies=frequencies,
        decays=decays,
        gains=own.astype(complex) / peak,
        noise=np.full(count, rms),
    )
    return (sound / peak + rms * _fan(length, chance))[None], starts, truth
