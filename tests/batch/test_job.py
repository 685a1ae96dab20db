"""One job: what it remembers, what it does not, and a file that changes under it."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from struck.batch.job import BodyJob, content_of
from struck.batch.job_process import done, find_finished
from struck.batch.job_table import jobs_of
from struck.errors import OptionError
from struck.files import guard
from tests.batch.bodies import bar
from tests.files.test_guard import speaking


def job_of(file: Path, **options: object) -> BodyJob:
    (job,) = jobs_of(str(file), "steel", None, options)
    return job.with_key()


def nothing(_stage: str, _fraction: float) -> None:
    """Show no progress."""


def test_a_file_that_changes_while_it_is_read_has_no_model(tmp_path: Path) -> None:
    file = tmp_path / "bar.vtu"
    bar(file, 0.08, 0.01, 0.01)
    job = job_of(file)

    def change(stage: str, _fraction: float) -> None:
        if stage == "computing how loudly modes radiate":
            bar(file, 0.09, 0.01, 0.01)

    facts = done(job, tmp_path / "out", change)
    assert "changed while it was read" in facts["message"]
    assert not (tmp_path / "out/bar.struck").exists()
    assert find_finished(job, tmp_path / "out") is None


def test_a_mesh_that_is_refused_is_remembered_until_it_changes(tmp_path: Path) -> None:
    file = tmp_path / "bad.obj"
    file.write_text("v 0 0")
    facts = done(job_of(file), tmp_path / "out", nothing)
    assert facts["failure"] == "MeshError"
    assert find_finished(job_of(file), tmp_path / "out") == facts
    assert find_finished(job_of(file, repair=False), tmp_path / "out") is None
    file.write_text("v 0 0 0")
    assert find_finished(job_of(file), tmp_path / "out") is None


@pytest.mark.parametrize(
    ("program", "told"),
    [
        ("time.sleep(60)", "longer than 0.01 s"),
        ("os._exit(77)", "bytes of memory"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "more memory than the system has left"),
    ],
)
def test_time_and_memory_of_this_machine_are_no_verdict_on_a_mesh(
    program: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = tmp_path / "bar.vtu", tmp_path / "out"
    bar(file, 0.08, 0.01, 0.01)
    wall = 0.01 if "sleep" in program else 60
    monkeypatch.setattr(guard, "_GUARD", speaking(program, wall=wall))
    facts = done(job_of(file), out, nothing)
    assert facts["failure"] == "MeshError"
    assert told in facts["message"]
    assert not list(out.iterdir())


def test_damaged_facts_are_none(tmp_path: Path) -> None:
    file = tmp_path / "bar.vtu"
    bar(file, 0.08, 0.01, 0.01)
    job, out = job_of(file), tmp_path / "out"
    done(job, out, nothing)
    assert find_finished(job, out) is not None
    facts = json.loads((out / "bar.facts.json").read_bytes())
    (tmp_path / "bar.struck").write_bytes(b"not of this batch")
    sizes = {**facts["files"], "../bar.struck": 17}
    labels = [["sound"], "sound"], [{"sound": [1]}], [{}], 7
    wrong = [
        *({"warnings": 5}, {"warnings": [5]}, {"modes": "x"}, {"lowest": []}, {"message": [[]]}),
        *({"files": sizes}, {"files": {str(tmp_path / "bar.struck"): 17}}, {"files": {"a\0": 1}}),
        *({"labels": each} for each in labels),
    ]
    texts = [json.dumps(facts | each) for each in wrong]
    for damaged in ("", "[]", '{"files": 1}', "{", '{"key": 3}', *texts):
        (out / "bar.facts.json").write_text(damaged)
        assert find_finished(job, out) is None
    done(job, out, nothing)  # which removes the files of an earlier run
    assert (tmp_path / "bar.struck").exists()
    assert find_finished(job, out) is not None


def test_buffers_of_a_gltf_are_part_of_its_content(tmp_path: Path) -> None:
    file, buffer = tmp_path / "a.gltf", tmp_path / "a.bin"
    file.write_text('{"buffers": [{"uri": "a.bin"}]}')
    buffer.write_bytes(b"1")
    first = content_of(str(file))
    buffer.write_bytes(b"2")
    assert content_of(str(file)) != first
    file.write_text('{"buffers": [3]}')
    assert content_of(str(file))


@pytest.mark.parametrize("fixed", [functools.partial(print, 1), lambda points: points[:, 0] < 0])
def test_functions_must_be_of_a_module(tmp_path: Path, fixed: Callable[..., object]) -> None:
    bar(tmp_path / "bar.vtu", 0.08, 0.01, 0.01)
    with pytest.raises(OptionError, match="other processes"):
        job_of(tmp_path / "bar.vtu", fixed=fixed)
