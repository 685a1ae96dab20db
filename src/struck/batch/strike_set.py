"""Strike set: which strikes of a model are rendered, and the labels from which each comes again.

A label holds a strike as the body received it: a point on the surface, a unit push, an impulse and
how long it lasts. So `struck.render` of a `Strike` with a label's own numbers is the same sound.
"""

from __future__ import annotations

import inspect
import io
import os
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from struck.errors import OptionError, StruckError, nearest, require_choice
from struck.excitation.hertz import strikers
from struck.excitation.strike import Strike
from struck.files.atomic import write_bytes
from struck.files.sound import Sound
from struck.files.sound_formats import chosen
from struck.files.sound_set import OF_A_SOUND
from struck.model.arrays import Array, require_number
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.scene.ending import FADE, require_fade
from struck.scene.render import render

Strikes: TypeAlias = (
    "int | Sequence[Mapping[str, Any]] | Callable[[ModalModel, Any], Sequence[Any]]"
)
SOUNDS = ("wav", "flac", "npz")
_MAX_STRIKES = 100_000  # strikes of a model
_SPEEDS = (0.1, 2.0)  # m/s, between which random strikers fly, evenly in octaves
_TILT = 0.3  # of random pushes from the normal, as a tangent's root mean square
_LISTENER_DISTANCE = 1.0  # m, of random listeners beyond the body
_XYZ = "xyz"
_SHARED_FIELDS = ("shape", "patch", "transient", "time", "seed")  # of a strike and of its label
_NAMES = tuple(field.name for field in fields(Strike))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrikeSet:
    """Strikes of each model of a batch, and how their sounds are written."""

    strikes: Strikes
    seed: int = 0
    seconds: float = 1.0
    sample_rate: int = 48_000
    sounds: str = "wav"
    fade: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.strikes, int | float):
            hint = "give how many of each model, their table, or a function that chooses them"
            require_number("strikes", self.strikes, 1, _MAX_STRIKES, whole=True, hint=hint)
        elif not callable(self.strikes):
            rows = self.strikes if isinstance(self.strikes, Sequence) else [self.strikes]
            bad_types = [type(row).__name__ for row in rows if not isinstance(row, Mapping)]
            if bad_types or not rows:
                raise OptionError(
                    f"strikes has {f'rows of type {bad_types[0]}' if bad_types else 'no row'}: "
                    "give a number, rows as [{'at': 'top', 'impulse': 0.01}], or a function "
                    "(model, generator) that returns Strikes"
                )
            named_strikes(self.strikes)
        require_number("seed", self.seed, 0, 2**63, whole=True, hint="give 0 or more")
        require_choice("sounds", self.sounds, SOUNDS)
        require_fade(self.fade, self.seconds)
        if self.sounds == "flac":
            chosen("sound.flac")

    @property
    def plain(self) -> tuple[object, ...]:
        """Values that determine the sounds; a function is represented by its source."""
        how = inspect.getsource(self.strikes) if callable(self.strikes) else self.strikes
        return how, self.seed, self.seconds, self.sample_rate, self.sounds, self.fade

    def labels(self, model: ModalModel, output: str) -> list[dict[str, Any]]:
        """Return the label of each strike on a model, whose places are checked by that."""
        return [self._label(model, *item) for item in self._chosen(model, output)]

    def written(
        self, model: ModalModel, chosen: Sequence[dict[str, Any]], output: str, folder: Path
    ) -> list[dict[str, Any]]:
        """Write the sounds of labels, all in one NPZ file or one by one; add file and level."""
        labels, sample_blocks = [], []
        for number, label in enumerate(chosen):
            sound = struck_as(model, label)
            ending = ".npz" if self.sounds == "npz" else f"_{number:03d}.{self.sounds}"
            unit = "Pa" if sound.calibrated else "relative"
            columns = {"sound": output + ending, "index": number, "factor": 1.0, "unit": unit}
            if self.sounds == "npz":
                sample_blocks.append(sound.samples)
            else:
                columns["factor"] = _saved(sound, folder / f"{output}{ending}")
            labels.append(label | columns)
        if sample_blocks:
            data, samples = io.BytesIO(), np.concatenate(sample_blocks)
            np.savez(data, samples=samples, sample_rate=self.sample_rate)
            write_bytes(folder / f"{output}.npz", data.getvalue())
        return labels

    def _chosen(self, model: ModalModel, output: str) -> Iterator[tuple[Strike, Array]]:
        """Yield strikes and listeners; random ones depend on the seed and the model's name."""
        chance = np.random.default_rng([self.seed, zlib.crc32(output.encode())])
        if callable(self.strikes):
            for item in self.strikes(model, chance):
                strike, listener = item if isinstance(item, tuple) else (item, None)
                yield strike, _listener_place(model, listener)
        elif isinstance(self.strikes, int | float):
            yield from (_random(model, chance) for _ in range(int(self.strikes)))
        else:
            for strike, listener in map(_strike_of, self.strikes):
                yield strike, _listener_place(model, listener)

    def _label(self, model: ModalModel, strike: Strike, listener: Array) -> dict[str, Any]:
        """Return the label of a strike: its place and force, and the listener's place."""
        contact = model.contact(strike.at, strike.direction)
        blow = strike.resolved(model, contact)
        return {
            **dict(zip(_XYZ, contact.point.tolist(), strict=False)),
            **{f"direction_{x}": v for x, v in zip(_XYZ, contact.direction.tolist(), strict=False)},
            "striker": strike.striker or "",
            "impulse": blow.impulse,
            "duration": blow.duration,
            **{name: getattr(strike, name) for name in _SHARED_FIELDS},
            **{f"listener_{x}": v for x, v in zip(_XYZ, listener.tolist(), strict=True)},
            "seconds": self.seconds,
            "sample_rate": self.sample_rate,
            "fade": min(FADE, self.seconds / 2) if self.fade is None else self.fade,
        }


def struck_as(model: ModalModel, label: Mapping[str, Any]) -> Sound:
    """Return the sound of a model struck as a label says."""
    strike = Strike(
        at=[label[x] for x in _XYZ if x in label],
        direction=[label[f"direction_{x}"] for x in _XYZ if f"direction_{x}" in label],
        **{name: label[name] for name in ("impulse", "duration", *_SHARED_FIELDS)},
    )
    return render(
        model,
        strike,
        seconds=label["seconds"],
        sample_rate=label["sample_rate"],
        listener=[label[f"listener_{x}"] for x in _XYZ],
        fade=label["fade"],
    )


def _random(model: ModalModel, chance: np.random.Generator) -> tuple[Strike, Array]:
    """Return a strike anywhere on a surface, evenly by area, and a listener in any direction."""
    surface = model.geometry
    if surface is None:
        raise OptionError(
            "the model has no surface to be struck at random: give a table of strikes"
        )
    areas = surface.areas
    face = surface.faces[chance.choice(len(areas), p=areas / areas.sum())]
    point = chance.dirichlet(np.ones(3)) @ surface.points[face]
    inward = model.contact(point).direction
    push = inward + _TILT * chance.standard_normal(3)
    strike = Strike(
        at=point.tolist(),
        direction=(push if push @ inward > 0 else inward).tolist(),
        striker=str(chance.choice(sorted(strikers()))),
        speed=float(np.exp(chance.uniform(*np.log(_SPEEDS)))),
        seed=int(chance.integers(2**31)),
    )
    direction = chance.standard_normal(3)
    return strike, _listener_place(model, None, direction / np.linalg.norm(direction))


def _listener_place(
    model: ModalModel,
    listener: Sequence[float] | None,
    direction: Sequence[float] | Array = (1, 0, 0),
) -> Array:
    """Return the given listener, or else one 1 m beyond the body from its centre."""
    if listener is not None:
        return np.asarray(listener, np.float64)
    gains = model.gains
    if not isinstance(gains, ShapeGains):
        return np.asarray(direction, np.float64)
    return np.asarray(gains.centre) + (_LISTENER_DISTANCE + gains.radius) * np.asarray(
        direction, np.float64
    )


@contextmanager
def row_of(table: str | os.PathLike[str], number: int) -> Iterator[None]:
    """Let errors name the row of a table, counted from 1, and call its cells by their columns."""
    try:
        yield
    except StruckError as error:
        message = re.sub(r"(?<=\w)=(?=['\s])", " ", str(error)).replace("  ", " ")
        message = re.sub(r": \w+ takes a number( or None)?", ": give one number, as 0.5", message)
        raise type(error)(f"row {number} of {table}: {message}") from error


def named_strikes(
    rows: Sequence[Mapping[str, Any]], table: str | os.PathLike[str] = "the strikes"
) -> list[tuple[str, Strike, Sequence[float] | None]]:
    """Return name, strike and listener of each row of a table; names are made where it has none."""
    strikes = []
    for number, row in enumerate(rows, start=1):
        with row_of(table, number):
            strike, listener = _strike_of(row)
        place = strike.at if isinstance(strike.at, str) else "strike"
        parts = (f"{number:03d}", place, strike.striker)
        default_name = "_".join(str(part).replace(":", "-") for part in parts if part)
        strikes.append((str(row.get("name") or default_name), strike, listener))
    return strikes


def _strike_of(row: Mapping[Any, Any]) -> tuple[Strike, Sequence[float] | None]:
    """Return the strike and the listener of a row of a table, of texts or of values."""
    if None in row:
        raise OptionError(
            f'it has {len(row[None])} cells more than columns: put texts with commas in "quotes"'
        )
    try:
        given = {name: _number(text) for name, text in row.items() if text not in {None, ""}}
    except TypeError:  # values that are no texts, as lists
        given = dict(row)
    for name in ("name", *OF_A_SOUND):  # of a set that is made again from its table
        given.pop(name, None)
    listener = given.pop("listener", None)
    unknown = sorted(str(name) for name in given if name not in _NAMES)
    if unknown:
        known = ("name", *_NAMES, "listener")
        raise OptionError(
            f"the column {unknown[0]!r} is nothing of a strike: {nearest(unknown[0], known)}give "
            f"some of {', '.join(known)}"
        )
    return Strike(**given), listener


def _number(text: Any) -> Any:  # noqa: ANN401 - a cell of a table
    """Return a text of one number or several as numbers, any other as it is."""
    if not isinstance(text, str):
        return text
    try:
        numbers = [float(item) for item in text.replace(",", " ").split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers


def _saved(sound: Sound, path: Path) -> float:
    """Write a sound, as floats in Pa where it has them or as 24 bit in FLAC; return its factor."""
    is_absolute = sound.calibrated and path.suffix == ".wav"
    return sound.save(path, level="absolute" if is_absolute else "peak")
