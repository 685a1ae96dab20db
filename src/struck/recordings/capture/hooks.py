"""Programs that a measurement runs: one that moves a positioner, one that fires a solenoid."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from struck.errors import FileFormatError, RecordingError
from struck.recordings.manifests.toml_table import TomlTable

PLACES = ("name", "hit", "contact", "listener", "u", "v", "x", "y", "z")
"""What an argument may hold in braces."""
_BRACED = re.compile(r"\{(\w*)\}")
_SHOWN = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """Programs with their arguments, none where nothing is to be run.

    Parameters
    ----------
    move : tuple of str
        Run before the takes of each point, which wait for its end.
    strike : tuple of str
        Run in each take when the lead-in is over.
    timeout : float
        After which a program is ended, s.
    folder : Path
        Where they run.
    """

    move: tuple[str, ...] = ()
    strike: tuple[str, ...] = ()
    timeout: float = 60.0
    folder: Path = Path()

    def run(self, which: str, facts: Mapping[str, str]) -> None:
        """Run "move" or "strike", if there is such a program, and wait for its end.

        Parameters
        ----------
        which : str
        facts : mapping
            What `PLACES` are now: put into arguments for ``{name}``, and given as variables
            ``STRUCK_NAME``.

        Raises
        ------
        RecordingError
            When it cannot be started, fails or takes too long.
        """
        command = self.move if which == "move" else self.strike
        if not command:
            return
        arguments = [_BRACED.sub(lambda braced: facts.get(braced[1], ""), each) for each in command]
        variables = {f"STRUCK_{name.upper()}": value for name, value in facts.items()}
        with tempfile.TemporaryFile() as said:
            trouble = self._outcome(arguments, {**os.environ, **variables}, said)
            if trouble:
                raise RecordingError(
                    f"the program of hooks.{which}, {' '.join(arguments)}, {trouble}{_tail(said)}; "
                    "what is recorded stays: mend it and start again to go on from here"
                )

    def _outcome(self, arguments: list[str], environment: dict[str, str], said: IO[bytes]) -> str:
        """Run a program; return what went wrong."""
        program = self._located(arguments[0])
        try:
            process = subprocess.Popen(  # noqa: S603 - what the plan says, without a shell
                [program, *arguments[1:]],
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,
            )
        except OSError as error:
            return f"cannot be started: {error.strerror or error}"
        try:
            code = process.wait(self.timeout)
        except subprocess.TimeoutExpired:
            return f"did not end within {self.timeout:g} s (hooks.timeout)"
        finally:
            _end(process)
        return f"ended with exit code {code}" if code else ""

    def _located(self, program: str) -> str:
        """Return a program given with folders as seen from the plan, another as it is."""
        return program if Path(program).name == program else str(self.folder / program)


def read_hooks(table: TomlTable, folder: Path) -> Hooks:
    """Return the programs that a table tells, to be run in a folder.

    Raises
    ------
    FileFormatError
        When arguments hold unknown words in braces, or the table what is unknown.
    """
    hooks = Hooks(
        move=table.texts("move"),
        strike=table.texts("strike"),
        timeout=table.number("timeout", 0.01, 86_400, 60.0),
        folder=folder,
    )
    table.require_known()
    for argument in (*hooks.move, *hooks.strike):
        for name in _BRACED.findall(argument):
            if name not in PLACES:
                raise FileFormatError(
                    f"{table.name}: {{{name}}} is not known: give one of "
                    f"{', '.join(f'{{{each}}}' for each in PLACES)}"
                )
    return hooks


def facts_of(
    name: str, hit: int, contact: Sequence[float], listeners: Sequence[Sequence[float]]
) -> dict[str, str]:
    """Return what programs are told: numbers as text; x, y, z of the first channel's listener."""
    axes = [*zip("uv", contact, strict=False)]
    if listeners:
        axes += zip("xyz", listeners[0], strict=True)
    return {
        "name": name,
        "hit": str(hit),
        "contact": ",".join(map(repr, contact)),
        "listener": ";".join(",".join(map(repr, place)) for place in listeners),
        **{axis: repr(value) for axis, value in axes},
    }


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a program that still runs, and all that it started."""
    if process.poll() is not None:
        return
    if os.name == "nt":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _tail(said: IO[bytes]) -> str:
    """Return the last of what a program wrote to its standard error."""
    said.seek(0, os.SEEK_END)
    said.seek(max(0, said.tell() - _SHOWN))
    text = " ".join(said.read().decode(errors="replace").split())
    return f": {text}" if text else ""
