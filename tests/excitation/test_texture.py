"""Textures: their spectrum, that places keep their heights, and that nothing repeats."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import welch

from struck.excitation.path import Path
from struck.excitation.roughness import Roughness
from struck.excitation.scraping_force import Reader, SlidingContact, force_variation
from struck.excitation.texture import CHUNK
from tests.samples import sampled

Array = NDArray[np.float64]
FINISH = Roughness(rms=3e-6, correlation_length=1e-4, slope=-2.4, shortest=5e-6, waviness=4e-6)
SURFACES = ["sandpaper p80", "sandpaper", "rough wood", "wood", "steel", "glass", "concrete"]


def line(direction: tuple[float, float, float], step: float, count: int) -> Array:
    return np.outer(np.arange(count) * step, direction / np.linalg.norm(direction))


@pytest.mark.parametrize(
    ("slope", "way"),
    [
        (-2.4, (0, 3, -2)),
        *(
            pytest.param(slope, way, marks=pytest.mark.prove)
            for slope in (-1.6, -2.4, -3.2)
            for way in ((1, 0, 0), (1, 1, 1), (2, 3, 5))
        ),
    ],
)
def test_the_spectrum_follows_its_law_over_three_decades(
    slope: float, way: tuple[float, float, float]
) -> None:
    finish = Roughness(rms=1e-6, correlation_length=1e-3, slope=slope, shortest=2e-5)
    step, longest = 4e-6, 2e-2
    heights = [finish.layers(seed).at(line(way, step, 1 << 19)) for seed in range(4)]
    waves, power = welch(np.array(heights), 1 / step, nperseg=1 << 15)
    edges = np.geomspace(1 / longest, 1 / 2e-5, 19)
    assert edges[-1] / edges[0] == pytest.approx(1000)
    wanted = finish.spectrum(waves)
    mean = power.mean(axis=0)
    for low, high in pairwise(edges):
        band = (waves >= low) & (waves < high)
        assert abs(10 * np.log10(mean[band].sum() / wanted[band].sum())) < 1
    beyond = waves > 2.2 / 2e-5
    assert mean[beyond].max() < 0.05 * wanted[waves < 1 / 2e-5].min()


def test_a_place_keeps_its_height_in_any_order_of_reading() -> None:
    layers = FINISH.layers(5)
    chance = np.random.default_rng(0)
    places = chance.uniform(-0.5, 0.5, (3000, 3))
    heights = layers.at(places)
    order = chance.permutation(len(places))
    assert np.abs(layers.at(places[order]) - heights[order]).max() < 1e-12
    one_by_one = [layers.at(place[None])[0] for place in places[:100]]
    assert np.abs(one_by_one - heights[:100]).max() < 1e-12
    again = FINISH.layers(5).at(places)
    assert np.array_equal(again, heights)
    assert np.abs(FINISH.layers(6).at(places) - heights).max() > 1e-6


def test_on_a_path_that_returns_the_profile_returns() -> None:
    turned = np.linspace(0, 1, 50)
    points = np.stack([0.1 * np.cos(turned), 0.1 * np.sin(turned), 0.02 * turned], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lengths = np.concatenate([[0.0], np.cumsum(steps)])
    path = Path(points=points, spots=points, normals=points, lengths=lengths, repeat="back")
    ways = np.random.default_rng(1).uniform(0, path.length, 2000)
    layers = FINISH.layers(0)
    out, home, again = (
        layers.at(path.spot(each))
        for each in (ways, 2 * path.length - ways, ways + 8 * path.length)
    )
    assert out.std() > 1e-6
    assert np.abs(home - out).max() < 1e-12
    assert np.abs(again - out).max() < 1e-12


def test_two_surfaces_add_their_mean_squares() -> None:
    places = line((1.0, 2.0, 3.0), 1e-5, 400_000)
    one, other = FINISH.layers(1).at(places), FINISH.layers(2).at(places)
    assert (one + other).var() == pytest.approx(one.var() + other.var(), rel=0.03)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.03


def test_heights_are_close_to_normal() -> None:
    heights = FINISH.layers(1).at(np.random.default_rng(0).uniform(-1, 1, (100_000, 3)))
    spread = heights / heights.std()
    assert abs(np.mean(spread**3)) < 0.05
    assert np.mean(spread**4) == pytest.approx(3, abs=0.5)


def force(name: str, *, speed: float, seconds: float, rate: float) -> Array:
    """Return the force on a straight line over an endless plane, steel on steel, 1 N."""
    rubbed = SlidingContact(roughness=Roughness.named(name), modulus=1.1e11, radius=1e-3, seed=1)
    count = round(seconds * rate) // CHUNK * CHUNK
    ways = np.arange(1, count + 1) * (speed / rate)
    rows = count // CHUNK + 1
    squeezes = Reader(rubbed, rate).compressions(
        0, np.outer(ways, [0.6, 0.8, 0.0]), ways, np.full(rows, speed), np.ones(rows)
    )
    return force_variation(squeezes, np.ones(count))


def likeness(signal: Array, rate: float, *heard: Callable[[Array], Array]) -> list[float]:
    """Return the largest autocorrelations at lags above 50 ms, up to half the length.

    Each of `heard` gives the gain of what it is heard through at frequencies, Hz.
    """
    count = len(signal)
    padded = next_fast_len(2 * count, real=True)
    frequencies = np.fft.rfftfreq(padded, 1 / rate)
    spectrum = np.abs(rfft(signal.astype(np.float32), padded))
    largest = []
    for through in heard:
        powers = np.square(spectrum * through(frequencies)).astype(np.float32)
        found = irfft(powers, padded)[: count // 2]
        largest.append(float(np.abs(found[round(0.05 * rate) :]).max() / found[0]))
    return largest


def in_band(frequencies: Array) -> Array:
    return (frequencies >= 100) & (frequencies <= 10_000)


def on_a_dull_body(frequencies: Array) -> Array:
    """Return the gains of a mode of 700 Hz that falls by 60 dB within 90 ms."""
    decay = np.log(1000) / 0.09
    resonance = (2 * np.pi * 700) ** 2 + decay**2 - (2 * np.pi * frequencies) ** 2
    return in_band(frequencies) / np.abs(resonance + 4j * np.pi * decay * frequencies)


@pytest.mark.parametrize("name", sampled(SURFACES, "sandpaper", "steel"))
@pytest.mark.parametrize(
    ("speed", "seconds"),
    [(0.15, 60.0), *(pytest.param(v, 600.0, marks=pytest.mark.prove) for v in (0.05, 0.5, 1.0))],
)
def test_the_force_never_repeats(name: str, speed: float, seconds: float) -> None:
    rate = 20_500.0
    found = force(name, speed=speed, seconds=seconds, rate=rate)
    of_force, of_sound = likeness(found, rate, in_band, on_a_dull_body)
    assert of_force < 0.05
    assert of_sound < 0.1
