"""The Utah teapot: four open surfaces that pass through each other are one solid."""

from __future__ import annotations

import json
from pathlib import Path

import igl
import numpy as np
import pytest

from struck.model.mesh import Mesh
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from struck.solids.surface.repair import Repair, repair_mesh

ALONG = 10  # quadrilaterals along each side of a patch
SAMPLES = 100_000


def teapot() -> Mesh:
    """Return its 32 patches as triangles, 0.2 m long."""
    data = json.loads(Path(__file__).with_name("teapot.json").read_text(encoding="utf-8"))
    control = np.array(data["points"])[np.array(data["patches"])].reshape(-1, 4, 4, 3)
    u = np.linspace(0, 1, ALONG + 1)
    weights = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    points = np.einsum("ai,bj,pijk->pabk", weights, weights, control).reshape(-1, 3)
    first = np.arange(len(points)).reshape(-1, ALONG + 1, ALONG + 1)
    corners = first[:, :-1, :-1], first[:, :-1, 1:], first[:, 1:, 1:], first[:, 1:, :-1]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(points=points / 32, faces=faces)


@pytest.fixture(scope="module")
def solid() -> Repair:
    return repair_mesh(teapot())


@pytest.mark.prove
def test_its_volume_is_where_the_winding_number_exceeds_one_half(solid: Repair) -> None:
    given = teapot()
    low, high = given.bounds
    places = np.random.default_rng(1).uniform(low, high, (SAMPLES, 3))
    winding = igl.fast_winding_number(given.points, given.faces, places)
    volume = np.mean(winding > 0.5) * np.prod(high - low)
    assert solid.mesh.volume == pytest.approx(volume, rel=0.01)
    assert "4 patches" in solid.faults[-1]


@pytest.mark.prove
def test_handle_spout_and_lid_stay(solid: Repair) -> None:
    filling = fill_body(FilledBody(mesh=solid.mesh), "preview")
    assert filling.volume_error == pytest.approx(0, abs=0.005)
    reach = np.abs(filling.mesh.surface()[0].bounds - solid.mesh.bounds).max()
    assert reach < 0.001
