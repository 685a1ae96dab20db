"""`struck export`: the gains of a model as a file that other programs read."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli import Result
from struck.cli.options import place
from struck.errors import OptionError
from struck.files.atomic import writable
from struck.files.sofa import CONVENTIONS
from struck.files.sofa_fields import export, left_out
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "vase.struck -o vase.sofa",
    (
        "bell.struck -o bell.sofa --contacts rim top --listeners 1,0,0 0,1,0 "
        "--convention GeneralFIR-E --seconds 2"
    ),
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck export`."""
    parser.add_argument("model")
    parser.add_argument(
        "--contacts",
        metavar="PLACE",
        nargs="+",
        action="extend",
        type=place,
        help="where it is struck: names, or coordinates; those recorded unless given",
    )
    parser.add_argument(
        "--listeners",
        metavar="X,Y,Z",
        nargs="+",
        action="extend",
        type=place,
        help="where it is heard, m; those recorded unless given (one below 0: --listeners=-1,0,0)",
    )
    parser.add_argument(
        "--convention",
        default=CONVENTIONS[0],
        help="GeneralTF-E (gains of modes, default) or GeneralFIR-E (impulse responses)",
    )
    parser.add_argument("--seconds", type=float, help="length of impulse responses")
    parser.add_argument("--rate", type=int, default=48_000, help="of impulse responses, Hz")
    parser.add_argument("--title", default="", help="what it is")
    parser.add_argument("--author", default="", help="who made it")
    parser.add_argument("--licence", default="", help="what others may do with it")
    parser.add_argument("-o", "--output", help="SOFA file; MODEL.sofa unless given")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck export`."""
    output = writable(
        options.output or Path(options.model).with_suffix(".sofa"),
        unlike=[options.model],
        endings=(".sofa",),
        kind="files of a model's data",
    )
    listeners = options.listeners
    for each in listeners or ():
        if isinstance(each, str) or len(each) != 3:
            raise OptionError(f"--listeners {each!r}: give x,y,z of each, m, as 1,0,0 0,1,0")
    model = struck.load(options.model)
    progress("export", 0.0)
    lost = export(
        model,
        output,
        contacts=options.contacts,
        listeners=listeners,
        convention=options.convention,
        seconds=options.seconds,
        sample_rate=options.rate,
        title=options.title,
        author=options.author,
        licence=options.licence,
    )
    beyond = [f"{lost} modes at or above {options.rate / 2:g} Hz are left out"] * (lost > 0)
    return Result(
        "\n".join([*beyond, f"wrote {output}"]),
        output=str(output),
        convention=options.convention,
        left_out=lost,
        without=list(left_out(model)),
    )
