"""Bodies of struck.shapes named in the shell."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from struck.errors import OptionError

if TYPE_CHECKING:
    from struck.shapes.shape import Shape

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
