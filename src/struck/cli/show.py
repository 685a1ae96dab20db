"""`struck show`: a picture of a model."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import struck
from struck.cli import Result
from struck.cli.options import length, place, refuse
from struck.errors import COUNTED, OptionError, nearest
from struck.files.atomic import writable
from struck.model.chart import Chart
from struck.model.provenance import TerminalProgress
from struck.recordings import read_plan
from struck.report import grid_picture
from struck.report.charts import PICTURES, save
from struck.report.model_pictures import BRIGHTNESS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXAMPLES = (
    "bell.struck -o bell.png",
    "bell.struck --strike rim",
    "bell.struck --modes 9",
    "plate.struck --nodal-lines 9",
    "bell.struck --field brightness",
    "bell.struck --energy",
    "plan.toml --pitch 0.3",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck show`."""
    parser.add_argument("model", help="model file, or the .toml plan of a measurement")
    parser.add_argument("-o", "--output", help="picture file; default: MODEL.png")
    parser.add_argument(
        "--field",
        help="draw a timbre field: the directivity of a mode, by its number from 1, or brightness",
    )
    parser.add_argument(
        "--strike",
        metavar="PLACE",
        type=place,
        help="draw the motion of the surface after a strike at PLACE",
    )
    parser.add_argument(
        "--modes", type=count_of_modes, metavar="N", help="draw the first N mode shapes"
    )
    parser.add_argument(
        "--nodal-lines",
        type=count_of_modes,
        metavar="N",
        help="draw the nodal lines of the first N modes",
    )
    parser.add_argument(
        "--energy",
        action="store_true",
        help="draw the radiation efficiency of the modes, and the energy that they lose as sound",
    )
    parser.add_argument(
        "--pitch",
        type=length,
        help="metres per unit of the contacts of a plan, if their names give no unit",
    )


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck show`."""
    output = writable(
        options.output or Path(options.model).with_suffix(".png"),
        unlike=[options.model],
        endings=PICTURES,
        kind="pictures",
    )
    planned = Path(options.model).suffix == ".toml"
    others = ("field", "strike", "modes", "nodal_lines", "energy") if planned else ("pitch",)
    refuse(options, others, f"is for a {'model' if planned else 'plan'}: give one")
    if planned:
        save(_planned(options.model, options.pitch), output)
        return Result(f"wrote {output}", output=str(output))
    strike = None if options.strike is None else struck.Strike(at=options.strike)
    model = struck.load(options.model)
    struck.show(
        model,
        output,
        field=_field(options.field, len(model.frequencies)),
        strike=strike,
        modes=options.modes,
        nodal_lines=options.nodal_lines,
        energy=options.energy,
    )
    return Result(f"wrote {output}", output=str(output))


def count_of_modes(text: str) -> int:
    """Return how many modes are meant, at least 1."""
    with suppress(ValueError):
        if int(text) >= 1:
            return int(text)
    raise argparse.ArgumentTypeError(f"it is {text!r}: give a whole number; {COUNTED}")


def _field(text: str | None, count: int) -> int | str | None:
    """Return the index, from 0, of the mode with a number, from 1; or the word for brightness."""
    if text is None or text == BRIGHTNESS:
        return text
    with suppress(ValueError):
        if 1 <= int(text) <= count:
            return int(text) - 1
    raise OptionError(
        f"--field is {text}: {nearest(text, [BRIGHTNESS])}give a mode's number, up to {count}, or "
        f"{BRIGHTNESS}; {COUNTED}"
    )


def _planned(path: str, pitch: float | None) -> Figure:
    """Draw the contacts and listeners of a capture plan."""
    plan = read_plan(path)
    points = list(plan.every())
    contacts = np.array(list(dict.fromkeys(point.contact for point in points)), np.float64)
    names = plan.coordinates or ("u", "v")[: contacts.shape[1]]
    centre = np.array(plan.centre) if plan.symmetry == "axial" else None
    pitches = None if pitch is None else np.full(contacts.shape[1], pitch)
    chart = Chart.of(names, pitch=pitches, geometry=None, round_about=centre)
    listeners = list(dict.fromkeys(place for point in points for place in point.listeners))
    if not listeners:
        raise OptionError(f"{path} names no listeners: give some, there is nothing to draw")
    return grid_picture(chart.places(contacts), np.array(listeners))
