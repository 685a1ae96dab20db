"""Options of the shell that commands share: bodies, materials, listeners and the room."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from functools import partial
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Binaural, Listener, Mono, Stereo, ascending
from struck.ears.reverberation import Reverberation
from struck.ears.room import Room
from struck.errors import (
    COUNTED,
    ArgumentError,
    FileFormatError,
    MaterialError,
    OptionError,
    nearest,
)
from struck.files.atomic import is_file, read_bytes
from struck.model.arrays import UNITS, Array
from struck.model.damping import InternalFriction, Rayleigh, hertz
from struck.model.material import Material

if TYPE_CHECKING:
    from struck.analysis.discretisation import Solid
    from struck.shapes.shape import Shape

    Body = Solid | Shape

BODY = "mesh file, or e.g. tube:length=50cm,radius=0.0125,wall=1mm (see 'struck analyze --list')"
ENDS = "ends=clamped,free"
CORNERS = "0x0,0.3x0,0x0.2"
_FORMS = {"size": "0.1,0.05,0.03", "corners": CORNERS}  # of arguments of several numbers
_ONE_UNIT = re.compile(r"(?:[\d.]+[x,])+[\d.]+[a-z]+")  # for several lengths
_NOT_IN_SHELL = {"elements", "section"}
_LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*([a-z]+)?")
MATERIAL = (
    "name (see 'struck materials'), or density=...,youngs_modulus=...,poisson_ratio=... in kg/m3 "
    "and Pa, optionally with loss_tangent=..."
)


def numbers(
    *counts: int, form: str = "", convert: Callable[[str], float] = float
) -> Callable[[str], tuple[float, ...]]:
    """Return a parser of numbers separated by commas, as many as one of some counts."""
    expected_form = form or f"{' or '.join(map(str, counts))} numbers with commas between"

    def parse(text: str) -> tuple[float, ...]:
        with suppress(ValueError):
            values = tuple(map(convert, text.split(",")))
            if len(values) in counts:
                return values
        raise argparse.ArgumentTypeError(f"it is {text!r}: give {expected_form}")

    return parse


def metres(text: str) -> float:
    """Return a length in m of "0.1", "10cm" or "4in"; ValueError of other texts."""
    match = _LENGTH.fullmatch(text.strip())
    if match is None or (match[2] or "m") not in UNITS:
        raise ValueError(f"{text!r} is no length")
    return float(match[1]) * UNITS[match[2] or "m"]


def length(text: str) -> float:
    """Return the value of an option that is a length, m."""
    with suppress(ValueError):
        return metres(text)
    known = ", ".join(UNITS)
    raise argparse.ArgumentTypeError(f"it is {text!r}: give a length in m, or in {known}, as 5cm")


def level(text: str) -> float:
    """Return the value of an option that is a height, m, or infinite."""
    return math.inf if text.strip() == "inf" else length(text)


def budget(text: str) -> int | None:
    """Return at most how many modes are meant, None for all."""
    with suppress(ValueError):
        if text == "all" or int(text) >= 1:
            return None if text == "all" else int(text)
    raise argparse.ArgumentTypeError(
        f"it is {text!r}: give a whole number of at least 1, or all; {COUNTED}"
    )


def pitch(text: str) -> float:
    """Return a frequency in Hz, of "880" or "A5+12c"."""
    try:
        return float(text) if text.strip("0.") == "" else hertz("the frequency", text)
    except OptionError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


POSITION = numbers(3, form="x,y,z in m, or with units, as 50cm", convert=metres)
PITCH = numbers(1, 2, form="one length or two, as 0.3 or 30cm,1m", convert=metres)
BAND = numbers(2, form="low,high in Hz or as notes", convert=pitch)


def select_options(options: argparse.Namespace, names: str) -> dict[str, Any]:
    """Return options, by their names with spaces between, as arguments of the same names."""
    return {name: getattr(options, name) for name in names.split()}


def names(text: str) -> list[str]:
    """Return the names in a text with commas between."""
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"it is {text!r}: give names with commas between")
    return names


def place(text: str) -> str | tuple[float, ...]:
    """Return a place's coordinates from text such as "0.1,0,2cm"; other text is a place's name."""
    try:
        return tuple(map(metres, text.split(",")))
    except ValueError:
        return text


def makers() -> Mapping[str, Callable[..., Body]]:
    """Return the constructors of bodies by their names in the shell."""
    from struck import shapes, solids
    from struck.solids import revolution

    def rod(
        *,
        length: float,
        radius: float,
        wall: float | None = None,
        ends: str | tuple[str, str] = "free",
    ) -> Shape:
        section = shapes.RoundSection(radius=radius, wall=wall)
        return shapes.Bar(length=length, section=section, ends=ends)

    return {
        "block": solids.Block,
        "tube": solids.Tube,
        "bowl": revolution.bowl,
        "bell": revolution.bell,
        "glass": revolution.wine_glass,
        "bar": shapes.Bar,
        "rod": rod,
        "string": shapes.String,
        "rectangular-membrane": shapes.RectangularMembrane,
        "circular-membrane": shapes.CircularMembrane,
        "annular-membrane": shapes.AnnularMembrane,
        "l-membrane": shapes.PolygonMembrane.l_shape,
        "polygon-membrane": shapes.PolygonMembrane,
        "rectangular-plate": shapes.RectangularPlate,
        "circular-plate": shapes.CircularPlate,
    }


def arguments_of(maker: Callable[..., Body]) -> tuple[list[str], list[str]]:
    """Return the names of a body's required arguments, and of its optional ones."""
    known = signature(maker).parameters
    absent = {Parameter.empty, None} if "section" in known else {Parameter.empty}  # or a section
    names = [name for name in known if name not in _NOT_IN_SHELL]
    needed = [name for name in names if known[name].default in absent]
    return needed, [name for name in names if name not in needed]


def body_named(text: str) -> str | Body:
    """Return the body that "tube:length=50cm,radius=0.0125,wall=1mm" means, else a file's name."""
    maker = maker_named(text)
    return maker if isinstance(maker, str) else maker()


def maker_named(text: str) -> str | partial[Body]:
    """Return the maker of the body that a text names, else a file's name.

    Raises
    ------
    OptionError
        When the body or one of its arguments is unknown, missing or impossible.
    """
    kind, colon, rest = text.partition(":")
    maker = makers().get(kind)
    if maker is None or (not colon and is_file(text)):
        if colon and "=" in rest:
            suggestion = nearest(kind, makers())
            raise OptionError(
                f"no body is called {kind!r}: {suggestion}there are {', '.join(makers())} (struck "
                "analyze --list), and mesh files"
            )
        return text
    values = _parse_arguments(rest, "N" if kind == "string" else "N/m")
    required_names, optional_names = arguments_of(maker)
    if "radius" in {*required_names, *optional_names} and "diameter" in values:
        values, rest = _with_radius(values, rest)
    if not set(required_names) <= set(values) <= {*required_names, *optional_names}:
        unknown = next(
            (name for name in values if name not in {*required_names, *optional_names}), ""
        )
        suggestion = nearest(unknown, [*required_names, *optional_names], "{}=")
        if kind == "bar" and unknown in {"radius", "diameter"}:
            suggestion = "a round bar is rod:length=...,radius=...; else "
        suggestion = f"it has no {unknown}=: {suggestion}" if unknown else ""
        arguments = ",".join(
            f"{name}={_FORMS.get(name, '...')}" for name in required_names or optional_names
        )
        optional_text = (
            f" and, if wanted, {', '.join(optional_names)}"
            if required_names and optional_names
            else ""
        )
        raise OptionError(
            f"{text!r} does not describe a {kind}: {suggestion}give "
            f"{kind}:{arguments}{optional_text}"
        )
    for name, value in values.items():
        if isinstance(signature(maker).parameters[name].default, bool) and value in (0, 1):
            values[name] = bool(value)
    _require_possible(maker, values, rest)
    return partial(maker, **values)


def _with_radius(values: dict[str, Any], text: str) -> tuple[dict[str, Any], str]:
    """Return arguments with half the diameter as radius, and the text with it."""
    if "radius" in values:
        raise OptionError(
            f"radius is {values['radius']} and diameter is {values['diameter']}: give one of "
            "the two"
        )
    half = values["diameter"] / 2 if isinstance(values["diameter"], float) else values["diameter"]
    others = {name: value for name, value in values.items() if name != "diameter"}
    return {**others, "radius": half}, re.sub(r"(^|,)\s*diameter\b", r"\1radius", text)


def _require_possible(maker: Callable[..., Body], values: dict[str, Any], text: str) -> None:
    """Refuse arguments of which no body can be made, as they were typed in a text."""
    texts = dict(re.findall(r"(?:^|,)(\w+)=(.*?)(?=,\w+=|$)", text))
    for name in [name for name, text in texts.items() if _ONE_UNIT.fullmatch(text)]:
        raise OptionError(f"{name} is {texts[name]!r}: give each length its unit, as 30cmx3cmx2cm")
    try:
        maker(**values)
    except ArgumentError as error:
        name = str(error).partition(" is ")[0]  # the rest speaks of Python's types
        is_flag = isinstance(signature(maker).parameters[name].default, bool)
        hint = {
            "size": "three lengths, as size=0.1,0.05,0.03 or size=10cmx5cmx3cm",
            "corners": f"the corners' x and y with 'x' between, as corners={CORNERS}",
            "tension": "a tension in N as 60N, in membranes in N/m as 60N/m, without k or M before",
        }.get(name, "0 or 1" if is_flag else "lengths as 0.5, 50cm, 500mm or 20in")
        raise OptionError(f"{name} is {texts.get(name)!r}: give {hint}") from None
    except OptionError as error:
        if not str(error).startswith("ends are"):
            raise
        raise OptionError(f"{error}, two as {ENDS}") from None


def _parse_arguments(text: str, tension: str) -> dict[str, Any]:
    """Return arguments by name of "ends=clamped,free,length=50cm", and the unit of a tension."""
    values: dict[str, list[Any]] = {}
    name = ""
    for prefix, equals, value in (part.rpartition("=") for part in text.split(",") if part):
        name = prefix.strip() if equals else name
        is_tension = name == "tension"
        words = value.strip().removesuffix(tension if is_tension else "")
        read = _value(words, float if is_tension else metres)
        values.setdefault(name, []).append(value.strip() if isinstance(read, str) else read)
    return {name: parts[0] if len(parts) == 1 else tuple(parts) for name, parts in values.items()}


def _value(text: str, number: Callable[[str], float]) -> object:
    """Return the number with its unit, the numbers with "x" between, or the word in a text."""
    with suppress(ValueError):
        values = tuple(map(number, text.split("x")))
        return values[0] if len(values) == 1 else values
    return {"yes": True, "true": True, "no": False, "false": False}.get(text.lower(), text)


def material_of(text: str) -> Material | str:
    """Return a material of "density=...,youngs_modulus=...,poisson_ratio=..."; a name as it is.

    A `loss_tangent` may stand with them, or `rayleigh_mass` (1/s) and `rayleigh_stiffness` (s).

    Raises
    ------
    MaterialError
        When a constant is missing or no number, or no solid has them.
    """
    if "=" not in text:
        return text
    texts = {name.strip(): value for name, _, value in (p.partition("=") for p in text.split(","))}
    constant_names = ("density", "youngs_modulus", "poisson_ratio")
    law = ("rayleigh_mass", "rayleigh_stiffness")
    laws, known_names = set(law) & set(texts), (*constant_names, "loss_tangent", *law)
    unknown = next((name for name in texts if name not in known_names), "")
    missing = [name for name in (*constant_names, *(law if laws else ())) if name not in texts]
    if unknown or missing or (laws and "loss_tangent" in texts):
        two = f"loss_tangent= and {'= and '.join(law)}= are two laws of damping: "
        reason = f"{'= and '.join(missing)}= missing: " if missing else two
        reason = (
            f"it has no {unknown}=: {nearest(unknown, known_names, '{}=')}" if unknown else reason
        )
        raise MaterialError(
            f"{text!r} is no material: {reason}give {'=...,'.join(constant_names)}=... and, if "
            f"known, one of loss_tangent=... or {'=...,'.join(law)}=..."
        )
    values = {}
    for name, value in texts.items():
        try:
            values[name] = float(value)
        except ValueError:
            message = f"{name} is {value!r}: give a number in SI units, as 7.2e10"
            raise MaterialError(message) from None
    rayleigh = Rayleigh(mass=values[law[0]], stiffness=values[law[1]]) if law[0] in values else None
    constants: dict[str, Any] = {name: values[name] for name in constant_names}
    damping_law = rayleigh or InternalFriction(loss_tangent=values.get("loss_tangent", 0.0))
    return Material(**constants, damping=damping_law)


def add_listener(parser: argparse.ArgumentParser) -> None:
    """Declare where someone listens, and with which ears."""
    group = parser.add_argument_group("listener")
    group.add_argument(
        "--listener", type=POSITION, help="position x,y,z, m; default: next to the body"
    )
    group.add_argument(
        "--walk", metavar="FILE", help="path of a moving listener: lines of time,x,y,z in s and m"
    )
    group.add_argument(
        "--facing",
        type=numbers(3, form="x,y,z"),
        help="direction in which the listener looks: x,y,z",
    )
    group.add_argument("--hrtf", help="two ears of a measured head: kemar, or a SOFA file")
    group.add_argument(
        "--head", help="two ears of a spherical head: exact, woodworth or simple1998"
    )
    group.add_argument("--stereo", action="store_true", help="two ears; the same as --head exact")


def add_budget(parser: argparse.ArgumentParser) -> None:
    """Declare how many modes are kept."""
    parser.add_argument(
        "--modes",
        type=budget,
        metavar="N",
        help="keep the N modes that are loudest over all contacts, or all (default)",
    )


def add_fade(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Declare the fade of a sound that is cut off."""
    parser.add_argument(
        "--fade",
        type=float,
        help="fade at the end of a sound that is cut off, s; 0 for none (default: 0.01)",
    )


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Declare whether finished work is taken up and kept."""
    text = "do not read or write the cache"
    parser.add_argument("--no-cache", dest="cache", action="store_false", help=text)


def refuse(options: argparse.Namespace, names: Collection[str], why: str) -> None:
    """Raise OptionError for the first of these options that was given, with the reason `why`."""
    for action in options.parser._actions:  # noqa: SLF001 - argparse has no public list
        if action.dest in names and (option := _option_text(options, action)):
            raise OptionError(f"{option} {why}{', or' if ':' in why else ':'} leave it out")


def require_alone(options: argparse.Namespace, name: str) -> None:
    """Refuse the other options of a command that only lists."""
    listing = f"--{name.replace('_', '-')}, which lists and ends"
    others = {*vars(options)} - {name, "json", "quiet"}
    refuse(options, others, f"does not go with {listing}")


def _option_text(options: argparse.Namespace, action: argparse.Action) -> str:
    """Return an option as it was given, or "" where it was not."""
    value = getattr(options, action.dest, action.default)
    if value in (None, []) or (action.dest not in options.given and value == action.default):
        return ""
    name = action.option_strings[-1] if action.option_strings else action.dest.upper()
    values = value if isinstance(value, list) else [value]
    texts = [
        ",".join(map(str, value)) if isinstance(value, tuple) else str(value) for value in values
    ]
    return name if action.nargs == 0 else " ".join([name, *texts])


def add_room(parser: argparse.ArgumentParser) -> None:
    """Declare the room around bodies and listener."""
    group = parser.add_argument_group("room")
    group.add_argument(
        "--room", type=POSITION, help="size x,y,z of a rectangular room, m, with a corner at 0,0,0"
    )
    group.add_argument(
        "--walls", default="brick", help="wall material: brick (default), wood, carpet, ..."
    )
    group.add_argument(
        "--reverberation",
        type=float,
        help="reverberation time T60, s; default: no late reverberation",
    )


def listener(
    options: argparse.Namespace, place: Sequence[float] | None = None
) -> Listener | ArrayLike | None:
    """Return the listener that the options describe, or one with the same ears at another place.

    Raises
    ------
    OptionError
        On ears of two kinds, a direction for one ear, or a place and a walk.
    FileFormatError
        On a walk that cannot be read.
    """
    if options.stereo:
        refuse(options, ("hrtf", "head"), "has two ears already: leave out --stereo")
        options.head = "exact"
    for one, other, what in (("listener", "walk", "places"), ("hrtf", "head", "heads")):
        first, second = getattr(options, one), getattr(options, other)
        if first and second:
            raise OptionError(f"--{one} and --{other} {second} are two {what}: give one")
    walk = options.walk if place is None else None
    course = _walk(walk) if walk else place or options.listener
    standing = {"position": course, "facing": options.facing}
    if options.hrtf:
        return Binaural(**standing, hrtf=options.hrtf)
    if options.head:
        return Stereo(**standing, head=options.head)
    if options.facing:
        raise OptionError("--facing needs two ears: give --stereo, --hrtf kemar, or --head exact")
    return Mono(position=course) if walk else course


def _walk(path: str) -> tuple[Array, Array]:
    """Return times (n,) and places (n, 3) of a file of four numbers a line."""
    rows: list[list[float]] = []
    wrong, data = "it is no text", read_bytes(path)
    try:
        for number, line in enumerate(data.decode("utf-8").split("\n"), 1):
            wrong = f"line {number} is {line.strip()[:40]!r}"
            if line.strip():
                time, x, y, z = map(float, line.split(","))
                rows.append([time, x, y, z])
    except ValueError as error:
        raise FileFormatError(
            f"{path} tells no walk, {wrong}: give lines of four numbers, time,x,y,z in s and m, as "
            "0.5,0,2,0, without a line of names"
        ) from error
    table = np.array(rows, np.float64).reshape(len(rows), 4)
    return ascending(path, table[:, 0]), table[:, 1:]


def room(options: argparse.Namespace) -> Room | None:
    """Return the requested room, or None.

    Raises
    ------
    OptionError
        On a reverberation without a room, or a room that cannot be.
    """
    if options.room is None:
        refuse(options, ("reverberation", "walls", "position"), "needs a room: give --room x,y,z")
        return None
    x, y, z = options.room
    late = None
    if options.reverberation is not None:
        late = Reverberation(seconds=options.reverberation, volume=x * y * z)
    return Room(size=(x, y, z), walls=options.walls, reverberation=late)
