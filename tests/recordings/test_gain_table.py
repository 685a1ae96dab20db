"""Hits that differ in strength and moment, brought to one another."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.gain_table import align_hits, average_pairs

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FREQUENCIES = np.array([311.0, 702.0, 1291.0, 2217.0, 3405.0, 5120.0, 7711.0])
DECAYS = np.array([2.0, 3.0, 5.0, 9.0, 15.0, 40.0, 90.0])
POLES = -DECAYS + 2j * np.pi * FREQUENCIES


def drawn(seed: int, contacts: int, listeners: int) -> tuple[Array, Complex]:
    """Return real drives (P, 7) and complex outputs (Q, 7)."""
    chance = np.random.default_rng(seed)
    outputs = chance.normal(size=(listeners, 7)) + 1j * chance.normal(size=(listeners, 7))
    return chance.choice([-1, 1], (contacts, 7)) * chance.uniform(0.3, 1, (contacts, 7)), outputs


def late(gains: Complex, delays: Array) -> Complex:
    return gains * np.exp(-np.outer(delays, POLES))


def small(gains: Complex) -> Array:
    return np.full(gains.shape, 1e-3)


def test_hits_of_a_contact_lose_their_strengths_and_moments() -> None:
    drives, outputs = drawn(1, 1, 2)
    one = drives[0] * outputs
    fall = np.exp(-2.0 * (FREQUENCIES / FREQUENCIES.max()) ** 2)
    softer = late(0.4 * fall * one, np.full(2, 7e-5))
    gains = np.concatenate([one, softer])
    hits, listeners = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    contacts = np.zeros(4, int)
    found, errors = align_hits(gains, small(gains), hits, contacts, listeners, POLES)
    assert found[2:] == pytest.approx(found[:2], rel=0.01)
    assert np.abs(found[0]) == pytest.approx(np.abs(one[0]), rel=0.01)
    assert errors[2] == pytest.approx(1e-3 / (0.4 * fall), rel=1e-2)


def test_moments_of_other_contacts_are_told_by_real_drives() -> None:
    drives, outputs = drawn(2, 5, 1)
    delays = np.array([0.0, 4e-5, -6e-5, 2e-5, -9e-5])
    gains = late(drives * outputs[0], delays)
    places = np.arange(5)
    found, _ = align_hits(gains, small(gains), places, places, np.zeros(5, int), POLES)
    ratios = found / found[0]
    assert np.abs(ratios.imag).max() < 0.01
    assert ratios.real == pytest.approx(drives / drives[0], rel=0.01)


def test_the_usual_moment_counts_not_that_of_the_loudest() -> None:
    drives, outputs = drawn(3, 5, 1)
    drives[0] *= 3
    delays = np.array([2e-4, 0.0, 1e-6, -1e-6, 0.0])
    true = drives * outputs[0]
    gains = late(true, delays)
    places = np.arange(5)
    found, _ = align_hits(gains, small(gains), places, places, np.zeros(5, int), POLES)
    assert found == pytest.approx(true, abs=0.02)


def test_hits_without_anything_in_common_stay_as_they_are() -> None:
    drives, outputs = drawn(4, 2, 2)
    gains = drives * outputs
    places = np.arange(2)
    found, errors = align_hits(gains, small(gains), places, places, places, POLES)
    assert np.array_equal(found, gains)
    assert np.array_equal(errors, small(gains))


def test_silence_tells_nothing() -> None:
    gains = np.zeros((2, 7), complex)
    zeros = np.zeros(2, int)
    found, _ = align_hits(gains, small(gains), np.arange(2), zeros, zeros, POLES)
    assert not found.any()


def test_means_weigh_by_what_is_known() -> None:
    gains = np.array([[1.0 + 0j], [4.0], [7j]])
    pairs, mean, error = average_pairs(
        gains, np.array([[1.0], [0.5], [2.0]]), np.array([[0, 0], [0, 0], [1, 0]])
    )
    assert pairs.tolist() == [[0, 0], [1, 0]]
    assert mean[:, 0] == pytest.approx([(1 + 4 * 4) / 5, 7j])
    assert error[:, 0] == pytest.approx([5**-0.5, 2.0])


def test_modes_beyond_the_clear_ones_follow_the_highest_of_them() -> None:
    """Five clear modes below 900 Hz, scattered by 5 %: they say nothing about 7 kHz."""
    chance = np.random.default_rng(6)
    tones = np.array([200.0, 350.0, 500.0, 700.0, 900.0, 4000.0, 7000.0])
    poles = -5.0 + 2j * np.pi * tones
    zeros = np.zeros(2, int)
    for _ in range(20):
        one = np.where(tones < 1000, 1.0, 1e-3) * np.exp(2j * np.pi * chance.random(7))
        other = 0.5 * one * np.exp(chance.normal(0, 0.05, 7))
        gains = np.stack([one, other])
        found, errors = align_hits(gains, small(gains), np.arange(2), zeros, zeros, poles)
        levels = 20 * np.log10(np.abs(found[1] / found[0]))
        assert np.abs(levels).max() < 3
        assert np.abs(errors[1] / 2e-3 - 1).max() < 0.5


def test_hits_in_which_nothing_is_clear_still_lose_their_strength() -> None:
    drives, outputs = drawn(7, 1, 1)
    one = drives[0] * outputs[0]
    gains = np.stack([one, 0.05 * one])
    errors = np.stack([np.full(7, 1e-3), np.full(7, 0.3)])
    zeros = np.zeros(2, int)
    found, _ = align_hits(gains, errors, np.arange(2), zeros, zeros, POLES)
    assert np.linalg.norm(found[1]) == pytest.approx(np.linalg.norm(found[0]), rel=1e-6)


def test_the_clearest_hit_leads_not_the_loudest() -> None:
    drives, outputs = drawn(8, 1, 1)
    one = drives[0] * outputs[0]
    gains = np.stack([5 * one, one])
    errors = np.stack([np.full(7, 10.0), np.full(7, 1e-4)])
    zeros = np.zeros(2, int)
    found, _ = align_hits(gains, errors, np.arange(2), zeros, zeros, POLES)
    assert found[1] == pytest.approx(one)
    assert np.linalg.norm(found[0]) == pytest.approx(np.linalg.norm(one), rel=1e-6)
