"""Everyday bodies against what CalculiX finds on finer meshes of the very same surface."""

from __future__ import annotations

import json
import multiprocessing
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Material
from tests.physics.everyday import BODIES

Array = NDArray[np.float64]
KEPT = json.loads(Path(__file__).with_name("everyday.json").read_text(encoding="utf-8"))
MODES = 20
# Thickness over size below 1:50 and below 1:100, where more is allowed.
THIN = {"plate of 4 mm", "perforated plate"}
VERY_THIN = {"plate of 1 mm", "wine glass", "guitar box"}
FINE = ["plate of 4 mm", "coin", "undercut bar", "fork", "hollow cube", "crate", "mug"]


class Found(NamedTuple):
    """What an analysis found, and what it took."""

    frequencies: Array
    errors: Array
    nodes: int
    seconds: float
    memory: int  # bytes, of a process of its own


def found(name: str, accuracy: str, highest: float) -> Found:
    begun = time.process_time()
    material = Material.named("glass" if "glass" in name else "steel")
    model = struck.analyze(
        BODIES[name](), material, accuracy=accuracy, band=(1, highest), cache=False
    )
    return Found(
        frequencies=model.natural_frequencies[:MODES],
        errors=model.errors[:MODES],
        nodes=int(str(model.provenance.details["nodes"])),
        seconds=time.process_time() - begun,
        memory=1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    )


def alone(name: str, accuracy: str) -> Found:
    """Analyze a body in a process of its own, whose memory is nobody else's."""
    highest = 1.03 * KEPT[name][-1]["frequencies"][MODES - 1]
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(found, name, accuracy, highest).result()


def truth(name: str) -> tuple[Array, Array]:
    """Return the frequencies of the finest mesh, and how far the one before is off."""
    coarse, fine = (np.array(run["frequencies"][:MODES]) for run in KEPT[name][-2:])
    return fine, np.abs(coarse / fine - 1)


def check(name: str, accuracy: str, allowed: float) -> None:
    body = alone(name, accuracy)
    frequencies, own = truth(name)
    assert len(body.frequencies) == MODES
    true = np.abs(body.frequencies / frequencies - 1)
    assert np.all(true <= np.maximum(allowed, 4 * own)), (true, own)
    counted = true > 3 * own
    assert np.mean((true <= body.errors) | ~counted) >= 0.9
    assert not counted.any() or np.median(body.errors[counted] / true[counted]) <= 6
    if accuracy == "standard":
        assert body.nodes <= 100_000
        assert body.memory <= 3 * 2**30
    own_work = KEPT[name][-1]
    sys.stdout.write(
        f"{name} {accuracy}: {body.nodes} nodes, {body.seconds:.0f} CPU s, at most "
        f"{true.max():.2%} off; CalculiX {own_work['nodes']} nodes, {own_work['seconds']} CPU s, "
        f"{own.max():.2%}\n"
    )


@pytest.mark.parametrize("name", ["mug", "plate of 4 mm", "coin"])
def test_preview_is_within_three_percent(name: str) -> None:
    highest = 1.03 * KEPT[name][-1]["frequencies"][MODES - 1]
    frequencies, own = truth(name)
    body = found(name, "preview", highest)
    true = np.abs(body.frequencies / frequencies - 1)
    assert np.all(true <= np.maximum(0.03, 4 * own))


@pytest.mark.prove
@pytest.mark.parametrize("name", BODIES)
def test_standard(name: str) -> None:
    check(name, "standard", 0.01 if name in VERY_THIN else 0.005)


@pytest.mark.prove
@pytest.mark.parametrize("name", FINE)
def test_fine(name: str) -> None:
    check(name, "fine", 0.003 if name in VERY_THIN | THIN else 0.0015)
