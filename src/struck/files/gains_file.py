"""Gains in model files: which kinds there are, and those of mode shapes on a surface."""

from __future__ import annotations

import numpy as np

from struck.errors import FileFormatError
from struck.files.formulas import formula_from_json, formula_to_json
from struck.files.layout import Kept, Kind, Tensor, Tensors, Text, from_pairs, in_pairs
from struck.files.values import vector
from struck.model.gains import Gains, Radiation, ShapeGains
from struck.model.mesh import Mesh
from struck.radiation import by_name

KINDS = ("ShapeGains", "TimbreField", "TimbreTable", "SinglePoint")
"""The classes of gains that files keep."""


def kind_of(gains: Gains) -> Kind:
    """Return how files keep such gains.

    Raises
    ------
    FileFormatError
        When they do not.
    """
    name = type(gains).__name__
    kind = kind_named(name) if name in KINDS else None
    if kind is None or type(gains) is not kind.made:
        raise FileFormatError(
            f"its gains are {name}, and files keep {', '.join(KINDS)} alone: save the model that "
            "it was made from"
        )
    return kind


def kind_named(name: str) -> Kind:
    """Return how files keep gains of the class with that name.

    Raises
    ------
    FileFormatError
        When they do not.
    """
    if name not in KINDS:
        raise FileFormatError(f"its gains are {name!r}, none of {', '.join(KINDS)}: update struck")
    if name == "ShapeGains":
        return SHAPES
    from struck.files.fields_file import RECORDED  # with SciPy, for those who need it

    return RECORDED[name]


def _keep(gains: ShapeGains) -> Kept:
    formula, arrays = formula_to_json(gains.formula)
    return Kept(
        text={
            "centre": np.asarray(gains.centre, np.float64).tolist(),
            "radiation": _radiation_name(gains.radiation),
            "formula": formula,
        },
        tensors={"shapes": gains.shapes, "outputs": in_pairs(gains.outputs), **arrays},
    )


def _radiation_name(radiation: Radiation) -> str:
    """Return the name, where that is all there is to tell."""
    known = by_name(radiation.name)
    if type(known) is not type(radiation) or vars(known) != vars(radiation):
        raise FileFormatError(
            f"its radiation {radiation.name!r} was changed, and files keep the name alone: make "
            f"the model with by_name({radiation.name!r})"
        )
    return radiation.name


def _make(text: Text, tensors: Tensors, surface: Mesh | None) -> ShapeGains:
    if surface is None:
        raise FileFormatError("its mode shapes have no surface: give vertices and faces")
    return ShapeGains(
        surface=surface,
        shapes=tensors["shapes"],
        outputs=from_pairs(tensors["outputs"]),
        centre=vector(text["centre"]),
        radiation=by_name(text["radiation"]),
        formula=formula_from_json(text.get("formula"), tensors),
    )


# Lengths by letter: M modes, V vertices, F faces.
SHAPES = Kind(
    made=ShapeGains,
    layout={
        "vertices": Tensor("float64", ("V", 3)),
        "faces": Tensor("uint32", ("F", 3)),
        "shapes": Tensor("float32", ("V", 3, "M")),
        "outputs": Tensor("float64", ("M", 2)),
    },
    keep=_keep,
    make=_make,
)
"""Mode shapes on the body's surface."""
