"""Multipoles against the sound of point sources, and against what waves must do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import spherical_jn, spherical_yn

from struck.errors import OptionError
from struck.radiation.multipoles import CLOSE, FAR, Multipoles, outgoing_waves, sphere_rule
from tests.radiation.sources import RADIUS, some_sources

KA = np.array([0.2, 0.5, 1.0, 2.5, 5.0, 12.0])
SOURCES = some_sources(KA / RADIUS * 343.21 / (2 * np.pi))
CENTRE = np.array([0.004, -0.002, 0.003])


@pytest.fixture(scope="module")
def waves() -> Multipoles:
    return Multipoles.fit(
        SOURCES.pressure, centre=CENTRE, radius=RADIUS, wave_numbers=SOURCES.wave_numbers
    )


def test_recurrence_against_tabulated_functions() -> None:
    x = np.array([0.01, 0.3, 2.0, 30.0])
    for degree, found in enumerate(outgoing_waves(24, x)):
        hankel = spherical_jn(degree, x) - 1j * spherical_yn(degree, x)
        wanted = x * np.exp(1j * x) * hankel / 1j ** (degree + 1)
        np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize("distance", [FAR * RADIUS, 0.2, 1.0, 10.0])
def test_from_one_and_a_half_radii_on_waves_are_the_sound(
    waves: Multipoles, distance: float
) -> None:
    directions = np.random.default_rng(3).normal(size=(400, 3))
    places = distance * directions / np.linalg.norm(directions, axis=1)[:, None]
    heard = SOURCES.pressure(CENTRE + places, np.arange(len(KA)))
    heard = heard * np.exp(1j * SOURCES.wave_numbers * distance)
    missed = np.sqrt(np.mean(np.abs(waves.at(places) - heard) ** 2, axis=0))
    assert np.all(missed < 0.02 * np.sqrt(np.mean(np.abs(heard) ** 2, axis=0)))


def test_nearer_the_stated_error_holds(waves: Multipoles) -> None:
    directions = np.random.default_rng(4).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for radii, stated in ((FAR, waves.errors[:, 0]), (CLOSE, waves.errors[:, 1])):
        places = radii * RADIUS * directions
        heard = SOURCES.pressure(CENTRE + places, np.arange(len(KA)))
        heard = heard * np.exp(1j * SOURCES.wave_numbers * radii * RADIUS)
        missed = np.sqrt(np.mean(np.abs(waves.at(places) - heard) ** 2, axis=0))
        assert np.all(missed < 1.1 * stated * np.sqrt(np.mean(np.abs(heard) ** 2, axis=0)))
    assert np.all(waves.errors < 0.05)


def test_degrees_grow_with_the_wave_number(waves: Multipoles) -> None:
    assert np.all(waves.degrees <= np.ceil(KA) + 6)
    assert waves.degrees[-1] > waves.degrees[0]


def test_the_same_power_goes_through_every_sphere(waves: Multipoles) -> None:
    directions, weights = sphere_rule(24)
    step, powers = 1e-6, []
    for distance in (1.5 * RADIUS, 3 * RADIUS, 30 * RADIUS):
        ways = distance + step * np.array([-1.0, 0.0, 1.0])
        before, here, after = (
            waves.at(way * directions) * np.exp(-1j * waves.wave_numbers * way) for way in ways
        )
        # Euler: i w rho v = -dp/dr; of the intensity only the factor 1 / (2 w rho) is left out.
        slope = (after - before) / (2 * step)
        intensity = np.imag(here * slope.conj()) / waves.wave_numbers
        powers.append(4 * np.pi * distance**2 * (weights @ intensity))
    np.testing.assert_allclose(powers[1:], powers[:2], rtol=1e-3)
    np.testing.assert_allclose(powers[2], 4 * np.pi * waves.levels**2, rtol=1e-3)


def test_a_mode_of_circumferential_order_4_is_heard_below_its_degree() -> None:
    around = 2 * np.pi * np.arange(8) / 8
    ring = 0.9 * RADIUS * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    octet = some_sources(np.array([0.5 / RADIUS * 343.21 / (2 * np.pi)]), count=8)
    octet = type(octet)(
        positions=ring,
        strengths=np.cos(4 * around)[:, None],
        wave_numbers=octet.wave_numbers,
        modes=octet.modes,
    )
    found = Multipoles.fit(
        octet.pressure, centre=np.zeros(3), radius=RADIUS, wave_numbers=octet.wave_numbers
    )
    assert found.degrees[0] >= 4
    place = np.array([[2.0, 0.0, 0.0]])
    exact = octet.pressure(place, np.array([0])) * np.exp(2j * octet.wave_numbers)
    assert abs(exact[0, 0]) > 0
    np.testing.assert_allclose(found.at(place), exact, rtol=0.02)


def test_a_larger_body_is_heard_alike_from_as_many_radii(waves: Multipoles) -> None:
    larger = waves.chosen(np.array([4, 1]), 2.0, 0.3)
    place = np.array([[0.3, -0.2, 0.4]])
    np.testing.assert_allclose(larger.at(2 * place), 0.3 * waves.at(place)[:, [4, 1]], rtol=1e-12)
    assert larger.radius == 2 * RADIUS
    assert larger.degrees.tolist() == waves.degrees[[4, 1]].tolist()


def test_modes_in_no_part_keep_their_estimate(waves: Multipoles) -> None:
    outputs = np.array([1.0, 2.0, 3.0j])
    every = np.array([5.0, 10.0, 20.0])
    part = waves.chosen(np.array([2]), 1.0, 1.0)
    joined = Multipoles.join([(np.array([1]), part)], outputs, every)
    place = np.array([[1.0, 1.0, 0.5]])
    np.testing.assert_allclose(joined.at(place)[0, [0, 2]], [1 / 1.5, 3.0j / 1.5])
    assert np.isnan(joined.errors[:, 0]).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"degrees": np.array([25])}, "give one of 0 to 24"),
        ({"amplitudes": np.zeros(3, complex)}, "must be"),
        ({"radius": 0.0}, "must exceed 0"),
    ],
)
def test_what_does_not_belong_together_is_refused(given: dict[str, object], told: str) -> None:
    whole = {
        "wave_numbers": np.ones(1),
        "degrees": np.zeros(1, np.int64),
        "amplitudes": np.ones(1, complex),
        "radius": 0.1,
        "errors": np.zeros((1, 2)),
    }
    with pytest.raises(OptionError, match=told):
        Multipoles(**{**whole, **given})
