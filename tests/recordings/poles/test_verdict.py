"""What is called modal, and which of a take's hits are real."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.recordings.fit import fit_recordings
from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.poles.verdict import MODAL_MARGIN, is_proven
from struck.recordings.takes import Take
from tests.recordings.scenes import LEAD, RATE, body, recorded, ringing, scene
from tests.recordings.sounds import engine, music, speech
from tests.samples import sampled

Array = NDArray[np.float64]


def fit(samples: Array, every: int = 1, budget: int = 32) -> PoleFit:
    return fit_poles(Take(samples=samples[..., ::every], sample_rate=RATE // every), budget=budget)


@pytest.mark.parametrize("lead", [0, pytest.param(LEAD, marks=pytest.mark.prove)])
@pytest.mark.parametrize("heard", sampled([music, speech, engine], music, engine))
@pytest.mark.parametrize("every", sampled([4, 1], 4))
def test_music_and_speech_are_refused(heard: Callable[..., Array], lead: int, every: int) -> None:
    """Eight seconds of chords, ten of speech, four of an engine, at once or after silence."""
    chance = np.random.default_rng(1)
    sound = heard(chance, 10.0)[RATE // 3 :] if heard is speech else heard(chance)
    samples = np.pad(0.5 * sound, (lead, 0))
    samples = samples + 1e-5 * chance.standard_normal(len(samples))
    assert not is_modal(samples, every)


def is_modal(samples: Array, every: int) -> bool:
    try:
        return fit(samples, every, 16 if every > 1 else 64).verdict.modal
    except RecordingError:  # no hit was found at all
        return False


def test_only_noise_that_a_lead_in_has_shown_is_forgiven() -> None:
    """Of a hit 6 dB over its noise; with the same noise from the hit on it is not modal."""
    heard = scene(12, 6, np.random.default_rng(2), seconds=1.0).samples
    after = fit(heard).verdict
    without = fit_poles(Take(samples=heard[:, LEAD - 100 :], sample_rate=RATE), onsets=[[0.0023]])
    assert after.modal
    assert after.signal_to_misfit > MODAL_MARGIN > after.signal_to_residual
    assert not without.verdict.modal


def flam(chance: np.random.Generator) -> Array:
    """Return two hits 90 ms apart, the second 8 dB softer and at another place."""
    frequencies, decays, gains = body(12, chance)
    whole = ringing(frequencies, decays, gains[None].astype(complex), RATE)
    second = 0.4 * gains * chance.normal(1, 0.4, 12)
    late = RATE // 11
    whole[:, late:] += ringing(frequencies, decays, second[None].astype(complex), RATE - late)
    return whole / np.abs(whole).max()


def test_the_second_hit_of_a_flam_stays() -> None:
    chance = np.random.default_rng(1)
    heard = np.pad(flam(chance), ((0, 0), (LEAD, 0)))
    heard = heard + 1e-4 * chance.standard_normal(heard.shape)
    onsets = [row.onset for row in fit(heard, budget=12).rows]
    assert onsets == pytest.approx([0.5, 0.591], abs=2e-3)


def test_a_hit_is_proven_by_more_than_its_gains_cost() -> None:
    """20 complex gains cost 2 x 20 ln 10000 = 368, and 10000 x 2 ln 1.0186 is as much."""
    left = [np.random.default_rng(1).standard_normal((1, 10_000))]
    worse, much_worse = ([factor * each for each in left] for factor in (1.017, 1.020))
    assert not is_proven(left, worse, 20)
    assert is_proven(left, much_worse, 20)


@pytest.mark.prove
def test_takes_that_are_modal_one_by_one_are_told_so_when_refused_together() -> None:
    takes = []
    for seed in range(3):
        chance = np.random.default_rng(seed)
        frequencies = 300.0 * 1.23 ** np.arange(8) * (1 + 0.05 * seed)
        heard = recorded(
            frequencies, np.full(8, 6.0), np.ones((1, 8), complex), 50, chance, seconds=1
        )
        takes.append(Take(samples=heard.samples, sample_rate=RATE, name=f"{seed}.wav"))
    with pytest.raises(RecordingError, match="Each alone is modal: they are not of one object"):
        fit_recordings(takes, modes=9, cache=False)
