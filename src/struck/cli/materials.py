"""`struck materials`: the table of materials with their sources."""

from __future__ import annotations

import argparse

import struck
from struck.cli import Result
from struck.errors import rounded
from struck.model.html import aligned
from struck.model.provenance import TerminalProgress

EXAMPLES = ("--json",)


def declare(_parser: argparse.ArgumentParser) -> None:
    """Add no options: `struck materials` has none of its own."""


def run(_options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck materials`."""
    head = ("material", "kg/m3", "GPa", "Poisson", "tan phi", "heard")
    rows = [
        (
            name,
            f"{entry['density']:.0f}",
            rounded(entry["youngs_modulus"] / 1e9, 4),
            rounded(entry["poisson_ratio"], 3),
            rounded(entry["loss_tangent"], 2),
            "yes" if "heard" in entry else "",
        )
        for name, entry in struck.materials().items()
    ]
    return Result(
        aligned([head, *rows]), **{name: dict(e) for name, e in struck.materials().items()}
    )
