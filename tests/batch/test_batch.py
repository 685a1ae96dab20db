"""Many meshes: a line for each body, models as of `analyze` alone, and nothing done twice."""

from __future__ import annotations

import csv
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.batch import BatchReport, analyze_many
from struck.cli import main
from struck.errors import FileFormatError, OptionError
from tests.batch.bodies import PAPER, QUICK, TABLE, bar, box, eight, many
from tests.folders import closed_to_writing

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
    model = struck.analyze(str(file), "steel", cache=False, **QUICK, **options)
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
                data = json.dumps(facts).encode()
            found[path.relative_to(folder).as_posix()] = data
    return found


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BatchReport, float]:
    """Return a folder with meshes, models and a cache, the report, and the processor's time, s."""
    folder = tmp_path_factory.mktemp("batch")
    eight(folder / "in")
    before = processor()
    report = run(folder)
    return folder, report, processor() - before


def run(folder: Path, out: str = "out", **options: object) -> BatchReport:
    given = {**QUICK, "cache": str(folder / "cache"), **options}
    table = folder / "in" / TABLE
    given |= {"table": table} if table.exists() else {}
    return analyze_many(str(folder / "in"), "steel", out=folder / out, **given)


def test_each_body_has_a_line_and_a_model_or_one_clear_error(
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
    assert page.count("<audio") == page.count("<img") == 8


def test_models_are_those_of_analyze_alone(done: tuple[Path, BatchReport, float]) -> None:
    folder, _, _ = done
    made = alone(folder / "in/bar.vtu")
    assert (folder / "out/bar.struck").read_bytes() == made
    assert (folder / "out/copy.struck").read_bytes() == made
    part = alone(folder / "in/pair.stl", part="1", **PAPER)
    assert (folder / "out/pair-1.struck").read_bytes() == part


def test_a_second_run_computes_nothing(done: tuple[Path, BatchReport, float]) -> None:
    folder, report, first = done
    before, files = processor(), contents(folder / "out")
    again = run(folder)
    assert processor() - before < first / 20
    assert (again.computed, report.computed) == (0, 9)
    assert again.rows == report.rows
    assert contents(folder / "out") == files


def test_same_content_is_computed_once_and_other_options_anew(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in "abc":
        bar(tmp_path / f"in/{name}.vtu", 0.08, 0.01, 0.01)
    assert run(tmp_path).computed == 1
    (tmp_path / "out/b.struck").unlink()
    assert run(tmp_path).computed == 0
    assert run(tmp_path, band=(20.0, 14_000.0)).computed == 1
    assert not run(tmp_path, band=(20.0, 14_000.0)).failed


def test_tables_tell_options_of_single_files(tmp_path: Path) -> None:
    bar(tmp_path / "a.vtu", 8, 1, 1)
    table = tmp_path / "objects.csv"
    table.write_text(
        "file,material,units,output,band,recoil\n"
        'a.vtu,glass,cm,first,"20,9e3",true\n'
        "a.vtu,steel,cm,second,,\n"
        "a.vtu,unobtainium,cm,third,,\n"
        "missing.obj,steel,,,,\n"
    )
    report = analyze_many(table=table, out=tmp_path / "out", cache=False)
    assert {row.model for row in report.rows} == {"first.struck", "second.struck", ""}
    told = {row.failure: row.message for row in report.failed}
    assert "cannot be read" in told["FileFormatError"]
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
    "analyze has no color": {"color": 1},
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
    "strikes tell nothing": {"strikes": [1]},
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
        with pytest.raises(OptionError) as refused:
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
    """Too little memory for a sheet, a folder in the place of a model, and a bar."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out/barred.struck").mkdir(parents=True)
    for name in ("bar", "barred"):
        bar(tmp_path / f"in/{name}.vtu", 0.08, 0.01, 0.01, count=6 + len(name))
    bar(tmp_path / "in/sheet.vtu", 0.4, 0.3, 0.002, count=400)
    report = run(tmp_path, memory=3e7, cache=False)
    told = {Path(row.file).stem: row for row in report.rows}
    assert told["bar"].status == "done"
    assert told["sheet"].failure == "SolverError"
    assert "GiB" in told["sheet"].message
    assert told["barred"].failure == "FileFormatError"
    assert "is a folder" in told["barred"].message
    for name in ("sheet", "barred"):  # no fault of the meshes, so it is not remembered
        assert not (tmp_path / f"out/{name}.facts.json").exists() or name == "barred"


SHELL = "from struck.__main__ import main; import sys; sys.exit(main())"


def shell(folder: Path, out: str) -> subprocess.Popen[bytes]:
    """Start `struck analyze-many` in a group of processes of its own."""
    meshes = folder / "in"
    words = ("analyze-many", str(meshes), "-o", out, "--material", "steel", "--accuracy", "preview")
    return subprocess.Popen(
        [sys.executable, "-c", SHELL, *words, "--table", str(meshes / TABLE)],
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


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a whole tree of processes, as a machine that stops does."""
    for each in tree(process.pid):
        try:
            os.kill(each, signal.SIGKILL)
        except ProcessLookupError:
            continue
    process.communicate()


def killed_at(folder: Path, moments: list[float]) -> None:
    """Kill runs at moments, s; each folder must end as one that was left alone."""
    expected = contents(folder / "out")
    for number, moment in enumerate(moments):
        process = shell(folder, f"out{number}")
        time.sleep(moment)
        kill(process)
        out = folder / f"out{number}"
        finished = {path: path.stat().st_mtime_ns for path in out.rglob("*.struck")}
        assert len(run(folder, out.name).failed) == 1
        assert contents(out) == expected
        assert {path: path.stat().st_mtime_ns for path in finished} == finished
        assert not list(out.rglob(".*"))


def test_kills_leave_whole_files_alone(done: tuple[Path, BatchReport, float]) -> None:
    killed_at(done[0], [0.9, 1.8])


def test_control_c_ends_within_a_second(done: tuple[Path, BatchReport, float]) -> None:
    folder, _, _ = done
    process = shell(folder, "interrupted")
    while not (folder / "interrupted/report.json").exists():
        time.sleep(0.01)
    time.sleep(0.5)
    family = tree(process.pid)
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, told = process.communicate(timeout=20)
    assert time.monotonic() - begun < 1 + os.getloadavg()[0] / 2
    assert (process.returncode, told) == (130, b"struck: interrupted\n")
    assert not [each for each in family if Path(f"/proc/{each}/cmdline").exists()]
    for path in (folder / "interrupted").rglob("*.struck"):
        struck.load(path)


def test_a_job_that_the_system_kills_fails_alone(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for number in range(3):
        bar(tmp_path / f"in/{number}.vtu", 0.08, 0.01, 0.01 + 0.001 * number)
    own = os.getpid()
    victims: list[int] = []

    def watch(_stage: str, _fraction: float) -> None:
        workers = [each for each in tree(own) if each != own]
        jobs = [each for each in workers if len(parents(each) & set(workers)) == 1]
        if jobs and not victims:
            victims.append(jobs[0])
            os.kill(jobs[0], signal.SIGKILL)

    report = run(tmp_path, cache=False, progress=watch, processes=1)
    assert victims
    (failed,) = report.failed
    assert failed.failure == "ProcessEnded"
    assert "signal 9" in failed.message
    assert run(tmp_path, cache=False).computed == 1


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


def test_shell_tells_failures_and_exits_with_3(
    done: tuple[Path, BatchReport, float], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _, _ = done
    words = [str(folder / "in"), "-o", str(folder / "out"), "--material", "steel", "--json"]
    words += ["--accuracy", "preview", "--table", str(folder / "in" / TABLE)]
    assert main(["analyze-many", *words]) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["computed"] == 0
    assert sum(row["status"] == "failed" for row in told["rows"]) == 1
    assert main(["analyze-many", str(folder / "in/bar.vtu"), "-o", str(folder / "none")]) == 2


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
            made = alone(Path(row.file), **{**PAPER, "band": (20.0, 40_000.0)})
            assert made == (tmp_path / "out" / row.model).read_bytes()
    before = processor()
    assert run(tmp_path, **quick).computed == 0
    assert processor() - before < first / 20


@pytest.mark.prove
def test_25_kills_leave_whole_files_alone(tmp_path: Path) -> None:
    eight(tmp_path / "in")
    run(tmp_path)
    killed_at(tmp_path, np.random.default_rng(25).uniform(0.2, 4.0, 25).tolist())
