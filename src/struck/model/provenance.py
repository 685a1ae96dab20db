"""Provenance of a result (method, versions, losses, papers), and progress while it is made."""

from __future__ import annotations

import sys
import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """How a result was made.

    Parameters
    ----------
    method : str
        What computed it, in one line.
    references : tuple of str
        Keys in ``references.toml`` of the methods really used, in order of use.
    dropped : tuple of str
        What was left out, one sentence each, with its count.
    details : mapping
        Figures a person would ask for (nodes, lattice, residual, versions ...); JSON values only.
    """

    method: str = ""
    references: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        texts = (self.method, *self.references, *self.dropped)
        if not all(isinstance(text, str) for text in texts) or isinstance(self.references, str):
            raise TypeError(f"provenance holds {texts!r}: give a method, references and losses")
        # A file of a newer version may name papers that this one does not know.
        known = bibliography()
        unknown = [key for key in self.references if key not in known]
        if unknown:
            kept = tuple(key for key in self.references if key in known)
            object.__setattr__(self, "references", kept)
            note = f"{len(unknown)} references, unknown to this version: {', '.join(unknown)}"
            object.__setattr__(self, "dropped", (*self.dropped, note))

    def extended(
        self, *, references: tuple[str, ...] = (), dropped: tuple[str, ...] = (), **details: object
    ) -> Provenance:
        """Return a copy with more references (each once), `dropped` losses and details."""
        fresh = tuple(key for key in references if key not in self.references)
        return replace(
            self,
            references=self.references + fresh,
            dropped=self.dropped + dropped,
            details={**self.details, **details},
        )

    def cite(self) -> str:
        """Return the papers behind this result, one a line."""
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


class TerminalProgress:
    """One line on a terminal: the stage, the share that is done, and the time left."""

    def __init__(self) -> None:
        self._stream = sys.stderr
        self._shown = self._stream.isatty()
        self._stage, self._begun = "", time.monotonic()

    def __call__(self, stage: str, fraction: float) -> None:
        """Show a stage and the fraction of it that is done."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._begun = stage, now
        if self._shown:
            kept = "\n" if stage.startswith(FORECAST) else ""
            self._stream.write(f"\r\x1b[K{stage}{_share(fraction, now - self._begun)}{kept}")
            self._stream.flush()

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def _share(fraction: float, passed: float) -> str:
    """Return the percentage done and, once it can be estimated, the time that is left."""
    if not fraction:
        return ""
    left = passed * (1 / fraction - 1)
    known = 0.02 <= fraction < 1 and left >= 1
    return f" {100 * fraction:3.0f} %" + (f", about {left:.0f} s left" if known else "")
