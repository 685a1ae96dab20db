"""Who listens, as people say it in the shell."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Binaural, Listener, Mono, Stereo
from struck.ears.reverberation import Reverberation
from struck.ears.room import Room
from struck.errors import FileFormatError, MaterialError, OptionError
from struck.files.atomic import read_bytes
from struck.model.arrays import Array
from struck.model.damping import InternalFriction, Rayleigh
from struck.model.material import Material

if TYPE_CHECKING:
    from struck.analysis.discretisation import Solid


# Texts of the shell turned into bodies, strikes and places to write.

MATERIAL = "name (see 'struck materials') or density=,youngs_modulus=,poisson_ratio="


def numbers(*counts: int) -> Callable[[str], tuple[float, ...]]:
    """Return a parser of numbers separated by commas, as many as one of some counts."""

    def parse(text: str) -> tuple[float, ...]:
        values = tuple(map(float, text.split(",")))
        if len(values) not in counts:
            many = " or ".join(map(str, counts))
            raise argparse.ArgumentTypeError(f"{text!r}: give {many} numbers with commas between")
        return values

    return parse


def place(text: str) -> str | tuple[float, ...]:
    """Return the coordinates that "0.1,0,0.02" tells, else a name of a place."""
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        return text


def body_named(text: str) -> str | Solid:
    """Return the solid that "tube:length=0.5,radius=0.0125,wall=0.001" means, else a file's name.

    Raises
    ------
    OptionError
        When the solid or one of its dimensions is unknown, missing or no number.
    """
    from struck.solids import Block, Tube

    kind, colon, rest = text.partition(":")
    solid = {"tube": Tube, "block": Block}.get(kind)
    if not colon or solid is None:
        return text
    names = [field.name for field in fields(solid) if field.name != "elements"]
    pairs = [part.partition("=") for part in rest.split(",")]
    given = {name: value for name, _, value in pairs}
    if set(given) != set(names):
        example = ",".join(f"{name}=..." for name in names)
        raise OptionError(f"{text!r} does not say what a {kind} needs: give {kind}:{example}")
    try:
        values = {name: _dimension(value) for name, value in given.items()}
    except ValueError:
        raise OptionError(f"{text!r} holds no numbers: give metres, as 0.5") from None
    return solid(**values)


def material_named(text: str, damping: str = "own") -> Material:
    """Return a material by name, or by "density=...,youngs_modulus=...,poisson_ratio=...".

    A `loss_tangent` may stand with them, or `rayleigh_mass` (1/s) and `rayleigh_stiffness` (s).

    Raises
    ------
    MaterialError
        When the name is unknown, a constant is missing or no number, or no solid has them.
    """
    if "=" not in text:
        return Material.named(text, damping)
    given = {name.strip(): value for name, _, value in (p.partition("=") for p in text.split(","))}
    wanted = ("density", "youngs_modulus", "poisson_ratio")
    law = ("rayleigh_mass", "rayleigh_stiffness")
    if set(given) - {*wanted, "loss_tangent"} not in (set(), set(law)) or set(wanted) - set(given):
        raise MaterialError(
            f"{text!r} is no material: give {'=...,'.join(wanted)}=... and, if known, loss_tangent="
        )
    try:
        values = {name: float(value) for name, value in given.items()}
    except ValueError:
        raise MaterialError(f"{text!r} holds no numbers: give SI units, as 7.2e10") from None
    rayleigh = Rayleigh(mass=values[law[0]], stiffness=values[law[1]]) if law[0] in values else None
    return Material(
        density=values["density"],
        youngs_modulus=values["youngs_modulus"],
        poisson_ratio=values["poisson_ratio"],
        damping=rayleigh or InternalFriction(loss_tangent=values.get("loss_tangent", 0.0)),
    )


def _dimension(text: str) -> float | tuple[float, ...]:
    edges = tuple(map(float, text.split("x")))
    return edges[0] if len(edges) == 1 else edges


def add_listener(parser: argparse.ArgumentParser) -> None:
    """Declare where someone listens, and with which ears."""
    group = parser.add_argument_group("listener")
    group.add_argument("--listener", type=numbers(3), help="position x,y,z, m")
    group.add_argument(
        "--walk", metavar="FILE", help="where the listener goes: lines of time,x,y,z in s and m"
    )
    group.add_argument("--facing", type=numbers(3), help="where the listener looks: x,y,z")
    group.add_argument("--hrtf", help="two measured ears: kemar, or a SOFA file")
    group.add_argument("--head", help="two ears on a ball: exact, woodworth or simple1998")


def add_room(parser: argparse.ArgumentParser) -> None:
    """Declare the room around bodies and listener."""
    group = parser.add_argument_group("room")
    group.add_argument("--room", type=numbers(3), help="size x,y,z of a room, m, corner at 0,0,0")
    group.add_argument("--walls", default="brick", help="of the room: brick, wood, carpet, ...")
    group.add_argument("--reverberation", type=float, help="time of the room for 60 dB, s")


def listener(options: argparse.Namespace) -> Listener | ArrayLike | None:
    """Return who was asked for.

    Raises
    ------
    OptionError
        On ears of two kinds, a direction for one ear, or a place and a walk.
    FileFormatError
        On a walk that cannot be read.
    """
    if options.walk and options.listener:
        raise OptionError(
            f"--listener {options.listener} and --walk {options.walk} are two places: give one"
        )
    if options.hrtf and options.head:
        raise OptionError(
            f"--hrtf {options.hrtf} and --head {options.head} are two heads: give one"
        )
    course = options.listener if options.walk is None else _walk(options.walk)
    place = {"position": course, "facing": options.facing}
    if options.hrtf:
        return Binaural(**place, hrtf=options.hrtf)
    if options.head:
        return Stereo(**place, head=options.head)
    if options.facing:
        raise OptionError("--facing needs two ears: give --hrtf kemar, or --head exact")
    return course if options.walk is None else Mono(position=course)


def _walk(path: str) -> tuple[Array, Array]:
    """Return times (n,) and places (n, 3) of a file of four numbers a line."""
    try:
        lines = read_bytes(path).decode("utf-8").split("\n")
        rows = [[float(each) for each in line.split(",")] for line in lines if line.strip()]
        table = np.array(rows, np.float64).reshape(len(rows), 4)
    except ValueError as error:
        raise FileFormatError(
            f"{path} tells no walk: give lines of four numbers, time,x,y,z ({error})"
        ) from error
    return table[:, 0], table[:, 1:]


def room(options: argparse.Namespace) -> Room | None:
    """Return the room that was asked for, if any.

    Raises
    ------
    OptionError
        On a reverberation without a room, or a room that cannot be.
    """
    if options.room is None:
        if options.reverberation is not None:
            raise OptionError("--reverberation needs a room: give --room x,y,z")
        return None
    x, y, z = options.room
    late = None
    if options.reverberation is not None:
        late = Reverberation(seconds=options.reverberation, volume=x * y * z)
    return Room(size=(x, y, z), walls=options.walls, reverberation=late)
