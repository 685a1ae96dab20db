"""Finishes and profiles: what they hold, and the spectrum that one has from the other."""

from __future__ import annotations

import numpy as np
import pytest

from struck.errors import OptionError
from struck.excitation.roughness import Profile, Roughness, profiles, roughnesses

FINISH = {"rms": 2e-6, "correlation_length": 1e-4, "slope": -2.0, "shortest": 1e-5}


@pytest.mark.parametrize("name", roughnesses())
def test_named_ones_are_of_a_possible_height_and_have_a_source(name: str) -> None:
    finish = Roughness.named(name.upper())
    assert 5e-9 < finish.rms < 2e-4
    assert finish.rms < 1.5 * finish.correlation_length < 1e-3
    assert finish.source
    # The longer scale is the gentler one, as the draft glTF extension asks.
    slope = finish.waviness / finish.waviness_length
    assert slope < finish.rms / finish.correlation_length or name == "fabric"


def test_heights_of_abrasive_papers_follow_their_grains() -> None:
    """Mean heights of P120 and of P2000 were measured as 42.4 and 3.64 um: Nanovea, 2018."""
    assert Roughness.named("sandpaper").rms / 1.25 == pytest.approx(42.4e-6, rel=0.05)
    rms = [Roughness.named(f"sandpaper p{grade}").rms for grade in (40, 80, 240, 600)]
    assert np.all(np.diff(rms) < 0)


def test_the_law_holds_its_mean_square_height() -> None:
    finish = Roughness(**FINISH)
    waves = np.linspace(0, 1.2 / 1e-5, 400_001)
    law = finish.spectrum(waves)
    assert np.trapezoid(law, waves) == pytest.approx(finish.rms**2, rel=1e-3)
    steep = law[waves > 0.5 / 1e-5][0] / law[waves > 0.25 / 1e-5][0]
    assert np.log2(steep) == pytest.approx(-2.0, abs=0.01)


def test_layers_hold_both_scales() -> None:
    finish = Roughness(**FINISH, waviness=5e-6, waviness_length=1e-2)
    places = np.random.default_rng(0).uniform(-1, 1, (200_000, 3))
    assert finish.layers(3).at(places).std() == pytest.approx(np.hypot(2e-6, 5e-6), rel=0.02)


@pytest.mark.parametrize("name", profiles())
def test_measured_profiles_join_up(name: str) -> None:
    measured = Profile.named(name.upper())
    assert 1e-9 < measured.rms < 1e-4
    assert 0.05 < measured.length < 1.0
    assert measured.source
    steps = np.diff(measured.heights)
    assert abs(measured.heights[0] - measured.heights[-1]) <= np.abs(steps).max()


def test_a_profile_goes_on_as_its_spectrum() -> None:
    finish = Roughness(**FINISH)
    line = np.outer(np.arange(100_000) * 4e-6, [0.6, 0.0, 0.8])
    found = Profile(heights=finish.layers(1).at(line), pitch=4e-6).roughness()
    assert found.rms == pytest.approx(finish.rms, rel=0.05)
    waves = np.geomspace(1 / 2e-3, 1 / 5e-5, 30)
    apart = 10 * np.log10(found.spectrum(waves) / finish.spectrum(waves))
    assert np.abs(apart).max() < 1.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rms": 0.0}, "rms is 0.0"),
        ({"rms": 1e-300}, "rms is 1e-300"),
        ({"rms": np.nan}, "rms is nan"),
        ({"slope": 1.0}, "slope is 1"),
        ({"correlation_length": -1.0}, "correlation_length is -1.0"),
        ({"shortest": 1e-9}, "shortest is 1e-09"),
        ({"shortest": 2e-3}, "shortest is 0.002"),
        ({"waviness": -1e-6}, "waviness is -1e-06"),
        ({"waviness_length": 0.0}, "waviness_length is 0.0"),
    ],
)
def test_impossible_finishes_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Roughness(**{**FINISH, **change})


def test_impossible_profiles_are_refused() -> None:
    with pytest.raises(OptionError, match="1 heights are not finite"):
        Profile(heights=np.array([*np.zeros(20), np.nan]), pitch=1e-5)
    with pytest.raises(OptionError, match="give 16 to"):
        Profile(heights=np.zeros(3), pitch=1e-5)
    with pytest.raises(OptionError, match="all the same"):
        Profile(heights=np.ones(30), pitch=1e-5).roughness()
    with pytest.raises(OptionError, match="did you mean sandpaper"):
        Roughness.named("sandpapr")
    with pytest.raises(OptionError, match="profile is 'steel': give one of"):
        Profile.named("steel")
