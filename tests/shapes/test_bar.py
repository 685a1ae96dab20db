"""Bars: every pair of ends against polynomials, many modes, surfaces, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from struck import Material
from struck.errors import OptionError
from struck.model.gains import TransverseShapes
from struck.shapes.bar import Bar, GivenSection, RectangularSection, RoundSection, Section
from struck.shapes.beam import ENDS
from struck.solids.surface.closedness import require_closed
from tests.shapes.legendre_beams import Timoshenko

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
PAIRS = list(product(ENDS, ENDS))
RING = RoundSection(radius=0.0125, wall=0.001)


def polynomials(bar: Bar, degree: int) -> Timoshenko:
    assert bar.width
    assert bar.thickness
    return Timoshenko(
        length=bar.length,
        width=bar.width,
        thickness=bar.thickness,
        material=STEEL,
        degree=degree,
    )


def critical(bar: Bar) -> float:
    value = bar.vibration(STEEL, 1.0).details["critical frequency (Hz)"]
    assert isinstance(value, float)
    return value


# The second of these bars has most of its modes beyond the critical frequency.
@pytest.mark.parametrize("thickness", [0.05, 0.3])
@pytest.mark.parametrize("ends", PAIRS)
def test_frequencies_and_shapes_with_any_ends(ends: tuple[str, str], thickness: float) -> None:
    bar = Bar(length=0.7, width=0.05, thickness=thickness, ends=ends)
    expected, at = polynomials(bar, 44).modes(ends)
    highest = float(expected[15] + expected[16]) / 2
    vibration = bar.vibration(STEEL, highest)
    assert vibration.frequencies == pytest.approx(expected[:16], rel=1e-8)
    assert (highest > critical(bar)) == (thickness == 0.3)
    x = np.linspace(0, bar.length, 41)
    shapes, others = vibration.forms.values(x[:, None]), at(x)[:, :16]
    signs = np.sign((shapes * others).sum(axis=0))
    np.testing.assert_allclose(shapes, others * np.where(signs, signs, 1), rtol=0, atol=1e-7)


@pytest.mark.prove
@pytest.mark.parametrize(
    "ends", [("clamped", "free"), pytest.param(("free", "free"), marks=pytest.mark.prove)]
)
def test_none_of_400_modes_is_missed_or_doubled(ends: tuple[str, str]) -> None:
    bar = Bar(length=1.0, width=0.05, thickness=0.2, ends=ends)
    expected, _ = polynomials(bar, 460).modes(ends)
    highest = float(expected[399] + expected[400]) / 2
    frequencies = bar.vibration(STEEL, highest).frequencies
    assert highest > 5 * critical(bar)
    # What rounding leaves of the polynomials' lowest frequencies has the size of the highest.
    assert frequencies == pytest.approx(expected[:400], rel=1e-8, abs=1e-9 * highest)


@pytest.mark.prove
def test_a_mode_at_the_very_frequency_where_waves_of_shear_begin_to_travel() -> None:
    def beyond(length: float) -> float:
        bar = Bar(length=length, width=0.05, thickness=0.1, ends="clamped")
        return bar.vibration(STEEL, 1.3 * critical(bar)).frequencies[4] - critical(bar)

    length = brentq(beyond, 0.38, 0.41, xtol=1e-13)
    for away in (0.0, 1e-12, 1e-6, 1e-3, -1e-9, -1e-3):
        bar = Bar(length=length * (1 + away), width=0.05, thickness=0.1, ends="clamped")
        expected, at = polynomials(bar, 30).modes(bar.pair)
        vibration = bar.vibration(STEEL, float(expected[5] + expected[4]) / 2)
        assert vibration.frequencies[4] == pytest.approx(critical(bar), rel=4e-3)
        assert vibration.frequencies == pytest.approx(expected[:5], rel=1e-10)
        x = np.linspace(0, bar.length, 21)
        shapes = vibration.forms.values(x[:, None])
        assert np.abs(shapes) == pytest.approx(np.abs(at(x)[:, :5]), abs=1e-8)


def test_between_hinges_sections_may_turn_while_the_bar_stays_straight() -> None:
    bar = Bar(length=0.4, width=0.05, thickness=0.1, ends="hinged")
    vibration = bar.vibration(STEEL, 1.5 * critical(bar))
    still = np.argmin(np.abs(vibration.frequencies - critical(bar)))
    assert vibration.frequencies[still] == pytest.approx(critical(bar), rel=1e-14)
    x = np.linspace(0, bar.length, 9)[:, None]
    assert vibration.forms.values(x)[:, still] == pytest.approx(0, abs=1e-12)
    others = np.delete(vibration.forms.values(x), still, axis=1)
    assert (np.abs(others).max(axis=0) > 0.2).all()


def test_two_modes_between_hinges_with_the_same_frequency_are_two() -> None:
    def apart(length: float) -> float:
        rotary = 0.1**2 / 12
        shear = rotary * 2 * (12 + 11 * STEEL.poisson_ratio) / 10
        wave = np.pi / length * np.array([6.0, 1.0])
        half = (1 + (rotary + shear) * wave**2) / 2
        root = np.sqrt(half**2 - rotary * shear * wave**4)
        return (half - root)[0] - (half + root)[1]

    length = brentq(apart, 0.2, 1.0, xtol=1e-15)
    bar = Bar(length=length, width=0.05, thickness=0.1, ends="hinged")
    expected, _ = polynomials(bar, 50).modes(bar.pair)
    frequencies = bar.vibration(STEEL, float(expected[11] + expected[12]) / 2).frequencies
    assert frequencies == pytest.approx(expected[:12], rel=1e-9)
    assert np.diff(frequencies).min() < 1e-9 * frequencies[-1]


@pytest.mark.parametrize("ends", PAIRS)
def test_400_shapes_of_euler_and_bernoulli_are_orthonormal(ends: tuple[str, str]) -> None:
    bar = Bar(length=0.8, width=0.02, thickness=0.002, ends=ends, theory="euler-bernoulli")
    vibration = bar.vibration(STEEL, 1.3e6)
    forms = vibration.forms.chosen(np.arange(0, 400, 7))
    nodes, weights = np.polynomial.legendre.leggauss(20)
    panels = np.linspace(0, bar.length, 101)
    x = (panels[:-1, None] + (nodes + 1) / 2 * np.diff(panels)[:, None]).reshape(-1, 1)
    values = forms.values(x)
    products = (values.T * np.tile(weights, 100) / 200) @ values
    np.testing.assert_allclose(products, np.eye(58), rtol=0, atol=1e-12)


def test_slopes_over_poissons_ratio() -> None:
    step = 1e-5
    for ends in combinations_with_replacement(ENDS, 2):
        for section in (RectangularSection(width=0.05, thickness=0.1), RING):
            bar = Bar(length=0.3, section=section, ends=ends)
            low, high = (
                bar.vibration(replace(STEEL, poisson_ratio=0.29 + k * step), 3e4).frequencies
                for k in (-1, 1)
            )
            slopes = bar.vibration(STEEL, 3e4).poisson_slopes
            expected = np.log(high / low) / (2 * step)
            assert slopes == pytest.approx(expected, abs=1e-8)
            assert (slopes < 0).all()


def test_slopes_vanish_where_poissons_ratio_does_not_count() -> None:
    plain = Bar(length=0.3, width=0.05, thickness=0.01, theory="euler-bernoulli")
    given = GivenSection(area=5e-4, second_moment=4e-9, shear_coefficient=0.8)
    assert not plain.vibration(STEEL, 2e4).poisson_slopes.any()
    # E / G = 2 (1 + nu) remains.
    assert (Bar(length=0.3, section=given).vibration(STEEL, 2e4).poisson_slopes < 0).all()


def test_sections_that_are_the_same_body_sound_the_same() -> None:
    def frequencies(section: Section) -> Array:
        return Bar(length=0.3, section=section).vibration(STEEL, 2e4).frequencies

    rod = frequencies(RoundSection(radius=0.01))
    assert frequencies(RoundSection(radius=0.01, wall=0.01)) == pytest.approx(rod, rel=1e-14)
    nu = STEEL.poisson_ratio
    given = GivenSection(
        area=np.pi * 0.01**2,
        second_moment=np.pi / 4 * 0.01**4,
        shear_coefficient=6 * (1 + nu) / (7 + 6 * nu),
    )
    assert frequencies(given) == pytest.approx(rod, rel=1e-12)
    short = Bar(length=0.3, width=0.02, thickness=0.01).vibration(STEEL, 2e4).frequencies
    long = frequencies(RectangularSection(width=0.02, thickness=0.01))
    assert short.tolist() == long.tolist()


def test_forms_stay_finite_and_still_beyond_the_ends() -> None:
    bar = Bar(length=2.0, width=0.02, thickness=0.001, ends=("clamped", "free"))
    forms = bar.vibration(STEEL, 6e5).forms
    values = forms.values(np.array([[-0.04], [0.0], [1.0], [2.0], [2.04]]))
    assert values.shape[1] > 700
    assert np.isfinite(values).all()
    assert values[0].tolist() == values[1].tolist()
    assert values[4].tolist() == values[3].tolist()
    assert values[1] == pytest.approx(0, abs=1e-12)
    picked = forms.chosen(np.array([5, 2, 2]))
    assert picked.values(np.array([[1.1]])).tolist() == [
        forms.values(np.array([[1.1]]))[0, [5, 2, 2]].tolist()
    ]
    assert picked.dimensions == 1


def test_forms_make_shapes_of_the_body_along_z() -> None:
    bar = Bar(length=0.3, width=0.02, thickness=0.01)
    forms = bar.vibration(STEEL, 2e4).forms
    shapes = TransverseShapes.of(forms, len(forms.values(np.zeros((1, 1)))[0]), 4.0)
    moved = shapes.displacements(np.array([[0.1, 0.005, 0.005]]))
    assert moved[0, 2] == pytest.approx(forms.values(np.array([[0.1]]))[0] / 2, rel=1e-15)
    assert not moved[0, :2].any()


@pytest.mark.parametrize(
    ("section", "area", "size"),
    [
        (RectangularSection(width=0.03, thickness=0.005), 1.5e-4, (0.03, 0.005)),
        (RoundSection(radius=0.01), np.pi * 1e-4, (0.02, 0.02)),
        (RING, np.pi * 0.024 * 0.001, (0.025, 0.025)),
        (
            GivenSection(area=1.5e-4, second_moment=3.125e-10, shear_coefficient=0.8),
            1.5e-4,
            (0.03, 0.005),
        ),
    ],
)
@pytest.mark.parametrize("spacing", [0.003, 0.02, 1.0])
def test_skins_are_closed_and_hold_the_volume(
    section: Section, area: float, size: tuple[float, float], spacing: float
) -> None:
    bar = Bar(length=0.3, section=section)
    skin = bar.skin(spacing)
    require_closed(skin)
    assert skin.volume == pytest.approx(0.3 * area, rel=1e-12)
    assert bar.volume == pytest.approx(0.3 * area, rel=1e-12)
    assert skin.bounds[:, 0].tolist() == [0, 0.3]
    assert np.ptp(skin.bounds, axis=0)[1:] == pytest.approx(size, rel=0.012)
    assert skin.bounds.mean(axis=0)[1:] == pytest.approx(0, abs=1e-12)
    along = np.unique(skin.points[:, 0])
    assert np.diff(along).max() <= max(spacing, 0.15) + 1e-12


def test_places_lie_on_the_top() -> None:
    bar = Bar(length=0.3, section=RING, ends=("clamped", "free"))
    assert {name: place.tolist() for name, place in bar.places.items()} == {
        "top": [0.15, 0, 0.0125],
        "middle": [0.15, 0, 0.0125],
        "quarter": [0.075, 0, 0.0125],
        "end": [pytest.approx(0.297), 0, 0.0125],
    }
    with pytest.raises(ValueError, match="read-only"):
        bar.places["top"][0] = 1.0


def test_what_holds_it() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    assert bar.pair == ("free", "free")
    assert not bar.supported
    assert not bar.tensioned
    assert replace(bar, ends=("free", "sliding")).supported
    assert bar.extent == 0.3


def test_half_waves_are_as_short_as_the_highest_mode() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.002, ends="hinged", theory="euler-bernoulli")
    vibration = bar.vibration(STEEL, 2e4)
    assert vibration.half_wave == pytest.approx(0.3 / len(vibration.frequencies), rel=1e-12)
    assert bar.vibration(STEEL, 1.0).half_wave == 0.3


RIGHT = {"length": 0.3, "width": 0.03, "thickness": 0.005}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"length": -0.3}, "length of the bar is -0.3 m: it must exceed 0"),
        ({"length": float("nan")}, "length of the bar is nan m"),
        ({"length": 0.001}, "length of the bar is 0.001 m: at least its radius of gyration, 0.00"),
        ({"thickness": 0.0}, "thickness of the section is 0.0 m: it must exceed 0"),
        ({"width": float("inf")}, "width of the section is inf m"),
        ({"width": None}, "width is None and thickness is 0.005: give both"),
        ({"section": RING}, "give width and thickness, or a section"),
        ({"ends": "glued"}, "ends is 'glued': give one of free, clamped, hinged, sliding"),
        ({"ends": ("free", "fixed")}, "ends is 'fixed': .* give one of"),
        ({"ends": ("free",)}, "ends are free: give one or two"),
        ({"theory": "mindlin"}, "theory is 'mindlin': give one of timoshenko, euler-bernoulli"),
    ],
)
def test_bad_bars_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Bar(**(RIGHT | wrong))  # type: ignore[arg-type]


def test_bad_sections_are_refused() -> None:
    with pytest.raises(OptionError, match=r"wall of the section is 0.02 m: at most its radius"):
        RoundSection(radius=0.01, wall=0.02)
    with pytest.raises(OptionError, match=r"wall of the section is 0.0 m: it must exceed 0"):
        RoundSection(radius=0.01, wall=0.0)
    with pytest.raises(OptionError, match=r"radius of the section is -1.0 m"):
        RoundSection(radius=-1)
    with pytest.raises(OptionError, match=r"second_moment of the section is 0.0 m\^4"):
        GivenSection(area=1e-4, second_moment=0.0, shear_coefficient=0.8)
    with pytest.raises(OptionError, match=r"shear_coefficient is 1.2: it must lie above 0 and at"):
        GivenSection(area=1e-4, second_moment=1e-9, shear_coefficient=1.2)


def test_bars_too_thick_for_their_theory_are_warned_of() -> None:
    for thick in (RoundSection(radius=0.06), RectangularSection(width=0.12, thickness=0.01)):
        details = Bar(length=0.3, section=thick).vibration(STEEL, 9000.0).details
        assert "length is 2.5 of the section's wider side, below 5" in str(details["caution"])
    slender = Bar(length=0.3, section=RoundSection(radius=0.02)).vibration(STEEL, 9000.0)
    assert "caution" not in slender.details
