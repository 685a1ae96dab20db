"""A body's timbre field: which modes on which mesh, what they radiate, and what is kept of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import struck
from struck.analysis.analysis import radiating
from struck.errors import OptionError, SolverError
from struck.model.gains import ShapeGains
from struck.radiation import sound_field
from struck.radiation.sound_field import FieldPlan, fields_of, velocities_on
from struck.solids import Block

BAND = 20.0, 20_000.0


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
    monkeypatch.setattr(sound_field, "solved", solved_again)
    again = radiating(block, band, cache=tmp_path)
    place = np.array([[0.1, 0.3, -0.2]])
    np.testing.assert_array_equal(made.gains.toward(place), again.gains.toward(place))
    estimate = np.abs(shaped(block).outputs)
    levels = 20 * np.log10(np.abs(shaped(made).outputs) / estimate)
    assert abs(levels[0]) < 4  # the estimate's measured error on blocks is 3 dB
    np.testing.assert_allclose(levels[1:], 0, atol=1e-9)  # out of the band


def solved_again(**given: object) -> None:
    raise AssertionError(f"what was kept is solved again: {given}")


def test_net_flux_is_that_of_the_bodys_own_surface(block: struck.ModalModel) -> None:
    gains = shaped(block)
    plan, modes = FieldPlan.of(gains, block.natural_frequencies, BAND), np.arange(gains.count)
    mesh = sound_field.remeshed(plan.skin.mesh, 2 * plan.edges[0], plan.wall)
    velocities = velocities_on(mesh, gains, plan.skin, modes)
    own = np.einsum("fd,fcdm->m", gains.surface.area_vectors, gains.shapes[gains.surface.faces])
    scale = mesh.areas @ np.abs(velocities)
    np.testing.assert_allclose((mesh.areas @ velocities - own / 3) / scale, 0, atol=1e-6)


def test_higher_modes_get_finer_meshes_and_the_highest_none(block: struck.ModalModel) -> None:
    gains, natural = shaped(block), block.natural_frequencies
    plan = FieldPlan.of(gains, natural, (20.0, 2e4))
    every = np.concatenate([*plan.meshed, plan.left_out])
    np.testing.assert_array_equal(np.sort(every), np.arange(len(natural)))
    assert list(plan.edges) == sorted(plan.edges)
    for edge, modes in zip(plan.edges, plan.meshed, strict=True):
        assert (plan.wave_numbers[modes] * edge <= 1.01 * 2 * np.pi / 6).all()
    high = FieldPlan.of(gains, 40 * natural, (20.0, 1e6)).left_out
    ka = 2 * np.pi * 40 * natural / 343.21 * gains.radius
    np.testing.assert_array_equal(high, np.flatnonzero(ka > 24))


def test_too_little_memory_and_a_relative_estimate_are_refused(
    block: struck.ModalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = FieldPlan.of(shaped(block), block.natural_frequencies, BAND)
    monkeypatch.setattr(sound_field, "available", lambda: 2**20)
    with pytest.raises(SolverError, match="give a band= that ends lower"):
        fields_of(shaped(block), plan)
    relative = struck.analyze(
        Block(size=(0.06, 0.02, 0.01)), "steel", accuracy="preview", radiation="obrien2002"
    )
    with pytest.raises(OptionError, match="radiation='power'"):
        relative.radiating()
