"""Which fitted mode is which computed one."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from struck import ModalModel
from struck.errors import OptionError, RecordingError
from struck.recordings.calibration.agreement import posteriors
from struck.recordings.calibration.pairing import (
    SIGNIFICANT,
    Pairing,
    beyond_chance,
    explains,
    paired,
)
from struck.shapes import Bar, CircularPlate, RectangularPlate, String
from tests.recordings.calibration.plates import (
    HIGHEST,
    STEEL,
    Modes,
    as_fitted,
    model_of,
    of_frequencies,
    ringing_plate,
)

SIZE = (0.30, 0.20, 0.004)
PLATE = RectangularPlate(length=SIZE[0], width=SIZE[1], thickness=SIZE[2])


@pytest.fixture(scope="module")
def plate() -> ModalModel:
    return model_of(PLATE)


def listed(odds: np.ndarray) -> tuple[np.ndarray, float]:
    """Return what `posteriors` does, from a list of all matchings."""
    rows, columns = odds.shape
    total, pairs = 0.0, np.zeros_like(odds)
    for count in range(min(rows, columns) + 1):
        for some in itertools.combinations(range(rows), count):
            for others in itertools.combinations(range(columns), count):
                likelihood = np.prod(odds[some, others])
                total += likelihood
                pairs[some, others] += likelihood
    return pairs / total, float(np.log(total))


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (5, 4)])
def test_pairs_are_weighed_over_all_matchings(shape: tuple[int, int]) -> None:
    odds = np.exp(np.random.default_rng(1).normal(0, 2, (2, *shape)))
    pairs, logarithms = posteriors(odds)
    for case in range(2):
        expected, total = listed(odds[case])
        assert pairs[case] == pytest.approx(expected, abs=1e-12)
        assert logarithms[case] == pytest.approx(total, abs=1e-12)


def test_sums_over_many_matchings_neither_overflow_nor_vanish() -> None:
    odds = np.full((1, 400, 400), 1e-9)
    np.fill_diagonal(odds[0], 1e9)
    pairs, logarithms = posteriors(odds)
    assert np.diag(pairs[0]) == pytest.approx(np.ones(400), abs=1e-6)
    assert logarithms[0] == pytest.approx(400 * np.log(1e9), rel=1e-6)


def right(fitted: Modes, pairing: Pairing) -> np.ndarray:
    return fitted.truth[pairing.fitted] == pairing.computed


@pytest.mark.prove
@pytest.mark.parametrize(
    ("cents", "share"),
    [
        (0.01, 1.0),
        (1.0, 0.97),
        (5.0, 0.9),
    ],
)
def test_a_fifth_missing_and_a_fifth_extra(plate: ModalModel, cents: float, share: float) -> None:
    """Of the modes that are there, so many are paired, and of the pairs as many are right."""
    found, correct, real, factors = 0, 0, 0, []
    for seed in range(3):
        chance = np.random.default_rng(seed)
        stretch = float(np.exp(chance.uniform(-0.5, 0.5)))
        material = replace(STEEL, youngs_modulus=200e9 * stretch**2)
        highest = HIGHEST * stretch
        fitted = as_fitted(ringing_plate(SIZE, material, highest), chance, cents=cents)
        pairing = paired(fitted, plate)
        found += len(pairing)
        correct += int(right(fitted, pairing).sum())
        real += int((fitted.truth >= 0).sum())
        factors.append(pairing.factor / stretch - 1)
        assert sorted([*pairing.fitted, *pairing.extra]) == list(range(len(fitted.truth)))
        assert sorted([*pairing.computed, *pairing.missing]) == list(range(len(plate.frequencies)))
    assert correct >= share * max(real, found)
    assert np.abs(factors).max() < 5e-6 + 3e-4 * cents


def test_modes_that_change_places_with_poissons_ratio(plate: ModalModel) -> None:
    """A model of 0.29 recognises the modes of a plate of 0.40, to first order."""
    material = replace(STEEL, poisson_ratio=0.40, youngs_modulus=150e9)
    pairing = paired(as_fitted(ringing_plate(SIZE, material), np.random.default_rng(2)), plate)
    assert pairing.poisson_ratio == pytest.approx(0.40, abs=0.02)
    assert pairing.factor == pytest.approx(np.sqrt(150 / 200), rel=0.01)
    assert len(pairing) > 25


@pytest.mark.prove
@pytest.mark.parametrize("fits", [3, pytest.param(5, marks=pytest.mark.prove)])
def test_confidence_is_how_often_pairs_are_right(plate: ModalModel, fits: int) -> None:
    """With errors of 15 cents many modes lie as close as these; which of such is heard is open."""
    told, correct = [], []
    true = ringing_plate(SIZE, STEEL)
    for seed in range(fits):
        fitted = as_fitted(true, np.random.default_rng(seed), cents=15)
        pairing = paired(fitted, plate)
        truth = fitted.truth[pairing.fitted]
        apart = np.log(pairing.expected[truth] / pairing.expected[pairing.computed])
        told.extend(pairing.confidence)
        correct.extend((truth >= 0) & (np.abs(apart) < pairing.scatter))
    told, correct = np.array(told), np.array(correct)
    assert 0.6 < told.mean() < 0.9
    assert told.mean() == pytest.approx(correct.mean(), abs=0.06)
    assert correct[told > 0.9].mean() > 0.92
    assert correct[told < 0.7].mean() < 0.72


def test_half_of_each_round_pair_is_enough() -> None:
    """A round plate has its modes two by two; of each two only one is struck."""
    disk = model_of(CircularPlate(radius=0.12, thickness=0.003))
    natural = disk.natural_frequencies
    singles = of_frequencies(natural[np.r_[True, np.diff(natural) > 1e-6 * natural[1:]]], STEEL)
    assert len(singles.truth) < 0.7 * len(natural)
    fitted = as_fitted(singles, np.random.default_rng(4))
    pairing = paired(fitted, disk)
    real = fitted.truth[pairing.fitted] >= 0
    assert real.all()
    assert len(pairing) == (fitted.truth >= 0).sum()
    assert pairing.confidence.min() > 0.99
    assert natural[pairing.computed] == pytest.approx(fitted.frequencies[pairing.fitted], rel=1e-4)


@pytest.mark.parametrize("kind", ["bar", "string"])
def test_simple_series_are_not_mistaken_by_an_octave(kind: str) -> None:
    bar = Bar(length=0.4, width=0.03, thickness=0.005)
    string = String(length=0.65, radius=5e-4, tension=700.0)
    model = model_of(bar if kind == "bar" else string)
    true = of_frequencies(model.natural_frequencies, STEEL)
    fitted = as_fitted(true, np.random.default_rng(7), cents=1)
    pairing = paired(fitted, model.scaled(1 / 0.8))
    assert pairing.factor == pytest.approx(1 / 0.8, rel=2e-3)
    assert right(fitted, pairing).all()


def test_modes_that_are_not_struck_are_no_partners(plate: ModalModel) -> None:
    silent = np.arange(len(plate.frequencies)) % 3 == 0
    fitted = as_fitted(ringing_plate(SIZE, STEEL), np.random.default_rng(3), missing=0, extra=0)
    pairing = paired(fitted, plate, audible=~silent)
    assert not silent[pairing.computed].any()
    assert len(pairing) >= 0.95 * (~silent).sum()


@pytest.mark.prove
def test_another_body_is_told_from_a_bad_recording_of_this_one() -> None:
    chance = np.random.default_rng(5)
    few = model_of(PLATE, highest=5000.0)
    blurred = as_fitted(ringing_plate(SIZE, STEEL, 5000.0), chance, cents=15)
    assert beyond_chance(blurred, few) > 1.5 * SIGNIFICANT
    assert explains(blurred, few, paired(blurred, few))
    disk = model_of(CircularPlate(radius=0.12, thickness=0.003), highest=5000.0)
    clear = as_fitted(ringing_plate(SIZE, STEEL, 5000.0), chance)
    assert not explains(clear, disk, paired(clear, disk))


def test_bad_input_is_refused(plate: ModalModel) -> None:
    fitted = as_fitted(ringing_plate(SIZE, STEEL), np.random.default_rng(0))
    with pytest.raises(RecordingError, match="0 fitted modes"):
        paired(fitted.chosen(np.zeros(0, int)), plate)
    with pytest.raises(RecordingError, match="frequencies hold nan"):
        paired(replace(fitted, frequencies=fitted.frequencies * np.nan), plate)
    with pytest.raises(RecordingError, match="decays of"):
        paired(replace(fitted, decays=fitted.decays[1:]), plate)
    with pytest.raises(OptionError, match=r"widest is 0\.5"):
        paired(fitted, plate, widest=0.5)
    with pytest.raises(OptionError, match="audible has shape"):
        paired(fitted, plate, audible=[0.5])
