"""Thin walls: thickness by balls, segments of a surface, and what lies behind all of its sheets."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.mesh import Mesh, Surface
from struck.solids.filling.filling import fill_body
from struck.solids.filling.thin_walls import (
    Segments,
    SheetedBody,
    ThinBody,
    balls_at,
)
from struck.solids.surface.distance import FilledBody
from tests.physics.bodies import ball, box
from tests.physics.everyday import BODIES as EVERYDAY
from tests.physics.test_thin_bodies import between, rounded, turned
from tests.samples import sampled

PLATE = (0.3, 0.2, 0.001)


def crate() -> Mesh:
    """Return a box of 12 mm thick walls that is open at the top."""
    outer, inner = box(0.4, 0.3, 0.25), box(0.376, 0.276, 0.238)
    lifted = Mesh(points=inner.points + np.array([0, 0, 0.006]), faces=inner.faces)
    joined = between(outer, lifted)
    top = [joined.points[:, 2] > 0.12499]
    assert top[0].sum() == 8
    rest = joined.faces[~top[0][joined.faces].all(axis=1)]
    corners = np.flatnonzero(top[0])
    ring = [
        sorted(half, key=lambda v: np.arctan2(*joined.points[v, 1::-1]))
        for half in (corners[:4], corners[4:])
    ]
    faces = []
    for k in range(4):
        a, b = ring[0][k], ring[0][(k + 1) % 4]
        c, d = ring[1][k], ring[1][(k + 1) % 4]
        faces += [[a, b, d], [a, d, c]]
    return Mesh(points=joined.points, faces=np.vstack([rest, faces]))


BODIES = {
    "plate": lambda: box(*PLATE),
    "crate": crate,
    "hollow box": lambda: between(box(0.05, 0.05, 0.05), box(0.045, 0.045, 0.045)),
    "beaker": lambda: turned(rounded(0.04, 0.036, 0.09, 0.005), 64),
}
SPACING = {"plate": 0.02, "crate": 0.04, "hollow box": 0.008, "beaker": 0.012}


def test_balls_tell_how_thick_a_body_is() -> None:
    for mesh, across in ((ball(0.05, 4), 0.1), (box(0.3, 0.2, 0.001), 0.001)):
        where = mesh.centroids[: 2 if across < 0.01 else 400]
        wide = np.argsort(-np.abs(mesh.face_normals[:, 2]))[: len(where)]
        found, faces = balls_at(
            Surface(mesh), mesh.centroids[wide], mesh.face_normals[wide], np.full(len(wide), 1.0)
        )
        assert found.max() <= across * (1 + 1e-3)
        assert np.median(found) == pytest.approx(across, rel=0.015)  # facets lie within the ball
        assert found.min() > 0.9 * across
        assert (faces >= 0).all()


def test_a_plate_is_six_segments_and_neighbours_are_different_sheets() -> None:
    segments = Segments.of(box(*PLATE), 0.02)
    assert len(segments.areas) == 6
    sheets = segments.colour()
    assert (sheets[segments.disjoint[:, 0]] != sheets[segments.disjoint[:, 1]]).all()
    wide = np.argsort(-segments.areas)[:2]
    assert sheets[wide[0]] != sheets[wide[1]]


@pytest.mark.parametrize(("name", "pairs"), [("crate", 8), ("hollow box", 12)])
def test_faces_that_meet_in_a_concave_edge_are_joined_and_different_sheets(
    name: str, pairs: int
) -> None:
    segments = Segments.of(BODIES[name](), 0.05)
    joined = np.unique(np.sort(segments.joined, axis=1), axis=0)
    assert len(joined) == pairs
    sheets = segments.colour()
    assert (sheets[joined[:, 0]] != sheets[joined[:, 1]]).all()
    inner = np.isin(np.arange(len(sheets)), joined)
    assert not set(sheets[inner]) & set(sheets[~inner])


def test_a_kink_is_a_crease_and_a_curve_of_as_much_is_none() -> None:
    """A hollow cone whose foot flares by 25 degrees is cut there; a pipe of 16 facets is not."""
    flared = [(0.05, 0.0), (0.04, 0.02), (0.035, 0.1), (0.033, 0.1), (0.038, 0.02), (0.048, 0.0)]
    found = Segments.of(turned(flared, 96), 0.03)
    assert len(found.areas) == 6
    pipe = [(0.05, 0.0), (0.05, 0.1), (0.048, 0.1), (0.048, 0.0)]
    assert len(Segments.of(turned(pipe, 16), 0.03).areas) == 4


def test_a_round_lip_parts_the_outside_from_the_inside() -> None:
    mesh = BODIES["beaker"]()
    segments = Segments.of(mesh, 0.016)
    middle, radius = mesh.centroids, np.hypot(*mesh.centroids[:, :2].T)
    wall = (middle[:, 2] > 0.02) & (middle[:, 2] < 0.08)
    outside, inside = (
        np.unique(segments.faces[wall & side]) for side in (radius > 0.038, radius < 0.038)
    )
    assert len(outside) == len(inside) == 1
    assert outside[0] != inside[0]
    assert (segments.faces < 0).any()  # what rounds off the lip is neither's


@pytest.mark.prove
@pytest.mark.parametrize("spacing", [0.008, 0.01, 0.014])
def test_a_rod_on_a_thin_body_stays_one_sheet(spacing: float) -> None:
    """Its surface bounds both sides of it and is short around: a mug's handle, a glass's stem."""
    for body, rod in (("mug", lambda c: c[:, 0] > 0.055), ("wine glass", _on_the_stem)):
        mesh = EVERYDAY[body]()
        labels = Segments.of(mesh, spacing).faces[rod(mesh.centroids)]
        assert len(labels) > 50
        assert len(np.unique(labels)) == 1


def _on_the_stem(centroids: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (centroids[:, 2] > 0.03) & (centroids[:, 2] < 0.075)


def test_a_thick_body_stays_a_solid() -> None:
    solid = FilledBody(mesh=box(0.1, 0.08, 0.09))
    assert ThinBody(solid=solid).at(0.02) is solid


@pytest.mark.parametrize("name", sampled(BODIES, "crate", "hollow box"))
def test_a_point_is_in_the_body_where_it_is_behind_all_sheets_that_are_not_joined(
    name: str,
) -> None:
    """As the winding number of libigl tells, at random and close to the surface."""
    mesh = BODIES[name]()
    body = FilledBody(mesh=mesh)
    seen = ThinBody(solid=body).at(SPACING[name])
    assert isinstance(seen, SheetedBody)
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    anywhere = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (3000, 3))
    face = rng.integers(len(mesh.faces), size=3000)
    near = mesh.centroids[face] + rng.normal(size=(3000, 3)) * body.thickness
    points = np.vstack([anywhere, near])
    depths, inside = seen.depths(points), body.distance(points) < 0
    alone = np.setdiff1d(np.arange(len(seen.sheets)), seen.joined)
    assert inside.sum() > 100
    assert (depths[np.ix_(inside, alone)] < 0).all()
    assert (depths[~inside] > 0).any(axis=1).all()
    if not seen.joined:
        assert np.array_equal((depths < 0).all(axis=1), inside)


@pytest.mark.parametrize("name", sampled(["plate", "crate", "beaker"], "plate", "crate"))
def test_few_elements_follow_a_thin_body(name: str) -> None:
    mesh = BODIES[name]()
    filling = fill_body(FilledBody(mesh=mesh), "preview")
    assert filling.path == "one layer"
    assert filling.mesh.cubic
    assert filling.mesh.functions <= 30_000
    assert filling.mesh.volume() == pytest.approx(mesh.volume, rel=0.02)
