"""`struck demo`: a gallery of sounds and pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from struck.cli.command import Result
from struck.model.provenance import TerminalProgress

EXAMPLES = ("--out gallery",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck demo`."""
    parser.add_argument("--out", default="gallery", help="folder to make")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck demo`."""
    from struck.report.gallery import gallery

    page = gallery(Path(options.out), progress)
    return Result(f"open {page.resolve()} in a browser to see and hear it", page=str(page))
