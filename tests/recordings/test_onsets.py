"""Hits found in takes whose hits are known."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.onsets import find_clipped, find_hits, hit_at
from struck.recordings.poles.search import fit_poles
from struck.recordings.takes import Take
from tests.recordings.scenes import (
    LEAD,
    RATE,
    in_room,
    repeated,
    ringing,
    scene,
    struck_softly,
)

Array = NDArray[np.float64]


def take(samples: Array) -> Take:
    return Take(samples=samples, sample_rate=RATE)


def missed_and_false(seeds: range) -> tuple[int, int, Array]:
    """Count hits missed and false, and tell how late the others are found, s."""
    missed, false, late = 0, 0, []
    for seed in seeds:
        samples, starts, _ = repeated(8, np.random.default_rng(seed))
        found = np.array([hit.onset for hit in find_hits(take(samples))])
        away = np.abs(found[:, None] - starts)
        missed += np.count_nonzero(away.min(axis=0) > 0.005 * RATE)
        false += np.count_nonzero(away.min(axis=1) > 0.005 * RATE)
        late += list((found - starts[away.argmin(axis=1)]) / RATE)
    return missed, false, np.array(late)


@pytest.mark.prove
def test_hits_on_loud_tails_are_found_to_the_sample() -> None:
    missed, false, late = missed_and_false(range(900, 903))
    assert (missed, false) == (0, 0)
    assert np.abs(np.median(late)) <= 1 / RATE
    assert np.abs(late).max() < 0.003


@pytest.mark.prove
def test_hits_on_loud_tails_are_found_in_160() -> None:
    missed, false, late = missed_and_false(range(920, 940))
    assert (missed, false) == (0, 0)
    assert np.quantile(np.abs(late), 0.9) < 0.001


def test_free_ringing_starts_after_the_onset_and_soon() -> None:
    hits = find_hits(take(scene(20, 40, np.random.default_rng(1)).samples))
    assert len(hits) == 1
    assert abs(hits[0].onset - LEAD) < 0.001 * RATE
    assert LEAD <= hits[0].start < LEAD + 0.004 * RATE


@pytest.mark.parametrize("delay", [0.01, 0.013, 0.028])
def test_a_second_contact_soon_after_a_hit_is_waited_for(delay: float) -> None:
    """The tool touches again, elsewhere and half as hard; modes are then found as of one hit."""
    made, chance = scene(20, 50, np.random.default_rng(1)), np.random.default_rng(7)
    truth = made.truth
    again = truth.gains * chance.uniform(-0.7, 0.7, truth.gains.shape)
    length = made.samples.shape[1] - LEAD - round(delay * RATE)
    samples = made.samples.copy()
    samples[:, -length:] += ringing(truth.frequencies, truth.decays, again, length)
    (hit,) = find_hits(take(samples))
    assert hit.again == pytest.approx(LEAD + delay * RATE, abs=0.002 * RATE)
    assert 0.002 < (hit.start - hit.again) / RATE < 0.01
    fit = fit_poles(take(samples), budget=64)
    assert "touched again" in " ".join(fit.notes)
    slow = truth.decays < 30
    away = np.abs(fit.frequencies[:, None] - truth.frequencies[slow]).min(axis=0)
    assert np.mean(away < 0.5) >= 0.9


@pytest.mark.parametrize("seed", range(2))
def test_no_second_contact_is_found_where_there_is_none(seed: int) -> None:
    for make in (
        scene,
        struck_softly,
        partial(in_room, seconds=0.35, distance=0.3),
        partial(in_room, seconds=0.35, distance=1.2),
    ):
        hits = find_hits(take(make(40, 50, np.random.default_rng(seed)).samples))
        assert {hit.again for hit in hits} == {None}


def test_a_file_may_begin_with_its_hit() -> None:
    times = np.arange(RATE) / RATE
    hits = find_hits(take(np.sin(2 * np.pi * 500 * times) * np.exp(-8 * times)))
    assert [hit.onset < 0.001 * RATE for hit in hits] == [True]


def test_a_slow_rise_is_waited_for() -> None:
    times = np.arange(RATE) / RATE
    rising = np.minimum(times / 0.004, 1) * np.sin(2 * np.pi * 500 * times) * np.exp(-8 * times)
    (hit,) = find_hits(take(np.pad(rising, (RATE // 4, 0)) + noise(1.25, 1e-4)))
    assert 0.002 < (hit.start - RATE // 4) / RATE < 0.006


def test_nearly_all_of_a_slow_rise_is_heard_after_its_arrival() -> None:
    times = np.arange(RATE) / RATE
    rising = np.minimum(times / 0.004, 1) * np.sin(2 * np.pi * 500 * times) * np.exp(-8 * times)
    (hit,) = find_hits(take(np.pad(rising, (RATE // 4, 0)) + noise(1.25, 1e-4)))
    missed = rising[: hit.arrival - RATE // 4]
    assert RATE // 4 < hit.arrival < hit.start
    assert 3e-5 < np.sum(missed**2) / np.sum(rising**2) < 3e-4


def noise(seconds: float, rms: float) -> Array:
    return rms * np.random.default_rng(3).standard_normal(round(seconds * RATE))


@pytest.mark.parametrize(
    ("rate", "seconds"),
    [(8000, 1.0), pytest.param(192_000, 1.0, marks=pytest.mark.prove)],
)
def test_hits_are_found_at_any_rate(rate: int, seconds: float) -> None:
    times = np.arange(round(seconds * rate)) / rate
    rung = sum(np.sin(2 * np.pi * tone * times) for tone in (300, 900, 2100)) * np.exp(-9 * times)
    sound = np.pad(rung, (len(times) // 2, 0))
    sound += 1e-3 * np.random.default_rng(0).standard_normal(len(sound))
    (hit,) = find_hits(Take(samples=sound, sample_rate=rate))
    assert abs(hit.onset / rate - 0.5 * seconds) < 0.001


def test_noise_and_swelling_tones_hold_no_hit() -> None:
    times = np.arange(2 * RATE) / RATE
    assert not find_hits(take(noise(2.0, 0.1)))
    assert not find_hits(take(np.minimum(times, 1) * np.sin(2 * np.pi * 440 * times)))


def test_a_known_onset_is_taken_as_it_is() -> None:
    samples = scene(20, 40, np.random.default_rng(2)).samples
    hit = hit_at(take(samples), LEAD, samples.shape[1])
    assert (hit.onset, hit.end) == (LEAD, samples.shape[1])
    assert hit.start > LEAD


def test_a_hit_that_is_over_at_once_is_no_longer_than_that() -> None:
    samples = scene(20, 40, np.random.default_rng(2)).samples
    for onset in (0, LEAD, samples.shape[1]):
        hit = hit_at(take(samples), onset, onset)
        assert (hit.onset, hit.arrival, hit.start, hit.end) == (onset,) * 4


def test_tops_of_high_tones_are_clipped_in_less_than_four_samples() -> None:
    times = np.arange(48_000) / 48_000
    tone = np.exp(-3 * times) * np.sin(2 * np.pi * 5013.7 * times)

    def found(samples: np.ndarray) -> int:
        rounded = np.round(32_767 * samples) / 32_768  # 16 bits
        return int(find_clipped(Take(samples=rounded, sample_rate=48_000)).sum())

    assert found(np.clip(3 * tone, -1, 1)) > 1000
    assert found(np.clip(1.5 * tone, -0.8, 0.8)) > 200
    for whole in (tone, np.sin(2 * np.pi * 100 * times), 1e-3 * np.sin(2 * np.pi * 440 * times)):
        assert not found(whole)
