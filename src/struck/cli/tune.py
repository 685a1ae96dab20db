"""`struck tune`: the dimension that makes a body ring at a frequency."""

from __future__ import annotations

import argparse
import re

from struck.analysis import tune
from struck.cli import Result
from struck.cli.options import BODY, MATERIAL, maker_named, material_of, pitch, select_options
from struck.errors import OptionError
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium --vary length --lowest 587.33",
    "bar:length=30cm,width=3cm,thickness=5mm --material rosewood --vary length --lowest A4",
    "block:size=30cmx3cmx2cm --material rosewood --vary length --frequency A6 --mode 'bending 2'",
    "bowl:radius=8cm,wall=2mm --material bronze --vary radius --lowest A4",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck tune`."""
    parser.add_argument("body", help=BODY)
    parser.add_argument("--material", required=True, help=MATERIAL)
    parser.add_argument(
        "--vary",
        required=True,
        help="dimension to change, by name; for a block: length, width or height",
    )
    parser.add_argument(
        "--note",
        "--lowest",
        dest="lowest",
        type=one_pitch,
        help="target frequency of the lowest mode: Hz, or a note such as A5",
    )
    parser.add_argument(
        "--frequency", type=one_pitch, help="target frequency of the mode of --mode: Hz, or a note"
    )
    parser.add_argument(
        "--mode",
        default="1",
        help="mode to tune: its number from 1 (default), or a family, e.g. 'bending 2' or torsion",
    )
    parser.add_argument(
        "--accuracy", help="accuracy for solids: preview, standard (default) or fine"
    )


def one_pitch(text: str) -> float:
    """Return a frequency in Hz; a list of several is refused."""
    if len(notes := [note for note in re.split(r"[,;\s]+", text) if note]) > 1:
        raise argparse.ArgumentTypeError(
            f"it is {text!r}: one body is tuned at a time, so run struck tune once for each note, "
            f"as {notes[0]}"
        )
    return pitch(text)


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck tune`."""
    body = maker_named(options.body)
    if isinstance(body, str):
        kind, mesh = ("model", "its mesh") if body.endswith(".struck") else ("mesh file", "it")
        raise OptionError(
            f"{body} is a {kind}, which has no dimensions to vary: give a body as "
            f"bowl:radius=8cm (struck analyze --list), or analyze {mesh} at another --size"
        )
    arguments = select_options(options, "vary lowest frequency mode accuracy")
    tuning = tune(body, material_of(options.material), **arguments, progress=progress)
    (old_value, old_frequency), (value, new_frequency) = tuning.before, tuning.after
    return Result(
        [f"{options.vary} = {value:.7g}", str(tuning)],
        **{options.vary: value},
        before=old_value,
        mode=tuning.mode,
        frequency=new_frequency,
        frequency_before=old_frequency,
    )
