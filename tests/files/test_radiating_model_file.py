"""Model files of computed timbre fields: version 2, exact, small, and refused by older readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import struck
from struck.errors import FileFormatError
from struck.explorer.page_files import model_bytes
from struck.files import model_file
from struck.files.container import pack, unpack
from struck.model.gains import ShapeGains
from struck.radiation.directivity import RadiatingGains
from tests.files.test_model_file import SCHEMA, assert_same, complaints, metadata, strings, through
from tests.radiation.sources import plain_ball, radiating_ball

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
