"""The shell as a whole: what its help needs, and that each command explains itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from struck.cli import COMMANDS, main

LIGHT = """
import sys
from struck.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
print(*sorted({"numpy", "scipy"} & set(sys.modules)), file=sys.stderr)
"""


def test_help_of_the_shell_loads_neither_numpy_nor_scipy() -> None:
    done = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True, check=True)
    assert not done.stderr.split()
    assert all(name in done.stdout for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_shows_what_it_does_and_an_example(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main([name, "--help"])
    assert left.value.code == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert COMMANDS[name] in shown
    assert f"example: struck {name}" in shown
    assert "--json" in shown


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("closed") / "bar.struck"
    shape = "analyze bar:length=0.3,width=0.03,thickness=0.005 --material steel -o"
    assert main([*shape.split(), str(path)]) == 0
    return path


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize(
    ("words", "streams", "code", "told"),
    [
        ("info MODEL --json", ">/dev/full", 1, "cannot be written (No space left on device)"),
        ("info --help", ">/dev/full", 1, "cannot be written (No space left on device)"),
        ("info MODEL", ">&- 2>&-", 0, ""),
        ("info none", "2>/dev/full", 2, ""),
    ],
)
def test_full_and_closed_outputs_are_no_traceback(
    model: Path, words: str, streams: str, code: int, told: str
) -> None:
    command = f'"$0" -m struck {words.replace("MODEL", str(model))} {streams}'
    done = subprocess.run(
        ["/bin/sh", "-c", command, sys.executable], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    assert told in done.stderr
    assert len(done.stderr.splitlines()) == bool(told)


def test_a_reader_that_has_gone_is_no_traceback(model: Path) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    command = [sys.executable, "-m", "struck", "info", str(model)]
    done = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, check=False)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (0, b"")
