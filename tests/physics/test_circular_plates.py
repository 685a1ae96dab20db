"""Circular plates against Leissa's tables and Ritz's method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import jn_zeros

from struck import Material
from struck.shapes.circular_plate import CircularPlate, plate_roots
from struck.shapes.shape import Vibration
from tests.physics import ritz_disk

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.3)

# lambda^2 by nodal diameters. Leissa, NASA SP-160, 1969, prints 10.216, 21.26, 34.88, 39.771,
# 51.04, 60.82; the digits are from the characteristic equation in 30-digit arithmetic.
CLAMPED = {
    0: (10.21582623, 39.77114824, 89.10414397),
    1: (21.26039769, 60.82867182, 120.07923658),
    2: (34.87703542, 84.58264955),
    3: (51.03003548, 111.02141188),
    4: (69.6658307,),
    5: (90.73898632,),
}
# The same by Poisson's ratio, from Leissa's equation; motions as a rigid body are left out.
FREE = {
    0.33: {
        0: (9.068899, 38.506969),
        1: (20.513087,),
        2: (5.262037, 35.242521),
        3: (12.243894,),
        4: (21.527217,),
        5: (33.061843,),
    },
    0.3: {
        0: (9.003137, 38.443198),
        1: (20.47455,),
        2: (5.35833, 35.260108),
        3: (12.438988,),
        4: (21.835163,),
        5: (33.494932,),
    },
    0.25: {
        0: (8.889893,),
        1: (20.409197,),
        2: (5.511182,),
        3: (12.744332,),
        4: (22.311959,),
        5: (34.159658,),
    },
}
# Leissa and Narita, Journal of Sound and Vibration 70, 221 (1980), for 0.3 (four digits of six).
SUPPORTED = {0: (4.935, 29.720, 74.156), 1: (13.898, 48.479), 2: (25.613, 70.117), 3: (39.957,)}
# Leissa 1969 prints these for 0.3; they are those of 0.33 within 0.05 %.
SUPPORTED_IN_1969 = {0: (4.977, 29.76, 74.20), 1: (13.94, 48.51), 2: (25.65, 70.14)}


def squares(edge: str, poisson_ratio: float, order: int) -> Array:
    """Return lambda^2 of `order` nodal diameters, ascending."""
    roots = plate_roots(edge, 12.0, poisson_ratio)[order]
    return roots[np.isfinite(roots)] ** 2


def vibration(edge: str, limit: float, material: Material = STEEL) -> tuple[Vibration, float]:
    """Return the modes with lambda up to `limit`, and the frequency at which it is 1, Hz."""
    body = CircularPlate(radius=0.2, thickness=0.001, edge=edge)
    stiffness = material.youngs_modulus * 0.001**3 / 12 / (1 - material.poisson_ratio**2)
    unit = np.sqrt(stiffness / (material.density * 0.001)) / (2 * np.pi * 0.2**2)
    return body.vibration(material, unit * limit**2), unit


@pytest.mark.parametrize("order", CLAMPED)
def test_clamped_plate_as_published(order: int) -> None:
    expected = CLAMPED[order]
    found = squares("clamped", 0.3, order)[: len(expected)]
    assert found == pytest.approx(expected, rel=1e-9, abs=6e-9)


@pytest.mark.parametrize("poisson_ratio", FREE)
def test_free_plate_as_published(poisson_ratio: float) -> None:
    expected = FREE[poisson_ratio]
    material = replace(STEEL, poisson_ratio=poisson_ratio)
    modes, unit = vibration("free", 6.3, material)
    values = sorted(v for m, few in expected.items() for v in few for _ in range(1 + (m > 0)))
    assert modes.frequencies[: len(values)] / unit == pytest.approx(values, abs=6e-7)


@pytest.mark.parametrize("order", SUPPORTED)
def test_supported_plate_as_published(order: int) -> None:
    expected = SUPPORTED[order]
    found = squares("supported", 0.3, order)[: len(expected)]
    assert found == pytest.approx(expected, abs=5.1e-4)


@pytest.mark.parametrize("order", SUPPORTED_IN_1969)
def test_supported_plate_as_first_published(order: int) -> None:
    expected = SUPPORTED_IN_1969[order]
    near = squares("supported", 0.33, order)[: len(expected)]
    assert near == pytest.approx(expected, rel=5e-4)
    assert squares("supported", 0.3, order)[0] < expected[0] * 0.999


@pytest.mark.parametrize(
    "poisson_ratio",
    [-0.9, 0.3, *(pytest.param(nu, marks=pytest.mark.prove) for nu in (-0.3, 0.0, 0.495))],
)
@pytest.mark.parametrize("edge", ritz_disk.HOLDS)
def test_every_mode_against_ritz(edge: str, poisson_ratio: float) -> None:
    limit = 42.0
    modes, unit = vibration(edge, limit, replace(STEEL, poisson_ratio=poisson_ratio))
    families = [ritz_disk.plate(edge, m, poisson_ratio, max(14, (76 - m) // 2)) for m in range(50)]
    found = [family[family <= limit] for family in families]
    expected = np.sort(np.concatenate([found[0], *(2 * found[1:])]))
    assert len(expected) >= 400
    assert np.sqrt(modes.frequencies / unit) == pytest.approx(expected, rel=1e-10)


def test_roots_alternate_with_zeros_of_bessel_functions() -> None:
    """What each constraint adds stiffens: free < supported < j(m, k) < clamped < j(m + 1, k)."""
    limit = 150.0
    clamped, supported, free = (
        plate_roots(edge, limit, 0.3) for edge in ("clamped", "supported", "free")
    )
    for m in (0, 1, 2, 17, 60, 120):
        zeros, following = jn_zeros(m, 50), jn_zeros(m + 1, 50)
        c, s, f = (table[m][np.isfinite(table[m])] for table in (clamped, supported, free))
        assert len(c) in {np.count_nonzero(following < limit), np.count_nonzero(zeros < limit)}
        assert ((zeros[: len(c)] < c) & (c < following[: len(c)])).all()
        assert (s < zeros[: len(s)]).all()
        assert (s[1:] > zeros[: len(s) - 1]).all()
        elastic = f if m > 1 else np.append(0.0, f)
        assert (elastic[: len(s)] < s).all()
        assert (elastic[1:] > s[: len(elastic) - 1]).all()


def test_waves_along_a_free_rim() -> None:
    """Konenkov 1960: a straight free edge guides waves slower than those within the plate."""
    nu = 0.3
    slow = ((1 - nu) * (3 * nu - 1 + 2 * np.sqrt(1 - 2 * nu + 2 * nu**2))) ** 0.25
    first = [plate_roots("free", 1.05 * m, nu)[m].min() / m for m in (50, 100, 200)]
    assert first[0] > first[1] > first[2] > slow
    # The rest is curvature.
    assert first[2] == pytest.approx(slow, abs=0.025)


@pytest.mark.parametrize("poisson_ratio", [-0.5, 0.0, 0.3])
@pytest.mark.parametrize("edge", ritz_disk.HOLDS)
def test_slopes_over_poissons_ratio_are_those_of_the_frequencies(
    edge: str, poisson_ratio: float
) -> None:
    def frequencies(nu: float) -> Array:
        material = replace(STEEL, poisson_ratio=nu)
        return (
            CircularPlate(radius=0.2, thickness=0.001, edge=edge)
            .vibration(material, 6000.0)
            .frequencies[:40]
        )

    material = replace(STEEL, poisson_ratio=poisson_ratio)
    body = CircularPlate(radius=0.2, thickness=0.001, edge=edge)
    slopes = body.vibration(material, 6000.0).poisson_slopes[:40]
    step = 1e-4
    change = np.log(frequencies(poisson_ratio + step) / frequencies(poisson_ratio - step))
    assert slopes == pytest.approx(change / (2 * step), rel=1e-6, abs=1e-6)
