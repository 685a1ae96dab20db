"""Texts of the shell turned into bodies, strikes and places to write."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING

from struck.errors import MaterialError, OptionError
from struck.model.damping import InternalFriction
from struck.model.material import Material

if TYPE_CHECKING:
    from struck.analysis.discretisation import Solid


def numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    """Return a parser of `count` numbers between commas."""

    def parse(text: str) -> tuple[float, ...]:
        values = tuple(map(float, text.split(",")))
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"{text!r}: give {count} numbers with commas between")
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

    A `loss_tangent` may stand with them.

    Raises
    ------
    MaterialError
        When the name is unknown, a constant is missing or no number, or no solid has them.
    """
    if "=" not in text:
        return Material.named(text, damping)
    given = {name.strip(): value for name, _, value in (p.partition("=") for p in text.split(","))}
    wanted = ("density", "youngs_modulus", "poisson_ratio")
    if not set(wanted) <= set(given) <= {*wanted, "loss_tangent"}:
        raise MaterialError(
            f"{text!r} is no material: give {'=...,'.join(wanted)}=... and, if known, loss_tangent="
        )
    try:
        values = {name: float(value) for name, value in given.items()}
    except ValueError:
        raise MaterialError(f"{text!r} holds no numbers: give SI units, as 7.2e10") from None
    return Material(
        density=values["density"],
        youngs_modulus=values["youngs_modulus"],
        poisson_ratio=values["poisson_ratio"],
        damping=InternalFriction(loss_tangent=values.get("loss_tangent", 0.0)),
    )


def _dimension(text: str) -> float | tuple[float, ...]:
    edges = tuple(map(float, text.split("x")))
    return edges[0] if len(edges) == 1 else edges
