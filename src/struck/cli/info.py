"""`struck info`: what a model holds."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

import struck
from struck.cli.command import Result
from struck.model.html import HEADINGS, aligned, modes_rows
from struck.model.provenance import TerminalProgress

if TYPE_CHECKING:
    import numpy as np

LISTED = 20  # modes, unless asked for more or fewer
EXAMPLES = ("bell.struck",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck info`."""
    parser.add_argument("model")
    parser.add_argument("--modes", type=int, default=LISTED, help="how many to list")


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck info`."""
    model = struck.load(options.model)
    return described(model, "", listed=options.modes)


def described(
    model: struck.ModalModel, last: str, *, listed: int = LISTED, **facts: object
) -> Result:
    """Return what a model holds, for people and machines, with a `last` line and more `facts`."""
    from struck.report.model_page import summary

    rows = modes_rows(model.frequencies, model.t60, model.decays, model.errors)
    more = [f"... and {len(rows) - listed} more"] if len(rows) > listed else []
    lines = [*summary(model), "", aligned([HEADINGS, *rows[:listed]]), *more, last]
    return Result(
        "\n".join(lines).rstrip(),
        frequencies=model.frequencies.tolist(),
        decays=model.decays.tolist(),
        errors=_or_null(model.errors),
        complete_to=model.complete_to,
        mass=model.mass,
        calibrated=model.calibrated,
        places=sorted(model.places),
        provenance={
            "method": model.provenance.method,
            "dropped": list(model.provenance.dropped),
            "references": list(model.provenance.references),
            "details": dict(model.provenance.details),
        },
        **facts,
    )


def _or_null(errors: np.ndarray | None) -> list[float | None] | None:
    """Return errors for JSON, which has no word for what is not a number."""
    if errors is None:
        return None
    return [error if math.isfinite(error) else None for error in errors.tolist()]
