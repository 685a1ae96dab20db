"""Model files of computed timbre fields: version 2, exact, small, and refused by older readers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.errors import FileFormatError
from struck.explorer.page_files import model_bytes
from struck.files import model_file
from struck.files.container import pack, unpack
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.radiation.boundary_elements import SurfaceField
from struck.radiation.directivity import RadiatingGains
from tests.files.test_model_file import SCHEMA, assert_same, complaints, metadata, strings, through
from tests.radiation.bodies import ball
from tests.radiation.sources import RADIUS, plain_ball, radiating_ball, some_sources

FAR = np.array([[0.5, 0.2, -0.3], [-0.09, 0.02, 0.05]])


def test_a_round_trip_is_exact(tmp_path: Path) -> None:
    made, _ = radiating_ball()
    loaded = through(made, tmp_path / "a.struck")
    assert_same(made, loaded)
    assert isinstance(loaded.gains, RadiatingGains)
    for name in ("wave_numbers", "degrees", "amplitudes", "errors"):
        kept, given = getattr(loaded.gains.field, name), getattr(made.gains.field, name)
        np.testing.assert_array_equal(kept, given)
        assert kept.dtype == given.dtype
    np.testing.assert_array_equal(loaded.gains.toward(FAR), made.gains.toward(FAR))
    assert (tmp_path / "a.struck").read_bytes() == model_file.to_bytes(loaded)


def with_a_skin(model: ModalModel) -> ModalModel:
    """Return a model with a coarse skin beside its field, of all modes but one."""
    skin, chance = ball(RADIUS, 1), np.random.default_rng(3)
    size, modes = (len(skin.faces), 5), np.array([0, 1, 2, 4, 5])
    part = SurfaceField(
        mesh=skin,
        modes=modes,
        wave_numbers=model.gains.field.wave_numbers[modes],
        pressures=chance.normal(size=(2, *size)).astype(np.float32),
        velocities=chance.normal(size=size).astype(np.float32),
        errors=np.full(5, 0.01),
    )
    return replace(model, gains=replace(model.gains, near=(part,)))


def test_what_is_near_returns_exactly(tmp_path: Path) -> None:
    made = with_a_skin(radiating_ball()[0])
    loaded = through(made, tmp_path / "a.struck")
    beside = np.array([[1.1 * RADIUS, 0, 0], [0.4, 0, 0]])
    np.testing.assert_array_equal(loaded.gains.toward(beside), made.gains.toward(beside))
    assert complaints(metadata(tmp_path / "a.struck"), SCHEMA, SCHEMA) == []
    text, tensors = unpack((tmp_path / "a.struck").read_bytes(), kind="struck", newest=2)
    for name in [name for name in tensors if name.startswith("near.")]:
        data = pack({**tensors, name: tensors[name][1:]}, {**text, "sha256": "0" * 64})
        with pytest.raises(FileFormatError):
            model_file.from_bytes(data)


def test_100_modes_of_a_body_add_little() -> None:
    frequencies = np.linspace(0.5, 5.0, 100) * 343.21 / (2 * np.pi * RADIUS)
    plain = plain_ball(frequencies)
    field = RadiatingGains.of(plain.gains, frequencies, [some_sources(frequencies)])
    sizes = [len(model_file.to_bytes(replace(plain, gains=each))) for each in (plain.gains, field)]
    assert sizes[1] - sizes[0] < 0.3e6
    skin = 1152 * 100 * (2 * 4 + 4)
    assert skin < 2e6


def test_a_field_needs_version_2_and_nothing_else_does(tmp_path: Path) -> None:
    made, _ = radiating_ball()
    struck.save(made, tmp_path / "a.struck")
    assert strings(tmp_path / "a.struck")["version"] == "2"
    assert complaints(metadata(tmp_path / "a.struck"), SCHEMA, SCHEMA) == []
    with pytest.raises(FileFormatError, match="version is 2, and this struck reads up to 1: upd"):
        unpack((tmp_path / "a.struck").read_bytes(), kind="struck", newest=1)
    struck.save(plain_ball(made.natural_frequencies), tmp_path / "b.struck")
    assert strings(tmp_path / "b.struck")["version"] == "1"


def test_the_page_gets_what_it_can_hear() -> None:
    made, _ = radiating_ball()
    seen = model_file.from_bytes(model_bytes(made))
    assert type(seen.gains) is ShapeGains
    np.testing.assert_array_equal(np.abs(seen.gains.outputs), made.gains.field.levels)


def test_a_field_that_cannot_be_is_refused(tmp_path: Path) -> None:
    made, _ = radiating_ball()
    struck.save(made, tmp_path / "a.struck")
    text, tensors = unpack((tmp_path / "a.struck").read_bytes(), kind="struck", newest=2)
    for name, value in (
        ("multipole_degrees", np.full(6, 30, np.uint32)),
        ("multipoles", tensors["multipoles"][1:]),
        ("multipole_wave_numbers", np.zeros(6)),
    ):
        data = pack({**tensors, name: value}, {**text, "sha256": "0" * 64})
        with pytest.raises(FileFormatError, match=r"degrees|amplitudes|wave numbers"):
            model_file.from_bytes(data)
