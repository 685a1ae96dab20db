"""`struck export`: gains or mode shapes of a model as a file that other programs read."""

from __future__ import annotations

import argparse
from pathlib import Path

import struck
from struck.cli import Result
from struck.cli.options import place, refuse, select_options
from struck.errors import OptionError, counted, rounded
from struck.files.atomic import writable
from struck.files.model_file import SHAPES
from struck.files.sofa import CONVENTIONS
from struck.files.sofa_fields import export, left_out
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "vase.struck -o vase.sofa",
    "bell.struck -o bell.vtu",
    (
        "bell.struck -o bell.sofa --contacts rim top --listeners 1,0,0 0,1,0 "
        "--convention GeneralFIR-E --seconds 2"
    ),
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck export`."""
    parser.add_argument("model", help="model file")
    parser.add_argument(
        "--contacts",
        metavar="PLACE",
        nargs="+",
        action="extend",
        type=place,
        help="contacts: names or coordinates; default: all that were recorded",
    )
    parser.add_argument(
        "--listeners",
        metavar="X,Y,Z",
        nargs="+",
        action="extend",
        type=place,
        help="positions of the listeners, m; default: all that were recorded",
    )
    parser.add_argument(
        "--convention",
        help="GeneralTF-E (modal gains, default) or GeneralFIR-E (impulse responses)",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        help="length of the impulse responses, s; default: until a fall of 60 dB, at most 10 s",
    )
    parser.add_argument(
        "--rate", type=int, help="sample rate of the impulse responses, Hz (default: 48000)"
    )
    parser.add_argument("--title", default="", help="title, stored in the file")
    parser.add_argument("--author", default="", help="author, stored in the file")
    parser.add_argument("--licence", default="", help="licence, stored in the file")
    parser.add_argument(
        "-o",
        "--output",
        help="file to write: .sofa (gains) or .vtu (surface and mode shapes); default: MODEL.sofa",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck export`."""
    output = writable(
        options.output or Path(options.model).with_suffix(".sofa"),
        unlike=[options.model],
        endings=(".sofa", SHAPES),
        kind="files of a model's data",
    )
    if output.suffix.lower() == SHAPES:
        return _shapes(options, output)
    _require_places(options)
    listeners = options.listeners
    model = struck.load(options.model)
    convention = options.convention or CONVENTIONS[0]
    if convention == CONVENTIONS[0]:
        others, other = ("seconds", "rate"), CONVENTIONS[1]
        refuse(options, others, f"is of impulse responses: give --convention {other}")
    rate = 48_000 if options.rate is None else options.rate
    progress("writing gains", 0.0)
    lost_count = export(
        model,
        output,
        listeners=listeners,
        convention=convention,
        sample_rate=rate,
        **select_options(options, "contacts seconds title author licence"),
    )
    lost_note = [f"{counted(lost_count, 'mode')} at or above {rounded(rate / 2)} Hz left out"] * (
        lost_count > 0
    )
    return Result(
        [*lost_note, f"wrote {output}"],
        output=str(output),
        convention=convention,
        left_out=lost_count,
        without=list(left_out(model)),
    )


def _require_places(options: argparse.Namespace) -> None:
    """Refuse listeners that are no places, and contacts with commas between."""
    for item in options.listeners or ():
        if isinstance(item, str) or len(item) != 3:
            text = item if isinstance(item, str) else ",".join(map("{:g}".format, item))
            raise OptionError(f"--listeners {text}: give x,y,z of each, m, as 1,0,0 0,1,0")
    for item in options.contacts or ():
        if isinstance(item, str) and "," in item:
            raise OptionError(
                f"--contacts {item}: part them by blanks, as {item.replace(',', ' ')}"
            )


def _shapes(options: argparse.Namespace, output: Path) -> Result:
    """Write surface and mode shapes; options of SOFA files are refused."""
    of_sofa = ("contacts", "listeners", "convention", "seconds", "rate")
    others = (*of_sofa, "title", "author", "licence")
    refuse(options, others, f"is of SOFA files, and {output} is none: take another ending")
    model = struck.load(options.model)
    struck.save(model, output)
    count = len(model.frequencies)
    text = f"wrote {output}: surface and {count} mode shapes (kg^-1/2), without gains and decays"
    return Result(text, output=str(output), modes=count)
