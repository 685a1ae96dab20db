"""`struck analyze`: a body and a material become a model file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import struck
from struck.cli import Result
from struck.cli.info import describe_model
from struck.cli.options import (
    BAND,
    BODY,
    CORNERS,
    ENDS,
    MATERIAL,
    add_budget,
    add_cache,
    arguments_of,
    body_named,
    length,
    level,
    makers,
    material_of,
    metres,
    numbers,
    require_alone,
)
from struck.errors import OptionError
from struck.files.model_file import model_path
from struck.model.html import aligned
from struck.model.provenance import TerminalProgress

EXAMPLES = (
    "bell.stl --material bronze --units mm -o bell.struck",
    "bar:length=30cm,width=3cm,thickness=5mm --material steel -o bar.struck",
    "--list",
)


_SOUND_OPTIONS = (
    "radiation",
    "air",
    "recoil",
    "filled",
    "immersed",
    "air_mass",
    "method",
    "damping",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck analyze`."""
    parser.add_argument("body", nargs="?", help=BODY)
    parser.add_argument(
        "--list", action="store_true", help="list the bodies that need no file, and exit"
    )
    add_how(parser)
    add_budget(parser)
    parser.add_argument("-o", "--output", help="model file; default: BODY.struck")


def add_how(parser: argparse.ArgumentParser) -> None:
    """Add the options for elements, band and damping of an analysis to a parser."""
    parser.add_argument("--material", help=MATERIAL)
    parser.add_argument(
        "--damping", default="own", help="damping constants: own (default), heard or heard_bowl"
    )
    parser.add_argument(
        "--units",
        help="unit of the coordinates: m, cm, mm, in or ft; default: that of the file, otherwise m",
    )
    parser.add_argument(
        "--size",
        type=length,
        help="scale the body so that the longest edge of its bounding box has this length, m",
    )
    parser.add_argument(
        "--wall",
        type=length,
        help="wall thickness, m; for mesh files only (a tube: has its own wall=)",
    )
    parser.add_argument(
        "--holes",
        help="holes in a surface with a wall: keep or fill; default: keep round and straight-edged "
        "holes, fill the others",
    )
    parser.add_argument(
        "--no-repair",
        dest="repair",
        action="store_const",
        const=False,
        help="refuse a defective surface instead of repairing it",
    )
    parser.add_argument(
        "--repair-seconds",
        type=float,
        help="processor time for the repair, s; default: 10 for reading and repair together",
    )
    parser.add_argument(
        "--part", help="name or number of one body of the file; default: the largest"
    )
    parser.add_argument(
        "--up", help="axis that points up: x, y or z; default: that of the file format"
    )
    parser.add_argument(
        "--fixed",
        type=numbers(6, form="x0,y0,z0,x1,y1,z1 in m", convert=metres),
        help="clamped region: a box x0,y0,z0,x1,y1,z1, m",
    )
    parser.add_argument(
        "--accuracy", help="accuracy of the frequencies: preview, standard (default) or fine"
    )
    parser.add_argument(
        "--band", type=BAND, help="lowest,highest frequency, Hz or notes; default: 20,20000"
    )
    parser.add_argument(
        "--radiation",
        default="power",
        help="model of radiation: power (default), field, obrien2002 or heuristic1998",
    )
    parser.add_argument(
        "--no-air",
        dest="air",
        action="store_false",
        help="leave the losses to the air out of the decay rates",
    )
    parser.add_argument(
        "--no-recoil",
        dest="recoil",
        action="store_false",
        help="leave out the sound of a free body that is accelerated as a whole",
    )
    parser.add_argument(
        "--filled", type=length, help="level of the water inside a vessel, m; default: empty"
    )
    parser.add_argument(
        "--immersed",
        type=level,
        help="level of the water outside, m, or inf without a surface; default: none",
    )
    parser.add_argument(
        "--air-mass",
        action="store_true",
        help="include the mass of the air that a membrane or thin plate moves",
    )
    parser.add_argument(
        "--method",
        help="formula (default for shapes), fem (default for all others), obrien2002 or "
        "obrien2002-consistent",
    )
    add_cache(parser)


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck analyze`."""
    if options.list:
        require_alone(options, "list")
        return _listed()
    if str(options.body).endswith(".struck"):
        raise OptionError(
            f"{options.body} is a model, whose modes are known: struck info lists them and struck "
            "render lets it sound; give a mesh or a body as bowl:radius=8cm"
        )
    if options.body is None or options.material is None:
        raise OptionError(
            f"the body is {options.body or 'not given'} and its material "
            f"{options.material or 'not given'}: give both, as bowl:radius=8cm --material bronze"
        )
    body, name = body_named(options.body), Path(options.body.partition(":")[0]).stem
    output = model_path(options.output or f"{name}.struck", unlike=[options.body])
    material, more = material_of(options.material), analysis_options(options)
    model = struck.analyze(body, material, modes=options.modes, progress=progress, **more)
    struck.save(model, output)
    return describe_model(model, [f"wrote {output}"], output=str(output))


def _listed() -> Result:
    """Return the list of named bodies with the arguments of each."""
    arguments_by_kind = {kind: arguments_of(maker) for kind, maker in makers().items()}
    rows = [("body", "needs", "may be given")]
    rows += [
        (kind, ", ".join(needed), ", ".join(more))
        for kind, (needed, more) in arguments_by_kind.items()
    ]
    others = f"corners as {CORNERS}; diameter= in place of radius="
    return Result(
        [*aligned(rows), f"as {BODY}; two ends as bar:...,{ENDS}; {others}"],
        bodies={
            kind: {"needs": needed, "takes": more}
            for kind, (needed, more) in arguments_by_kind.items()
        },
    )


def analysis_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `add_how` as arguments of `struck.analyze`, without the material."""
    option_names = (
        "units",
        "size",
        "wall",
        "holes",
        "repair",
        "repair_seconds",
        "part",
        "up",
        "accuracy",
        "cache",
        "band",
    )
    surface_options = {name: getattr(options, name) for name in (*option_names, *_SOUND_OPTIONS)}
    return surface_options | {"fixed": options.fixed and (options.fixed[:3], options.fixed[3:])}
