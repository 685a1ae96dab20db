"""The shell as a whole: what its help needs, and that each command explains itself."""

from __future__ import annotations

import subprocess
import sys

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
