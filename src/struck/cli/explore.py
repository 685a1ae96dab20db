"""`struck explore`: a room of objects in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli import Result
from struck.cli.options import names
from struck.errors import OptionError
from struck.model.provenance import TerminalProgress
from struck.processes.termination import orderly_end

EXAMPLES = ("bell.struck glass.struck", "--objects string,bell")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck explore`."""
    parser.add_argument(
        "models",
        nargs="*",
        metavar="MODEL",
        help="model files; default: a room of eighteen objects",
    )
    parser.add_argument(
        "--objects",
        type=names,
        metavar="NAME,...",
        help="objects of the room to compute, e.g. string,bell; default: all",
    )
    parser.add_argument(
        "--port", type=int, default=0, help="port on 127.0.0.1; default: a free one"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="print the address, but open no browser"
    )
    parser.add_argument("--seconds", type=float, help="stop after this time, s; default: at Ctrl-C")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck explore`."""
    if options.seconds is not None and not 0 <= options.seconds < float("inf"):
        raise OptionError(f"--seconds is {options.seconds}: it must be finite and at least 0")
    progress("reading models", 0.0)
    models = [struck.load(path) for path in options.models]
    progress.close()
    with (
        orderly_end(),
        struck.explore(
            models,
            names=[Path(path).stem for path in options.models],
            objects=options.objects,
            port=options.port,
            browser=not options.no_browser,
            wait=False,
        ) as explorer,
    ):
        explorer.wait(options.seconds)
    return Result("the room is closed", url=explorer.url)
