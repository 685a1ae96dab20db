"""Who listens, as people say it in the shell."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.arguments import numbers
from struck.ears.listeners import Binaural, Listener, Mono, Stereo
from struck.ears.reverberation import Reverberation
from struck.ears.room import Room
from struck.errors import FileFormatError, OptionError

Array = NDArray[np.float64]


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
        lines = Path(path).read_text(encoding="utf-8").split("\n")
        rows = [[float(each) for each in line.split(",")] for line in lines if line.strip()]
        table = np.array(rows, np.float64).reshape(len(rows), 4)
    except (OSError, ValueError) as error:
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
