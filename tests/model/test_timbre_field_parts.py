from __future__ import annotations

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.typing import NDArray
from scipy.special import spherical_jn, spherical_yn

from struck.errors import OptionError
from struck.model.survey import Survey, shares
from struck.model.timbre_field import ContactPart, ListenerPart, Separation
from struck.model.waves import ORDER, SphericalWaves, degrees, near_field, real_harmonics
from tests.model.vases import error

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def sphere(polar: int = 16, around: int = 32) -> tuple[Array, Array]:
    """Return unit vectors (n, 3) and weights (n,) of a quadrature exact for high degrees."""
    z, weights = np.polynomial.legendre.leggauss(polar)
    angles = 2 * np.pi * np.arange(around) / around
    flat = np.sqrt(1 - z**2)[:, None]
    x, y = flat * np.cos(angles), flat * np.sin(angles)
    places = np.stack([x, y, np.repeat(z[:, None], around, axis=1)], axis=2).reshape(-1, 3)
    return places, np.repeat(weights / (2 * around), around)


def scattered(count: int, seed: int) -> Array:
    directions = default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def test_harmonics_are_orthonormal() -> None:
    places, weights = sphere()
    harmonics = real_harmonics(places, ORDER)
    np.testing.assert_allclose(
        harmonics.T @ (weights[:, None] * harmonics), np.eye((ORDER + 1) ** 2), atol=1e-12
    )


def test_harmonics_are_the_polynomials_that_they_should_be() -> None:
    x, y, z = places = default_rng(1).normal(size=(3, 7))
    degree, angular = degrees(2)
    assert list(zip(degree.tolist(), angular.tolist(), strict=True))[4:6] == [(2, -2), (2, -1)]
    expected = [
        np.ones(7),
        -np.sqrt(3) * y,
        np.sqrt(3) * z,
        -np.sqrt(3) * x,
        np.sqrt(15) * x * y,
        -np.sqrt(15) * y * z,
        np.sqrt(5) / 2 * (2 * z**2 - x**2 - y**2),
        -np.sqrt(15) * x * z,
        np.sqrt(15) / 2 * (x**2 - y**2),
    ]
    np.testing.assert_allclose(real_harmonics(places.T, 2).T, expected, atol=1e-12)


def test_near_fields_are_hankel_functions() -> None:
    x = np.array([0.2, 1.0, 7.0])
    orders = np.arange(ORDER + 1)
    hankel = spherical_jn(orders[:, None], x) - 1j * spherical_yn(orders[:, None], x)
    powers = x ** -np.arange(ORDER + 1.0)[:, None]
    expected = hankel / hankel[0] / 1j ** orders[:, None]
    np.testing.assert_allclose(near_field(ORDER).T @ powers, expected, rtol=1e-12)


def sources(places: Array, wave_number: float, modes: int) -> Complex:
    """Return the sound of six points, up to 6 cm from the centre, since the arrival (L, M)."""
    chance = default_rng(2)
    points = 0.06 * scattered(6, 3) * chance.uniform(0, 1, (6, 1))
    strengths = chance.normal(size=(6, modes)) + 1j * chance.normal(size=(6, modes))
    ways = np.linalg.norm(places[:, None] - points, axis=2)
    late = ways - np.linalg.norm(places, axis=1)[:, None]
    return (np.exp(-1j * wave_number * late) / ways) @ strengths


@pytest.mark.parametrize(("wave_number", "bound"), [(2.0, -35.0), (10.0, -30.0), (25.0, -24.0)])
def test_sound_of_points_is_known_where_nobody_listened(wave_number: float, bound: float) -> None:
    modes = 8
    near = np.concatenate([0.4 * scattered(30, 4), 0.9 * scattered(30, 5)])
    heard = sources(near, wave_number, modes)
    waves = SphericalWaves.of(near, heard, np.ones(heard.shape), np.full(modes, wave_number))
    assert not waves.levelled.any()
    places = scattered(200, 6) * default_rng(7).uniform(0.3, 2.0, (200, 1))
    assert error(waves.at(places), sources(places, wave_number, modes)) < bound


def test_what_is_fitted_solves_the_wave_equation() -> None:
    wave_number, step = 10.0, 1e-3
    places = np.concatenate([0.4 * scattered(30, 4), 0.9 * scattered(30, 5)])
    heard = sources(places, wave_number, 3)
    waves = SphericalWaves.of(places, heard, np.ones(heard.shape), np.full(3, wave_number))

    def pressure(at: Array) -> Complex:
        return waves.at(at) * np.exp(-1j * wave_number * np.linalg.norm(at, axis=1))[:, None]

    at = 0.6 * scattered(20, 8)
    middle = pressure(at)
    steps = step * np.eye(3)
    laplacian = sum(pressure(at + each) + pressure(at - each) - 2 * middle for each in steps)
    np.testing.assert_allclose(
        laplacian / step**2, -(wave_number**2) * middle, atol=0.02 * 100 * np.abs(middle).max()
    )


def test_more_lobes_than_listeners_keep_their_level() -> None:
    """A ball far larger than the wave: 60 points on it, each as loud as any other."""
    chance, wave_number, modes = default_rng(9), 120.0, 30
    points = 0.15 * scattered(60, 10)
    strengths = chance.normal(size=(60, modes)) + 1j * chance.normal(size=(60, modes))

    def heard(places: Array) -> Complex:
        ways = np.linalg.norm(places[:, None] - points, axis=2)
        late = ways - np.linalg.norm(places, axis=1)[:, None]
        return (np.exp(-1j * wave_number * late) / ways) @ strengths

    places = scattered(25, 11) * 0.7
    waves = SphericalWaves.of(
        places, heard(places), np.ones((25, modes)), np.full(modes, wave_number)
    )
    assert waves.levelled.mean() > 0.5
    others = scattered(300, 12) * 0.7
    powers = [np.square(np.abs(each)).mean(axis=0) for each in (waves.at(others), heard(others))]
    assert np.median(np.abs(10 * np.log10(powers[0] / powers[1]))) < 2


def test_waves_by_angular_order_add_up() -> None:
    chance = default_rng(13)
    places = 0.5 * scattered(40, 14)
    heard = chance.normal(size=(40, 2)) + 0j
    waves = SphericalWaves.of(places, heard, np.ones((40, 2)), np.full(2, 5.0), mirrored=True)
    ahead = waves.turned(places)
    order = len(waves.parts) - 1
    assert ahead.shape == (40, 2 * order + 1, 2)
    factors = np.array([1.0, *([1.0, 0.0] * order)])
    np.testing.assert_allclose(np.einsum("r,lrm->lm", factors, ahead), waves.at(places))


def test_inside_and_outside_meet_without_a_step() -> None:
    outside = 0.5 * scattered(20, 15)
    inside = np.array([[0.0, 0.0, 0.1], [0.0, 0.05, 0.0]])
    outputs = np.concatenate([np.full((20, 1), 2.0), [[7.0], [-3j]]]).astype(complex)
    part = ListenerPart.of(
        np.concatenate([outside, inside]), outputs, np.ones((22, 1)), np.ones(1), radius=0.2
    )
    np.testing.assert_allclose(part.at(inside)[:, 0, 0], [7.0, -3j], rtol=1e-9)
    np.testing.assert_allclose(part.at(outside)[:, 0, 0], 2.0, rtol=1e-3)
    way = np.linspace(0, 0.6, 6001)[:, None] * [0.02, 0.03, 1.0]
    assert np.abs(np.diff(part.at(way)[:, 0, 0])).max() < 0.02  # in steps of 0.1 mm
    with pytest.raises(OptionError, match="needs a radius= above 0"):
        ListenerPart.of(np.zeros((1, 3)), outputs[:1], np.ones((1, 1)), np.ones(1))


def test_shapes_between_contacts_beat_straight_lines() -> None:
    chance = default_rng(16)
    at, between = np.linspace(0.2, 1.7, 7), np.linspace(0.2, 1.7, 200)
    waves, phases = chance.integers(0, 3, 40), chance.uniform(0, 2 * np.pi, 40)

    def shapes(places: Array) -> Array:
        return np.cos(np.pi * waves * (places[:, None] - 0.2) / 1.5 + phases)

    drives = shapes(at) + 0.01 * chance.normal(size=(7, 40))
    part = ContactPart.of(at[:, None], drives, np.full(40, 0.014))
    straight = np.stack([np.interp(between, at, each) for each in drives.T], axis=1)
    gained = error(straight, shapes(between)) - error(part.at(between[:, None]), shapes(between))
    assert gained > 6
    np.testing.assert_allclose(part.at(at[:, None]), drives, atol=0.05)


def test_shapes_over_two_coordinates() -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(-1, 1, 6))
    contacts = np.stack([u.ravel(), v.ravel()], axis=1)

    def shapes(places: Array) -> Array:
        x, y = places.T
        return np.stack([np.cos(np.pi * x) * np.cos(np.pi * y / 2), np.sin(np.pi * x * y)], axis=1)

    part = ContactPart.of(contacts, shapes(contacts), np.full(2, 1e-4))
    places = default_rng(17).uniform([0, -1], [1, 1], (100, 2))
    assert error(part.at(places), shapes(places)) < -25


def test_one_contact_is_the_same_everywhere() -> None:
    part = ContactPart.of(np.array([[0.3]]), np.array([[1.0, 1.0]]), np.zeros(2))
    np.testing.assert_allclose(part.at(np.array([[0.3]])), 1.0, rtol=1e-6)


def test_modes_that_tell_little_go_with_the_others() -> None:
    told = np.zeros((3, 50))
    told[1, :49] = 6.0
    believed = shares(told)
    np.testing.assert_allclose(believed.sum(axis=0), 1)
    assert believed[1, 49] > 0.9
    assert shares(told[:, 49:])[1, 0] == pytest.approx(1 / 3)


def table(seed: int) -> tuple[Array, Complex]:
    chance = default_rng(seed)
    return chance.normal(size=(6, 4)), chance.normal(size=(8, 4)) + 1j * chance.normal(size=(8, 4))


def survey(gains: Complex, pairs: NDArray[np.int64], errors: Array | None = None) -> Survey:
    return Survey(
        contacts=np.arange(6.0)[:, None],
        listeners=scattered(8, 18),
        pairs=pairs,
        gains=gains[tuple(pairs.T)],
        frequencies=np.arange(1.0, 5),
        errors=errors,
        centre=np.zeros(3),
    )


ALL = np.argwhere(np.ones((6, 8)))
CROSS = ALL[(ALL[:, 0] == 2) | (ALL[:, 1] == 5)]


@pytest.mark.parametrize("pairs", [ALL, CROSS, np.append(CROSS, [[4, 1], [0, 7]], axis=0)])
def test_products_come_apart_exactly(pairs: NDArray[np.int64]) -> None:
    drives, outputs = table(19)
    gains = drives[:, None] * outputs[None]
    parts = Separation.of(survey(gains, pairs))
    np.testing.assert_allclose(parts.drives[:, None] * parts.outputs[None], gains, atol=1e-9)
    np.testing.assert_allclose(np.abs(parts.drives).max(axis=0), 1)
    assert parts.drives.max(axis=0).tolist() == [1.0] * 4
    assert parts.rank_errors.max() < 1e-9


def test_the_nearest_product_is_that_of_the_singular_value_decomposition() -> None:
    """Real drives: the decomposition is that of real and imaginary parts side by side."""
    drives, outputs = table(20)
    gains = drives[:, None] * outputs[None]
    gains = gains + 0.3 * np.abs(gains).std() * default_rng(21).normal(size=gains.shape)
    parts = Separation.of(survey(gains, ALL))
    for mode in range(4):
        beside = np.concatenate([gains[:, :, mode].real, gains[:, :, mode].imag], axis=1)
        left, values, right = np.linalg.svd(beside)
        best = values[0] * np.outer(left[:, 0], right[0])
        found = np.outer(parts.drives[:, mode], parts.outputs[:, mode])
        np.testing.assert_allclose(found, best[:, :8] + 1j * best[:, 8:], atol=1e-6)
        rest = np.square(values[1:]).sum() / np.square(values).sum() * 96 / (96 - 21)
        assert parts.rank_errors[mode] == pytest.approx(np.sqrt(rest), rel=1e-6)


@pytest.mark.prove
def test_expected_errors_are_those_that_come() -> None:
    drives, outputs = table(22)
    gains, chance = drives[:, None] * outputs[None], default_rng(23)
    found, expected = [], []
    for _ in range(60):
        noise = chance.normal(size=(2, *gains.shape)) * 0.03 / np.sqrt(2)
        errors = np.full((len(CROSS), 4), 0.03)
        parts = Separation.of(survey(gains + noise[0] + 1j * noise[1], CROSS, errors))
        leading = np.abs(drives).argmax(axis=0)
        exact = outputs * drives[leading, range(4)]
        # The common factor, from which the largest drive is 1, is not the listener part's own.
        factor = (parts.outputs.conj() * exact).sum(axis=0) / np.square(np.abs(parts.outputs)).sum(
            0
        )
        off = np.square(np.abs(parts.outputs * factor - exact)).mean(axis=0)
        found.append(off / np.square(np.abs(exact)).mean(axis=0))
        expected.append(np.square(parts.output_errors))
    ratio = np.mean(found, axis=0) / np.mean(expected, axis=0)
    assert np.all((ratio > 0.6) & (ratio < 1.3))


def test_better_recordings_count_more() -> None:
    drives, outputs = table(24)
    gains = drives[:, None] * outputs[None]
    bad = np.zeros(len(ALL), np.bool_)
    bad[::5] = True
    spoilt = gains.copy()
    spoilt[tuple(ALL[bad].T)] += 3.0
    errors = np.where(bad, 100.0, 0.01)[:, None] * np.ones(4)
    parts = Separation.of(survey(spoilt, ALL, errors))
    np.testing.assert_allclose(parts.drives[:, None] * parts.outputs[None], gains, atol=1e-5)
