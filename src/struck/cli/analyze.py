"""`struck analyze`: a body and a material become a model file."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import struck
from struck.cli import Result
from struck.cli.info import described
from struck.cli.options import MATERIAL, body_named, material_named, numbers
from struck.errors import OptionError
from struck.files.model_file import model_path
from struck.model.provenance import TerminalProgress

if TYPE_CHECKING:
    from struck.analysis.analysis import Source
    from struck.shapes.shape import Shape


# Bodies of struck.shapes named in the shell.

# What each shape takes: first what it needs, then what it may be given.
_TAKEN: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "string": (("length", "radius", "tension"), ("stiff",)),
    "bar": (("length", "width", "thickness"), ("ends", "theory")),
    "rod": (("length", "radius"), ("wall", "ends", "theory")),
    "rectangular-membrane": (("length", "width", "thickness", "tension"), ()),
    "circular-membrane": (("radius", "thickness", "tension"), ()),
    "annular-membrane": (("radius", "hole", "thickness", "tension"), ()),
    "l-membrane": (("side", "thickness", "tension"), ()),
    "polygon-membrane": (("corners", "thickness", "tension"), ()),
    "rectangular-plate": (("length", "width", "thickness"), ("ends",)),
    "circular-plate": (("radius", "thickness"), ("ends",)),
}
_LENGTHS = {
    "length": "along x, m",
    "width": "along y, m",
    "thickness": "along z, m",
    "radius": "m",
    "hole": "radius of an annular membrane's hole, m",
    "side": "of each of the three squares of an L, m",
    "tension": "N of a string, N/m of a membrane",
}


def add_shape(parser: argparse.ArgumentParser) -> None:
    """Add the options that name a body of struck.shapes."""
    group = parser.add_argument_group("bodies in closed form, in place of BODY")
    group.add_argument("--shape", choices=_TAKEN, metavar="SHAPE", help=", ".join(_TAKEN))
    for name, text in _LENGTHS.items():
        group.add_argument(f"--{name}", type=float, help=text)
    group.add_argument(
        "--ends",
        help="what holds a bar's ends or a plate's edges: free, clamped, hinged or sliding "
        "(bars), supported (plates); several with commas: clamped,free",
    )
    group.add_argument("--theory", help="of a bar: timoshenko (default) or euler-bernoulli")
    group.add_argument("--stiff", action="store_true", default=None, help="a string that resists")
    group.add_argument("--corners", type=_corners, help="of a polygon, m: 0,0 1,0 0.5,1", nargs="+")


def shape_named(options: argparse.Namespace) -> Shape:
    """Return the body that the options name.

    Raises
    ------
    OptionError
        When something it needs is missing, or something is given that it does not take.
    """
    needed, possible = _TAKEN[options.shape]
    every = {*_LENGTHS, "ends", "theory", "stiff", "corners", "wall"}
    given = {name: getattr(options, name) for name in every}
    given = {name: value for name, value in given.items() if value is not None}
    if not set(needed) <= set(given) <= {*needed, *possible}:
        wanted = " ".join(f"--{name} ..." for name in needed)
        more = "".join(f" [--{name} ...]" for name in possible)
        raise OptionError(
            f"--shape {options.shape} was given {', '.join(sorted(given)) or 'nothing'}: it takes "
            f"{wanted}{more}"
        )
    if "ends" in given:
        given["ends"] = _each(given["ends"])
    return _makers()[options.shape](**given)


def _makers() -> Mapping[str, Callable[..., Any]]:
    from struck import shapes

    def rod(*, length: float, radius: float, wall: float | None = None, **rest: Any) -> Any:  # noqa: ANN401  a shape's own arguments
        section = shapes.RoundSection(radius=radius, wall=wall)
        return shapes.Bar(length=length, section=section, **rest)

    def rectangular_plate(*, ends: Any = "free", **rest: float) -> Any:  # noqa: ANN401
        return shapes.RectangularPlate(edges=ends, **rest)

    def circular_plate(*, ends: Any = "free", **rest: float) -> Any:  # noqa: ANN401
        return shapes.CircularPlate(edge=ends, **rest)

    return {
        "string": shapes.String,
        "bar": shapes.Bar,
        "rod": rod,
        "rectangular-membrane": shapes.RectangularMembrane,
        "circular-membrane": shapes.CircularMembrane,
        "annular-membrane": shapes.AnnularMembrane,
        "l-membrane": shapes.PolygonMembrane.l_shape,
        "polygon-membrane": shapes.PolygonMembrane,
        "rectangular-plate": rectangular_plate,
        "circular-plate": circular_plate,
    }


def _each(text: str) -> str | tuple[str, ...]:
    parts = tuple(text.split(","))
    return parts[0] if len(parts) == 1 else parts


def _corners(text: str) -> tuple[float, float]:
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: give x,y in m") from None
    return x, y


EXAMPLES = (
    "bell.stl --material bronze --units mm -o bell.struck",
    "--shape bar --length 0.3 --width 0.03 --thickness 0.005 --material steel -o bar.struck",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck analyze`."""
    parser.add_argument(
        "body", nargs="?", help="mesh file, or tube:length=0.5,radius=0.0125,wall=0.001"
    )
    add_how(parser)
    parser.add_argument("-o", "--output", help="model file; BODY.struck unless given")
    add_shape(parser)


def add_how(parser: argparse.ArgumentParser, *, one: bool = True) -> None:
    """Declare how a body is analyzed; `one` needs its material."""
    parser.add_argument("--material", required=one, help=MATERIAL)
    parser.add_argument("--damping", default="own", help="own (default), heard or heard_bowl")
    parser.add_argument("--units", help="of the file's numbers: m, cm, mm, in or ft")
    parser.add_argument("--size", type=float, help="longest edge of the body instead, m")
    parser.add_argument("--wall", type=float, help="thickness of a hollow body's or tube's wall, m")
    parser.add_argument("--holes", help="of a surface with a wall: keep or fill")
    parser.add_argument("--no-repair", dest="repair", action="store_false", help="refuse instead")
    parser.add_argument("--part", help="which of several bodies in the file")
    parser.add_argument("--up", help="axis that points up: x, y or z")
    parser.add_argument("--fixed", type=numbers(6), help="box x0,y0,z0,x1,y1,z1 that is held, m")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")
    parser.add_argument("--band", type=numbers(2), help="low,high in Hz; 20,20000 unless given")
    parser.add_argument(
        "--radiation", default="power", help="power (default), field, obrien2002 or heuristic1998"
    )
    parser.add_argument(
        "--no-recoil", dest="recoil", action="store_false", help="modes alone, no click of the body"
    )
    parser.add_argument("--method", help="formula (of shapes), fem (of all others) or obrien2002")
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="neither take up nor keep finished work",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck analyze`."""
    body, name = _body(options)
    read = [] if options.body is None else [options.body]
    output = model_path(options.output or f"{name}.struck", unlike=read)
    given = how(options)
    if options.shape:
        given["wall"] = None  # which is the shape's own
    material = material_named(options.material, options.damping)
    model = struck.analyze(body, material, progress=progress, **given)
    struck.save(model, output)
    return described(model, f"wrote {output}", output=str(output))


def how(options: argparse.Namespace) -> dict[str, Any]:
    """Return what `add_how` declares as options of `struck.analyze`, but for the material."""
    same = ("units", "size", "wall", "holes", "repair", "part", "up", "accuracy", "cache", "band")
    given = {name: getattr(options, name) for name in (*same, "radiation", "recoil", "method")}
    return given | {"fixed": options.fixed and (options.fixed[:3], options.fixed[3:])}


def _body(options: argparse.Namespace) -> tuple[Source, str]:
    """Return the body, and what to call its model."""
    if (options.body is None) == (options.shape is None):
        raise OptionError(
            f"the body is {options.body!r} and --shape is {options.shape!r}: give one of them"
        )
    if options.shape is not None:
        return shape_named(options), options.shape
    return body_named(options.body), Path(options.body.partition(":")[0]).stem
