"""`struck demo`: the room of objects in a browser, or a gallery of sounds and pictures."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import struck
from struck.cli import Result
from struck.cli.options import names, refuse
from struck.model.provenance import TerminalProgress

EXAMPLES = ("--out gallery", "--out gallery --pieces string,tabla")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck demo`."""
    parser.add_argument(
        "--out", default="gallery", help="folder for the gallery (default: gallery)"
    )
    parser.add_argument(
        "--pieces",
        type=names,
        metavar="NAME,...",
        help="pieces of the gallery to make, e.g. string,tabla; default: all",
    )
    parser.add_argument(
        "--open",
        action="store_true",
        help="open the room of objects instead, if there are a terminal and a display",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck demo`."""
    from struck.explorer.server import has_display
    from struck.report.gallery import LIST, gallery

    if options.open and sys.stdin is not None and sys.stdin.isatty() and has_display():
        refuse(options, ("pieces",), "is of the gallery, and --open opens the room")
        explorer = struck.explore()
        return Result("the room is closed", page=explorer.url)
    page = gallery(Path(options.out), progress, pieces=options.pieces)
    return Result(
        [
            f"open {page.resolve()} in a browser to see and hear it",
            f"{page.with_name(LIST)} lists all that was made",
            "to strike objects in a browser: struck explore",
        ],
        page=str(page),
        made=str(page.with_name(LIST)),
    )
