"""What all commands of the shell have in common."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from struck.errors import LossWarning, RepairWarning
from struck.files.cache import CacheWarning
from struck.model.provenance import TerminalProgress


class Result:
    """What a command tells machines (`facts`) and people (`text`)."""

    def __init__(self, text: str, **facts: object) -> None:
        self.text = text
        self.facts = facts


def command(
    commands: argparse._SubParsersAction,
    run: Callable[[argparse.Namespace, TerminalProgress], Result],
    name: str,
    about: str,
    *examples: str,
) -> argparse.ArgumentParser:
    """Declare a command and return its parser.

    Parameters
    ----------
    commands : action
        Of the parser of the whole shell.
    run : callable
        Does the work.
    name, about, *examples : str
        What people type, what they get, and the rest of lines that work.
    """
    lines = "\n".join(f"  struck {name} {example}" for example in examples)
    parser = commands.add_parser(
        name,
        help=about,
        description=about,
        epilog=f"example:\n{lines}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", action="store_true", help="print the result for machines")
    parser.set_defaults(run=run)
    return parser


_TOLD = (CacheWarning, LossWarning, RepairWarning)


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
            sys.stderr.write(f"struck: {message}\n")
        else:
            shown(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        for category in _TOLD:
            warnings.simplefilter("always", category)
        warnings.showwarning = tell
        yield
