"""Data sets of sounds: the same bytes for a seed, and each sound again from its label."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.batch import analyze_many
from struck.errors import ContactError, MissingDependencyError, OptionError
from tests.batch.bodies import bar
from tests.batch.test_batch import contents

XYZ = "xyz"


def six(folder: Path) -> None:
    folder.mkdir()
    for number in range(6):
        bar(folder / f"{number}.vtu", 0.08 + 0.004 * number, 0.01, 0.01)


def made(folder: Path, out: str, **options: object) -> list[dict[str, str]]:
    """Return the labels of a data set, as a table of texts."""
    given = {"cache": str(folder / "cache"), "seconds": 0.25, **options}
    report = analyze_many(str(folder / "in"), "steel", out=folder / out, **given)
    assert not report.failed
    with (folder / out / "labels.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def by_hand(folder: Path, label: dict[str, str]) -> struck.Sound:
    """Return the sound of a label's own numbers."""
    strike = struck.Strike(
        at=[float(label[x]) for x in XYZ],
        direction=[float(label[f"direction_{x}"]) for x in XYZ],
        impulse=float(label["impulse"]),
        duration=float(label["duration"]),
    )
    return struck.render(
        struck.load(folder / label["model"]),
        strike,
        seconds=float(label["seconds"]),
        sample_rate=int(label["sample_rate"]),
        listener=[float(label[f"listener_{x}"]) for x in XYZ],
    )


def test_the_same_seed_gives_the_same_bytes_and_labels_their_sounds(tmp_path: Path) -> None:
    six(tmp_path / "in")
    labels = made(tmp_path, "one", strikes=5, seed=3)
    made(tmp_path, "two", strikes=5, seed=3)
    assert len(labels) == 30
    assert len({label["impulse"] for label in labels}) == 30
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    for label in labels[::6]:
        again = by_hand(tmp_path / "one", label)
        again.save(tmp_path / "again.wav", level="absolute")
        assert (tmp_path / "again.wav").read_bytes() == (
            tmp_path / "one" / label["sound"]
        ).read_bytes()
        distance = math.dist([float(label[f"listener_{x}"]) for x in XYZ], (0, 0, 0))
        assert 1.0 < distance < 1.2
    assert (tmp_path / "one/report.html").read_text().count("<audio") == 20


def test_tables_functions_and_other_kinds_of_files(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    bar(tmp_path / "in/bar.vtu", 0.08, 0.01, 0.01)
    table = tmp_path / "strikes.csv"
    table.write_text('at,striker,speed,listener\n"0.04,0,0",wood,1,"0,0,2"\ntop,steel,0.5,\n')
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    given = {"strikes": table, "sounds": "npz", "labels": "labels.parquet", "cache": False}
    analyze_many(str(tmp_path / "in"), "steel", out=tmp_path / "out", **given)
    wood, steel = parquet.read_table(tmp_path / "out/labels.parquet").to_pylist()
    assert (wood["striker"], steel["striker"]) == ("wood", "steel")
    assert [wood[f"listener_{x}"] for x in XYZ] == [0, 0, 2]
    with np.load(tmp_path / "out/bar.npz") as both:
        assert both["samples"].shape == (2, 48_000)
        again = by_hand(tmp_path / "out", wood).samples
        np.testing.assert_array_equal(both["samples"][:1], again)
    soundfile = pytest.importorskip("soundfile")
    (label,) = made(tmp_path, "out", strikes=corner, sounds="flac")
    assert not (tmp_path / "out/bar.npz").exists()
    samples, rate = soundfile.read(tmp_path / "out" / label["sound"])
    written = by_hand(tmp_path / "out", label).samples[0] * float(label["factor"])
    np.testing.assert_allclose(samples, written, atol=2**-23)
    assert rate == 48_000


def corner(model: struck.ModalModel, chance: np.random.Generator) -> Sequence[struck.Strike]:
    """Return one strike somewhere along an edge."""
    assert model.geometry is not None
    low, high = model.geometry.bounds
    along = chance.uniform(low[0], high[0])
    return [struck.Strike(at=(along, high[1], high[2]), impulse=0.01, duration=1e-4)]


def test_a_strike_off_one_body_fails_with_that_body_alone(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    bar(tmp_path / "in/long.vtu", 0.1, 0.01, 0.01)
    bar(tmp_path / "in/short.vtu", 0.06, 0.01, 0.01)
    strikes = [{"at": (0.05, 0, 0), "impulse": 0.01}]
    given = {"out": tmp_path / "out", "strikes": strikes, "cache": False}
    report = analyze_many(str(tmp_path / "in"), "steel", **given)
    assert [row.failure for row in report.rows] == ["", ContactError.__name__]
    assert len(json.loads((tmp_path / "out/report.json").read_bytes())) == 2
    assert analyze_many(str(tmp_path / "in"), "steel", **given).computed == 0


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
