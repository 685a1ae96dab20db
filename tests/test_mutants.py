"""Thirty faults and more in physics, signal processing and files: a test notices each of them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
MUTANTS = tomllib.loads((ROOT / "tests/mutants.toml").read_text(encoding="utf-8"))["mutant"]
LONGEST = 300.0  # s: a fault may also never end


@cache
def sources() -> dict[Path, str]:
    """Return the text of each file of the sources."""
    kinds = (".py", ".c", ".h")
    files = sorted(path for path in (ROOT / "src").rglob("*") if path.suffix in kinds)
    return {path: path.read_text(encoding="utf-8") for path in files}


def holder(mutant: dict[str, Any]) -> Path:
    """Return the only file of the sources that holds what a mutant changes."""
    counts = {path: text.count(mutant["find"]) for path, text in sources().items()}
    assert sum(counts.values()) == 1, f"stands {sum(counts.values())} times: {mutant['find']!r}"
    return max(counts, key=counts.__getitem__)


def run(tests: list[str], folder: Path) -> int:
    """Return the exit code of tests of these sources; 1 where they do not come to an end."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", ""]
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    environment.pop("PYTEST_XDIST_WORKER", None)
    try:
        done = subprocess.run(
            [*command, *tests],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            timeout=LONGEST,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1
    return done.returncode


def test_every_mutant_changes_one_place() -> None:
    assert len(MUTANTS) >= 30
    assert len({mutant["name"] for mutant in MUTANTS}) == len(MUTANTS)
    for mutant in MUTANTS:
        holder(mutant)


def test_tests_of_mutants_exist() -> None:
    tests = {test.partition("[")[0] for mutant in MUTANTS for test in mutant["tests"]}
    missing = []
    for test in sorted(tests):
        name, _, function = test.partition("::")
        text = (ROOT / name).read_text(encoding="utf-8") if (ROOT / name).is_file() else ""
        missing += [] if f"def {function}" in text else [test]
    assert not missing


@pytest.mark.prove
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant["name"])
def test_mutant_is_caught(mutant: dict[str, Any], tmp_path: Path) -> None:
    path = holder(mutant)
    shutil.copytree(ROOT / "src", tmp_path / "src")  # compiled modules too: their dates are kept
    changed = tmp_path / path.relative_to(ROOT)
    text = changed.read_text(encoding="utf-8")
    changed.write_text(text.replace(mutant["find"], mutant["replace"]), encoding="utf-8")
    if path.suffix != ".py":
        build = tmp_path / "src/struck/core/build.py"
        subprocess.run([sys.executable, build], check=True, capture_output=True)
    assert run(mutant["tests"], tmp_path / "src") == 1  # failed: not missing, not misspelt


@pytest.mark.prove
def test_without_a_mutant_tests_pass() -> None:
    """One for all: make test and make prove run each of them without its fault."""
    assert run(MUTANTS[0]["tests"], ROOT / "src") == 0
