"""The object's modes told from those that stand for the blow."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import fftconvolve

import struck
from struck import Strike
from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.takes import Take
from struck.shapes import Bar
from tests.recordings.scenes import RATE

Array = NDArray[np.float64]
PUSH = np.sin(np.pi * np.arange(132) / 132)
"""3 ms."""


def fitted(sound: Array, rate: int = RATE) -> PoleFit:
    """Fit a sound after half a second of noise 74 dB below its peak."""
    heard = np.pad(0.5 * sound / np.abs(sound).max(), (rate // 2, 0))
    heard += 1e-4 * np.random.default_rng(0).standard_normal(len(heard))
    return fit_poles(Take(samples=heard, sample_rate=rate))


def test_a_drum_under_a_long_push_keeps_its_broad_modes() -> None:
    """Twelve modes of a membrane, of Q from 1 to 10."""
    chance = np.random.default_rng(0)
    ratios = [1, 1.59, 2.14, 2.30, 2.65, 2.92, 3.16, 3.5, 3.6, 4.06, 4.23, 4.6]
    frequencies = 80 * np.array(ratios)
    decays = np.pi * frequencies / np.geomspace(1, 10, 12)[chance.permutation(12)]
    times = np.arange(RATE)[:, None] / RATE
    waves = np.exp(-decays * times) * np.sin(2 * np.pi * frequencies * times)
    drum = fftconvolve(waves @ chance.uniform(0.5, 1, 12), PUSH)[:RATE]
    fit = fitted(drum)
    own = ~fit.blow
    # Within half of its half-power bandwidth, of a width that is right to a factor of two.
    near = np.abs(fit.frequencies[own, None] - frequencies) < decays / (2 * np.pi)
    near &= np.abs(np.log2(fit.decays[own, None] / decays)) < 1
    assert np.count_nonzero(near.any(axis=0)) >= 10
    assert near.any(axis=1).all()
    assert fit.verdict.modal


@pytest.mark.prove
def test_a_push_alone_has_no_mode_of_an_object() -> None:
    assert fitted(np.pad(PUSH, (0, RATE - 132))).blow.all()


@pytest.mark.prove
def test_modes_of_a_bar_are_all_of_its_own() -> None:
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="free"), "steel")
    sound = struck.render(bar, Strike(at=(0.02,)), seconds=1.0)
    fit = fitted(np.asarray(sound.samples[0], float), 48_000)
    own = np.sort(fit.frequencies[~fit.blow])
    assert own[:3] == pytest.approx(bar.frequencies[:3], rel=1e-3)
    nearest = np.abs(own[:, None] - bar.frequencies).min(axis=1)
    assert nearest.max() < 1
