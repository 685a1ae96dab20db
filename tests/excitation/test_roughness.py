"""Roughness profiles: what they hold, and that they repeat by the seed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from struck.errors import OptionError
from struck.excitation.roughness import Roughness, roughnesses

FRACTAL = {"rms": 2e-6, "exponent": 1.5, "shortest": 2e-5, "longest": 2e-3}


@pytest.mark.parametrize("name", roughnesses())
def test_named_ones_are_of_a_possible_height_and_join_up(name: str) -> None:
    rough = Roughness.named(name.upper())
    assert 1e-9 < rough.rms < 1e-4
    assert 0.05 < rough.length < 1.0
    assert rough.source
    steps = np.diff(rough.heights)
    assert abs(rough.heights[0] - rough.heights[-1]) <= np.abs(steps).max()


def test_a_fractal_has_the_rms_and_the_slope_asked_for() -> None:
    rough = Roughness.fractal(**FRACTAL, seed=3)
    assert rough.rms == pytest.approx(2e-6)
    waves, power = welch(rough.heights, 1 / rough.pitch, nperseg=4096)
    inside = (waves > 2 / 2e-3) & (waves < 0.8 / 2e-5)
    slope = np.polyfit(np.log(waves[inside]), np.log(power[inside]), 1)[0]
    assert slope == pytest.approx(-1.5, abs=0.1)
    assert power[waves > 1.2 / 2e-5].max() < 1e-3 * power[inside].min()


def test_seeds_repeat() -> None:
    one, same, other = (Roughness.fractal(**FRACTAL, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.heights, same.heights)
    assert not np.allclose(one.heights, other.heights)


def test_over_another_length_it_still_joins_up() -> None:
    rough = Roughness.fractal(**FRACTAL)
    heights = rough.over(0.0628, 20000)
    assert abs(heights[0] - heights[-1]) < 3 * np.abs(np.diff(heights)).std()
    assert heights.std() == pytest.approx(rough.rms, rel=0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rms": 0.0}, "rms is 0.0"),
        ({"rms": np.nan}, "rms is nan"),
        ({"exponent": -1.0}, "exponent is -1.0"),
        ({"shortest": 2e-3}, "longest must exceed shortest"),
        ({"shortest": 1e-6}, "at most 1638 times"),
    ],
)
def test_impossible_fractals_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Roughness.fractal(**{**FRACTAL, **change})


def test_impossible_profiles_are_refused() -> None:
    with pytest.raises(OptionError, match="1 heights are not finite"):
        Roughness(heights=np.array([*np.zeros(20), np.nan]), pitch=1e-5)
    with pytest.raises(OptionError, match="give 16 to"):
        Roughness(heights=np.zeros(3), pitch=1e-5)
    with pytest.raises(OptionError, match="did you mean sandpaper"):
        Roughness.named("sandpapr")
