"""Everyday bodies against what CalculiX finds on finer meshes of the very same surface."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import struck
from struck import ModalModel
from tests.commands import run
from tests.physics.everyday import BODIES

Array = NDArray[np.float64]
KEPT = json.loads(Path(__file__).with_name("everyday.json").read_text(encoding="utf-8"))
MODES, FEWEST = 20, 5


VERY_THIN = ("plate of 1 mm", "guitar box", "wine glass")
THIN = ("plate of 1 mm", "coin")
FINE = ("plate of 4 mm", "plate of 1 mm", "undercut bar", "fork")


def truth(name: str) -> tuple[Array, Array]:
    """Return the frequencies of the finest mesh, and how far one 1.4 times coarser is off."""
    fine, coarse, _ = _meshes(name)
    return fine, coarse / fine - 1


def limit(name: str) -> tuple[Array, Array]:
    """Return the frequencies that both meshes tend to, and how far the finest mesh is off."""
    # Errors of quadratic elements fall by the fourth power of their width where a body is smooth,
    # and by the third as found on the crate's four meshes, whose creases go inward.
    fine, coarse, wider = _meshes(name)
    off = (coarse / fine - 1) / (wider**3 - 1)
    return fine * (1 - off), np.abs(off)


def _meshes(name: str) -> tuple[Array, Array, float]:
    """Return frequencies of the finest mesh and of a coarser one, and the ratio of their widths."""
    runs = KEPT[name]
    finest = runs[-1]
    fine = np.array(finest["frequencies"][:MODES])
    # The glass has no coarser mesh, as its facets are no larger than elements may be: residuals of
    # its modes say how far they are above their limit.
    if "errors" in finest:
        return fine, fine * (1 + np.array(finest["errors"][:MODES])), 2 ** (1 / 3)
    coarser = next(run for run in reversed(runs) if run["size"] >= 1.4 * finest["size"])
    coarse = np.array(coarser["frequencies"][:MODES])
    return fine, coarse, coarser["size"] / finest["size"]


def check(name: str, model: ModalModel, tolerance: float) -> None:
    """Assert that modes are within a tolerance, or four errors of the truth, and errors hold."""
    frequencies, own = truth(name)
    true = np.abs(model.natural_frequencies[:MODES] / frequencies - 1)
    assert np.all(true <= np.maximum(tolerance, 4 * np.abs(own)))
    assert model.errors is not None
    stated = model.errors[:MODES]
    frequencies, own = limit(name)
    true = np.abs(model.natural_frequencies[:MODES] / frequencies - 1)
    counted = true > 3 * own
    assert np.mean((true <= stated) | ~counted) >= 0.9
    # Fewer have no median: four modes of the coin at fine are known so well.
    assert counted.sum() < FEWEST or np.median(stated[counted] / true[counted]) <= 6


def analyzed(folder: Path, name: str, accuracy: str) -> tuple[ModalModel, int]:
    """Return a model of a body's file, as the command makes it, and its peak memory, bytes."""
    mesh = BODIES[name]()
    trimesh.Trimesh(mesh.points, mesh.faces, process=False).export(folder / "body.stl")
    words = f"analyze body.stl --units m --material {material(name)} --accuracy {accuracy}"
    highest = 1.03 * truth(name)[0][-1]
    memory = run(folder, *words.split(), "--band", f"20,{highest}", "-o", "body.struck")
    return struck.load(folder / "body.struck"), memory


def material(name: str) -> str:
    """Return the name of the material of a body."""
    return "glass" if "glass" in name else "steel"


@pytest.mark.prove
@pytest.mark.parametrize(
    "name",
    ["undercut bar", *(pytest.param(name, marks=pytest.mark.prove) for name in THIN)],
)
def test_preview_is_within_three_percent(tmp_path: Path, name: str) -> None:
    check(name, analyzed(tmp_path, name, "preview")[0], 0.03)


@pytest.mark.prove
@pytest.mark.parametrize("name", BODIES)
def test_standard_is_within_half_a_percent(tmp_path: Path, name: str) -> None:
    """One percent where a body is 100 times as long as thick; at most 100,000 nodes and 3 GiB."""
    model, memory = analyzed(tmp_path, name, "standard")
    check(name, model, 0.01 if name in VERY_THIN else 0.005)
    assert int(str(model.provenance.details["nodes"])) <= 100_000
    assert int(str(model.provenance.details["unknowns"])) <= 3 * 110_000  # cubic ones included
    assert memory <= 3 * 2**30


@pytest.mark.prove
@pytest.mark.parametrize("name", FINE)
def test_fine_is_within_a_seventh_of_a_percent(tmp_path: Path, name: str) -> None:
    """Twice that where a body is more than 50 times as long as thick."""
    model, _ = analyzed(tmp_path, name, "fine")
    check(name, model, 0.003 if "plate" in name else 0.0015)
