"""Forty dirty versions of eight clean bodies: the same volume and the same sound, or one error."""

from __future__ import annotations

import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.files.meshes import load_body
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from tests.solids.surface.dirty_bodies import CLEAN, VERSIONS

EVERY = [(name, number) for name in CLEAN for number in range(5)]
COSTLY = {"ball", "bracket", "capsule", "cube", "ellipsoid", "hollow ball", "ring"}
SAMPLE = [(name, place % 5) for place, name in enumerate(CLEAN) if name not in COSTLY]
REFUSED = {("cube", "lidless"), ("cylinder", "lidless")}


def frequencies(mesh: Mesh, highest: float) -> NDArray[np.float64]:
    """Return the frequencies of a body of steel, Hz."""
    elements = fill_body(FilledBody(mesh=mesh), "preview").mesh.promoted()
    return vibration_modes(elements, Material.named("steel"), highest).frequencies


@cache
def clean(name: str) -> NDArray[np.float64]:
    """Return the first five frequencies of a clean body."""
    body = CLEAN[name][0]()
    mesh = Mesh(points=body.points, faces=body.faces)
    assert mesh.volume == pytest.approx(CLEAN[name][1], rel=0.01)
    return frequencies(mesh, 1.2 * 3200 / body.extent)[:5]


def outcome(name: str, number: int, folder: Path) -> str:
    """Return "same" or "refused", or tell what differs."""
    dirty = VERSIONS[name][number]
    seed = zlib.crc32(f"{name} {number}".encode())
    surface = dirty(CLEAN[name][0](), np.random.default_rng(seed))
    path = surface.written(folder / "dirty.obj")
    try:
        body = load_body(path, **surface.options)  # type: ignore[arg-type]
    except MeshError as error:
        return str(error) if "\n" in str(error) else "refused"
    volume = body.volume_after / CLEAN[name][1] - 1
    wanted = clean(name)
    found = frequencies(body.mesh, 1.1 * wanted[-1])[:5]
    off = np.abs(found / wanted[: len(found)] - 1).max() if len(found) == 5 else np.inf
    close = abs(volume) <= 0.03 and off <= 0.02
    return "same" if close else f"{name}, {dirty.__name__}: {volume:+.2%} volume, {off:.2%} Hz"


@pytest.mark.parametrize(("name", "number"), SAMPLE)
def test_dirty_body_sounds_like_the_clean_one(name: str, number: int, tmp_path: Path) -> None:
    expected = "refused" if (name, VERSIONS[name][number].__name__) in REFUSED else "same"
    assert outcome(name, number, tmp_path) == expected


@pytest.mark.prove
def test_thirty_six_of_forty_dirty_bodies(tmp_path: Path) -> None:
    outcomes = [outcome(name, number, tmp_path) for name, number in EVERY]
    assert len(outcomes) == 40
    assert set(outcomes) == {"same", "refused"}
    assert outcomes.count("same") >= 36
