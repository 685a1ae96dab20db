"""Interruptions: whatever is killed and started again ends as if nothing had happened."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh

from struck.cache import Cache
from struck.files import model_file

SHELL = "import sys; from struck.cli import main; sys.exit(main())"
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
        material = ["--material", "steel", "--band", "20,25000", "--accuracy", "preview"]
        return subprocess.Popen(
            [sys.executable, "-c", SHELL, "analyze", "egg.stl", *material, "-o", output],
            cwd=self.folder,
            env={**os.environ, "STRUCK_CACHE": str(self.cache)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

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

    def require_finished(self, process: subprocess.Popen[str]) -> None:
        _, errors = process.communicate()
        assert (process.returncode, errors) == (0, "")
        assert len(self.entries()) == STAGES
        hidden = [*self.folder.glob(".*"), *self.cache.glob(".*")]
        assert not hidden


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that takes about a second."""
    path = tmp_path_factory.mktemp("body") / "egg.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=0.05).apply_scale([1, 1.2, 1.4]).export(path)
    return path


def prepared(body: Path, folder: Path) -> Analysis:
    folder.mkdir()
    (folder / body.name).write_bytes(body.read_bytes())
    return Analysis(folder=folder, cache=folder / "cache")


@pytest.fixture(scope="module")
def undisturbed(
    body: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[bytes, dict[str, int], float]:
    """The model file, the entries and the seconds of a run that nobody disturbs."""
    analysis = prepared(body, tmp_path_factory.mktemp("undisturbed") / "run")
    start = time.perf_counter()
    analysis.require_finished(analysis.start())
    seconds = time.perf_counter() - start
    return analysis.model.read_bytes(), analysis.entries(), seconds


def killed(process: subprocess.Popen[str], seconds: float) -> bool:
    """Kill a process after so many seconds; tell whether it was still running."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return True
    return False


def killed_and_finished(
    analysis: Analysis, delays: list[float], expected: tuple[bytes, dict[str, int], float]
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
    assert analysis.entries().keys() == expected[1].keys()
    return kills, resumed


def kills_at_random_moments(
    body: Path, folder: Path, expected: tuple[bytes, dict[str, int], float], wanted: int
) -> int:
    """Kill so many times, on as many caches as that takes; return after how many work was done."""
    rng = np.random.default_rng(9)
    seconds = expected[2]
    kills = resumed = runs = 0
    while kills < wanted:
        runs += 1
        analysis = prepared(body, folder / str(runs))
        delays = seconds * rng.uniform(0.2, 1.0, min(5, wanted - kills))
        done = killed_and_finished(analysis, delays.tolist(), expected)
        kills, resumed = kills + done[0], resumed + done[1]
        if not done[0]:
            seconds /= 2  # the machine has become faster since that was measured
        assert runs <= 2 * wanted + 10
    return resumed


def test_two_kills_at_random_moments_change_nothing(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    kills_at_random_moments(body, tmp_path, undisturbed, 2)


@pytest.mark.prove
def test_fifty_kills_at_random_moments_change_nothing(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    assert kills_at_random_moments(body, tmp_path, undisturbed, 50) >= 5


def ended_at_stage(analysis: Analysis, process: subprocess.Popen[str], count: int) -> bool:
    """Wait until so many stages are kept; tell whether the process ended before."""
    while len(analysis.entries()) < count:
        if process.poll() is not None:
            return True
        time.sleep(0.002)
    return False


def test_a_kill_after_every_stage_changes_nothing(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    analysis = prepared(body, tmp_path / "run")
    finished: dict[str, int] = {}
    for count in range(1, STAGES):
        process = analysis.start()
        assert not ended_at_stage(analysis, process, count)
        process.kill()
        process.communicate()
        analysis.require_sound(finished)
        finished = analysis.entries()
    analysis.require_finished(analysis.start())
    analysis.require_sound(finished)
    assert analysis.model.read_bytes() == undisturbed[0]


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
    analysis.require_finished(analysis.start())
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


def test_two_analyses_on_one_cache_agree(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    agree(body, tmp_path / "run", undisturbed[0], 2)


@pytest.mark.prove
def test_eight_analyses_on_one_cache_agree(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    agree(body, tmp_path / "run", undisturbed[0], 8)


def test_a_damaged_cache_is_said_in_one_line_and_computed_again(
    body: Path, tmp_path: Path, undisturbed: tuple[bytes, dict[str, int], float]
) -> None:
    analysis = prepared(body, tmp_path / "run")
    analysis.cache.mkdir()
    for key in undisturbed[1]:
        (analysis.cache / key).write_bytes(b"not what it was")
    process = analysis.start()
    _, errors = process.communicate()
    assert process.returncode == 0
    assert re.fullmatch(r"struck: an entry of the cache .* is computed again\n", errors)
    assert analysis.model.read_bytes() == undisturbed[0]
    analysis.require_sound({})
    assert analysis.entries().keys() == undisturbed[1].keys()
