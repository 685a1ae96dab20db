"""Hits that differ in strength and moment, brought to one another."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.fields.alignment import aligned, averaged

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FREQUENCIES = np.array([311.0, 702.0, 1291.0, 2217.0, 3405.0, 5120.0, 7711.0])


def drawn(seed: int, contacts: int, listeners: int) -> tuple[Array, Complex]:
    """Return real drives (P, 7) and complex outputs (Q, 7)."""
    chance = np.random.default_rng(seed)
    outputs = chance.normal(size=(listeners, 7)) + 1j * chance.normal(size=(listeners, 7))
    return chance.choice([-1, 1], (contacts, 7)) * chance.uniform(0.3, 1, (contacts, 7)), outputs


def late(gains: Complex, delays: Array) -> Complex:
    return gains * np.exp(-2j * np.pi * np.outer(delays, FREQUENCIES))


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
    found, errors = aligned(gains, small(gains), hits, contacts, listeners, FREQUENCIES)
    assert found[2:] == pytest.approx(found[:2], rel=1e-3)
    assert np.abs(found[0]) == pytest.approx(np.abs(one[0]), rel=1e-6)
    assert errors[2] == pytest.approx(1e-3 / (0.4 * fall), rel=1e-2)


def test_moments_of_other_contacts_are_told_by_real_drives() -> None:
    drives, outputs = drawn(2, 5, 1)
    delays = np.array([0.0, 4e-5, -6e-5, 2e-5, -9e-5])
    gains = late(drives * outputs[0], delays)
    places = np.arange(5)
    found, _ = aligned(gains, small(gains), places, places, np.zeros(5, int), FREQUENCIES)
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
    found, _ = aligned(gains, small(gains), places, places, np.zeros(5, int), FREQUENCIES)
    assert found == pytest.approx(true, abs=0.02)


def test_hits_without_anything_in_common_stay_as_they_are() -> None:
    drives, outputs = drawn(4, 2, 2)
    gains = drives * outputs
    places = np.arange(2)
    found, errors = aligned(gains, small(gains), places, places, places, FREQUENCIES)
    assert np.array_equal(found, gains)
    assert np.array_equal(errors, small(gains))


def test_silence_tells_nothing() -> None:
    gains = np.zeros((2, 7), complex)
    zeros = np.zeros(2, int)
    found, _ = aligned(gains, small(gains), np.arange(2), zeros, zeros, FREQUENCIES)
    assert not found.any()


def test_means_weigh_by_what_is_known() -> None:
    gains = np.array([[1.0 + 0j], [4.0], [7j]])
    pairs, mean, error = averaged(
        gains, np.array([[1.0], [0.5], [2.0]]), np.array([[0, 0], [0, 0], [1, 0]])
    )
    assert pairs.tolist() == [[0, 0], [1, 0]]
    assert mean[:, 0] == pytest.approx([(1 + 4 * 4) / 5, 7j])
    assert error[:, 0] == pytest.approx([5**-0.5, 2.0])
