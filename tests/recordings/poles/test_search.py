"""Modes found in scenes whose modes are known; what the Cramer-Rao bound allows beside it.

The figures are those of the project's promise; `-m prove` shows them over 20 seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.takes import Take
from tests.recordings.bounds import resolvable
from tests.recordings.scenes import (
    CLEAR,
    LEAD,
    RATE,
    Scene,
    Score,
    Truth,
    paired,
    pairs,
    scene,
    score,
)
from tests.samples import sampled

FEW, MANY = range(1000, 1002), range(2000, 2020)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Means over seeds: a score, of the resolvable clear modes those found, and honest errors.

    `told` holds each figure's mean and standard error.
    """

    score: Score
    of_resolvable: float
    honest: float
    strong_missing: float
    told: dict[str, str]


def fitted(take: Scene) -> PoleFit:
    return fit_poles(Take(samples=take.samples, sample_rate=RATE), budget=None)


def poles(fit: PoleFit) -> np.ndarray:
    return -fit.decays + 2j * np.pi * fit.frequencies


def since_the_hit(fit: PoleFit) -> np.ndarray:
    """Return gains as of the true moment of the hit."""
    times = np.array([row.time for row in fit.rows]) - LEAD / RATE
    return fit.gains * np.exp(np.outer(-times, poles(fit)))


def within_two(fit: PoleFit, truth: Truth) -> float:
    """Return the share of true errors that two standard errors cover."""
    rows, columns = paired(truth, poles(fit), since_the_hit(fit))
    frequency = np.abs(fit.frequencies[columns] - truth.frequencies[rows])
    decay = np.abs(fit.decays[columns] - truth.decays[rows])
    covered = (frequency < 2 * fit.frequency_errors[columns], decay < 2 * fit.decay_errors[columns])
    return float(np.mean(covered))


def strong_missing(fit: PoleFit, truth: Truth) -> float:
    """Return which share of the gains 40 dB over the noise have no value within 6 dB."""
    strong = np.abs(truth.gains) ** 2 / (4 * truth.decays) * RATE > 1e4 * truth.noise[:, None] ** 2
    rows, columns = paired(truth, poles(fit), since_the_hit(fit))
    ratios = np.abs(since_the_hit(fit)[:, columns]) / np.abs(truth.gains[:, rows])
    right = np.zeros_like(strong)
    right[:, rows] = np.abs(20 * np.log10(ratios)) < 6
    return float(1 - right[strong].mean())


def outcome(seeds: range, modes: int, level: float, channels: int = 1) -> Outcome:
    scores, shares, honest, missing = [], [], [], []
    for seed in seeds:
        take = scene(modes, level, np.random.default_rng(seed), channels=channels, fan=channels > 1)
        fit = fitted(take)
        possible = resolvable(take.truth)
        scores.append(score(take.truth, poles(fit), since_the_hit(fit), possible))
        found = np.isin(np.arange(modes), paired(take.truth, poles(fit), since_the_hit(fit))[0])
        shares.append(found[possible & take.truth.detectable(CLEAR)].mean())
        honest.append(within_two(fit, take.truth))
        missing.append(strong_missing(fit, take.truth))
    figures = {name: [getattr(each, name) for each in scores] for name in Score.__slots__}
    mean = Score(**{name: np.mean(values) for name, values in figures.items()})
    figures |= {"of_resolvable": shares, "honest": honest, "strong_missing": missing}
    return Outcome(
        score=mean,
        of_resolvable=float(np.mean(shares)),
        honest=float(np.mean(honest)),
        strong_missing=float(np.mean(missing)),
        told={name: mean_and_error(values) for name, values in figures.items()},
    )


def mean_and_error(values: list[float]) -> str:
    if len(values) < 2:
        return f"{values[0]:.4g}"
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    return f"{np.mean(values):.4g} +- {error:.2g}"


def require_quiet_scene(found: Outcome) -> None:
    assert found.score.found >= 0.91
    assert found.score.false <= 2
    assert found.score.cents <= 0.005
    assert found.score.decay <= 0.007
    assert found.of_resolvable >= 0.97
    assert found.honest >= 0.90


def require_noisy_scene(found: Outcome) -> None:
    assert found.score.detected >= 0.87
    assert found.score.false <= 1
    assert found.of_resolvable >= 0.97
    assert found.honest >= 0.90


def require_dense_scene(found: Outcome) -> None:
    assert found.score.found >= 0.96
    assert found.score.false <= 6
    assert found.of_resolvable >= 0.97
    assert found.honest >= 0.90


def require_microphones(found: Outcome) -> None:
    assert found.score.found >= 0.86
    assert found.score.false <= 2
    assert found.strong_missing <= 0.02
    assert found.honest >= 0.90


CASES = {
    "quiet": ((100, 40.0, 1), require_quiet_scene),
    "noisy": ((100, 20.0, 1), require_noisy_scene),
    "dense": ((200, 60.0, 1), require_dense_scene),
    "microphones": ((100, 20.0, 8), require_microphones),
}


@pytest.mark.parametrize("name", ["noisy", pytest.param("dense", marks=pytest.mark.prove)])
def test_modes_are_found(name: str) -> None:
    (modes, level, channels), require = CASES[name]
    require(outcome(FEW[:1] if name == "dense" else FEW, modes, level, channels))


@pytest.mark.prove
@pytest.mark.parametrize("name", CASES)
def test_modes_are_found_in_20_scenes(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    (modes, level, channels), require = CASES[name]
    found = outcome(MANY, modes, level, channels)
    for figure, value in found.told.items():
        record_property(f"{name}: {figure}", value)
    require(found)


def unsplit(seeds: range, decay: float, split: float = 0.3) -> int:
    """Count the modes of close pairs that are missing, and all that are none."""
    wrong = 0
    for seed in seeds:
        take = pairs(decay, split, 20, np.random.default_rng(seed))
        fit = fitted(take)
        rows, columns = paired(take.truth, poles(fit), since_the_hit(fit))
        wrong += len(take.truth.frequencies) - len(rows) + len(poles(fit)) - len(columns)
    return wrong


@pytest.mark.parametrize("decay", sampled([0.5, 2.0], 0.5))
def test_pairs_that_beat_every_three_seconds_are_split(decay: float) -> None:
    assert unsplit(FEW, decay) == 0


@pytest.mark.prove
@pytest.mark.parametrize("decay", [0.5, 2.0])
def test_80_pairs_that_beat_every_three_seconds_are_split(decay: float) -> None:
    assert unsplit(MANY, decay) == 0
