"""The shell: the same verbs as in Python, one module a command."""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import TextIO

from struck.errors import CacheWarning, LossWarning, RepairWarning, ScaleWarning, StruckError
from struck.model.provenance import TerminalProgress

COMMANDS = {
    "analyze": "compute the modes of a body and save its model",
    "analyze-many": "compute the models of many mesh files, and a data set of their sounds",
    "radiate": "compute the timbre field of a model, which sounds another way on each side",
    "info": "tell what a model holds",
    "show": "draw shape, modes and spectrum",
    "render": "strike, scrape, roll on, pluck or hold a model and save the sound",
    "simulate": "let rigid bodies of a scene file move, and save what is heard of their contacts",
    "sound-map": "tell how few contacts of a body are enough, and where its timbre changes",
    "play": "play models with the keyboard, live",
    "explore": "open objects in the browser, where a click strikes them",
    "record": "record the takes that a plan asks for, and go on where it stopped",
    "fit": "make a model of recordings of one object",
    "compare": "tell how a model differs from a recording of the body, or from another model",
    "calibrate": "infer a material from recordings of a body and a model of its shape",
    "export": "write the gains of a model as a SOFA file",
    "tune": "find the dimension that makes a body ring at a frequency",
    "materials": "list materials with their sources",
    "cache": "show or clear the finished work kept between runs",
    "demo": "make a gallery of sounds and pictures",
}
UNWRITTEN = 1
BAD_INPUT = 2
SOME_FAILED = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0, 1 unwritten, 2 bad input, 3 if some failed."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who started us
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - open until the process ends
    try:
        options = _parser(words).parse_args(words)
    except SystemExit:
        if _told(""):  # help, which waits to be written
            return UNWRITTEN
        raise
    progress = TerminalProgress()
    try:
        with warnings_in_one_line():
            result = options.run(options, progress)
    except StruckError as error:
        progress.close()  # before what is said of it
        complain(str(error))
        return BAD_INPUT
    finally:
        progress.close()
    text = json.dumps(result.facts, indent=2) if options.json else result.text
    return _told(text + "\n") or result.code


def _told(text: str) -> int:
    """Print, and return the exit code: 0 also when the reader has gone, as `head` does."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        # What is left must not be tried again at the end of the process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            complain(f"the result cannot be written ({error.strerror}): free some space there")
            return UNWRITTEN
    return 0


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of the shell; of its commands only the one in `words` is imported."""
    parser = argparse.ArgumentParser(
        prog="struck", description="The sounds of physical objects, computed from what they are."
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    chosen = next((word for word in words if not word.startswith("-")), None)
    for name, about in COMMANDS.items():
        one = commands.add_parser(
            name,
            help=about,
            description=about,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name == chosen:
            declare(one, name)
    return parser


def declare(parser: argparse.ArgumentParser, name: str) -> None:
    """Give a parser the options, the examples and the work of the command of that name."""
    module = import_module(f"struck.cli.{name.replace('-', '_')}")
    parser.epilog = "example:\n" + "\n".join(f"  struck {name} {line}" for line in module.EXAMPLES)
    parser.add_argument("--json", action="store_true", help="print the result for machines")
    parser.set_defaults(run=module.run)
    module.declare(parser)


# What all commands have in common.


class Result:
    """What a command tells machines (`facts`) and people (`text`), and its exit code."""

    def __init__(self, text: str, **facts: object) -> None:
        self.text = text
        self.facts = facts
        self.code = 0


def complain(message: str) -> None:
    """Tell a person in one line, where there is anywhere to tell it."""
    with suppress(OSError):
        sys.stderr.write(f"struck: {message}\n")


_TOLD = (CacheWarning, LossWarning, RepairWarning, ScaleWarning)


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Tell what a person should know as the shell tells all: in one line, without code."""
    shown = warnings.showwarning

    def tell(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, _TOLD):
            complain(str(message))
        else:
            shown(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        for category in _TOLD:
            warnings.simplefilter("always", category)
        warnings.showwarning = tell
        yield
