"""Data sets of sounds: the same bytes for a seed, and each sound again from its label."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.batch import analyze_many
from struck.batch.batch_report import label_table
from struck.batch.job_process import Facts, done
from struck.batch.job_table import jobs_of, table_rows
from struck.batch.strike_set import StrikeSet
from struck.errors import ContactError, MissingDependencyError, OptionError
from struck.model.provenance import silent
from tests.batch.bodies import bar
from tests.batch.test_batch import by_hand

XYZ = "xyz"


def analyzed(folder: Path, name: str = "bar", **how: object) -> Facts:
    """Return the facts of a bar's strikes, of a job in this process."""
    (job,) = jobs_of(str(folder / f"{name}.vtu"), "steel", None, {})
    return done(replace(job, strikes=StrikeSet(**how)).with_key(), folder / "out", silent)


def test_tables_functions_and_other_kinds_of_files(tmp_path: Path) -> None:
    bar(tmp_path / "bar.vtu", 0.08, 0.01, 0.01)
    table = tmp_path / "strikes.csv"
    table.write_text('at,striker,speed,listener\n"0.04,0,0",wood,1,"0,0,2"\ntop,steel,0.5,\n')
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    facts = analyzed(tmp_path, strikes=table_rows(table), sounds="npz")
    (tmp_path / "labels.parquet").write_bytes(label_table("labels.parquet", facts["labels"]))
    wood, steel = parquet.read_table(tmp_path / "labels.parquet").to_pylist()
    assert (wood["striker"], steel["striker"]) == ("wood", "steel")
    assert [wood[f"listener_{x}"] for x in XYZ] == [0, 0, 2]
    with np.load(tmp_path / "out/bar.npz") as both:
        assert both["samples"].shape == (2, 48_000)
        again = by_hand(tmp_path / "out/bar.struck", wood).samples
        np.testing.assert_array_equal(both["samples"][:1], again)
    soundfile = pytest.importorskip("soundfile")
    (label,) = analyzed(tmp_path, strikes=corner, sounds="flac")["labels"]
    assert not (tmp_path / "out/bar.npz").exists()
    samples, rate = soundfile.read(tmp_path / "out" / label["sound"])
    written = by_hand(tmp_path / "out/bar.struck", label).samples[0] * float(label["factor"])
    np.testing.assert_allclose(samples, written, atol=2**-23)
    assert rate == 48_000


def corner(model: struck.ModalModel, chance: np.random.Generator) -> Sequence[struck.Strike]:
    """Return one strike somewhere along an edge."""
    assert model.geometry is not None
    low, high = model.geometry.bounds
    along = chance.uniform(low[0], high[0])
    return [struck.Strike(at=(along, high[1], high[2]), impulse=0.01, duration=1e-4)]


def test_a_strike_off_a_body_is_an_error_that_stays(tmp_path: Path) -> None:
    bar(tmp_path / "short.vtu", 0.06, 0.01, 0.01)
    facts = analyzed(tmp_path, "short", strikes=[{"at": (0.05, 0, 0), "impulse": 0.01}])
    assert facts["failure"] == ContactError.__name__
    assert json.loads((tmp_path / "out/short.facts.json").read_bytes()) == facts


def test_labels_need_what_writes_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in").mkdir()
    bar(tmp_path / "in/bar.vtu", 0.08, 0.01, 0.01)
    for name in ("pyarrow", "soundfile", "distributed"):
        monkeypatch.setitem(__import__("sys").modules, name, None)
    where = {"files": str(tmp_path / "in"), "material": "steel", "out": tmp_path / "out"}
    for given in (
        {"strikes": 1, "labels": "labels.parquet"},
        {"strikes": 1, "sounds": "flac"},
        {"scheduler": "tcp://127.0.0.1:1"},
    ):
        with pytest.raises(MissingDependencyError, match="pip install"):
            analyze_many(**where, **given)
    with pytest.raises(OptionError, match="labels"):
        analyze_many(**where, strikes=1, labels="labels.xml")
    assert not (tmp_path / "out/bar.struck").exists()
