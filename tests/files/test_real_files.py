"""Meshes that other people made, through the shell as a user types it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.files.meshes import load_body
from tests.commands import run

MESHES = Path(__file__).parents[3] / "shared/data/meshes"
SPOT, BUNNY = MESHES / "spot.obj", MESHES / "stanford_bunny.obj"


@pytest.mark.prove
@pytest.mark.skipif(not SPOT.exists(), reason=f"{SPOT.name} is not beside the checkout")
def test_a_hollow_ceramic_cow(tmp_path: Path) -> None:
    command = f"analyze {SPOT} --material ceramic --size 0.15 --wall 0.008 -o spot.struck"
    memory = run(tmp_path, *command.split())
    run(tmp_path, *["render", "spot.struck", "--strike", "top", "-o", "spot.wav"])
    model = struck.load(tmp_path / "spot.struck")
    sound = struck.Sound.load(tmp_path / "spot.wav")
    assert memory < 4 * 2**30
    assert 20_000 / (1 + model.errors.max()) <= model.complete_to <= 20_000
    assert len(model.frequencies) == model.provenance.details["sturm_count"]
    assert model.geometry.extent == pytest.approx(0.15, rel=0.01)
    assert np.isfinite(sound.samples).all()
    assert sound.peak > 0


@pytest.mark.prove
@pytest.mark.skipif(not BUNNY.exists(), reason=f"{BUNNY.name} is not beside the checkout")
def test_a_scan_with_holes_is_mended() -> None:
    """All five holes are in the base: seen from there, what the open scan encloses is whole."""
    scan = trimesh.load_mesh(BUNNY)
    result = load_body(BUNNY, size=0.15)
    mended = trimesh.Trimesh(result.mesh.points, result.mesh.faces, process=False)
    assert mended.is_watertight
    assert mended.is_winding_consistent
    assert "5 holes in the surface." in result.faults
    assert 0 < len(mended.faces) - len(scan.faces) < 500
    scan.apply_scale(0.15 / scan.extents.max())
    base = [scan.centroid[0], scan.bounds[0, 1], scan.centroid[2]]
    corners = scan.triangles - base
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(mended.volume, rel=0.01)


@pytest.mark.prove
@pytest.mark.skipif(not BUNNY.exists(), reason=f"{BUNNY.name} is not beside the checkout")
@pytest.mark.parametrize(
    ("wall", "accuracies", "gibibytes", "path"),
    [
        (0.008, ("standard", "fine"), 4, ""),
        (0.004, ("preview", "standard"), 6, "one layer"),
    ],
)
def test_a_scan_with_holes_rings(
    tmp_path: Path, wall: float, accuracies: tuple[str, str], gibibytes: int, path: str
) -> None:
    """Certified, in bounded memory, and as near a finer run as it says."""
    command = f"analyze {BUNNY} --material ceramic --size 0.15 --wall {wall} --no-cache"
    memory = {
        accuracy: run(
            tmp_path, *command.split(), "--accuracy", accuracy, "-o", f"{accuracy}.struck"
        )
        for accuracy in accuracies
    }
    model, finer = (struck.load(tmp_path / f"{accuracy}.struck") for accuracy in accuracies)
    assert memory["standard"] < gibibytes * 2**30
    for each in (model, finer):
        assert 20_000 / (1 + each.errors.max()) <= each.complete_to <= 20_000
        assert len(each.frequencies) == each.provenance.details["sturm_count"]
        assert str(each.provenance.details["path"]).startswith(path)
    count = min(len(model.frequencies), len(finer.frequencies))
    assert count >= 25
    away = np.abs(model.frequencies[:count] / finer.frequencies[:count] - 1)
    assert np.mean(away <= model.errors[:count]) >= 0.9
    assert np.median(finer.errors) < 0.05
    assert np.median(model.errors[:count] / away) < 6
