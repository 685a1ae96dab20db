"""The rigid sphere against tables, closed forms and Hankel functions computed apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from struck.ears.sphere import arrival_delay, distance_gain, pressure
from struck.errors import OptionError

RADIUS, SPEED = 0.0875, 343.0
AZIMUTHS = np.radians([15, 30, 45, 60, 75, 90])


def decibels(values: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.abs(values))


def frequency(ka: float) -> float:
    return ka * SPEED / (2 * np.pi * RADIUS)


# Duda & Martens' series, computed apart from this library; angles 0 to 180 by 30 degrees.
@pytest.mark.parametrize(
    ("ka", "expected"),
    [
        (0.1, [0.0074, 0.0009, -0.0122, -0.019, -0.0129, -0.0003, 0.0061]),
        (1, [3.0359, 2.6858, 1.5482, -0.2351, -1.0595, -0.0652, 0.5724]),
        (5, [5.4557, 5.2645, 4.2362, 1.9243, -1.8119, -5.6365, 1.1776]),
        (10, [5.8321, 5.6994, 4.9274, 2.4329, -2.4553, -8.7487, 0.3847]),
    ],
)
def test_plane_wave_has_the_tabulated_levels(ka: float, expected: list[float]) -> None:
    angles = np.radians(np.arange(0, 181, 30))
    levels = decibels(pressure(frequency(ka), angles, None, RADIUS, SPEED)[0])
    np.testing.assert_allclose(levels, expected, rtol=0, atol=1e-3)


@pytest.mark.parametrize(("rho", "front", "back"), [(2, 8.35, -5.64), (10, 1.35, -1.26)])
def test_static_near_field_has_the_tabulated_levels(rho: float, front: float, back: float) -> None:
    levels = decibels(pressure(0, [0, np.pi], rho * RADIUS, RADIUS)[0])
    np.testing.assert_allclose(levels, [front, back], rtol=0, atol=6e-3)


def test_static_near_field_has_its_closed_form() -> None:
    # sum (2 - 1 / (n + 1)) t^n with t = 1 / rho, at the front, and with -t at the back.
    for rho in (1.05, 1.5, 4, 1e4):
        t = np.array([1, -1]) / rho
        exact = 2 / (1 - t) + np.log1p(-t) / t
        np.testing.assert_allclose(pressure(0, [0, np.pi], rho * RADIUS)[0], exact, rtol=1e-9)


def by_hankel_functions(ka: float, rho: float, angles: np.ndarray, terms: int) -> np.ndarray:
    """Return the series as it is printed, which overflows beyond moderate orders."""
    order = np.arange(terms)[:, None]
    above = spherical_jn(order, ka * rho) - 1j * spherical_yn(order, ka * rho)
    slope = spherical_jn(order, ka, True) - 1j * spherical_yn(order, ka, True)  # noqa: FBT003
    series = (2 * order + 1) * eval_legendre(order, np.cos(angles)) * above / slope
    return -rho / ka * np.exp(1j * ka * rho) * series.sum(axis=0)


@pytest.mark.parametrize(
    ("ka", "rho", "terms"),
    [(0.5, 1.5, 75), (3, 1.3, 110), (10, 1.3, 120), (40, 1.3, 160), (40, 10, 100), (25, 1e4, 80)],
)
def test_near_field_is_the_printed_series(ka: float, rho: float, terms: int) -> None:
    angles = np.linspace(0, np.pi, 37)
    expected = by_hankel_functions(ka, rho, angles, terms)
    found = pressure(frequency(ka), angles, rho * RADIUS, RADIUS, SPEED)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


def test_far_source_is_a_plane_wave() -> None:
    angles, high = np.linspace(0, np.pi, 37), frequency(20)
    plane = pressure([0, high], angles, None, RADIUS, SPEED)
    np.testing.assert_array_equal(plane[0], 1)
    np.testing.assert_allclose(
        pressure([0, high], angles, 1e6 * RADIUS, RADIUS, SPEED), plane, 1e-4
    )


def test_sphere_of_no_size_changes_nothing_but_the_arrival() -> None:
    angles = np.radians([0, 60, 180])
    found = pressure(100, angles, None, 1e-4)[0]
    np.testing.assert_allclose(found, 1, atol=1e-3)
    # Phase: 3/2 of the way at low frequencies (Kuhn 1977), positive where it is earlier.
    way = 2 * np.pi * 100 * 1e-4 / 343.21
    np.testing.assert_allclose(np.angle(found), 1.5 * way * np.cos(angles), rtol=1e-3)


@pytest.mark.parametrize(
    ("hertz", "expected"),
    [
        (500, [209.05, 398.98, 554.72, 668.05, 736.27, 758.99]),
        (1000, [154.37, 320.2, 485.33, 609.43, 679.68, 702.13]),
        (3000, [143.76, 280.42, 414.9, 517.9, 649.24, 676.5]),
    ],
)
def test_interaural_phase_delay_is_the_tabulated_one(hertz: float, expected: list[float]) -> None:
    left = pressure(hertz, np.pi / 2 - AZIMUTHS, None, RADIUS, SPEED)[0]
    right = pressure(hertz, np.pi / 2 + AZIMUTHS, None, RADIUS, SPEED)[0]
    phases = np.unwrap(np.append(0, np.angle(left / right)))[1:]
    np.testing.assert_allclose(phases / (2 * np.pi * hertz) * 1e6, expected, rtol=2e-3)


def test_interaural_phase_delay_of_low_frequencies_is_kuhn_s() -> None:
    """3 a sin(azimuth) / c (Kuhn 1977, JASA 62(1), 157)."""
    tabulated = [198.08, 382.65, 541.15, 662.77, 739.23, 765.31]
    left = pressure(1.0, np.pi / 2 - AZIMUTHS, None, RADIUS, SPEED)[0]
    right = pressure(1.0, np.pi / 2 + AZIMUTHS, None, RADIUS, SPEED)[0]
    found = np.angle(left / right) / (2 * np.pi) * 1e6
    np.testing.assert_allclose(found, tabulated, rtol=1e-4)
    np.testing.assert_allclose(found, 3e6 * RADIUS * np.sin(AZIMUTHS) / SPEED, rtol=1e-4)


def test_arrivals_from_afar_at_both_ears_differ_by_woodworth_s_delay() -> None:
    """a (sin(azimuth) + azimuth) / c (Woodworth 1938, Experimental Psychology, 520-523)."""
    tabulated = [132.81, 261.12, 380.74, 488.07, 580.34, 655.82]
    left = arrival_delay(np.pi / 2 - AZIMUTHS, None, RADIUS, SPEED)
    right = arrival_delay(np.pi / 2 + AZIMUTHS, None, RADIUS, SPEED)
    np.testing.assert_allclose((right - left) * 1e6, tabulated, rtol=1e-4)
    woodworth = RADIUS / SPEED * (np.sin(AZIMUTHS) + AZIMUTHS)
    np.testing.assert_allclose(right - left, woodworth, rtol=1e-12)


def shortest_way(angle: float, distance: float) -> float:
    """Return the length of the shortest way outside the sphere, by trying all points to leave."""
    points = np.linspace(0, angle, 200_001)
    legs = np.sqrt(distance**2 + RADIUS**2 - 2 * distance * RADIUS * np.cos(points))
    outside = distance * np.cos(points) >= RADIUS * (1 - 1e-12)
    return float(np.min((legs + RADIUS * (angle - points))[outside]))


@pytest.mark.parametrize("distance", [0.1, 0.2, 1.0])
def test_arrival_is_by_the_shortest_way(distance: float) -> None:
    for angle in np.radians([0.0, 20, 60, 85, 110, 180]):
        expected = (shortest_way(float(angle), distance) - distance) / SPEED
        found = arrival_delay(angle, distance, RADIUS, SPEED)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_arrival_is_smooth_at_the_edge_of_the_shadow() -> None:
    angles = np.linspace(0, np.pi, 20_001)
    for distance in (None, 0.1, 0.3, 1e4):
        slopes = np.diff(arrival_delay(angles, distance, RADIUS, SPEED)) / np.diff(angles)
        # Without a corner, slopes change by no more than curvature times step.
        assert np.max(np.abs(np.diff(slopes))) < 8 * RADIUS / SPEED * angles[1]
    np.testing.assert_allclose(
        arrival_delay(angles, 1e6), arrival_delay(angles, None), rtol=0, atol=1e-9
    )


# Computed apart from this library: source at 90 degrees to the side, ears 100 degrees from the
# front; at 3, 1, 0.25 and 0.125 m.
@pytest.mark.parametrize(
    ("hertz", "expected"), [(500, [2.5, 3.8, 10.1, 20.5]), (4000, [8.7, None, None, 27.0])]
)
def test_near_sources_have_the_tabulated_interaural_levels(
    hertz: float, expected: list[float | None]
) -> None:
    for distance, level in zip((3, 1, 0.25, 0.125), expected, strict=True):
        ears = decibels(pressure(hertz, np.radians([10, 170]), distance)[0])
        if level is not None:
            assert ears[0] - ears[1] == pytest.approx(level, abs=0.06)


def test_distance_gain_leads_from_one_distance_to_another() -> None:
    frequencies, angles = [0, 500, 4000], np.radians([0, 100, 180])
    near, far = (np.abs(pressure(frequencies, angles, distance)) for distance in (0.2, 1.4))
    np.testing.assert_allclose(far * distance_gain(frequencies, angles, 0.2, 1.4), near)
    # The static gains of two tabulated distances: rho = 2 against 10.
    gains = decibels(distance_gain(0, [0, np.pi], 2 * RADIUS, 10 * RADIUS, RADIUS)[0])
    np.testing.assert_allclose(gains, [8.35 - 1.35, -5.64 + 1.26], rtol=0, atol=0.012)


def test_series_holds_over_all_its_range() -> None:
    angles = np.linspace(0, np.pi, 19)
    frequencies = np.array([0, 1e-3, *(frequency(ka) for ka in (1, 10, 40))])
    for rho in (1.05, 1.2, 3, 100, 1e4):
        found = pressure(frequencies, angles, rho * RADIUS, RADIUS, SPEED)
        # The free field at the nearest point, doubled by a hard wall, is more than a sphere's.
        assert np.all(np.isfinite(found))
        assert np.max(np.abs(found)) <= 2.0 / (1 - 1 / rho)
        # ka = 1.6e-6 turns the phase by about as much.
        np.testing.assert_allclose(found[1], found[0], rtol=1e-5)


@pytest.mark.parametrize("distance", [-1.0, 0.0, RADIUS, 1.005 * RADIUS, np.nan])
def test_source_in_the_sphere_is_refused(distance: float) -> None:
    with pytest.raises(OptionError, match="too near"):
        pressure(500, 0, distance, RADIUS)
    with pytest.raises(OptionError, match="too near"):
        arrival_delay(0, distance, RADIUS)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_impossible_arguments_are_refused(bad: float) -> None:
    with pytest.raises(OptionError, match="frequencies"):
        pressure([100, bad], 0)
    with pytest.raises(OptionError, match="radius"):
        pressure(100, 0, None, bad)
    with pytest.raises(OptionError, match="sound_speed"):
        arrival_delay(1, None, RADIUS, bad)
    with pytest.raises(OptionError, match="radius"):
        arrival_delay(1, None, bad)
