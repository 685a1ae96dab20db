"""What is said of all sounds of a triangle holds for any of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import trimesh

from struck.analysis.analysis import model_of_modes
from struck.model.gains import Gains
from struck.model.model import ModalModel
from struck.perception.sonic_distance import HeardModel, erb_distance
from struck.perception.sound_map import Ear, Facets, sound_map
from struck.shapes.skins import rectangle, slab
from tests.perception.bodies import STEEL, Plain, clamped_plate, given, random_contacts

Array = np.ndarray
LEVEL = 45.0  # many modes are near the threshold


def rough(seed: int, modes: int = 14) -> ModalModel:
    """Return a plate whose modes are random at the vertices: full of nodal lines."""
    random = np.random.default_rng(seed)
    mesh = slab(*rectangle(0.3, 0.2, 0.05), 0.01)
    heights = random.standard_normal((len(mesh.points), modes))
    heights *= 10 ** random.uniform(-2, 0, modes)
    return given(mesh, np.sort(random.uniform(100, 12_000, modes)), heights)


def inside(facets: Facets, count: int, seed: int) -> tuple[Array, Array]:
    """Return shares of the corners (F, N, 3), some of them near edges, and the points there."""
    random = np.random.default_rng(seed)
    shares = random.dirichlet([0.4, 0.4, 0.4], (len(facets), count))
    return shares, np.einsum("fnc,fcd->fnd", shares, facets.corners)


def looked_at(model: ModalModel) -> tuple[Ear, Facets]:
    ear, mesh = Ear.of(HeardModel.at(model, level=LEVEL)), model.geometry
    return ear, Facets.of(ear, mesh.points[mesh.faces], -mesh.face_normals)


def decibels(amplitudes: Array) -> Array:
    return 20 * np.log10(np.maximum(amplitudes, 1e-300))


@pytest.mark.parametrize(
    "model",
    [lambda: rough(1), lambda: rough(2), lambda: clamped_plate(4000.0, spacing=0.02)],
    ids=["rough 1", "rough 2", "plate"],
)
def test_timbres_and_levels_stay_within_their_bounds(model: Callable[[], ModalModel]) -> None:
    ear, facets = looked_at(model())
    shares, points = inside(facets, 12, seed=3)
    levels = decibels(ear.behind(ear.parts(points, facets.directions)))
    assert np.all(levels <= facets.loud[:, None] + 1e-6)
    soft = facets.soft[:, None]
    assert np.all((levels >= soft - 1e-6) | (soft < -60))
    assert np.mean(soft > -60) > 0.1
    heard = levels > -60
    straight = decibels(np.einsum("fnc,fc->fn", shares, facets.amplitudes))
    timbres = levels - straight[:, :, None]
    below, above = facets.least[:, None] - timbres, timbres - facets.most[:, None]
    assert below[heard].max() < 1e-3
    assert above[heard].max() < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_no_place_is_farther_from_a_timbre_than_its_misfit(seed: int) -> None:
    ear, facets = looked_at(rough(seed))
    shares, points = inside(facets, 12, seed)
    level = decibels(np.einsum("fnc,fc->fn", shares, facets.amplitudes))
    true = decibels(ear.behind(ear.parts(points, facets.directions)))
    random = np.random.default_rng(seed)
    for timbre in facets.timbres[random.choice(len(facets), 8)]:
        bound = facets.misfits(ear.quiet, timbre[None])
        played = level[:, :, None] + timbre
        apart = erb_distance(*(np.maximum(each - ear.quiet, 0) for each in (true, played)))
        assert np.all(apart <= bound[:, None] + 1e-9)
        assert apart.max() > 0.3 * bound.max()  # and the bound is of use


def test_halves_are_the_whole() -> None:
    ear, facets = looked_at(rough(5))
    halves = facets.halved(ear)
    areas = [
        np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()
        for c in (facets.corners, halves.corners)
    ]
    assert len(halves) == 2 * len(facets)
    assert areas[0] == pytest.approx(areas[1])
    assert np.mean(halves.misfits(ear.quiet, halves.timbres)) < np.mean(
        facets.misfits(ear.quiet, facets.timbres)
    )


def apart(model: ModalModel, threshold: float, seed: int) -> tuple[Array, float]:
    """Return how far 100 contacts are from what a map says, and its bound, dB."""
    made = sound_map(model, threshold, level=60)
    hearing = HeardModel.at(model, made.listener, made.level)
    ear = Ear.of(hearing)
    points, directions = random_contacts(model.geometry, 100, seed)
    true = np.square(np.abs(hearing.gains(points, directions)[:, 0])) * hearing.weights
    told = np.square(np.abs([made.at(point) for point in points])) * hearing.weights
    modes = len(model.frequencies)
    excess = [
        np.maximum(10 * np.log10(each @ ear.passing[:, :modes].T + 1e-300) - ear.quiet, 0)
        for each in (true, told)
    ]
    return erb_distance(*excess), made.bound


def ball() -> ModalModel:
    solid = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    x, y, z = 10 * solid.vertices.T
    fields = [(x * y, z, x), (y * z, x**2, z * y), (x**3, y, z**2), (z, y * x, x * y * z)]
    shapes = np.stack([np.stack(field, axis=1) for field in fields], axis=2)
    return model_of_modes(
        solid.vertices,
        solid.faces,
        [400.0, 900.0, 2100.0, 5200.0],
        shapes,
        material=STEEL,
        mass=1.0,
        centre=np.zeros(3),
        inertia=np.eye(3),
        radiation=Plain(),
    )


each_threshold = pytest.mark.parametrize(
    "threshold", [8.0, pytest.param(5.0, marks=pytest.mark.prove)]
)


@pytest.mark.prove
@each_threshold
def test_the_bound_holds_on_a_round_body_of_flat_faces(threshold: float) -> None:
    found, bound = apart(ball(), threshold, seed=1)
    assert 1 < found.max() <= bound <= threshold


@dataclass(frozen=True, kw_only=True, eq=False)
class Products(Gains):
    """Two products: what a listener hears of a mode turns with the contact."""

    plain: Gains

    @property
    def calibrated(self) -> bool:
        return False

    @property
    def rank(self) -> int:
        return 2

    def changed(self, frequencies: Array, modes: Array, size: float, density: float) -> Gains:
        raise NotImplementedError

    def at(self, points: Array, directions: Array) -> Array:
        drives = self.plain.at(points, directions)
        return np.concatenate([drives, drives * points[:, :1, None] / 0.1], axis=1)

    def toward(self, listeners: Array) -> Array:
        outputs = self.plain.toward(listeners)
        return np.concatenate([outputs, 1j * outputs], axis=1)


@pytest.mark.prove
@each_threshold
def test_the_bound_holds_for_sums_of_products(threshold: float) -> None:
    body = ball()
    found, bound = apart(replace(body, gains=Products(plain=body.gains)), threshold, seed=2)
    assert 1 < found.max() <= bound <= threshold
