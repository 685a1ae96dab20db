"""Solids that close on the axis or undercut, against closed forms of volume and frequency."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck.errors import MeshError
from struck.solids import Revolution
from tests.physics.bodies import ALUMINIUM
from tests.physics.reference import TORSIONAL
from tests.physics.test_sphere import RADIUS, UNIT, exact
from tests.samples import sampled
from tests.solids.test_bodies import determinants


def arc(start: float, end: float, count: int = 17) -> list[tuple[float, float]]:
    """Return points of a circle about the origin, between angles above the horizon."""
    angles = np.linspace(start, end, count)
    r, z = np.abs(np.round(np.cos(angles), 15)), np.sin(angles)
    return [(RADIUS * a, RADIUS * b) for a, b in zip(r, z, strict=True)]


BALL = Revolution(profile=arc(-np.pi / 2, np.pi / 2))
DOME = Revolution(profile=arc(0, np.pi / 2))
CONE = Revolution(profile=[(0.03, 0), (0, 0.08)], smooth=False)
# A disc with a rim bent down around its stem: what a rectangle with a notch sweeps.
UNDERCUT = [(0.01, 0), (0.01, 0.03), (0.03, 0.03), (0.03, 0.02), (0.04, 0.02), (0.04, 0.04)]
BODIES = {
    "ball": (BALL, 4 / 3 * np.pi * RADIUS**3),
    "dome": (DOME, 2 / 3 * np.pi * RADIUS**3),
    "cone": (CONE, np.pi * 0.03**2 * 0.08 / 3),
    "undercut": (
        Revolution(profile=[*UNDERCUT, (0, 0.04)], smooth=False),
        np.pi * (0.01**2 * 0.03 + 0.04**2 * 0.01 + (0.04**2 - 0.03**2) * 0.01),
    ),
    "dumb-bell": (
        Revolution(
            profile=[
                *[(0, 0), (0.03, 0), (0.03, 0.02), (0.008, 0.02), (0.008, 0.06)],
                *[(0.03, 0.06), (0.03, 0.08)],
            ],
            smooth=False,
        ),
        np.pi * (2 * 0.03**2 * 0.02 + 0.008**2 * 0.04),
    ),
}


@pytest.mark.parametrize("name", sampled(BODIES, "ball", "undercut"))
def test_elements_fill_the_volume_of_the_closed_form(name: str) -> None:
    body, volume = BODIES[name]
    assert body.volume == pytest.approx(volume, rel=3e-5)
    errors = []
    for accuracy in ("preview", "standard", "fine"):
        mesh = body.volume_mesh(accuracy)
        assert (determinants(mesh) > 0).all()
        errors.append(abs(mesh.volume() / body.volume - 1))
    # Quadratic arcs around the axis: 12, 12 and 16 of them.
    assert max(errors) < 4e-4
    assert errors[2] < errors[0]


def test_smooth_lips_are_followed() -> None:
    profile = [(0, 0), (0.02, 0), (0.012, 0.03), (0.04, 0.028), (0.035, 0.045), (0, 0.055)]
    lip = Revolution(profile=profile)
    mesh = lip.volume_mesh("preview")
    assert (determinants(mesh) > 0).all()
    assert mesh.volume() == pytest.approx(lip.volume, rel=2e-3)


@pytest.mark.parametrize(
    ("accuracy", "highest", "off"),
    [("preview", 3.0, 0.03), ("standard", 4.0, 0.005)],
)
@pytest.mark.prove
def test_a_ball_has_the_modes_of_a_ball(accuracy: str, highest: float, off: float) -> None:
    model = struck.analyze(BALL, ALUMINIUM, band=(20, highest * UNIT), accuracy=accuracy)
    true = exact(highest) * UNIT
    assert len(model.frequencies) == len(true)
    wrong = np.abs(model.frequencies / true - 1)
    assert wrong.max() < off
    assert np.mean(wrong <= model.errors) >= 0.9


@pytest.mark.prove
def test_half_a_ball_and_a_ball_share_modes() -> None:
    """Turns about the axis that are even in height leave the ball's middle free of stress."""
    dome = struck.analyze(DOME, ALUMINIUM, band=(20, 4.0 * UNIT), accuracy="preview")
    assert np.abs(dome.frequencies / (TORSIONAL[3][0] * UNIT) - 1).min() < 0.01


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ([(0.01, 0), (0, 0.01), (0.02, 0.02)], "reaches the axis at z = 0.01 m, between its ends"),
        ([(0.01, 0.05), (0.02, 0.02), (0, 0)], "list it from bottom to top"),
        ([(0, 0), (0.02, 0.03), (0.02, 0), (0, 0.05)], "crosses itself"),
    ],
)
def test_impossible_sides_are_refused(profile: list[tuple[float, float]], message: str) -> None:
    with pytest.raises(MeshError, match=message):
        Revolution(profile=profile, smooth=False)


def test_places_lie_on_the_surface() -> None:
    places = BALL.places
    assert sorted(places) == ["bottom", "rim", "side", "top"]
    distances = [np.linalg.norm(place) for place in places.values()]
    np.testing.assert_allclose(distances, RADIUS, rtol=1e-4)
