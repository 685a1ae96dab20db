"""`struck radiate`: a model gets its timbre field, computed by boundary elements."""

from __future__ import annotations

import argparse
import warnings

import struck
from struck.cli import Result
from struck.cli.options import BAND, add_cache, select_options
from struck.errors import OptionError, ScaleWarning, counted
from struck.files.model_file import model_path
from struck.model.provenance import TerminalProgress

EXAMPLES = ("bell.struck -o bell.struck", "bowl.struck --band 20,8000 --near -o bowl.struck")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck radiate`."""
    parser.add_argument("model", help="model file of a computed body")
    parser.add_argument(
        "-o", "--output", required=True, help="model file to write, which may be MODEL"
    )
    parser.add_argument(
        "--band",
        type=BAND,
        default=(20.0, 20_000.0),
        help="compute the modes in this band: lowest,highest, Hz or notes (default: 20,20000)",
    )
    parser.add_argument(
        "--near",
        action="store_true",
        help="store the pressure on the surface, for listeners within 1.2 radii",
    )
    add_cache(parser)


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck radiate`."""
    from struck.analysis.analysis import radiating

    output = model_path(options.output)
    arguments = select_options(options, "near cache")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScaleWarning)  # reported below
        model = radiating(struck.load(options.model), options.band, progress=progress, **arguments)
    left = [text for text in model.provenance.dropped if "timbre field" in text]
    modes = len(model.frequencies)
    if not model.gains.directional:
        lowest = f"the lowest lies at {model.frequencies.min():.0f} Hz" if modes else "it has none"
        raise OptionError(f"{left[-1]}; {lowest}: give another --band, or leave it as it is")
    struck.save(model, output)
    last = f"wrote {output}: {counted(modes, 'mode')}"
    return Result([last, *left], model=str(output), modes=modes)
