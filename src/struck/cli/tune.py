"""`struck tune`: the dimension that makes a body ring at a frequency."""

from __future__ import annotations

import argparse

import struck
from struck.cli import Result
from struck.cli.options import MATERIAL, body_named, material_named
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium --vary length --lowest 587.33",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck tune`."""
    parser.add_argument("body", help="tube:length=0.5,radius=0.0125,wall=0.001")
    parser.add_argument("--material", required=True, help=MATERIAL)
    parser.add_argument("--vary", required=True, help="name of the dimension")
    parser.add_argument("--lowest", type=float, required=True, help="Hz")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck tune`."""
    body = struck.tune(
        body_named(options.body),
        material_named(options.material),
        vary=options.vary,
        lowest=options.lowest,
        accuracy=options.accuracy,
        progress=progress,
    )
    value = getattr(body, options.vary)
    return Result(f"{options.vary} = {value:.7g}", **{options.vary: value})
