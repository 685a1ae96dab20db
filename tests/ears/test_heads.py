"""Heads that are spheres against the series itself, and against the formulas they are named by."""

from __future__ import annotations

import numpy as np
import pytest

from struck.ears.heads import Filters, Head, SimpleHead, SphereHead, WoodworthHead
from struck.ears.sphere import pressure
from struck.errors import OptionError
from struck.model.material import AIR

RADIUS, SPEED = 0.0875, 343.21
HEADS: list[Head] = [SphereHead(), SphereHead(ear_angle=100), WoodworthHead(), SimpleHead()]


def around(azimuths: np.ndarray) -> np.ndarray:
    """Return directions in the ears' plane."""
    return np.stack([np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=1)


def spectra(
    filters: Filters, directions: np.ndarray, distance: float, frequencies: np.ndarray, rate: float
) -> np.ndarray:
    """Return what reaches both ears (F, n, 2), delays included."""
    delays, responses = filters.toward(directions, np.full(len(directions), distance))
    waves = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(filters.taps)) / rate)
    phases = np.exp(-2j * np.pi * np.multiply.outer(frequencies, delays))
    return np.einsum("ft,net->fne", waves, responses.astype(float)) * phases


def decibels(values: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.abs(values))


# Beside the table's knots, 0.1006 m (the nearest) to 20 m.
@pytest.mark.parametrize("distance", [0.101, 0.12, 0.15, 0.4, 1.7, 20.0])
@pytest.mark.parametrize(
    "rate", [8000.0, 44100.0, 48000.0, pytest.param(192000.0, marks=pytest.mark.prove)]
)
def test_responses_follow_the_series(rate: float, distance: float) -> None:
    angles = np.radians(np.arange(0.2, 180, 0.7))
    frequencies = np.append(500, np.linspace(50, min(0.4 * rate, 20000), 80))
    filters = SphereHead().prepared(rate)
    found = spectra(filters, around(np.pi / 2 - angles), distance, frequencies, rate)[..., 0]
    ratio = found / pressure(frequencies, angles, distance)
    assert np.max(np.abs(decibels(ratio))) < 0.5
    assert np.max(np.abs(np.angle(ratio[0]))) / (2 * np.pi * 500) < 5e-6


def test_ears_sit_where_they_are_said_to() -> None:
    filters, rate = SphereHead(ear_angle=100).prepared(48000), 48000
    directions = np.array([[0.48, 0.6, 0.64], [0.0, 0.0, 1.0], [-0.6, 0.8, 0.0]])
    ear = np.array([np.cos(np.radians(100)), np.sin(np.radians(100)), 0])
    frequencies = np.array([300.0, 2000, 7000])
    for side, mirror in enumerate([1, -1]):
        angles = np.arccos(directions @ (ear * [1, mirror, 1]))
        found = spectra(filters, directions, 0.6, frequencies, rate)[..., side]
        np.testing.assert_allclose(found, pressure(frequencies, angles, 0.6), rtol=0.02)


@pytest.mark.parametrize("head", HEADS, ids=repr)
def test_left_mirrors_right(head: Head) -> None:
    directions = np.random.default_rng(1).standard_normal((20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    distances = np.geomspace(0.1, 50, 20)
    filters = head.prepared(48000)
    delays, responses = filters.toward(directions, distances)
    mirrored_delays, mirrored = filters.toward(directions * [1, -1, 1], distances)
    np.testing.assert_allclose(mirrored_delays, delays[:, ::-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(mirrored, responses[:, ::-1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("head", [SphereHead(), WoodworthHead()], ids=repr)
def test_source_on_the_left_is_louder_and_earlier_at_the_left_ear(head: Head) -> None:
    filters = head.prepared(48000)
    left = around(np.radians([20.0, 90.0, 160.0]))
    ears = spectra(filters, left, 1.0, np.array([500.0, 3000.0]), 48000)
    assert np.all(np.abs(ears[..., 0]) > 1.05 * np.abs(ears[..., 1]))
    assert np.all(np.angle(ears[0, :, 0] / ears[0, :, 1]) > 0)
    delays, _ = filters.toward(left, np.ones(3))
    assert np.all(delays[:, 0] < delays[:, 1] - 1e-4)


def bends(filters: Filters, step: float) -> tuple[float, float]:
    """Return the largest second differences of delays and responses while a source turns."""
    turn = np.arange(0, 2 * np.pi, step)
    delays, responses = filters.toward(around(turn), np.full(turn.shape, 0.5))
    both = (np.diff(each.astype(float), 2, axis=0) for each in (delays, responses))
    delay, response = (float(np.max(np.abs(each))) for each in both)
    return delay, response


@pytest.mark.parametrize("head", HEADS, ids=repr)
def test_turning_source_has_no_jumps_and_no_corners(head: Head) -> None:
    # Halving the step quarters second differences of what has no corner, halves those of what
    # has corners (a table with straight lines), and leaves those of jumps.
    filters = head.prepared(48000)
    coarse, fine = bends(filters, np.radians(0.2)), bends(filters, np.radians(0.1))
    assert coarse[0] > 3 * fine[0]
    assert coarse[1] > 3 * fine[1] or coarse[1] < 1e-6


def test_delay_of_the_sphere_bends_gently() -> None:
    # Cosine and arc have a curvature of a / c, the rounded peak of a / (0.15 c).
    step = np.radians(0.05)
    assert bends(SphereHead().prepared(48000), step)[0] < 8 * RADIUS / SPEED * step**2


def test_leaving_source_has_no_jumps() -> None:
    distances = np.geomspace(0.09, 40, 8001)
    directions = np.tile(around(np.radians([60.0])), (8001, 1))
    delays, responses = SphereHead().prepared(48000).toward(directions, distances)
    assert np.max(np.abs(np.diff(delays, axis=0))) < 2e-6
    assert np.max(np.abs(np.diff(responses, axis=0))) < 0.02 * np.max(np.abs(responses))


def test_near_source_has_the_interaural_level_of_the_series() -> None:
    filters, frequencies = SphereHead(ear_angle=100).prepared(48000), np.array([500.0, 4000.0])
    beside = around(np.array([np.pi / 2]))
    for distance in (0.125, 0.15, 0.25, 1.0, 3.0):
        ears = decibels(spectra(filters, beside, distance, frequencies, 48000)[:, 0])
        exact = decibels(pressure(frequencies, np.radians([10, 170]), distance))
        np.testing.assert_allclose(ears[:, 0] - ears[:, 1], exact[:, 0] - exact[:, 1], atol=0.1)
    # And the tabulated one at 500 Hz, 12.5 cm.
    ears = decibels(spectra(filters, beside, 0.125, frequencies, 48000)[0, 0])
    assert ears[0] - ears[1] == pytest.approx(20.5, abs=0.15)


@pytest.mark.parametrize("head", [WoodworthHead(), SimpleHead()], ids=repr)
def test_delays_are_woodworth_s(head: Head) -> None:
    azimuths = np.radians([-90.0, -33.3, 0, 15, 44.4, 90, 120])
    delays, _ = head.prepared(44100).toward(around(azimuths), np.full(7, 3.0))
    found = delays[:, 1] - delays[:, 0]
    sines = np.sin(azimuths)
    woodworth = RADIUS / AIR.sound_speed * (sines + np.arcsin(sines))
    np.testing.assert_allclose(found, woodworth, rtol=0, atol=1e-7)


@pytest.mark.parametrize("rate", [8000.0, 48000.0, 192000.0])
def test_shadow_is_brown_and_duda_s(rate: float) -> None:
    angles = np.radians([0.0, 45.5, 90, 120, 150, 179])
    frequencies = np.linspace(0, 0.1 * rate, 20)
    filters = WoodworthHead().prepared(rate)
    delays, responses = filters.toward(around(np.pi / 2 - angles), np.ones(6))
    waves = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(filters.taps)) / rate)
    alpha = 1.05 + 0.95 * np.cos(np.radians(180) * angles / np.radians(150))
    # Brown & Duda 1998, equation of H(omega, theta), with the warp of the bilinear transform.
    warped = 2 * rate * np.tan(np.pi * frequencies / rate)
    ratio = 1j * warped[:, None] * RADIUS / (2 * SPEED)
    expected = (1 + alpha * ratio) / (1 + ratio)
    np.testing.assert_allclose(waves @ responses[:, 0].T, expected, rtol=0, atol=4e-3)
    assert np.all(np.diff(delays[:, 0]) > 0)


def test_simple_head_has_no_levels() -> None:
    filters = SimpleHead().prepared(44100)
    _, responses = filters.toward(around(np.linspace(0, 6, 50)), np.geomspace(0.1, 9, 50))
    assert filters.taps == 1
    np.testing.assert_allclose(responses, 1, rtol=1e-6)


@pytest.mark.parametrize("head", HEADS, ids=repr)
def test_answers_are_of_the_promised_kind(head: Head) -> None:
    filters = head.prepared(48000)
    for count in (0, 1, 3):
        delays, responses = filters.toward(around(np.ones(count)), np.ones(count))
        assert delays.shape == (count, 2)
        assert delays.dtype == np.float64
        assert responses.shape == (count, 2, filters.taps)
        assert responses.dtype == np.float32
    assert head.prepared(48000) is filters
    assert head.name
    assert head.references


def test_one_source_is_answered_with_the_others_as_alone() -> None:
    filters = SphereHead().prepared(48000)
    directions, distances = around(np.array([0.3, 2.0, 4.0])), np.array([0.05, 1.0, 1e3])
    together = filters.toward(directions, distances)
    for n in range(3):
        alone = filters.toward(directions[n : n + 1], distances[n : n + 1])
        np.testing.assert_allclose(alone[0][0], together[0][n], rtol=1e-12)
        np.testing.assert_allclose(alone[1][0], together[1][n], rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", [SphereHead, WoodworthHead, SimpleHead])
@pytest.mark.parametrize("bad", [-1.0, 0.0, 1.0, np.nan, np.inf])
def test_impossible_heads_are_refused(kind: type, bad: float) -> None:
    with pytest.raises(OptionError, match="radius"):
        kind(radius=bad)
    with pytest.raises(OptionError, match="sample_rate"):
        kind().prepared(bad)


@pytest.mark.parametrize("bad", [-10.0, 0.0, 180.0, np.nan])
def test_impossible_ear_angles_are_refused(bad: float) -> None:
    with pytest.raises(OptionError, match="ear_angle"):
        SphereHead(ear_angle=bad)


@pytest.mark.parametrize("radius", [0.05, 0.15])
@pytest.mark.parametrize("rate", [4000.0, 22050.0, pytest.param(96000.0, marks=pytest.mark.prove)])
def test_small_and_large_heads_fit_their_taps(radius: float, rate: float) -> None:
    filters = SphereHead(radius=radius).prepared(rate)
    angles, frequencies = np.radians([10.0, 80, 120]), np.linspace(50, min(0.4 * rate, 16000), 20)
    found = spectra(filters, around(np.pi / 2 - angles), 1.0, frequencies, rate)[..., 0]
    exact = pressure(frequencies, angles, 1.0, radius)
    np.testing.assert_allclose(decibels(found / exact), 0, atol=0.5)
