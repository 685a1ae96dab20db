"""Thin bodies given by both faces, against published frequencies and their own stated errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import struck
from struck import Material
from struck.model.mesh import Mesh
from tests.physics import reference
from tests.physics.bodies import CHIME, ball, box

Profile = list[tuple[float, float]]


def turned(profile: Profile, around: int = 96) -> Mesh:
    """Return the closed surface of a closed polygon (radius, height) that is turned about z."""
    rings = np.array(profile)
    angles = 2 * np.pi * np.arange(around) / around
    spokes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate(
        [
            rings[:, None, :1] * spokes,
            np.broadcast_to(rings[:, None, 1:], (len(rings), around, 1)),
        ],
        axis=2,
    ).reshape(-1, 3)
    ring, spoke = (grid.ravel() for grid in np.indices((len(rings), around)))
    up, on = (ring + 1) % len(rings), (spoke + 1) % around
    a, b, c, d = ring * around + spoke, ring * around + on, up * around + on, up * around + spoke
    return Mesh(points=points, faces=np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def between(outer: Mesh, inner: Mesh) -> Mesh:
    """Return what lies inside one surface and outside another."""
    return Mesh(
        points=np.vstack([outer.points, inner.points]),
        faces=np.vstack([outer.faces, inner.faces[:, ::-1] + len(outer.points)]),
    )


def rounded(outer: float, inner: float, height: float, foot: float) -> Profile:
    """Return the profile of a beaker: a flat foot, a straight wall, and a lip that is round."""
    radius = (outer - inner) / 2
    bend = np.radians(np.arange(0, 181, 20))
    lip = [(inner + radius + radius * np.cos(t), height + radius * np.sin(t)) for t in bend]
    return [(1e-6, 0.0), (outer, 0.0), *lip, (inner, foot), (1e-6, foot)]


class Body(NamedTuple):
    """A closed surface of both faces, its material, and known frequencies, Hz."""

    mesh: Callable[[], Mesh]
    material: Material
    highest: float
    known: tuple[float, ...]
    within: float  # of the truth: of the theory itself, and of facets


SIDE, SHEET = 0.3, 0.002
STEEL = Material(density=7850.0, youngs_modulus=2.0e11, poisson_ratio=0.3)
PLATE = np.sqrt(STEEL.youngs_modulus * SHEET**2 / (12 * (1 - 0.3**2) * STEEL.density)) / (
    2 * np.pi * SIDE**2
)
HOLLOW = Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.25)
BODIES = {
    "plate": Body(
        lambda: box(SIDE, SIDE, SHEET),
        STEEL,
        400.0,
        tuple(PLATE * each for each in reference.SQUARE_PLATE),
        0.0025,  # shear and rotation, which plates of no thickness leave out
    ),
    "tube": Body(
        lambda: turned([(0.0115, 0.0), (0.0125, 0.0), (0.0125, 0.505), (0.0115, 0.505)]),
        CHIME,
        3000.0,
        tuple(each for each in reference.D3_FAMILIES[1][:3] for _ in range(2)),
        0.0025,  # a prism of 96 sides
    ),
    "hollow ball": Body(
        lambda: between(ball(0.05, 5), ball(0.048, 5)),
        HOLLOW,
        12_500.0,
        (reference.HOLLOW_SPHERE[0.002],) * 5,
        0.001,
    ),
}
SAMPLED = ("plate", "preview")
LIMITS = {"preview": 0.03, "standard": 0.005, "fine": 0.0015}


@pytest.mark.prove
@pytest.mark.parametrize(
    ("name", "accuracy"),
    [
        pytest.param(name, accuracy, marks=[] if (name, accuracy) == SAMPLED else pytest.mark.prove)
        for name in BODIES
        for accuracy in LIMITS
        if (name, accuracy) != ("hollow ball", "fine")
    ],
)
def test_frequencies_are_as_published(name: str, accuracy: str) -> None:
    body = BODIES[name]
    model = struck.analyze(
        body.mesh(), body.material, accuracy=accuracy, band=(20, body.highest), cache=False
    )
    known = np.array(body.known)
    found, stated = (each[: len(known)] for each in (model.natural_frequencies, model.errors))
    off = np.abs(found / known - 1)
    assert off.max() <= max(LIMITS[accuracy], body.within), off
    assert np.mean(off <= stated + body.within) >= 0.9
    assert "one layer" in str(model.provenance.details["path"])
