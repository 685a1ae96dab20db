from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from struck.radiation.on_surface import PointSources, bundles
from tests.radiation.bodies import ball, box, tube

TURN = Rotation.random(rng=np.random.default_rng(1)).as_matrix()


def placed(positions: np.ndarray) -> PointSources:
    """Return sources at some places, whatever the skin they stand for."""
    of_a_ball = PointSources.of(ball(subdivisions=1))
    return PointSources(
        positions=positions,
        flows=of_a_ball.flows,
        moments=of_a_ball.moments,
        forces=of_a_ball.forces,
    )


def mean_square(sources: PointSources, wave_number: float, flows: object, dipoles: object) -> float:
    """Return the mean square of one mode."""
    flow, dipole = np.asarray(flows)[:, None], np.asarray(dipoles)[:, :, None]
    return float(sources.mean_squares(np.array([wave_number]), flow, dipole)[0])


@pytest.mark.parametrize("distance", [0.3, 2.0, 7.0, 20.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_two_sources_interfere(distance: float, sign: int) -> None:
    sources = placed(np.array([[0.0, 0, 0], [0, 0, distance]]) @ TURN)
    computed = mean_square(sources, 1.0, np.array([1.0, sign]), np.zeros((2, 3), complex))
    expected = 2 + 2 * sign * np.sin(distance) / distance  # the mean of a plane wave
    assert computed == pytest.approx(expected, rel=0.025)  # 0.1 dB


@pytest.mark.parametrize("strength", [1, 1j, (1 + 2j) / 5**0.5])
def test_dipole_sends_a_third_of_its_axis(strength: complex) -> None:
    dipole = (strength * TURN[:1]).astype(complex)
    source = placed(np.zeros((1, 3)))
    alone = mean_square(source, 3.0, np.zeros(1), dipole)
    assert alone == pytest.approx(1 / 3, rel=0.01)
    both = mean_square(source, 3.0, np.ones(1), dipole)
    assert both == pytest.approx(4 / 3, rel=0.01)  # nothing in common over all directions


def test_source_aside_is_a_source_and_a_dipole() -> None:
    aside = np.array([[0.01, -0.02, 0.005]])
    there = mean_square(placed(aside), 1.0, np.array([1.0]), np.zeros((1, 3), complex))
    here = mean_square(placed(0 * aside), 1.0, np.array([1.0]), -1j * aside)
    assert here == pytest.approx(there, rel=1e-3)


def test_bundles_gather_every_face() -> None:
    mesh = tube(0.04, 0.004, 0.3, 48, 40)
    sources = PointSources.of(mesh)
    velocities = np.random.default_rng(0).normal(size=(len(mesh.faces), 2))
    flows, moments = sources.flows @ velocities, (sources.moments @ velocities).reshape(-1, 3, 2)
    weighed = mesh.areas[:, None] * velocities
    np.testing.assert_allclose(flows.sum(axis=0), weighed.sum(axis=0))
    first = np.einsum("kd,km->dm", sources.positions, flows) + moments.sum(axis=0)
    np.testing.assert_allclose(first, mesh.centroids.T @ weighed)
    steady = (sources.forces @ np.ones(len(mesh.points))).reshape(-1, 3)
    np.testing.assert_allclose(steady.sum(axis=0), 0, atol=1e-12)  # a closed surface
    ramp = (sources.forces @ mesh.points).reshape(-1, 3, 3).sum(axis=0)
    np.testing.assert_allclose(ramp, mesh.volume * np.eye(3), atol=1e-12)  # Archimedes


def test_bundles_are_alike_and_compact() -> None:
    mesh = box((0.2, 0.2, 0.2), (24, 24, 24))
    labels = bundles(mesh.centroids, mesh.areas, 128)
    shares = np.bincount(labels, weights=mesh.areas) / mesh.areas.sum()
    assert len(shares) == 128
    assert np.all(np.abs(shares * 128 - 1) < 0.35)
    spread = [np.linalg.norm(np.ptp(mesh.centroids[labels == k], axis=0)) for k in range(128)]
    assert max(spread) < 2.5 * np.sqrt(mesh.areas.sum() / 128)


def test_no_more_bundles_than_faces() -> None:
    mesh = ball(subdivisions=1)
    labels = bundles(mesh.centroids, mesh.areas, 512)
    np.testing.assert_array_equal(np.sort(labels), np.arange(len(mesh.faces)))


def test_faces_of_hardly_any_area_are_bundled_too() -> None:
    chance = np.random.default_rng(0)
    weights = chance.uniform(size=3000)
    weights[:1500] *= 1e-14
    labels = bundles(chance.normal(size=(3000, 3)), weights, 512)
    assert np.bincount(labels).min() >= 1
    assert labels.max() == 511
