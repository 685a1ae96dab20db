"""Interruptions: whatever is killed and started again ends as if nothing had happened."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh

from struck.cli import main
from struck.files import model_file
from struck.files.cache import Cache

SHELL = "import sys; from struck.__main__ import main; sys.exit(main())"
COMMAND = ["analyze", "egg.stl", "--material", "steel", "--accuracy", "preview", "--quiet"]
STAGES = 6  # surface, filling and modes, both coarse and fine, and model


@dataclass(frozen=True)
class Analysis:
    """One command of the shell, to be run again and again on one cache."""

    folder: Path
    cache: Path

    @property
    def model(self) -> Path:
        return self.folder / "egg.struck"

    def start(self, output: str = "egg.struck") -> subprocess.Popen[str]:
        """Run it in a process of its own, to be killed."""
        return subprocess.Popen(
            [sys.executable, "-c", SHELL, *COMMAND, "-o", output],
            cwd=self.folder,
            env={**os.environ, "STRUCK_CACHE": str(self.cache)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self) -> tuple[int, str]:
        """Run it in this process, which has imported all; return its status and its errors."""
        errors = io.StringIO()
        with (
            pytest.MonkeyPatch.context() as patch,
            redirect_stdout(io.StringIO()),
            redirect_stderr(errors),
        ):
            patch.chdir(self.folder)
            patch.setenv("STRUCK_CACHE", str(self.cache))
            status = main([*COMMAND, "-o", self.model.name])
        return status, errors.getvalue()

    def entries(self) -> dict[str, int]:
        """Return all entries, each with the number that the disk gave it when it was written."""
        listed = Cache(self.cache).entries()
        return {entry.path.name: entry.path.stat().st_ino for entry in listed}

    def require_sound(self, finished: dict[str, int]) -> None:
        """Check that what was finished is whole and was not written again."""
        entries = self.entries()
        assert finished.items() <= entries.items()
        assert all(Cache(self.cache).get(key) is not None for key in entries)  # a warning raises
        if self.model.exists():
            model_file.load(self.model)

    def require_finished(self, process: subprocess.Popen[str] | None = None) -> None:
        """Check that a process, or a run of this one, comes to the end and leaves no part."""
        if process is None:
            assert self.run() == (0, "")
        else:
            _, errors = process.communicate()
            assert (process.returncode, errors) == (0, "")
        assert len(self.entries()) == STAGES
        hidden = [*self.folder.glob(".*"), *self.cache.glob(".*")]
        assert not hidden


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that takes about a second; its three modes lie at the upper end of the band."""
    path = tmp_path_factory.mktemp("body") / "egg.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=0.05).apply_scale([1, 1.2, 1.4]).export(path)
    return path


def prepared(body: Path, folder: Path) -> Analysis:
    folder.mkdir()
    (folder / body.name).write_bytes(body.read_bytes())
    return Analysis(folder=folder, cache=folder / "cache")


@pytest.fixture(scope="module")
def undisturbed(body: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, set[str]]:
    """The model file and the names of the entries of a run that nobody disturbs."""
    analysis = prepared(body, tmp_path_factory.mktemp("undisturbed") / "run")
    analysis.require_finished()
    return analysis.model.read_bytes(), set(analysis.entries())


def killed(process: subprocess.Popen[str], seconds: float) -> bool:
    """Kill a process after so many seconds; tell whether it was still running then."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return True
    return False


def ended_at_stage(analysis: Analysis, process: subprocess.Popen[str], count: int) -> bool:
    """Wait until so many stages are kept; tell whether the process ended before."""
    while len(analysis.entries()) < count:
        if process.poll() is not None:
            return True
        time.sleep(0.002)
    return False


@pytest.mark.parametrize(
    "kills",
    [
        pytest.param([(2, 0.2)], id="amid a stage", marks=pytest.mark.prove),
        pytest.param(
            [(count, 0.0) for count in range(1, STAGES)],
            id="at every stage",
            marks=pytest.mark.prove,
        ),
    ],
)
def test_kills_change_nothing(
    body: Path,
    tmp_path: Path,
    undisturbed: tuple[bytes, set[str]],
    kills: list[tuple[int, float]],
) -> None:
    """Kill when so many stages are kept, or at a random moment of so many seconds after that."""
    analysis = prepared(body, tmp_path / "run")
    finished: dict[str, int] = {}
    for (count, longest), share in zip(kills, np.random.default_rng(9).random(9), strict=False):
        process = analysis.start()
        assert not ended_at_stage(analysis, process, count)
        assert killed(process, share * longest)
        analysis.require_sound(finished)
        finished = analysis.entries()
    analysis.require_finished()
    analysis.require_sound(finished)
    assert analysis.model.read_bytes() == undisturbed[0]


def killed_and_finished(
    analysis: Analysis, delays: list[float], expected: tuple[bytes, set[str]]
) -> tuple[int, int]:
    """Kill once after each delay or until it ends; return the kills, and those with work done."""
    kills, resumed, finished = 0, 0, {}
    for delay in delays:
        process = analysis.start()
        if not killed(process, delay):
            break
        analysis.require_sound(finished)
        finished = analysis.entries()
        kills, resumed = kills + 1, resumed + bool(finished)
    else:
        process = analysis.start()
    analysis.require_finished(process)
    analysis.require_sound(finished)
    assert analysis.model.read_bytes() == expected[0]
    assert analysis.entries().keys() == expected[1]
    return kills, resumed


@pytest.mark.prove
def test_twenty_kills_at_random_moments_change_nothing(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, set[str]]
) -> None:
    """From the first moment to the last, on as many caches as that takes."""
    rng = np.random.default_rng(9)
    seconds = np.inf
    kills = resumed = runs = 0
    while kills < 20:
        runs += 1
        analysis = prepared(body, tmp_path / str(runs))
        delays = seconds * rng.uniform(0.2, 1.0, min(5, 20 - kills)) if runs > 1 else []
        start = time.perf_counter()
        done = killed_and_finished(analysis, list(delays), undisturbed)
        kills, resumed = kills + done[0], resumed + done[1]
        if not done[0]:  # so long it takes; the machine may have become faster since
            seconds = min(seconds, time.perf_counter() - start)
        assert runs <= 44
    assert resumed >= 2


@pytest.mark.prove
@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for other processes")
def test_control_c_keeps_what_is_finished_and_leaves_no_part(body: Path, tmp_path: Path) -> None:
    analysis = prepared(body, tmp_path / "run")
    process = analysis.start()
    assert not ended_at_stage(analysis, process, 2)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert (process.returncode, errors) == (130, "struck: interrupted\n")
    finished = analysis.entries()
    assert len(finished) in {2, 3}
    assert not [*analysis.cache.glob(".*"), *analysis.folder.glob(".*"), *tmp_path.glob("*.struck")]
    analysis.require_finished()
    analysis.require_sound(finished)


def agree(body: Path, folder: Path, expected: bytes, count: int) -> None:
    """Run so many at once on one cache."""
    analysis = prepared(body, folder)
    outputs = [f"{number}.struck" for number in range(count)]
    processes = [analysis.start(output) for output in outputs]
    told = [process.communicate()[1] for process in processes]
    assert [process.returncode for process in processes] == [0] * count
    assert told == [""] * count
    assert {(folder / output).read_bytes() for output in outputs} == {expected}
    assert len(analysis.entries()) == STAGES
    analysis.require_sound({})


@pytest.mark.prove
def test_eight_analyses_on_one_cache_agree(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, set[str]]
) -> None:
    agree(body, tmp_path / "run", undisturbed[0], 8)


@pytest.mark.prove
def test_a_damaged_cache_is_said_in_one_line_and_computed_again(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, set[str]]
) -> None:
    analysis = prepared(body, tmp_path / "run")
    analysis.cache.mkdir()
    for key in undisturbed[1]:
        (analysis.cache / key).write_bytes(b"not what it was")
    status, errors = analysis.run()
    assert status == 0
    assert re.fullmatch(r"struck: an entry of the cache .* is computed again\n", errors)
    assert analysis.model.read_bytes() == undisturbed[0]
    analysis.require_sound({})
    assert analysis.entries().keys() == undisturbed[1]
