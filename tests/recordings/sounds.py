"""Sounds that nobody struck: tones, speech, noise, and a cymbal's crowd of modes."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.recordings.scenes import RATE, ringing

Array = NDArray[np.float64]

_VOWELS = ((730, 1090, 2440), (270, 2290, 3010), (300, 870, 2240), (530, 1840, 2480))
"""Formants of Peterson & Barney 1952, Hz."""


def sine(seconds: float = 1.5) -> Array:
    return 0.5 * np.sin(2 * np.pi * 440 * np.arange(round(seconds * RATE)) / RATE)


def chord(seconds: float = 1.5) -> Array:
    """Return an organ chord: it sets in like a hit, and stays."""
    times = np.arange(round(seconds * RATE)) / RATE
    tones = sum(np.sin(2 * np.pi * tone * times) for tone in (220.0, 277.2, 329.6, 440.0))
    return np.pad(0.1 * tones * np.minimum(times / 0.02, 1), (RATE // 3, 0))


def speech(chance: Generator, seconds: float = 1.5) -> Array:
    """Return four vowels of a gliding voice, pulses through formants."""
    length = round(seconds * RATE)
    times = np.arange(length) / RATE
    wander = np.cumsum(chance.standard_normal(length)) / np.sqrt(RATE)
    pitch = 120 * np.exp(0.15 * np.sin(2 * np.pi * 0.7 * times) + 0.03 * wander)
    pulses = np.diff(np.floor(np.cumsum(pitch) / RATE), prepend=0.0)
    said = np.zeros(length)
    for place, formants in enumerate(_VOWELS):
        voice = pulses + 0.02 * chance.standard_normal(length)
        for formant in formants:
            radius = np.exp(-np.pi * 100 / RATE)
            turn = 2 * np.cos(2 * np.pi * formant / RATE)
            voice = lfilter([1.0], [1.0, -radius * turn, radius**2], voice)
        shape = np.clip(1 - 1.2 * np.abs(4 * times / seconds - place - 0.5), 0, 1)
        said += shape * voice / np.abs(voice).max()
    return np.pad(0.7 * said / np.abs(said).max(), (RATE // 3, 0))


def cymbal(chance: Generator, seconds: float = 1.5) -> Array:
    """Return three thousand modes, one every 6 Hz."""
    frequencies = chance.uniform(300, 18000, 3000)
    gains = chance.standard_normal((1, 3000)) + 1j * chance.standard_normal((1, 3000))
    sound = ringing(frequencies, 2 + frequencies / 3000, gains, round(seconds * RATE))[0]
    return np.pad(0.8 * sound / np.abs(sound).max(), (RATE // 4, 0))


def burst(chance: Generator, seconds: float = 1.0) -> Array:
    """Return noise that fades like a hit."""
    times = np.arange(round(seconds * RATE)) / RATE
    return np.pad(0.2 * chance.standard_normal(len(times)) * np.exp(-5 * times), (RATE // 3, 0))


def music(chance: Generator, seconds: float = 8.0) -> Array:
    """Return sustained chords of five partials a tone, with a new one every half second."""
    length = round(seconds * RATE)
    times, played = np.arange(length) / RATE, np.zeros(length)
    begins = np.arange(0, seconds, 0.5)
    for begin in begins:
        rise = np.clip((times - begin) / 0.02, 0, 1) * np.clip((begin + 0.55 - times) / 0.05, 0, 1)
        here = slice(*np.flatnonzero(rise)[[0, -1]])
        for tone in 220 * 2 ** (chance.choice(24, 3, replace=False) / 12):
            for partial in range(1, 6):
                turn = 2 * np.pi * (partial * tone * times[here] + chance.random())
                played[here] += rise[here] * np.sin(turn) / partial
    return 0.1 * played


def engine(chance: Generator, seconds: float = 4.0) -> Array:
    """Return forty harmonics of an engine of 25 turns a second that speeds up and slows down."""
    times = np.arange(round(seconds * RATE)) / RATE
    wander = np.cumsum(chance.standard_normal(len(times))) / np.sqrt(RATE)
    turns = np.cumsum(25 + 1.5 * np.sin(0.8 * np.pi * times) + 0.3 * wander) / RATE
    tones = sum(np.sin(2 * np.pi * k * turns + k * k) / k for k in range(1, 41))
    return 0.1 * tones + 0.02 * chance.standard_normal(len(times))
