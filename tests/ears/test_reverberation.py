"""A diffuse tail against Schroeder's integration and the laws of diffuse fields."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.signal

from struck.ears.reverberation import Reverberation, band_shares
from struck.ears.room import Images, Room
from struck.errors import OptionError
from struck.model.material import AIR

RATE = 48_000.0


def schroeder_time(response: np.ndarray, low: float = -35.0) -> float:
    """T60 by a line through -5 dB to `low` of the backward integration (ISO 3382-1)."""
    left = np.cumsum(response[::-1] ** 2)[::-1]
    decibels = 10 * np.log10(left[:-1] / left[0])
    fit = (decibels < -5) & (decibels > low)
    slope = np.polyfit(np.flatnonzero(fit) / RATE, decibels[fit], 1)[0]
    return -60 / slope


def band(signal: np.ndarray, low: float, high: float) -> np.ndarray:
    sos = scipy.signal.butter(4, (low, high), "bandpass", fs=RATE, output="sos")
    return scipy.signal.sosfilt(sos, signal)


@pytest.mark.parametrize("seconds", [0.4, 1.3, 4.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_tail_dies_away_in_its_time(seconds: float, seed: int) -> None:
    tail = Reverberation(seconds=seconds, volume=80.0, seed=seed).tail(RATE)
    assert tail.dtype == np.float32
    assert tail.shape == (2, round(seconds * RATE))
    for channel in tail.astype(float):
        assert schroeder_time(channel) == pytest.approx(seconds, rel=0.03)


def test_each_band_dies_away_in_its_own_time() -> None:
    times = {125: 2.0, 250: 2.0, 500: 2.0, 2000: 0.7, 4000: 0.7, 8000: 0.7}
    found = []
    for seed in range(8):  # few degrees of freedom in 300 Hz: one noise tells 5 %, the mean 2 %
        tail = Reverberation(seconds=times, volume=200.0, seed=seed).tail(RATE, 1)[0].astype(float)
        bands = band(tail, 100, 400), band(tail, 3000, 12_000)
        found.append([schroeder_time(part) for part in bands])
    np.testing.assert_allclose(np.mean(found, axis=0), (2.0, 0.7), rtol=0.03)


def test_bands_of_one_time_are_one_band() -> None:
    one = Reverberation(seconds=0.8, volume=100.0).tail(RATE)
    many = Reverberation(seconds=dict.fromkeys((125, 500, 2000), 0.8), volume=100.0).tail(RATE)
    np.testing.assert_allclose(many, one, atol=1e-6 * np.abs(one).max())


def test_shares_are_one_in_sum_and_one_at_the_centre() -> None:
    centres = np.array([125.0, 250.0, 1000.0])
    shares = band_shares(np.geomspace(1, 20_000, 500), centres)
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(band_shares(centres, centres), np.eye(3), atol=1e-12)
    assert band_shares([0.0], centres)[0, 0] == 1.0


@pytest.mark.parametrize(("seconds", "volume"), [(0.5, 60.0), (1.0, 200.0), (2.5, 12_000.0)])
def test_direct_sound_and_tail_are_equal_at_the_critical_distance(
    seconds: float, volume: float
) -> None:
    """The textbook's 0.057 sqrt(V / T), m (Kuttruff 2009, chapter 5)."""
    critical = 0.057 * math.sqrt(volume / seconds)
    tail = Reverberation(seconds=seconds, volume=volume).tail(RATE).astype(float)
    ratios = 10 * np.log10(critical**-2 / np.sum(tail**2, axis=1))
    assert np.abs(ratios).max() < 0.5


def test_critical_distance_is_the_textbooks() -> None:
    found = Reverberation(seconds={500: 1.0, 1000: 2.0}, volume=200.0).critical_distances()
    np.testing.assert_allclose(found, 0.057 * np.sqrt([200.0, 100.0]), rtol=0.01)  # two digits


@pytest.mark.parametrize("seconds", [1.5, {250: 1.5, 4000: 0.6}])
def test_level_is_that_of_the_whole_tail(seconds: float | dict[float, float]) -> None:
    tails = np.stack(  # one noise has some 50 degrees of freedom below 250 Hz: 0.6 dB
        [Reverberation(seconds=seconds, level=-12.0, seed=s).tail(RATE, 1)[0] for s in range(16)]
    )
    spectrum = np.mean(np.abs(np.fft.rfft(tails.astype(float))) ** 2, axis=0)
    frequencies = np.fft.rfftfreq(tails.shape[1], 1 / RATE)
    for low, high in ((20, 250), (4000, 16_000)):
        mean = spectrum[(frequencies > low) & (frequencies < high)].mean()
        assert abs(10 * np.log10(mean) + 12) < 0.5


@pytest.mark.parametrize("order", [1, 2, 3])
def test_tail_takes_over_where_the_images_end(order: int) -> None:
    """A few images and the tail have the energy of all images (here: up to order 24)."""
    room, whole = (Room(size=(5.3, 4.1, 3.2), walls=0.2, order=n) for n in (order, 24))
    places = np.random.default_rng(4).uniform(0.5, 2.7, (20, 2, 3))
    tail = room.expected_reverberation().tail(RATE, 1, start=room.mixing_time()).astype(float)
    few, every = (reflected(images, places) for images in (room.images(), whole.images()))
    assert abs(10 * np.log10((few + np.sum(tail**2)) / every)) < 0.5


def reflected(images: Images, places: np.ndarray) -> float:
    """Return the mean energy of all images but the source, where 20 % are absorbed."""
    distances = [np.linalg.norm(images.at(p) - listener, axis=1) for p, listener in places]
    energies = 0.8**images.reflections / np.square(distances)
    return float(np.mean(energies[:, 1:].sum(axis=1)))


def test_a_late_start_leaves_out_the_beginning_only() -> None:
    """After 0.1 s of a T60 of 0.6 s, 10 dB are gone."""
    reverberation = Reverberation(seconds=0.6, volume=50.0)
    whole = reverberation.tail(RATE, 1)[0].astype(float)
    late = reverberation.tail(RATE, 1, start=0.1)[0].astype(float)
    assert len(late) == len(whole) - 4800
    assert 10 * np.log10(np.sum(late**2) / np.sum(whole**2)) == pytest.approx(-10, abs=0.4)
    assert reverberation.tail(RATE, start=0.7).shape == (2, 0)


def test_ears_are_coherent_as_two_points_in_a_diffuse_field() -> None:
    """sin(k d) / (k d) by Welch's method: near 1 below 100 Hz, 0 at c / 2d, then negative."""
    spacing = 0.175
    tail = Reverberation(seconds=8.0, volume=5000.0).tail(RATE, ear_spacing=spacing)
    steady = 10 ** (3 * np.arange(tail.shape[1]) / tail.shape[1])  # or the first second decides
    left, right = steady * tail
    frequencies, cross = scipy.signal.csd(left, right, RATE, nperseg=1024)
    powers = [scipy.signal.welch(ear, RATE, nperseg=1024)[1] for ear in (left, right)]
    coherence = cross / np.sqrt(powers[0] * powers[1])
    k = 2 * np.pi * frequencies[1:] / AIR.sound_speed
    expected = np.sin(k * spacing) / (k * spacing)
    assert np.sqrt(np.mean(np.abs(coherence[1:] - expected) ** 2)) < 0.06
    assert coherence.real[frequencies < 150][1:].min() > 0.9
    dip = (frequencies > 1250) & (frequencies < 1550)  # the first negative lobe: -0.217
    assert coherence.real[dip].mean() == pytest.approx(-0.21, abs=0.05)


def test_both_ears_are_equally_loud() -> None:
    left, right = Reverberation(seconds=2.0, volume=100.0).tail(RATE).astype(float)
    assert abs(10 * np.log10(np.sum(left**2) / np.sum(right**2))) < 0.3


def test_a_seed_gives_the_same_tail() -> None:
    make = [Reverberation(seconds=0.3, volume=50.0, seed=s).tail(RATE) for s in (5, 5, 6)]
    np.testing.assert_array_equal(make[0], make[1])
    assert abs(np.corrcoef(make[0][0], make[2][0])[0, 1]) < 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seconds": 0.0, "volume": 1.0}, "reverberation in s is 0.0"),
        ({"seconds": {1000: math.nan}, "volume": 1.0}, "reverberation in s is nan"),
        ({"seconds": {-1.0: 1.0}, "volume": 1.0}, "reverberation in Hz is -1.0"),
        ({"seconds": {}, "volume": 1.0}, "names no band"),
        ({"seconds": 1.0}, "give one of them"),
        ({"seconds": 1.0, "volume": 1.0, "level": 0.0}, "give one of them"),
        ({"seconds": 1.0, "volume": -3.0}, "volume of -3.0"),
        ({"seconds": 1.0, "level": math.inf}, "level is inf"),
    ],
)
def test_impossible_reverberation_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Reverberation(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sample_rate": 0.0}, "sample rate is 0.0 Hz"),
        ({"channels": 3}, "3 channels"),
        ({"start": -0.1}, "starts at -0.1"),
        ({"ear_spacing": 0.0}, "ears 0.0 m apart"),
    ],
)
def test_impossible_tails_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Reverberation(seconds=1.0, volume=50.0).tail(**{"sample_rate": RATE, **options})  # type: ignore[arg-type]
