"""Where a model came from: method, versions, what was dropped, and the papers behind it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources


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

    def extended(
        self,
        *,
        references: tuple[str, ...] = (),
        dropped: tuple[str, ...] = (),
        **details: object,
    ) -> Provenance:
        """Return a copy with more references (each once), losses and details."""
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
def bibliography() -> Mapping[str, str]:
    """Return every reference that struck may cite, by key."""
    text = resources.files("struck").joinpath("references.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
