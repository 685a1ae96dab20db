"""Hearing against published tables and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from struck.errors import OptionError
from struck.perception import auditory_scale

# ISO 226:2003, table 1 and the contours that its formula gives (as carried in aarae's iso226.m).
ROWS = np.array([20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800,
                 1000, 1250, 1600, 2000, 2500, 3150, 4000, 5000, 6300, 8000, 10000,
                 12500])  # fmt: skip
THRESHOLD = [78.5, 68.7, 59.5, 51.1, 44.0, 37.5, 31.5, 26.5, 22.1, 17.9, 14.4, 11.4, 8.6, 6.2, 4.4,
             3.0, 2.2, 2.4, 3.5, 1.7, -1.3, -4.2, -6.0, -5.4, -1.5, 6.0, 12.6, 13.9,
             12.3]  # fmt: skip
CONTOURS = {
    20: [89.58, 82.65, 75.98, 69.62, 64.02, 58.55, 53.19, 48.38, 43.94, 39.37, 35.51, 31.99, 28.69,
         25.67, 23.43, 21.48, 20.1, 20.01, 21.46, 21.4, 18.15, 15.38, 14.26, 15.14, 18.63, 25.02,
         31.52, 34.43, 33.04],
    40: [99.85, 93.94, 88.17, 82.63, 77.78, 73.08, 68.48, 64.37, 60.59, 56.7, 53.41, 50.4, 47.58,
         44.98, 43.05, 41.34, 40.06, 40.01, 41.82, 42.51, 39.23, 36.51, 35.61, 36.65, 40.01, 45.83,
         51.8, 54.28, 51.49],
    60: [109.51, 104.23, 99.08, 94.18, 89.96, 85.94, 82.05, 78.65, 75.56, 72.47, 69.86, 67.53,
         65.39, 63.45, 62.05, 60.81, 59.89, 60.01, 62.15, 63.19, 59.96, 57.26, 56.42, 57.57, 60.89,
         66.36, 71.66, 73.16, 68.63],
    80: [118.99, 114.23, 109.65, 105.34, 101.72, 98.36, 95.17, 92.48, 90.09, 87.82, 85.92, 84.31,
         82.89, 81.68, 80.86, 80.17, 79.67, 80.01, 82.48, 83.74, 80.59, 77.88, 77.07, 78.31, 81.62,
         86.81, 91.41, 91.74, 85.41],
}  # fmt: skip
EVERYWHERE = np.geomspace(20, 20000, 400)


@pytest.mark.parametrize("phon", CONTOURS)
def test_equal_loudness_is_that_of_iso_226(phon: int) -> None:
    assert auditory_scale.equal_loudness(ROWS, phon) == pytest.approx(CONTOURS[phon], abs=0.05)


def test_threshold_is_that_of_iso_226() -> None:
    assert auditory_scale._ISO_226[3] == pytest.approx(THRESHOLD, abs=1e-9)


def test_threshold_is_that_of_terhardt() -> None:
    tones = [50, 100, 200, 500, 1000, 2000, 3300, 4000, 5000, 8000, 10000, 15000]
    published = [39.9761, 22.9529, 13.1706, 6.2788, 3.3691, -0.2513, -4.9809, -3.3875, 0.4817,
                 4.7856, 10.5769, 51.0421]  # fmt: skip
    assert auditory_scale.threshold_in_quiet(tones) == pytest.approx(published, abs=1e-3)
    lowest = minimize_scalar(
        lambda tone: auditory_scale.threshold_in_quiet(tone).item(),
        bounds=(3000, 3700),
        method="bounded",
    )
    assert lowest.x == pytest.approx(3324.13, abs=0.05)


def test_the_two_thresholds_agree_where_both_were_measured() -> None:
    middle = (ROWS >= 100) & (ROWS <= 4000)
    apart = auditory_scale.threshold_in_quiet(ROWS[middle]) - np.array(THRESHOLD)[middle]
    assert np.abs(apart).max() < 4.5


def test_beyond_its_table_the_standard_goes_on_in_parallel_to_the_formula() -> None:
    high = np.array([12500.0, 16000.0, 20000.0])
    rise = np.diff(auditory_scale.threshold_in_quiet(high))
    assert np.diff(auditory_scale.equal_loudness(high)) == pytest.approx(rise)


def test_bandwidths_are_those_of_glasberg_and_moore() -> None:
    tones = [100, 500, 1000, 2000, 4000, 8000]
    published = [35.494, 78.669, 132.639, 240.578, 456.456, 888.212]
    assert auditory_scale.erb(tones) == pytest.approx(published, abs=1e-3)


def test_bark_is_that_of_zwicker_and_terhardt() -> None:
    tones = [100, 500, 1000, 2000, 4000, 8000]
    published = [0.9867, 4.7365, 8.5105, 13.1041, 17.2589, 21.2753]
    assert auditory_scale.bark(tones) == pytest.approx(published, abs=1e-3)


def test_erb_number_counts_bandwidths() -> None:
    assert auditory_scale.frequency_of(auditory_scale.erb_number(EVERYWHERE)) == pytest.approx(
        EVERYWHERE
    )
    numbers = np.diff(auditory_scale.erb_number([999.5, 1000.5]))
    assert numbers == pytest.approx(
        1 / auditory_scale.erb(1000), rel=0.005
    )  # 21.4 is a rounded figure


def test_filters_are_as_wide_as_their_bandwidth() -> None:
    for centre in (100.0, 1000.0, 8000.0):
        low, high = (
            quad(lambda tone, c=centre: auditory_scale.spreading([tone], [c]).item(), *ends)[0]
            for ends in ((1e-3, centre), (centre, 3 * centre))
        )
        assert low + high == pytest.approx(auditory_scale.erb(centre), rel=1e-3)


def test_sensitivity_is_greatest_where_the_contour_is_lowest() -> None:
    weights = auditory_scale.sensitivity(EVERYWHERE)
    assert np.all((weights >= 0) & (weights <= 1))
    assert auditory_scale.sensitivity([3150]) == pytest.approx(1)
    assert auditory_scale.sensitivity([1000, 100]) == pytest.approx(
        10 ** ((35.61 - np.array([40.01, 64.37])) / 20), rel=2e-3
    )


def test_a_decay_leaves_the_mean_over_the_integration_time() -> None:
    for decay in (0.0, 1e-9, 0.5, 30.0, 4000.0):
        mean = (
            quad(lambda t, d=decay: np.exp(-2 * d * t), 0, 0.2, points=[1 / (decay + 5)])[0] / 0.2
        )
        assert auditory_scale.integrated(decay) == pytest.approx(mean, rel=1e-6)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: auditory_scale.threshold_in_quiet([1000, -3]), "-3"),
        (lambda: auditory_scale.equal_loudness(1000, 100), "20 to 80"),
        (lambda: auditory_scale.spreading([np.nan], [1000]), "exceed 0 Hz"),
    ],
)
def test_bad_arguments_are_refused(wrong: object, says: str) -> None:
    assert callable(wrong)
    with pytest.raises(OptionError, match=says):
        wrong()
