"""A body's timbre field: which modes on which mesh, what they radiate, and what is kept of it."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import struck
from struck.analysis.analysis import radiating
from struck.errors import OptionError, SolverError
from struck.model.gains import ShapeGains
from struck.radiation import sound_field
from struck.radiation.sound_field import Plan, fields_of, velocities_on
from struck.solids import Block

SPOT = Path("/work/shared/data/meshes/spot.obj")
BAND = 20.0, 7000.0


@pytest.fixture(scope="module")
def block() -> struck.ModalModel:
    """Return a block that is small against its waves."""
    made = Block(size=(0.06, 0.02, 0.01))
    return struck.analyze(made, "steel", accuracy="preview", band=(20, 20_000), cache=False)


def shaped(model: struck.ModalModel) -> ShapeGains:
    assert isinstance(model.gains, ShapeGains)
    return model.gains


def test_a_field_is_computed_kept_and_taken_up_again(
    block: struck.ModalModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = float(block.natural_frequencies[0])
    band, told = (20.0, 1.01 * first), []
    made = radiating(block, band, cache=tmp_path, progress=lambda *each: told.append(each))
    assert made.gains.directional
    assert made.provenance.details["radiation"] == "field"
    assert told[0][0].startswith("forecast: timbre field, about ")
    assert told[-1] == ("timbre field", 1.0)
    monkeypatch.setattr(sound_field, "solved", None)  # what is kept is not solved again
    again = radiating(block, band, cache=tmp_path)
    place = np.array([[0.1, 0.3, -0.2]])
    np.testing.assert_array_equal(made.gains.toward(place), again.gains.toward(place))
    estimate = np.abs(shaped(block).outputs)
    levels = 20 * np.log10(np.abs(shaped(made).outputs) / estimate)
    assert abs(levels[0]) < 4  # the estimate's measured error on blocks is 3 dB
    np.testing.assert_allclose(levels[1:], 0, atol=1e-9)  # out of the band


def test_net_flux_is_that_of_the_bodys_own_surface(block: struck.ModalModel) -> None:
    gains = shaped(block)
    plan, modes = Plan.of(gains, block.natural_frequencies, BAND), np.arange(gains.count)
    mesh = sound_field.remeshed(plan.skin.mesh, 2 * plan.edges[0], plan.wall)
    velocities = velocities_on(mesh, gains, plan.skin, modes)
    own = np.einsum("fd,fcdm->m", gains.surface.area_vectors, gains.shapes[gains.surface.faces])
    scale = mesh.areas @ np.abs(velocities)
    np.testing.assert_allclose((mesh.areas @ velocities - own / 3) / scale, 0, atol=1e-6)


def test_higher_modes_get_finer_meshes_and_the_highest_none(block: struck.ModalModel) -> None:
    gains, natural = shaped(block), block.natural_frequencies
    plan = Plan.of(gains, natural, (20.0, 2e4))
    every = np.concatenate([*plan.meshed, plan.left_out])
    np.testing.assert_array_equal(np.sort(every), np.arange(len(natural)))
    assert list(plan.edges) == sorted(plan.edges)
    for edge, modes in zip(plan.edges, plan.meshed, strict=True):
        assert (plan.wave_numbers[modes] * edge <= 1.01 * 2 * np.pi / 6).all()
    high = Plan.of(gains, 40 * natural, (20.0, 1e6)).left_out
    ka = 2 * np.pi * 40 * natural / 343.21 * gains.radius
    np.testing.assert_array_equal(high, np.flatnonzero(ka > 24))


def test_too_little_memory_and_bodies_without_shapes_are_refused(
    block: struck.ModalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan.of(shaped(block), block.natural_frequencies, BAND)
    monkeypatch.setattr(sound_field, "available", lambda: 2**20)
    with pytest.raises(SolverError, match="give a band= that ends lower"):
        fields_of(shaped(block), plan)
    relative = struck.analyze(
        Block(size=(0.06, 0.02, 0.01)), "steel", accuracy="preview", radiation="obrien2002"
    )
    with pytest.raises(OptionError, match="radiation='power'"):
        relative.radiating()
    recorded = replace(block, gains=Recorded(block.gains), geometry=None, recoil=None)
    with pytest.raises(OptionError, match="mode shapes on a surface"):
        recorded.radiating()


class Recorded(struck.model.gains.Gains):
    """Gains without shapes."""

    def __init__(self, gains: Any) -> None:
        self.count_of = gains.count

    calibrated = True

    def changed(self, *given: Any) -> Any:
        return self

    def at(self, points: Any, directions: Any) -> Any:
        return np.ones((len(points), 1, self.count_of))

    def toward(self, listeners: Any) -> Any:
        return np.ones((len(listeners), 1, self.count_of), complex)


RUN = """
import resource, struck, sys, time
model = struck.load(sys.argv[1])
from struck.analysis.analysis import radiating
told = []
def progress(stage, share):
    print(stage, share, time.process_time(), flush=True)
radiating(model, (20.0, float(sys.argv[2])), cache=sys.argv[3], progress=progress)
print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time())
"""


@pytest.mark.prove
@pytest.mark.timed
@pytest.mark.skipif(not SPOT.exists(), reason="the mesh of the cow is not there")
def test_a_cow_of_ceramic_to_8_khz_is_forecast_and_taken_up_after_a_kill(tmp_path: Path) -> None:
    made = struck.analyze(str(SPOT), "ceramic", size=0.15, wall=0.008, band=(20, 8000))
    struck.save(made, tmp_path / "spot.struck")
    command = [sys.executable, "-c", RUN, tmp_path / "spot.struck", "8000", tmp_path / "cache"]
    work = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert work.stdout is not None
    lines = [next(work.stdout) for _ in range(4)]
    work.kill()
    work.wait()
    forecast = float(lines[0].split("about ")[1].split()[0])
    kept = len(list((tmp_path / "cache").iterdir()))
    begun = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = [line for line in done.stdout.splitlines() if line.startswith("timbre field")]
    # What was finished comes from the cache: those steps take no time of the processor.
    first = float(told[min(kept, 3) - 1].split()[-1]) - float(
        done.stdout.splitlines()[0].split()[-1]
    )
    *_, peak, spent = done.stdout.split()
    assert float(peak) * 1024 < 4 * 2**30
    every = float(lines[-1].split()[-1]) + float(spent) - first
    print(f"forecast {forecast} s, took {spent} s after the kill, {every:.0f} in all; peak {peak}")
    assert forecast / 1.5 < every < 1.5 * forecast
    assert time.monotonic() > begun
