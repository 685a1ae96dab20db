"""`struck analyze`: a body and a material become a model file."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import struck
from struck.arguments import body_named, material_named, numbers
from struck.cli.command import Result, command
from struck.errors import OptionError
from struck.files.any_model import model_path
from struck.progress import TerminalProgress
from struck.shape_arguments import add_shape, shape_named
from struck.tables import HEADINGS, aligned, modes_rows

if TYPE_CHECKING:
    import numpy as np

    from struck.analysis.analysis import Source

LISTED = 20
MATERIAL = "name (see 'struck materials') or density=,youngs_modulus=,poisson_ratio="


def declare_analyze(commands: argparse._SubParsersAction) -> None:
    """Declare `struck analyze`."""
    parser = command(
        commands,
        _run_analyze,
        "analyze",
        "compute the modes of a body and save its model",
        "bell.stl --material bronze --units mm -o bell.struck",
        "--shape bar --length 0.3 --width 0.03 --thickness 0.005 --material steel -o bar.struck",
    )
    parser.add_argument(
        "body", nargs="?", help="mesh file, or tube:length=0.5,radius=0.0125,wall=0.001"
    )
    parser.add_argument("--material", required=True, help=MATERIAL)
    parser.add_argument("--damping", default="own", help="own (default) or heard")
    parser.add_argument("--units", help="of the file's numbers: m, cm, mm, in or ft")
    parser.add_argument("--size", type=float, help="longest edge of the body instead, m")
    parser.add_argument("--wall", type=float, help="thickness of a hollow body's or tube's wall, m")
    parser.add_argument("--no-repair", dest="repair", action="store_false", help="refuse instead")
    parser.add_argument("--part", help="which of several bodies in the file")
    parser.add_argument("--up", help="axis that points up: x, y or z")
    parser.add_argument("--fixed", type=numbers(6), help="box x0,y0,z0,x1,y1,z1 that is held, m")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")
    parser.add_argument("--band", type=numbers(2), default=(20.0, 20_000.0), help="low,high in Hz")
    parser.add_argument(
        "--radiation", default="power", help="power (default), obrien2002 or heuristic1998"
    )
    parser.add_argument("--method", help="formula (of shapes), fem (of all others) or obrien2002")
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="neither take up nor keep finished work",
    )
    parser.add_argument("-o", "--output", help="model file; BODY.struck unless given")
    add_shape(parser)


def _run_analyze(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    body, name = _body(options)
    read = [] if options.body is None else [options.body]
    output = model_path(options.output or f"{name}.struck", unlike=read)
    fixed = options.fixed and (options.fixed[:3], options.fixed[3:])
    same = ("units", "size", "repair", "part", "up", "accuracy", "cache", "radiation", "method")
    model = struck.analyze(
        body,
        material_named(options.material, options.damping),
        **{name: getattr(options, name) for name in same},
        wall=None if options.shape else options.wall,
        fixed=fixed,
        band=options.band,
        progress=progress,
    )
    struck.save(model, output)
    return described(model, f"wrote {output}", output=str(output))


def _body(options: argparse.Namespace) -> tuple[Source, str]:
    """Return the body, and what to call its model."""
    if (options.body is None) == (options.shape is None):
        raise OptionError(
            f"the body is {options.body!r} and --shape is {options.shape!r}: give one of them"
        )
    if options.shape is not None:
        return shape_named(options), options.shape
    return body_named(options.body), Path(options.body.partition(":")[0]).stem


def described(
    model: struck.ModalModel, last: str, *, listed: int = LISTED, **facts: object
) -> Result:
    """Return what a model holds, for people and machines, with a `last` line and more `facts`."""
    from struck.report.model_page import summary

    rows = modes_rows(model.frequencies, model.t60, model.decays, model.errors)
    more = [f"... and {len(rows) - listed} more"] if len(rows) > listed else []
    lines = [*summary(model), "", aligned([HEADINGS, *rows[:listed]]), *more, last]
    return Result(
        "\n".join(lines).rstrip(),
        frequencies=model.frequencies.tolist(),
        decays=model.decays.tolist(),
        errors=_or_null(model.errors),
        complete_to=model.complete_to,
        mass=model.mass,
        calibrated=model.calibrated,
        places=sorted(model.places),
        provenance={
            "method": model.provenance.method,
            "dropped": list(model.provenance.dropped),
            "references": list(model.provenance.references),
            "details": dict(model.provenance.details),
        },
        **facts,
    )


def _or_null(errors: np.ndarray | None) -> list[float | None] | None:
    """Return errors for JSON, which has no word for what is not a number."""
    if errors is None:
        return None
    return [error if math.isfinite(error) else None for error in errors.tolist()]
