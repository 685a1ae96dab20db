"""What an estimate of radiation is called, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from struck.errors import MeshError, OptionError
from struck.model.mesh import Mesh
from struck.radiation import by_name

CENTRE = np.zeros(3)


def ball() -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=1)
    return Mesh(points=np.array(sphere.vertices), faces=np.array(sphere.faces))


def pulsating(mesh: Mesh) -> NDArray[np.float64]:
    return mesh.points[:, :, None]


def test_only_the_power_is_calibrated() -> None:
    assert by_name("power").calibrated
    assert not by_name("obrien2002").calibrated


def test_unknown_name_lists_the_known() -> None:
    with pytest.raises(OptionError, match=r"'horn'.*'power' or 'obrien2002'"):
        by_name("horn")


@pytest.mark.parametrize("name", ["power", "obrien2002"])
@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan])
def test_frequencies_must_be_positive(name: str, frequency: float) -> None:
    mesh = ball()
    with pytest.raises(OptionError, match="leave rigid motions out"):
        by_name(name).coefficients(mesh, pulsating(mesh), np.array([frequency]), CENTRE)


def test_shapes_must_belong_to_the_surface() -> None:
    mesh = ball()
    with pytest.raises(OptionError, match=r"not \(42, 3, 2\)"):
        by_name("power").coefficients(mesh, pulsating(mesh), np.array([1.0, 2.0]), CENTRE)


def test_normals_must_point_outward() -> None:
    mesh = ball()
    inverted = Mesh(points=mesh.points, faces=mesh.faces[:, ::-1])
    with pytest.raises(MeshError, match="flip the normals"):
        by_name("power").coefficients(inverted, pulsating(mesh), np.array([1e3]), CENTRE)
