"""Membranes against 1998's square, tables of Bessel functions, and Ritz's method."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import jn_zeros

from struck import Material
from struck.shapes.circular_membrane import AnnularMembrane, CircularMembrane
from struck.shapes.rectangular_membrane import RectangularMembrane
from struck.shapes.shape import Shape, Vibration
from tests.physics import ritz_disk

Array = NDArray[np.float64]
UNIT = Material(density=1.0, youngs_modulus=1.0, poisson_ratio=0.3)

# Morse and Ingard, "Theoretical Acoustics", 1968; Abramowitz and Stegun, table 9.5.
BESSEL_ZEROS = {
    0: (2.404825557695773, 5.520078110286311, 8.653727912911013),
    1: (3.8317059702075125, 7.015586669815619, 10.173468135062722),
    2: (5.135622301840683, 8.417244140399864, 11.619841172149059),
    3: (6.380161895923983, 9.76102312998167, 13.015200721698434),
    4: (7.588342434503804, 11.064709488501185, 14.37253667161759),
    5: (8.771483815959954, 12.338604197466944, 15.70017407971167),
}
DRUM_RATIOS = (1, 1.593341, 2.135549, 2.295417, 2.653066, 2.917295)
DRUM_RATIOS += (3.155465, 3.500147, 3.598485, 3.647451, 4.058932, 4.131738)
# Jahnke and Emde, "Tables of Functions", 1945, roots of J_m(x) Y_m(2 x) = J_m(2 x) Y_m(x).
RING_ZEROS = {0: (3.1230, 6.2734, 9.4182), 1: (3.1966, 6.3123, 9.4445)}


def up_to(body: Shape, wavenumber: float) -> Vibration:
    """Return the modes with waves of speed 1 up to a wavenumber, 1/m."""
    return body.vibration(UNIT, wavenumber / (2 * np.pi))


def disk(wavenumber: float) -> Array:
    return up_to(CircularMembrane(radius=1, thickness=1, tension=1), wavenumber).frequencies


def ring(hole: float, wavenumber: float) -> Array:
    body = AnnularMembrane(radius=1, hole=hole, thickness=1, tension=1)
    return up_to(body, wavenumber).frequencies


def by_order(families: list[Array], highest: float) -> Array:
    """Return all roots up to `highest`, two of each with nodal diameters."""
    found = [roots[roots <= highest] for roots in families]
    return np.sort(np.concatenate([found[0], *(2 * found[1:])]))


def square(count: int) -> tuple[Array, RectangularMembrane]:
    """Return the lowest frequencies of 1998's square, whose first is 500 Hz."""
    body = RectangularMembrane(length=1, width=1, thickness=1, tension=500.0**2 * 2)
    return body.vibration(UNIT, 8300.0).frequencies[:count], body


def test_spectrum_of_the_square_of_1998() -> None:
    found, _ = square(401)
    lowest = [500.0, 790.569415, 790.569415, 1000.0, 1118.033989, 1118.033989]
    assert found[:6] == pytest.approx(lowest, rel=1e-9)
    assert found[[399, 400]] == pytest.approx([8200.6097, 8223.4421], rel=1e-8)


@pytest.mark.parametrize(
    ("place", "sounding", "strongest", "centroid", "energy_centroid", "size"),
    [
        ((0.1, 0.1), 341, (4, 4), 3326.9521, 5353.4464, 10.06491724),
        ((0.1, 0.4), 305, (2, 1), 2997.113, 5396.0798, 10.14677622),
        ((0.5, 0.4), 171, (1, 1), 2279.2157, 5477.8532, 10.29740135),
    ],
)
def test_strikes_of_the_square_of_1998(
    place: tuple[float, float],
    sounding: int,
    strongest: tuple[int, int],
    centroid: float,
    energy_centroid: float,
    size: float,
) -> None:
    """1998, eq. 10 and figures 5 to 7: amplitudes Psi / omega of the lowest 400 modes."""
    frequencies, body = square(400)
    forms = body.vibration(UNIT, 8300.0).forms.chosen(np.arange(400))
    psi = forms.values(np.array([place]))[0] / 2  # the paper leaves Psi unnormalised
    amplitudes = (psi / frequencies) ** 2
    assert np.count_nonzero(np.abs(psi) > 1e-9) == sounding
    best = np.argmax(amplitudes)
    assert (forms.along[best], forms.across[best]) == strongest
    assert amplitudes @ frequencies / amplitudes.sum() == pytest.approx(centroid, rel=1e-6)
    energy = psi**2 @ frequencies / (psi @ psi)
    assert energy == pytest.approx(energy_centroid, rel=1e-6)
    assert np.sqrt(psi @ psi) == pytest.approx(size, rel=1e-6)


def test_zeros_of_bessel_functions_as_printed() -> None:
    every = [
        root for m, roots in BESSEL_ZEROS.items() for root in roots for _ in range(1 + (m > 0))
    ]
    found = 2 * np.pi * disk(16.0)
    for root in every:
        assert np.abs(found / root - 1).min() < 1e-14
    lowest = np.unique(found.round(9)) / found[0]
    assert lowest[:12] == pytest.approx(DRUM_RATIOS, abs=5e-7)


def test_zeros_of_rings_as_printed() -> None:
    found = 2 * np.pi * ring(0.5, 20.0) / 2
    for root in np.concatenate(list(RING_ZEROS.values())):
        assert np.abs(found - root).min() < 6e-5


def test_disk_has_the_zeros_that_scipy_finds() -> None:
    highest = 45.0
    expected = by_order([jn_zeros(m, 20) for m in range(46)], highest)
    assert len(expected) > 400
    assert 2 * np.pi * disk(highest) == pytest.approx(expected, rel=1e-14)


def test_disk_against_ritz() -> None:
    highest = 45.0
    families = [ritz_disk.membrane(m, max(14, (80 - m) // 2)) for m in range(47)]
    expected = by_order(families, highest)
    assert 2 * np.pi * disk(highest) == pytest.approx(expected, rel=1e-12)


@pytest.mark.prove
@pytest.mark.parametrize(
    ("hole", "highest", "count"),
    [
        (0.05, 42.0, 80),
        (0.3, 45.0, 50),
        (0.6, 60.0, 30),
        (0.9, 130.0, 25),
    ],
)
def test_rings_against_ritz(hole: float, highest: float, count: int) -> None:
    families = [ritz_disk.ring(m, hole, count) for m in range(int(highest) + 2)]
    expected = by_order(families, highest)
    assert len(expected) > 400
    assert 2 * np.pi * ring(hole, highest) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("hole", [0.0, 1e-6, 0.01, 0.2, 0.5, 0.8])
def test_round_membranes_have_as_many_modes_as_weyl_says(hole: float) -> None:
    highest = 60 / np.sqrt(1 - hole**2)
    found = 2 * np.pi * (ring(hole, highest) if hole else disk(highest))
    x = np.linspace(highest / 2, highest, 500)
    expected = (1 - hole**2) * x**2 / 4 - (1 + hole) * x / 2 + (1 / 3 if hole == 0 else 0)
    excess = np.searchsorted(found, x) - expected
    assert np.abs(excess.mean()) < 1.5  # one order lost would make 20
    assert np.abs(excess).max() < 25


def test_hole_of_nothing_leaves_a_drum_that_is_held_in_its_middle() -> None:
    highest = 30.0
    pricked, whole = 2 * np.pi * ring(1e-9, highest), 2 * np.pi * disk(highest)
    turned = whole[np.abs(whole[:, None] - jn_zeros(0, 12)).min(axis=1) > 1e-6]
    for root in turned:
        assert np.abs(pricked - root).min() < 1e-12 * root
    # Without nodal diameters, tension in the middle tells as 1 / ln(1 / hole).
    assert jn_zeros(0, 1)[0] + 0.03 < pricked[0] < jn_zeros(0, 1)[0] + 0.12


def test_narrow_ring_is_a_strip() -> None:
    """Watson, section 15.2: x(m, k) tends to [(k pi / (1 - b))^2 + (m / mean radius)^2]^(1/2)."""
    hole = 0.999
    found = 2 * np.pi * ring(hole, 3200.0)
    half_wave = np.pi / (1 - hole)
    mean = np.sqrt(hole)
    strip = [np.hypot(half_wave, m / mean) for m in range(700)]
    expected = by_order([np.array([x]) for x in strip], 3200.0)
    assert found == pytest.approx(expected, rel=1e-6)
