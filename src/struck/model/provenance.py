"""Provenance of a result (method, versions, losses, papers), and progress while it is made."""

from __future__ import annotations

import html
import sys
import time
import tomllib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any

from struck.errors import ArgumentError, counted, printable


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Method, references and details of a result.

    Parameters
    ----------
    method : str, default ""
        Method, in one line.
    references : tuple of str, default ()
        Keys in ``references.toml`` of the methods that were used, in order.
    dropped : tuple of str, default ()
        Sentences on what was left out, with its count.
    details : mapping, optional
        Further figures (nodes, lattice, residual, versions ...), as JSON values.
    """

    method: str = ""
    references: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        texts = (self.method, *self.references, *self.dropped)
        if not all(isinstance(text, str) for text in texts) or isinstance(self.references, str):
            raise ArgumentError(f"provenance holds {texts!r}: give a method, references and losses")
        if not isinstance(self.details, Mapping):
            raise ArgumentError(
                f"details are {self.details!r}: give a mapping, as {{'nodes': 1200}}"
            )
        # A file of a newer version may name papers that this one does not know.
        known = bibliography()
        unknown = [key for key in self.references if key not in known]
        if unknown:
            known_references = tuple(key for key in self.references if key in known)
            object.__setattr__(self, "references", known_references)
            count = counted(len(unknown), "reference")
            note = f"{count}, unknown to this version: {', '.join(unknown)}"
            object.__setattr__(self, "dropped", (*self.dropped, note))

    def extended(
        self, *, references: tuple[str, ...] = (), dropped: tuple[str, ...] = (), **details: object
    ) -> Provenance:
        """Return a copy with more references, losses and details.

        Parameters
        ----------
        references : tuple of str, optional
            Keys of references; known ones are not repeated.
        dropped : tuple of str, optional
            Sentences on what was left out.
        **details : object
            Further details by name.

        Returns
        -------
        Provenance
            The copy.
        """
        new_references = tuple(key for key in references if key not in self.references)
        return replace(
            self,
            references=self.references + new_references,
            dropped=self.dropped + dropped,
            details={**self.details, **details},
        )

    def cite(self) -> str:
        """List the papers behind this result.

        Returns
        -------
        str
            One reference per line.
        """
        return "\n".join(bibliography()[key] for key in self.references)


@cache
def table_of(room: str, name: str) -> Mapping[str, Any]:
    """Return the table ``<name>.toml`` that lies in a room, as "struck.model"."""
    text = (resources.files(room) / f"{name}.toml").read_text(encoding="utf-8")
    return MappingProxyType(tomllib.loads(text))


def bibliography() -> Mapping[str, str]:
    """Return every reference that struck may cite, by key."""
    return table_of("struck.model", "references")


Progress = Callable[[str, float], None]  # takes a stage of long work and the fraction done
_FIRST_DELAY = 2.0  # s to a first line
_INTERVAL = 10.0  # s between lines
_REDRAW_INTERVAL = 0.2  # s between bars
FORECAST = "forecast: "  # begins a stage that tells what all of the work takes


class ForecastStage(str):
    """Text of the stage that forecasts time and memory, bytes, of the whole work."""

    __slots__ = ("memory",)

    @classmethod
    def of(cls, cost: object, memory: float) -> ForecastStage:
        """Return the stage that announces a cost in words."""
        stage = cls(f"{FORECAST}{cost}")
        stage.memory = memory
        return stage


def silent(_stage: str, _fraction: float) -> None:
    """Show no progress."""


def shown(_stage: str, _fraction: float) -> None:
    """Take the place of a progress of each work's own, which `reported` begins."""


def reported(progress: Progress | None) -> Progress:
    """Return the function that shows one work's progress: silent for None, else a bar or lines.

    In a notebook that is a bar, elsewhere a line on stderr after two seconds and each ten more.
    """
    if progress is not shown:
        return progress or silent
    return NotebookProgress() if _in_notebook() else TerminalProgress(lines=True)


class TerminalProgress:
    """One line on a terminal: the stage, the share that is done, and the time left.

    Where there is no terminal, or with `lines`, a line after 2 s and each 10 s more;
    `quiet`, nothing.
    """

    def __init__(self, *, lines: bool = False, quiet: bool = False) -> None:
        self._is_quiet = quiet
        self._stream = sys.stderr
        self._on_terminal = self._stream.isatty() and not (lines or quiet)
        self._stage, self._start = "", time.monotonic()
        self._last_shown = self._start + _FIRST_DELAY - _INTERVAL

    def __call__(self, stage: str, fraction: float) -> None:
        """Show a stage and the fraction of it that is done."""
        if self._is_quiet:
            return
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._start = stage, now
        text = f"{printable(stage)}{_format_progress(fraction, now - self._start)}"
        if self._on_terminal:
            ending = "\n" if stage.startswith(FORECAST) else ""
            self._stream.write(f"\r\x1b[K{text}{ending}")
        elif now - self._last_shown >= _INTERVAL:
            self._last_shown = now
            with suppress(OSError, ValueError):  # closed by who started us
                self._stream.write(f"struck: {text}\n")
        else:
            return
        with suppress(OSError, ValueError):
            self._stream.flush()

    def close(self) -> None:
        """Clear the line."""
        if self._on_terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


class NotebookProgress:
    """A bar below the cell of a notebook, with the stage and the time left."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._stage, self._start = "", time.monotonic()
        self._last_shown = 0.0

    def __call__(self, stage: str, fraction: float) -> None:
        """Show a stage and the fraction of it that is done, five times a second at most."""
        now = time.monotonic()
        if stage == self._stage and now - self._last_shown < _REDRAW_INTERVAL and fraction < 1:
            return
        if stage != self._stage:
            self._stage, self._start = stage, now
        self._last_shown = now
        text = html.escape(f"{stage}{_format_progress(fraction, now - self._start)}")
        bar = {"text/html": f'<progress value="{fraction:.3f}"></progress> {text}'}
        bar["text/plain"] = text
        if self._handle is None:
            display: Any = sys.modules["IPython.display"]
            self._handle = display.display(bar, raw=True, display_id=True)
        else:
            self._handle.update(bar, raw=True)


def _in_notebook() -> bool:
    """Return whether a kernel of IPython runs this, which shows HTML."""
    ipython: Any = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython and "IPython.display" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


def _format_progress(fraction: float, elapsed_time: float) -> str:
    """Return the percentage done and, once it can be estimated, the time that is left."""
    if not fraction:
        return ""
    seconds_left = elapsed_time * (1 / fraction - 1)
    is_known = 0.02 <= fraction < 1 and seconds_left >= 1
    return f" {100 * fraction:3.0f} %" + (f", about {seconds_left:.0f} s left" if is_known else "")
