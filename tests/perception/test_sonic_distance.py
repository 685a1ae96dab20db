"""Sonic distances against the formulas written out, and what a distance must and must not feel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from struck.errors import ContactError, OptionError
from struck.model.model import ModalModel
from struck.perception.auditory_scale import threshold_in_quiet
from struck.perception.sonic_distance import METHODS, sonic_distance
from tests.perception.bodies import LEFT, RIGHT, chord, hinged_bar, random_contacts

TONES = np.array([300.0, 1000.0, 2500.0, 6000.0])


def written_out(frequencies: list[float], one: list[float], other: list[float]) -> float:
    """Return the distance behind the ear's filters of partials at given levels, dB."""
    total, count = 0.0, 0
    for half in range(1, 100):
        centre = (10 ** (half / 2 / 21.4) - 1) / 0.00437
        if not 20 <= centre <= 20_000:
            continue
        steepness = 4 * centre / (24.7 * (0.00437 * centre + 1))
        excess = []
        for levels in (one, other):
            energy = 1e-300
            for tone, level in zip(frequencies, levels, strict=True):
                step = steepness * abs(tone - centre) / centre
                energy += 10 ** (level / 10) * (1 + step) * math.exp(-step)
            quiet = threshold_in_quiet(centre).item()
            excess.append(max(10 * math.log10(energy) - quiet, 0.0))
        total += (excess[0] - excess[1]) ** 2
        count += max(excess) > 0
    return math.sqrt(total / max(count, 1))


def levels_of(model: ModalModel, heights: np.ndarray, loudest: np.ndarray) -> list[float]:
    """Return the levels of partials when `loudest` heights come to 85 dB."""
    decays = model.decays
    energies = (1 - np.exp(-0.4 * decays)) / (0.4 * decays)
    return list(85 + 10 * np.log10(heights**2 * energies / (loudest**2 @ energies)))


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    return hinged_bar(20)


@pytest.mark.parametrize("method", METHODS)
def test_a_contact_is_not_far_from_itself_and_as_far_both_ways(
    bar: ModalModel, method: str
) -> None:
    here, there = (0.07, 0.005, 0.0025), (0.22, 0.005, 0.0025)
    assert sonic_distance(bar, bar, at=here, method=method) == 0
    far = sonic_distance(bar, bar, at=here, against=there, method=method)
    assert far > 1
    assert sonic_distance(bar, bar, at=there, against=here, method=method) == pytest.approx(far)
    mirrored = (0.43, 0.005, 0.0025)
    assert sonic_distance(bar, bar, at=here, against=mirrored, method=method) < 1e-4


def test_the_sum_of_1998_keeps_the_triangle_inequality(bar: ModalModel) -> None:
    places = random_contacts(bar.geometry, 3 * 6, seed=3)[0].reshape(6, 3, 3)
    for first, second, third in places:
        sides = [
            sonic_distance(bar, bar, at=here, against=there, method="doel1998")
            for here, there in ((first, second), (second, third), (first, third))
        ]
        assert 2 * max(sides) <= sum(sides) + 1e-9


def test_behind_filters_it_is_the_formula_written_out() -> None:
    left, right = np.array([1.0, 0.3, 0.5, 0.2]), np.array([0.4, 0.3, 0.05, 0.7])
    model = chord(TONES, left, right)
    decays = model.decays
    energies = (1 - np.exp(-0.4 * decays)) / (0.4 * decays)
    loudest = max((left, right), key=lambda heights: heights**2 @ energies)
    wanted = written_out(
        TONES.tolist(), levels_of(model, left, loudest), levels_of(model, right, loudest)
    )
    assert sonic_distance(model, model, at=LEFT, against=RIGHT) == pytest.approx(wanted, rel=1e-5)


def test_a_tone_of_ten_decibels_more_is_ten_decibels_away() -> None:
    model = chord([1000.0], [1.0], [10**-0.5])
    found = sonic_distance(model, model, at=LEFT, against=RIGHT)
    assert found == pytest.approx(written_out([1000.0], [85], [75]), rel=1e-5)
    assert 9 < found < 10  # at its farthest flanks the threshold cuts in


def test_ten_decibels_on_one_of_four_modes_count_by_the_ear_for_that_mode() -> None:
    model = chord(TONES, np.ones(4), [1, 10**-0.5, 1, 1])
    # S(f), from the 40 phon contour of ISO 226 at 300, 1000, 2500 and 6000 Hz.
    contour = np.interp(
        np.log(TONES),
        np.log([250, 315, 1000, 2500, 5000, 6300]),
        [50.40, 47.58, 40.01, 36.51, 40.01, 45.83],
    )
    weights = 10 ** ((35.61 - contour) / 20)
    apart = {
        method: sonic_distance(model, model, at=LEFT, against=RIGHT, method=method)
        for method in ("doel1998", "doel1998-mean")
    }
    assert apart["doel1998"] == pytest.approx(10 * np.sqrt(weights[1]), rel=2e-3)
    assert apart["doel1998-mean"] == pytest.approx(
        10 * np.sqrt(weights[1] / weights.sum()), rel=2e-3
    )


@pytest.mark.parametrize("method", METHODS[:2])
def test_modes_that_nobody_hears_do_not_matter(method: str) -> None:
    heard = chord(TONES[:2], [1.0, 0.5], [0.2, 1.0])
    more = chord([*TONES[:2], 15_000.0], [1.0, 0.5, 1e-3], [0.2, 1.0, 1e-2])
    first, second = (
        sonic_distance(each, each, at=LEFT, against=RIGHT, method=method, level=60)
        for each in (heard, more)
    )
    assert second == pytest.approx(first, rel=1e-3)


def test_what_one_filter_cannot_tell_apart_counts_for_little() -> None:
    model = chord([1000.0, 1004.0], [1.0, 0.1], [0.1, 1.0])
    assert sonic_distance(model, model, at=LEFT, against=RIGHT) < 0.5
    assert sonic_distance(model, model, at=LEFT, against=RIGHT, method="doel1998") > 10


def test_a_neighbour_that_is_masked_counts_for_little() -> None:
    near = chord([1000.0, 1050.0], [1.0, 1e-3], [1.0, 1e-2])
    apart = chord([1000.0, 4000.0], [1.0, 1e-3], [1.0, 1e-2])
    close, far = (sonic_distance(each, each, at=LEFT, against=RIGHT) for each in (near, apart))
    assert close < 0.1
    assert far > 20 * close


def test_models_with_modes_of_their_own_are_compared_behind_filters(bar: ModalModel) -> None:
    assert sonic_distance(bar, bar.scaled(1.0001)) < 0.05
    assert sonic_distance(bar, bar.scaled(2.0)) > 5
    with pytest.raises(OptionError, match="method='erb'"):
        sonic_distance(bar, bar.scaled(2.0), method="doel1998")
    fewer = hinged_bar(19)
    with pytest.raises(OptionError, match="20 and 19"):
        sonic_distance(bar, fewer, method="doel1998-mean")


def test_at_a_lower_level_contacts_sound_more_alike() -> None:
    model = chord(TONES, [1.0, 0.01, 0.01, 0.01], [1.0, 0.1, 0.001, 0.1])
    loud, soft, faint = (
        sonic_distance(model, model, at=LEFT, against=RIGHT, level=level) for level in (85, 40, -30)
    )
    assert loud > soft > faint == 0


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"method": "euclid"}, OptionError, "euclid"),
        ({"level": float("nan")}, OptionError, "nan"),
        ({"listener": (0.0, 0.0, np.inf)}, ContactError, "x, y and z"),
        ({"listener": (0.25, 0.005, 0.0)}, ContactError, "inside the body"),
        ({"at": (9.0, 9.0, 9.0)}, ContactError, "off the body"),
        ({"at": "rim"}, ContactError, "rim"),
    ],
)
def test_bad_arguments_are_refused(
    bar: ModalModel, options: dict[str, object], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        sonic_distance(bar, bar, **options)


def test_a_silent_body_has_no_level() -> None:
    silent = chord([500.0], [0.0], [0.0])
    with pytest.raises(OptionError, match="no push"):
        sonic_distance(silent, silent, at=LEFT)
