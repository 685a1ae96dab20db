"""What all commands of the shell have in common."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from struck.errors import CacheWarning, LossWarning, RepairWarning, ScaleWarning


class Result:
    """What a command tells machines (`facts`) and people (`text`)."""

    def __init__(self, text: str, **facts: object) -> None:
        self.text = text
        self.facts = facts


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
