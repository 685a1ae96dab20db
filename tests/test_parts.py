"""Parts of the proofs: each untimed proof is in exactly one, and CI runs one of four."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests import conftest
from tests.parts import SECONDS, part, part_of

ROOT = Path(__file__).parents[1]
WRONG = ["0/4", "5/4", "x", "", "4", "1/0", "1/4/4", "-1/4", "1.5/4", "٢/٤"]
NO_TESTS = pytest.ExitCode.NO_TESTS_COLLECTED


@pytest.mark.parametrize("text", WRONG)
def test_wrong_part_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="k/n with k from 1 to n, as in 1/4"):
        part(text)


def test_part_is_parsed() -> None:
    assert [part(f"{number}/4") for number in range(1, 5)] == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.fixture
def proofs(request: pytest.FixtureRequest) -> list[str]:
    """Return the untimed proofs, which only a run of all tests collects."""
    if {Path(path).resolve() for path in request.config.args} != {ROOT / "tests"}:
        pytest.skip("some files alone were collected: make test")
    return request.config.stash[conftest.PROOFS]


@pytest.mark.parametrize("parts", [1, 2, 4, 7])
def test_each_proof_is_in_one_part(proofs: list[str], parts: int) -> None:
    assert len(proofs) > 1000
    numbers = [part_of(conftest.group_of(proof), parts) for proof in proofs]
    assert set(numbers) == set(range(1, parts + 1))


def test_measured_seconds_are_of_proofs(proofs: list[str]) -> None:
    assert set(SECONDS) <= set(map(conftest.group_of, proofs))


def test_parts_take_equally_long() -> None:
    totals = [0.0] * 4
    for group, seconds in SECONDS.items():
        totals[part_of(group, 4) - 1] += seconds
    assert max(totals) < 1.05 * min(totals)


@pytest.fixture(scope="module")
def tests_of_three_kinds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of twelve files, each with a test, two proofs and a timed proof."""
    folder = tmp_path_factory.mktemp("kinds")
    (folder / "pytest.ini").write_text(
        "[pytest]\nmarkers = prove\n timed\naddopts = -m 'not prove'\n"
    )
    for number in range(12):
        (folder / f"test_{number}.py").write_text(
            "import pytest\n"
            "def test_sample(): pass\n"
            f"@pytest.mark.prove\ndef test_proof_{number}(): pass\n"
            "@pytest.mark.prove\n@pytest.mark.parametrize('x', [1, 2])\ndef test_other(x): pass\n"
            "@pytest.mark.prove\n@pytest.mark.timed\ndef test_time(): pass\n"
        )
    return folder


def collected(folder: Path, *options: str) -> tuple[int, list[str]]:
    """Return the exit code of pytest with options, and the tests that it selects."""
    names: list[str] = []

    class Names:
        def pytest_collection_finish(self, session: pytest.Session) -> None:
            names.extend(item.nodeid for item in session.items)

    command = ["--collect-only", "-q", f"--rootdir={folder}", "-c", f"{folder}/pytest.ini"]
    code = pytest.main([*command, *options, str(folder)], plugins=[conftest, Names()])
    return int(code), names


@pytest.mark.prove
def test_parts_hold_the_untimed_proofs_once(tests_of_three_kinds: Path) -> None:
    untimed = ("-m", "prove and not timed")
    _, proofs = collected(tests_of_three_kinds, *untimed)
    parts = [collected(tests_of_three_kinds, *untimed, "--part", f"{k}/4") for k in range(1, 5)]
    assert len(proofs) == 36
    assert all(code == 0 for code, _ in parts)
    assert sorted(name for _, names in parts for name in names) == sorted(proofs)
    assert collected(tests_of_three_kinds, *untimed, "--part", "2/4") == parts[1]


@pytest.mark.prove
def test_one_name_is_in_one_part(tests_of_three_kinds: Path) -> None:
    options = ("-m", "prove and not timed", "-k", "proof_7")
    parts = [collected(tests_of_three_kinds, *options, "--part", f"{k}/4") for k in range(1, 5)]
    assert sorted(parts) == [(0, ["test_7.py::test_proof_7"]), *[(NO_TESTS, [])] * 3]


def make(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run make for the proofs, apart from the run of make that may have started the tests."""
    passed = ("MAKE", "ONLY", "PART")
    environment = {name: os.environ[name] for name in os.environ if not name.startswith(passed)}
    command = ["make", "--no-print-directory", "-o", ".venv/test.stamp", "prove", *arguments]
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


def commands(*variables: str) -> list[str]:
    """Return the commands by which make runs the proofs, without running them."""
    return [" ".join(line.split()) for line in make("-n", *variables).stdout.splitlines()]


def test_make_passes_the_part() -> None:
    untimed, timed = commands()
    assert '-m "prove and not timed"' in untimed
    assert '-m "prove and timed"' in timed
    assert commands("PART=2/4") == [untimed.replace('timed"', 'timed" --part "2/4"')]
    (command,) = commands("PART=2/4", "ONLY=sphere")
    assert '--part "2/4" -k "sphere"' in command
    assert command.endswith("|| test $? -eq 5")  # a part may have no test of that name


def test_make_refuses_a_wrong_part() -> None:
    done = make("PART=5/4", "ONLY=sphere")
    assert done.returncode != 0
    assert "'5/4' is not a part of the proofs" in done.stderr


def surroundings(**changed: str) -> dict[str, str]:
    """Return the environment without what git has set, as it does for its hooks."""
    return {name: os.environ[name] for name in os.environ if not name.startswith("GIT_")} | changed


def git(folder: Path, *arguments: str) -> str:
    """Run git as the same author at the same time, so that hashes are the same too."""
    people = {
        f"GIT_{who}_{what}": "test" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    dates = {f"GIT_{who}_DATE": "1000000000 +0000" for who in ("AUTHOR", "COMMITTER")}
    settings = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    return subprocess.run(
        [shutil.which("git") or "git", *arguments],
        cwd=folder,
        env=surroundings(**people, **dates, **settings),
        check=True,
        capture_output=True,
        text=True,
    ).stdout


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_ci_runs_a_part_by_the_commit(tmp_path: Path) -> None:
    programs, source = tmp_path / "programs", tmp_path / "source"
    programs.mkdir()
    for name, text in (("make", 'echo "make $*"'), ("chromium", "")):
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    environment = surroundings(PATH=f"{programs}:{os.environ['PATH']}")

    def lines(folder: Path) -> list[str]:
        done = subprocess.run(
            [shutil.which("bash") or "bash", ".ci/run"],
            cwd=folder,
            env=environment,
            check=True,
            capture_output=True,
        )
        return done.stdout.decode().splitlines()

    def with_script(folder: Path) -> Path:
        (folder / ".ci").mkdir(parents=True)
        (folder / ".ci/run").write_text((ROOT / ".ci/run").read_text(encoding="utf-8"))
        return folder

    git(with_script(source), "init", "-q")
    parts = set()
    for number in range(12):
        git(source, "commit", "-q", "--allow-empty", "-m", f"Commit {number}")
        commit = git(source, "rev-parse", "HEAD").strip()
        expected = f"{int(commit[:7], 16) % 4 + 1}/4"
        first, *rest = lines(source)
        assert commit in first
        assert f"part {expected} of the proofs" in first
        assert rest == ["make check", "make test", f"make prove PART={expected}"]
        parts.add(expected)
    assert len(parts) == 4
    assert lines(source) == [first, *rest]  # a rerun
    git(tmp_path, "clone", "-q", "--depth", "1", source.as_uri(), "shallow")
    assert lines(with_script(tmp_path / "shallow")) == [first, *rest]
    assert lines(with_script(tmp_path / "no clone"))[-1] == "make prove PART=1/4"
