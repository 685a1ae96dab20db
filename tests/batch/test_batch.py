"""Many meshes: a line for each body, models as of `analyze` alone, and nothing done twice."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import struck
from struck.batch import BatchReport, analyze_many
from struck.batch.job_table import jobs_of
from struck.cli import main
from struck.errors import FileFormatError, OptionError, StruckError
from tests.batch.bodies import PAPER, QUICK, TABLE, bar, box, eight, many
from tests.folders import closed_to_writing

STRUCK = {"strikes": 5, "seconds": 0.05, "seed": 3, "fade": 0.02}
MODELS = {
    *("bar.struck", "below/thin.struck", "long.struck", "copy.struck", "dirty.struck"),
    *("die.struck", "pair-0.struck", "pair-1.struck"),
}


def processor() -> float:
    """Return the time of this process and of those that it waited for, s."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in both)


def alone(file: Path, **options: object) -> bytes:
    """Return the model file that `analyze` gives."""
    model = struck.analyze(str(file), "steel", cache=False, **options)
    path = file.parent.parent / "alone.struck"
    struck.save(model, path)
    return path.read_bytes()


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder, but for the report and what each cost."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file() and not path.name.startswith("report."):
            data = path.read_bytes()
            if path.name.endswith(".facts.json"):
                facts = {k: v for k, v in json.loads(data).items() if k not in {"cpu", "memory"}}
                # Texts name their file as it was given: from here, or from the root.
                data = re.sub(r'"[^\s"]*/(?=[^\s"/]+\.\w+: )', '"', json.dumps(facts)).encode()
            found[path.relative_to(folder).as_posix()] = data
    return found


def by_hand(file: Path, label: Mapping[str, Any]) -> struck.Sound:
    """Return the sound of a label's own numbers."""
    strike = struck.Strike(
        at=[float(label[x]) for x in "xyz"],
        direction=[float(label[f"direction_{x}"]) for x in "xyz"],
        impulse=float(label["impulse"]),
        duration=float(label["duration"]),
    )
    return struck.render(
        struck.load(file),
        strike,
        seconds=float(label["seconds"]),
        sample_rate=int(label["sample_rate"]),
        listener=[float(label[f"listener_{x}"]) for x in "xyz"],
        fade=float(label["fade"]),
    )


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BatchReport, float]:
    """Return a folder of meshes, a data set and a cache, the report, and processor time, s."""
    folder = tmp_path_factory.mktemp("batch")
    eight(folder / "in")
    before = processor()
    report = run(folder, **STRUCK)
    return folder, report, processor() - before


def run(folder: Path, out: str = "out", **options: object) -> BatchReport:
    given = {**QUICK, "cache": str(folder / "cache"), **options}
    table = folder / "in" / TABLE
    given |= {"table": table} if table.exists() else {}
    return analyze_many(str(folder / "in"), "steel", out=folder / out, **given)


def test_each_body_has_a_line_and_the_model_of_analyze_alone_or_one_clear_error(
    done: tuple[Path, BatchReport, float],
) -> None:
    folder, report, _ = done
    rows = {row.model or row.file: row for row in report.rows}
    assert {name for name in rows if name.endswith(".struck")} == MODELS
    (failed,) = report.failed
    assert (Path(failed.file).name, failed.failure) == ("broken.obj", "MeshError")
    assert "broken.obj" in failed.message
    assert rows["dirty.struck"].warnings
    assert rows["die.struck"].modes == 0
    assert "recoil" in rows["die.struck"].message
    for name in MODELS:
        model = struck.load(folder / "out" / name)
        assert len(model.frequencies) == rows[name].modes
    assert {row.part for row in report.rows} == {"", "0", "1"}
    assert all(0 < row.cpu < 60 and 1e7 < row.memory < 2e9 for row in report.rows)
    with (folder / "out/report.csv").open(newline="") as file:
        assert [line["status"] for line in csv.DictReader(file)].count("done") == 8
    assert len(json.loads((folder / "out/report.json").read_bytes())) == 9
    page = (folder / "out/report.html").read_text()
    assert page.count("<audio") == page.count("<img") == 20
    for name in ("bar", "copy"):
        made = alone(folder / f"in/{name}.vtu")
        assert (folder / f"out/{name}.struck").read_bytes() == made
    part = alone(folder / "in/pair.off", part="1", **QUICK, **PAPER)
    assert (folder / "out/pair-1.struck").read_bytes() == part


def test_a_second_run_computes_nothing(
    done: tuple[Path, BatchReport, float], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, report, first = done
    files = contents(folder / "out")
    before = processor()
    again = run(folder, **STRUCK)
    assert processor() - before < first / 20
    assert (again.computed, report.computed) == (0, 10)
    assert again.rows == report.rows
    assert contents(folder / "out") == files
    assert main([*words("in", "out", folder), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["computed"] == 0
    assert sum(row["status"] == "failed" for row in told["rows"]) == 1
    assert main(["analyze-many", str(folder / "in/bar.vtu"), "-o", str(folder / "none")]) == 2


def test_a_pattern_and_a_table_may_name_a_file_from_here_or_from_the_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bar(tmp_path / "a.vtu", 0.08, 0.01, 0.01)
    (tmp_path / TABLE).write_text("file,size\na.vtu,0.1\n")
    monkeypatch.chdir(tmp_path)
    for files, table in (("a.vtu", tmp_path / TABLE), (tmp_path / "a.vtu", TABLE)):
        (job,) = jobs_of(files, "steel", table, {})
        assert (job.file, job.options["size"]) == (str(files), 0.1)


def test_each_label_is_that_of_its_sound(done: tuple[Path, BatchReport, float]) -> None:
    folder, _, _ = done
    with (folder / "out/labels.csv").open(newline="") as file:
        labels = list(csv.DictReader(file))
    assert len(labels) == len({label["impulse"] for label in labels}) == 40
    for label in labels[::6]:
        again = by_hand(folder / "out" / label["model"], label)
        again.save(folder / "again.wav", level="absolute")
        assert (folder / "again.wav").read_bytes() == (folder / "out" / label["sound"]).read_bytes()
        distance = math.dist([float(label[f"listener_{x}"]) for x in "xyz"], (0, 0, 0))
        assert 1.0 < distance < 1.2


@pytest.mark.prove
def test_control_c_ends_within_a_second_and_kills_leave_whole_files_alone(
    done: tuple[Path, BatchReport, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _, _ = done
    process = shell(folder, "cut", *ONE)
    while not (folder / "cut/report.json").exists():
        time.sleep(0.01)
    time.sleep(0.8)
    family = tree(process.pid)
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, told = process.communicate(timeout=20)
    while any(map(works, family)):
        time.sleep(0.01)
    assert time.monotonic() - begun < 1 + os.getloadavg()[0] / 2
    said = told.decode().splitlines()  # lines of progress, then that it was interrupted
    assert (process.returncode, said[-1]) == (130, "struck: interrupted")
    assert "Traceback" not in " ".join(said)
    for path in (folder / "cut").rglob("*.struck"):
        struck.load(path)
    finished = killed(folder, "cut", 1.0, *ONE) | killed(folder, "cut", 1.6, *ONE)
    monkeypatch.setenv("STRUCK_CACHE", str(folder / "cache"))
    assert main([*words("in", "cut", folder), *ONE]) == 3  # as Python makes it, two bodies of one
    ends_as(contents(folder / "out"), folder / "cut", finished)


NUMBERS = ("first", "second", "fourth")


@pytest.mark.prove
def test_tables_tell_options_of_single_files(tmp_path: Path) -> None:
    bar(tmp_path / "a.vtu", 8, 1, 1)
    table = tmp_path / "objects.csv"
    table.write_text(
        "file,material,units,output,band,recoil\n"
        'a.vtu,glass,cm,first,"20,9e3",true\n'
        "a.vtu,steel,cm,second,,\n"
        "a.vtu,unobtainium,cm,third,,\n"
        "a.vtu,steel,cm,fourth,,\n"
        "missing.obj,steel,,,,\n"
    )
    report = analyze_many(table=table, out=tmp_path / "out", cache=False, processes=1)
    assert {row.model for row in report.rows} == {"", *(f"{n}.struck" for n in NUMBERS)}
    assert report.computed == 2  # what is the same is computed once
    page = (tmp_path / "out/report.html").read_text()
    assert page.count("<audio") == page.count("<img") == 3
    steel = (tmp_path / "out/second.struck").read_bytes()
    assert (tmp_path / "out/fourth.struck").read_bytes() == steel
    (tmp_path / "out/fourth.struck").unlink()
    again = analyze_many(table=table, out=tmp_path / "out", cache=False)
    assert (again.computed, again.rows) == (0, report.rows)
    assert (tmp_path / "out/fourth.struck").read_bytes() == steel
    told = {row.failure: row.message for row in report.failed}
    assert "there is no file of that name" in told["FileFormatError"]
    assert "unobtainium" in told["MaterialError"]
    glass = struck.load(tmp_path / "out/first.struck")
    assert glass.material is not None
    assert glass.material.name == "glass"
    assert glass.mass == pytest.approx(glass.material.density * 0.08 * 0.01 * 0.01)
    same = tmp_path / "objects.toml"
    same.write_text(
        '[[files]]\nfile = "a.vtu"\nmaterial = "glass"\nunits = "cm"\noutput = "first"\n'
        "band = [20, 9e3]\n"
    )
    again = analyze_many(table=same, out=tmp_path / "out", cache=False)
    assert (again.computed, len(again.rows)) == (0, 1)


WRONG = {
    "no mesh file has the name": {"files": "nowhere/*.obj"},
    "(none)": {"files": []},
    "analyze_many has no color": {"color": 1},
    "did you mean strikes?": {"striks": 3},
    "did you mean steel": {"material": "stel"},
    "did you mean preview?": {"accuracy": "previw"},
    "did you mean mm?": {"units": "mmm"},
    "has no material": {"material": None},
    "would both become a.struck": {"files": ["in/a.obj", "in/a.stl"]},
    "names no file": {"table": [{"size": 1}]},
    "has no colour": {"table": [{"file": "in/a.obj", "colour": 1}]},
    "is not understood": {"table": [{"file": "in/a.obj", "size": "large"}]},
    "does not lie in the folder": {"table": [{"file": "in/a.obj", "output": "../a"}]},
    "processes is 0": {"processes": 0},
    "strikes is 0": {"strikes": 0},
    "sounds is 'mp3'": {"strikes": 1, "sounds": "mp3"},
    "nothing of a strike": {"strikes": [{"where": "top"}]},
    "strikes has rows of type int": {"strikes": [1]},
    "other processes": {"fixed": lambda points: points[:, 0] < 0},
}


@pytest.mark.parametrize("told", WRONG)
def test_what_concerns_all_is_refused_before_anything_is_done(told: str, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in ("a.obj", "a.stl"):
        box(0.02, 0.02, 0.02).export(tmp_path / "in" / name)
    given = {"files": "in/a.obj", "material": "steel", **WRONG[told]}
    before = Path.cwd()
    os.chdir(tmp_path)
    try:
        with pytest.raises(StruckError) as refused:
            analyze_many(given.pop("files"), given.pop("material"), out="out", **given)
    finally:
        os.chdir(before)
    assert told in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_outputs_replace_no_inputs(tmp_path: Path) -> None:
    table = tmp_path / "report.csv"
    table.write_text("file,material\na.obj,steel\n")
    with pytest.raises(OptionError, match="is read as well"):
        analyze_many(table=table, out=tmp_path)
    assert table.read_text().startswith("file,")


def test_folders_and_disks_that_cannot_be_written(tmp_path: Path) -> None:
    box(0.02, 0.02, 0.02).export(tmp_path / "a.obj")
    (tmp_path / "closed").mkdir()
    with closed_to_writing(tmp_path / "closed") as folder, pytest.raises(FileFormatError):
        analyze_many(str(tmp_path / "a.obj"), "steel", out=folder)
    with closed_to_writing(tmp_path / "closed") as folder, pytest.raises(FileFormatError):
        analyze_many(str(tmp_path / "a.obj"), "steel", out=folder / "more")


def test_what_is_wrong_with_one_stops_no_other(tmp_path: Path) -> None:
    """A job that the system kills, a folder for a model, a sheet too large, and a bar."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out/barred.struck").mkdir(parents=True)
    for name in ("a", "bar", "barred"):
        bar(tmp_path / f"in/{name}.vtu", 0.08, 0.01, 0.01, count=6 + len(name))
    bar(tmp_path / "in/sheet.vtu", 0.4, 0.3, 0.002, count=200)
    own = os.getpid()
    victims: list[int] = []

    def watch(_stage: str, _fraction: float) -> None:
        workers = [each for each in tree(own) if each != own]
        jobs = [each for each in workers if len(parents(each) & set(workers)) == 1]
        if jobs and not victims:
            victims.append(jobs[0])
            os.kill(jobs[0], signal.SIGKILL)

    report = run(tmp_path, memory=2e7, cache=False, progress=watch, processes=1)
    told = {Path(row.file).stem: row for row in report.rows}
    assert told["bar"].status == "done"
    assert told["a"].failure == "ProcessEnded"
    assert "signal 9" in told["a"].message
    assert told["sheet"].failure == "SolverError"
    assert "GiB" in told["sheet"].message
    assert told["barred"].failure == "FileFormatError"
    assert "is a folder" in told["barred"].message
    for name in ("a", "sheet"):  # no fault of the meshes, so it is not remembered
        assert not (tmp_path / f"out/{name}.facts.json").exists()


ONE = ("--processes", "1")
SHELL = "from struck.__main__ import main; import sys; sys.exit(main())"


def words(files: str, out: str, folder: Path = Path()) -> list[str]:
    """Return the command of a run in the shell."""
    sounds = [text for name, value in STRUCK.items() for text in (f"--{name}", str(value))]
    table = ["--table", str(folder / files / TABLE)]
    where = ["analyze-many", str(folder / files), "-o", str(folder / out), *table]
    return [*where, "--material", "steel", "--accuracy", "preview", *sounds]


def shell(folder: Path, out: str, *more: str) -> subprocess.Popen[bytes]:
    """Start `struck analyze-many` in a group of processes of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", SHELL, *words("in", out), *more],
        cwd=folder,
        env={**os.environ, "STRUCK_CACHE": str(folder / "cache")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def tree(process: int) -> list[int]:
    """Return a process and all that stem from it."""
    found = [process]
    for each in found:
        for task in Path(f"/proc/{each}/task").glob("*/children"):
            found += map(int, task.read_text().split())
    return found


def works(process: int) -> bool:
    """Tell whether a process is still there, and not only its number."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def killed(folder: Path, out: str, moment: float, *more: str) -> dict[Path, int]:
    """Kill all processes of a run at a moment, s; return finished models with their times."""
    process = shell(folder, out, *more)
    time.sleep(moment)
    family = tree(process.pid)
    for each in family:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(os.getpgid(each), signal.SIGKILL)  # with what it starts meanwhile
    while any(map(works, family[1:])):
        time.sleep(0.01)
    process.communicate()
    models = (folder / out).rglob("*.struck")
    finished = (path for path in models if path.with_suffix(".facts.json").exists())
    return {path: path.stat().st_mtime_ns for path in finished}


def ends_as(expected: dict[str, bytes], folder: Path, finished: dict[Path, int]) -> None:
    """Check that a folder is as one left alone, and what was finished there not done again."""
    assert contents(folder) == expected
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    assert not list(folder.rglob(".*"))


def parents(process: int) -> set[int]:
    """Return those that a process stems from."""
    found: set[int] = set()
    while process > 1:
        try:
            status = Path(f"/proc/{process}/stat").read_text()
        except OSError:
            break
        process = int(status.rpartition(")")[2].split()[1])
        found.add(process)
    return found


@pytest.mark.prove
@pytest.mark.filterwarnings("ignore::struck.errors.RepairWarning")
def test_150_files_each_have_a_line_and_what_is_whole_has_its_model(tmp_path: Path) -> None:
    many(tmp_path / "in", np.random.default_rng(25))
    quick = {**PAPER, "band": (20.0, 40_000.0), "cache": False}
    before = processor()
    report = run(tmp_path, **quick)
    first = processor() - before
    assert len(report.rows) == 150
    assert {Path(row.file).name[:4] for row in report.failed} == {"brok", "bomb"}
    assert len(report.failed) == 18
    for row in report.failed:
        assert row.failure in {"MeshError", "OptionError"}
        assert len(row.message) > 20
    for number, row in enumerate(row for row in report.rows if row.model):
        assert len(struck.load(tmp_path / "out" / row.model).frequencies) == row.modes
        if number % 8 == 0:
            made = alone(Path(row.file), **{**QUICK, **PAPER, "band": (20.0, 40_000.0)})
            assert made == (tmp_path / "out" / row.model).read_bytes()
    before = processor()
    assert run(tmp_path, **quick).computed == 0
    assert processor() - before < first / 20


@pytest.mark.prove
def test_25_kills_leave_whole_files_alone(tmp_path: Path) -> None:
    eight(tmp_path / "in")
    run(tmp_path, **STRUCK)
    for number, moment in enumerate(np.random.default_rng(25).uniform(0.2, 3.0, 25)):
        finished = killed(tmp_path, f"out{number}", moment)
        report = run(tmp_path, f"out{number}", **STRUCK)
        ends_as(contents(tmp_path / "out"), report.folder, finished)


@pytest.mark.prove
def test_sounds_of_an_earlier_run_stay_and_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "in").mkdir()
    bar(tmp_path / "in/bar.vtu", 0.08, 0.01, 0.01)
    run(tmp_path, strikes=3, seconds=0.1, progress=None)
    labels = (tmp_path / "out/labels.csv").read_bytes()
    given = ["analyze-many", str(tmp_path / "in"), "-o", str(tmp_path / "out")]
    assert main([*given, "--material", "steel", "--seconds", "2"]) == 2
    assert "--seconds 2.0 is for sounds, which are made by --strikes" in capsys.readouterr().err
    assert main([*given, "--material", "steel", "--accuracy", "preview", "--modes", "2"]) == 0
    told = "3 files of sounds of an earlier run: --strikes makes them again"
    assert f"bar.vtu: {told}" in capsys.readouterr().out
    assert len(struck.load(tmp_path / "out/bar.struck").frequencies) == 2
    assert len(list((tmp_path / "out").glob("*.wav"))) == 3
    assert (tmp_path / "out/labels.csv").read_bytes() == labels
    failed = run(tmp_path, strikes=[{"at": "nowhere"}], seconds=0.1, progress=None).failed
    assert "the place is 'nowhere'" in failed[0].message
    assert len(list((tmp_path / "out").glob("*.wav"))) == 3  # what cannot be made undoes nothing
    assert (tmp_path / "out/bar.struck").is_file()
    run(tmp_path, strikes=1, seconds=0.1, progress=None)
    assert (tmp_path / "out/bar_000.wav").is_file()
    assert run(tmp_path, strikes=1, seconds=0.1, band=(20, 9000)).computed == 1
    assert run(tmp_path, strikes=1, seconds=0.1, band=[20.0, 9000.0]).computed == 0
