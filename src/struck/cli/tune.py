"""`struck tune`: the dimension that makes a body ring at a frequency."""

from __future__ import annotations

import argparse
from typing import Any

import struck
from struck.cli import Result
from struck.cli.options import BODY, MATERIAL, body_named, material_named, pitch
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium --vary length --lowest 587.33",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck tune`."""
    parser.add_argument("body", help=BODY)
    parser.add_argument("--material", required=True, help=MATERIAL)
    parser.add_argument("--vary", required=True, help="name of the dimension")
    parser.add_argument("--lowest", type=pitch, required=True, help="Hz, or a note as A5")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck tune`."""
    asked: Any = body_named(options.body)  # which refuses what it cannot tune
    body = struck.tune(
        asked,
        material_named(options.material),
        vary=options.vary,
        lowest=options.lowest,
        accuracy=options.accuracy,
        progress=progress,
    )
    value = getattr(body, options.vary)
    return Result(f"{options.vary} = {value:.7g}", **{options.vary: value})
