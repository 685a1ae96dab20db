"""`struck show`: a picture of a model."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli.command import Result
from struck.files.atomic import writable
from struck.model.provenance import TerminalProgress

EXAMPLES = ("bell.struck -o bell.png",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck show`."""
    parser.add_argument("model")
    parser.add_argument("-o", "--output", help="picture; MODEL.png unless given")


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck show`."""
    output = writable(
        options.output or Path(options.model).with_suffix(".png"), unlike=[options.model]
    )
    struck.show(struck.load(options.model), output)
    return Result(f"wrote {output}", output=str(output))
