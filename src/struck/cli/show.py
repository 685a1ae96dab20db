"""`struck show`: a picture of a model."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli import Result
from struck.files.atomic import writable
from struck.model.provenance import TerminalProgress

EXAMPLES = ("bell.struck -o bell.png", "bell.struck --field brightness")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck show`."""
    parser.add_argument("model")
    parser.add_argument("-o", "--output", help="picture; MODEL.png unless given")
    parser.add_argument(
        "--field", help="of a timbre field: number of a mode for its directivity, or brightness"
    )


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck show`."""
    output = writable(
        options.output or Path(options.model).with_suffix(".png"), unlike=[options.model]
    )
    field = int(options.field) if (options.field or "").isdigit() else options.field
    struck.show(struck.load(options.model), output, field=field)
    return Result(f"wrote {output}", output=str(output))
