"""Any damaged file gets a result or one StruckError, within 10 s of processor time and 2 GB."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.fuzz.run import FAILURES, Outcome
from tests.fuzz.targets import TARGETS, share

ROOT = Path(__file__).parents[2]
SAMPLE, PROOF = 1_000, max(10_000, 205 * len(TARGETS))
UNCHANGEABLE = "cache entry"  # behind a checksum, so that no mutant is read


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What became of inputs, and what was printed about failures."""

    outcomes: list[Outcome]
    failures: str

    @property
    def mutants(self) -> list[Outcome]:
        return [outcome for outcome in self.outcomes if not outcome.file]


def run(count: int, folder: Path) -> Report:
    """Read the corpus and so many mutants; failures are saved in a folder."""
    program = [sys.executable, "-m", "tests.fuzz.run", "--json", "--save", str(folder)]
    done = subprocess.run(
        [*program, "--count", str(count)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    outcomes = [Outcome(**json.loads(line)) for line in done.stdout.splitlines()]
    assert outcomes, done.stderr
    return Report(outcomes=outcomes, failures=done.stderr)


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Report:
    return run(SAMPLE, tmp_path_factory.mktemp("failures"))


def test_a_thousand_damaged_files_and_all_that_ever_failed(sample: Report) -> None:
    assert len(sample.mutants) == SAMPLE
    assert not [outcome for outcome in sample.outcomes if outcome.has_failed], sample.failures
    # On two idle cores half of this by the clock.
    assert sum(outcome.seconds for outcome in sample.outcomes) <= 20


def test_every_seed_is_read(sample: Report) -> None:
    seeds = [each for each in sample.outcomes if "/seeds/" in each.file]
    assert len(seeds) == sum(len(target.seeds) for target in TARGETS.values())
    assert [each.file for each in seeds if each.answer != "read"] == []


def test_every_file_that_failed_has_a_line_on_how() -> None:
    lines = tomllib.loads(FAILURES.with_suffix(".toml").read_text(encoding="utf-8"))
    files = {path.relative_to(FAILURES).as_posix() for path in FAILURES.glob("*/*")}
    assert lines.keys() == files
    assert {name.partition("/")[0] for name in files} <= TARGETS.keys()
    assert all(lines.values())


def test_inputs_are_the_same_again_and_differ() -> None:
    for target in TARGETS.values():
        contents = [target.content(number) for number in range(12)]
        assert contents == [target.content(number) for number in range(12)]
        assert len({*contents}) > 6


@pytest.mark.parametrize("count", [SAMPLE, PROOF, 50_000])
def test_all_inputs_are_shared_out(count: int) -> None:
    shares = share(count)
    assert sum(shares.values()) == count
    assert min(shares.values()) >= (5 if count == SAMPLE else 200)


HOSTILE = """
import mmap, os, sys, time, warnings
from dataclasses import replace
from struck.errors import FileFormatError
from tests.fuzz import run, targets

def refuse(_): raise FileFormatError("a\\n\\x1b[31mb")
def fail(_): raise KeyError("x")
def warn(_): warnings.warn("x", RuntimeWarning)
def crash(_): os.abort()
def end(_): os._exit(0)
def hang(_):
    while True: pass
def wait(_): time.sleep(60)
def swell(_): bytearray(3 * 2**30)

names = {each.__name__: each for each in (refuse, fail, warn, crash, end, hang, wait, swell)}
names["read"] = len
like = targets.TARGETS["walk"]
targets.TARGETS.clear()
targets.TARGETS.update({name: replace(like, read=read) for name, read in names.items()})
targets.TARGETS["read"] = replace(like, read=str)
run.SECONDS, run._START, run._WALL, run.MEMORY = 0.1, 0.1, 3.0, 2**27
for outcome in run.run([run.Task(target=name, number=0) for name in targets.TARGETS]):
    print(outcome.target, outcome.answer, sep=": ")
"""


def test_what_is_no_answer_is_found(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HOSTILE],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    answers = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    expected = {
        "read": "read",
        "refuse": "refused",
        "fail": "KeyError: \"'x'\"",
        "warn": "RuntimeWarning: 'x'",
        "crash": "a crash (exit code -6)",
        "end": "a crash (exit code 0)",
        "hang": "more than 0.4 s of processor time",
        "wait": "no answer within 3.0 s",
        "swell": "MemoryError",
    }
    assert answers.keys() == expected.keys()
    for name, answer in expected.items():
        assert answer in answers[name]


@pytest.mark.prove
def test_ten_thousand_damaged_files(tmp_path: Path) -> None:
    report = run(PROOF, tmp_path)
    assert not [outcome for outcome in report.outcomes if outcome.has_failed], report.failures
    answers: dict[str, Counter[str]] = {name: Counter() for name in TARGETS}
    for outcome in report.mutants:
        answers[outcome.target][outcome.answer] += 1
    assert min(counts.total() for counts in answers.values()) >= 200
    # Else the changes would be too weak or too strong to show anything.
    assert all(counts["refused"] for counts in answers.values())
    assert [name for name, counts in answers.items() if not counts["read"]] == [UNCHANGEABLE]
    assert sum(outcome.seconds for outcome in report.outcomes) <= 2 * 12 * 60
