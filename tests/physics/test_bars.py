"""Bars in closed form against printed roots, chimes in three dimensions, and limits of theories."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck import Material
from struck.shapes.bar import Bar, RectangularSection, RoundSection, Section
from tests.physics.bodies import CHIME
from tests.physics.reference import CHIME_RADIUS, CHIME_WALL, CHIMES, D3_FAMILIES

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
# Roots beta L of the characteristic equations of Euler and Bernoulli (Leissa 1969; Blevins 1979),
# confirmed to 25 digits.
ROOTS = {
    ("free", "free"): (
        4.730040744862704,
        7.853204624095838,
        10.995607838001671,
        14.137165491257464,
        17.27875965739948,
    ),
    ("clamped", "free"): (
        1.8751040687119611,
        4.694091132974175,
        7.854757438237613,
        10.995540734875467,
        14.13716839104647,
    ),
    ("clamped", "hinged"): (
        3.926602312047919,
        7.068582745628732,
        10.21017612281303,
        13.351768777754094,
    ),
}
# The same ends the other way round, and those with equal roots: where the deflection of one bar is
# the moment of the other.
ALIKE = {
    ("clamped", "clamped"): ("free", "free"),
    ("free", "clamped"): ("clamped", "free"),
    ("hinged", "clamped"): ("clamped", "hinged"),
    ("free", "hinged"): ("clamped", "hinged"),
    ("hinged", "free"): ("clamped", "hinged"),
}


def plain_roots(ends: tuple[str, str], count: int) -> Array:
    """Return beta L of a bar by Euler and Bernoulli, from its frequencies."""
    bar = Bar(length=0.9, width=0.02, thickness=0.004, ends=ends, theory="euler-bernoulli")
    speed = np.sqrt(STEEL.youngs_modulus / STEEL.density) * 0.004 / np.sqrt(12)
    highest = speed * ((count + 0.9) * np.pi / bar.length) ** 2 / (2 * np.pi)
    frequencies = bar.vibration(STEEL, highest).frequencies[:count]
    return np.sqrt(2 * np.pi * frequencies / speed) * bar.length


@pytest.mark.parametrize("ends", [*ROOTS, *ALIKE])
def test_roots_of_euler_and_bernoulli(ends: tuple[str, str]) -> None:
    expected = ROOTS[ALIKE.get(ends, ends)]
    assert plain_roots(ends, len(expected)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("ends", "shift"),
    [
        (("free", "free"), 0.5),
        (("clamped", "free"), -0.5),
        (("clamped", "hinged"), 0.25),
        (("hinged", "hinged"), 0.0),
        (("sliding", "sliding"), 0.0),
        (("sliding", "hinged"), -0.5),
        (("free", "sliding"), -0.25),
        (("sliding", "clamped"), -0.25),
    ],
)
def test_high_roots_lie_where_ends_no_longer_feel_each_other(
    ends: tuple[str, str], shift: float
) -> None:
    roots = plain_roots(ends, 450)
    assert len(roots) == 450
    expected = (np.arange(1, 451) + shift) * np.pi
    assert roots[12:] == pytest.approx(expected[12:], rel=1e-14)


def test_the_clamped_bar_of_1998() -> None:
    # Equation 14: deflection and slope vanish at both ends.
    bar = Bar(length=1.0, width=0.02, thickness=0.004, ends="clamped", theory="euler-bernoulli")
    vibration = bar.vibration(STEEL, 1000.0)
    ratios = vibration.frequencies / vibration.frequencies[0]
    squares = np.square(ROOTS["free", "free"])
    assert ratios[:5] == pytest.approx(squares / squares[0], rel=1e-14)
    assert ratios[1:3] == pytest.approx([2.756538507099962, 5.4039176323833225], rel=1e-14)
    step = 1e-6
    near = vibration.forms.values(np.array([[0.0], [step], [1 - step], [1.0]]))
    assert near[[0, 3]] == pytest.approx(0, abs=1e-14)
    # What remains next to a clamp is the curvature, 2 beta^2 in a mode of mean square 1.
    curved = np.square(step * ROOTS["free", "free"][0])
    assert np.abs(near[[1, 2], 0]) == pytest.approx(curved, rel=1e-3)


@pytest.mark.parametrize("name", CHIMES)
def test_chimes_ring_as_in_three_dimensions(name: str) -> None:
    chime = CHIMES[name]
    section = RoundSection(radius=CHIME_RADIUS, wall=CHIME_WALL)
    bar = Bar(length=chime.length, section=section)
    lowest = bar.vibration(CHIME, 2000.0).frequencies[0]
    assert lowest == pytest.approx(chime.elastic, rel=1.2e-3)
    assert lowest == pytest.approx(chime.computed, rel=3.5e-3)


def test_overtones_of_a_chime() -> None:
    section = RoundSection(radius=CHIME_RADIUS, wall=CHIME_WALL)
    bar = Bar(length=CHIMES["D3"].length, section=section)
    vibration = bar.vibration(CHIME, 5000.0)
    # The theory falls short by more the shorter the waves: by 0.05, 0.19, 0.35 and 0.53 %.
    assert vibration.frequencies[:2] == pytest.approx(D3_FAMILIES[1][:2], rel=2e-3)
    short = 1 - vibration.frequencies[:4] / D3_FAMILIES[1][:4]
    assert short.tolist() == sorted(short)
    assert vibration.details["shear coefficient"] == pytest.approx(0.5345, abs=5e-5)
    plain = Bar(length=0.505, section=section, theory="euler-bernoulli")
    assert plain.vibration(CHIME, 1000.0).frequencies[0] == pytest.approx(596.6, rel=1e-4)


@pytest.mark.parametrize("ends", ["free", ("clamped", "free"), ("hinged", "sliding"), "clamped"])
def test_slender_bars_tend_to_euler_and_bernoulli(ends: str | tuple[str, str]) -> None:
    apart = []
    for thickness in (1e-2, 1e-3, 1e-4):
        bars = [
            Bar(length=1.0, width=0.05, thickness=thickness, ends=ends, theory=theory)
            for theory in ("timoshenko", "euler-bernoulli")
        ]
        full, plain = (bar.vibration(STEEL, 1e5 * thickness).frequencies[:3] for bar in bars)
        apart.append(1 - full / plain)
    # Shear and turning count with the square of the thickness.
    assert (apart[0] > 0).all()
    assert apart[1] == pytest.approx(apart[0] / 100, rel=0.02)
    assert apart[2] == pytest.approx(apart[1] / 100, rel=0.02)


@pytest.mark.parametrize(
    ("section", "coefficients"),
    [
        (RectangularSection(width=0.02, thickness=0.01), (5 / 6, 13 / 15.3)),
        (RoundSection(radius=0.01), (6 / 7, 7.8 / 8.8)),
        (RoundSection(radius=0.01, wall=1e-9), (1 / 2, 2.6 / 4.9)),
    ],
)
def test_shear_coefficients_of_cowper(section: Section, coefficients: tuple[float, float]) -> None:
    # Poisson's ratio 0, then 0.3; thin tube 2 (1 + nu) / (4 + 3 nu).
    for nu, expected in zip((0.0, 0.3), coefficients, strict=True):
        material = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=nu)
        details = Bar(length=0.4, section=section).vibration(material, 1e3).details
        assert details["shear coefficient"] == pytest.approx(expected, rel=1e-9)


def test_bars_between_hinges_by_formula() -> None:
    # Han, Benaroya & Wei 1999: whole half waves, two frequencies for each.
    bar = Bar(length=0.5, width=0.05, thickness=0.1, ends="hinged")
    density, nu = STEEL.density, STEEL.poisson_ratio
    shear = 10 * (1 + nu) / (12 + 11 * nu) * STEEL.shear_modulus
    wave = np.arange(1, 10) * np.pi / 0.5
    gyration = 0.1**2 / 12
    frequencies = []
    for k in wave:
        polynomial = [
            density**2 * gyration,
            -density * (shear + (STEEL.youngs_modulus + shear) * gyration * k**2),
            STEEL.youngs_modulus * shear * gyration * k**4,
        ]
        frequencies += np.sqrt(np.roots(polynomial)).tolist()
    frequencies.append(np.sqrt(shear / (density * gyration)))
    expected = np.sort(frequencies) / (2 * np.pi)
    found = bar.vibration(STEEL, expected[7] * 1.0001).frequencies
    assert found == pytest.approx(expected[:8], rel=1e-12)
    # Among them the section's own turning, the first of the second kind.
    assert (
        np.count_nonzero(found > bar.vibration(STEEL, 1.0).details["critical frequency (Hz)"]) == 1
    )
