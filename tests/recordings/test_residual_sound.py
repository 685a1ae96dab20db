"""What a fit keeps beside its modes: as loud in each band of the ear as what was recorded."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

import struck
from struck import InternalFriction, Strike
from struck.recordings.fit import Fitting, fit_recordings
from struck.recordings.residual_sound import band_energies, ear_bands, loudest_row, one_strike
from struck.recordings.takes import Take
from tests.recordings.strings import ONSET, RATE, hit, noise, ringing, take
from tests.recordings.strings import gains as gains_at
from tests.recordings.test_real_takes import HAMMERED, RECORDINGS, TEN, load

Array = NDArray[np.float64]

MORE = ("fluidr3_kalimba_c7", "sonicpi_tabla_te1", "fluidr3_timpani_3_L")
HISS = 30.0
"""Decay of the hiss, 1/s."""


def fitted(recorded: Take, **options: object) -> Fitting:
    return fit_recordings(recorded, modes=6, cache=False, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def hissing() -> tuple[Take, Fitting]:
    """Return a take of tones with a hiss 20 dB under them, and its fit as it is made unasked."""
    clean = ringing(gains_at(np.array(0.05))[0])
    times = np.maximum(np.arange(len(clean)) / RATE - ONSET, 0)
    hiss = np.where(times > 0, np.exp(-HISS * times), 0) * noise(len(clean), 20, 2)
    recorded = take(clean + hiss + noise(len(clean), 80, 3))
    return recorded, fitted(recorded)


def erb_levels(sound: Array, rate: int) -> tuple[Array, Array]:
    """Return middles, Hz, and levels of the first half second in ERB bands, dB, by filters."""
    numbers = np.arange(4, 33)
    edges = (10 ** (numbers / 21.4) - 1) / 4.37e-3  # Glasberg & Moore 1990, eq. 4
    heard = np.pad(sound[: rate // 2], (0, rate // 10))
    bands = [butter(4, [low, high], "band", fs=rate, output="sos") for low, high in pairwise(edges)]
    levels = [10 * np.log10(np.square(sosfilt(band, heard)).sum()) for band in bands]
    return np.sqrt(edges[1:] * edges[:-1]), np.array(levels)


def strike_of(made: Fitting, seconds: float = 0.6) -> Array:
    sound = struck.render(made.model, Strike(), seconds=seconds, sample_rate=RATE)
    return np.asarray(sound.samples[0], np.float64)


@pytest.mark.prove
def test_every_band_of_the_ear_is_as_loud_as_it_was(hissing: tuple[Take, Fitting]) -> None:
    recorded, made = hissing
    assert made.model.residual is not None  # nobody asked for it
    assert made.short > 6
    start = round(made.fitted.rows[0].onset * RATE)
    _, original = erb_levels(recorded.samples[0, start:], RATE)
    _, rendered = erb_levels(strike_of(made), RATE)
    heard = original > original.max() - 50
    assert np.abs(rendered - original)[heard].max() < 3


def test_noise_decays_as_it_did(hissing: tuple[Take, Fitting]) -> None:
    rest = hissing[1].model.residual
    assert rest is not None
    loud = (rest.levels > 0) & (rest.edges[:-1] > 5000)  # above all tones
    assert np.count_nonzero(loud) > 5
    assert np.median(rest.decays[loud]) == pytest.approx(HISS, rel=0.15)


def test_one_strike_explains_its_share_of_several() -> None:
    """Of two blows of one strength, and a third of half of it: 4 of 9 parts of the energy."""
    length = round(0.5 * RATE)
    one = ringing(gains_at(np.array(0.05))[0], onset=0.0, seconds=0.5)
    sound = np.concatenate([np.zeros(length), one, one, 0.5 * one])
    made = fitted(take(sound + noise(len(sound), 80, 4)))
    assert one_strike(made.fitted) == pytest.approx(4 / 9, abs=0.01)
    told = made.model.provenance.details["explained_by_one_strike"]
    assert told == pytest.approx(4 / 9, abs=0.01)


def test_what_modes_explain_alone_needs_no_residual() -> None:
    made = fitted(hit(0.05))
    assert made.model.residual is None
    assert made.short < 3
    assert fitted(hit(0.05), residual=True).model.residual is not None


def test_another_size_leaves_the_residual_out_and_says_so(hissing: tuple[Take, Fitting]) -> None:
    larger = hissing[1].model.scaled(2)
    assert larger.residual is None
    assert any("attack and noise" in note for note in larger.provenance.dropped)


def test_another_damping_lets_the_noise_decay_by_its_law(hissing: tuple[Take, Fitting]) -> None:
    before = hissing[1].model.residual
    model = hissing[1].model.damped(InternalFriction(loss_tangent=0.01))
    rest = model.residual
    assert rest is not None
    assert before is not None
    middles = np.sqrt(rest.edges[1:] * rest.edges[:-1])
    assert rest.decays == pytest.approx(np.pi * 0.01 * middles)
    assert np.array_equal(rest.attack, before.attack)
    assert any("noise of its residual" in note for note in model.provenance.dropped)


@pytest.mark.prove
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="recordings are not beside the checkout")
@pytest.mark.parametrize("name", [*TEN, *HAMMERED, *MORE])
def test_real_takes_are_as_loud_in_every_band(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    """Of the first half second, bands within 50 dB of the loudest that stand out of the noise."""
    take = load(name)
    made = fit_recordings(take, modes=64, residual=True, force=True, cache=False)
    row = loudest_row(made.fitted)
    what, rate = made.fitted.rows[row], take.sample_rate
    segment, _ = made.fitted.samples_and_model(row)
    first = round(what.onset * rate)
    original = take.samples[what.channel, first : round(what.time * rate) + len(segment)]
    rendered, rest = np.zeros(len(original)), made.residual.samples(rate)[: len(original)]
    rendered[: len(rest)] += rest
    lead = round(made.residual.lead * rate)
    time = (first + lead) / rate
    rendered[lead:] += made.fitted.ringing(row, time, len(original) - lead)
    edges = ear_bands(rate)
    levels, others = (band_energies(each, rate, edges) for each in (original, rendered))
    noise = made.fitted.noise_in(row, edges) * min(len(original), rate // 2)
    heard = (levels > 1e-5 * levels.max()) & (levels > 4 * noise)
    off = 10 * np.log10(others[heard] / levels[heard])
    record_property(name, f"{off.min():.2f} to {off.max():.2f} dB in {len(off)} bands")
    assert np.abs(off).max() < 3
