"""Gains in model files: mode shapes on a surface; others by their name, from `fields_file`."""

from __future__ import annotations

from typing import Any

import numpy as np

from struck.errors import FileFormatError
from struck.files.container import (
    Arrays,
    Kind,
    Tensor,
    Tensors,
    Text,
    from_pairs,
    from_plain,
    to_plain,
    vector,
)
from struck.model.gains import Gains, Radiation, ShapeGains, TransverseShapes
from struck.model.mesh import Mesh
from struck.radiation import by_name

_FORMULA = "formula."
_NAMES = ("ShapeGains", "TimbreField", "TimbreTable", "SinglePoint")


def kind_of(gains: Gains) -> Kind:
    """Return how files keep these gains; FileFormatError when they do not."""
    name = type(gains).__name__
    kind = _kind(name)
    if kind is None or type(gains) is not kind.made:
        raise FileFormatError(
            f"its gains are {name}, and files keep {', '.join(_NAMES)} alone: save the model that "
            "it was made from"
        )
    return kind


def kind_named(name: str) -> Kind:
    """Return how files keep gains of the named class; FileFormatError when they do not."""
    kind = _kind(name)
    if kind is None:
        raise FileFormatError(f"its gains are {name!r}, none of {', '.join(_NAMES)}: update struck")
    return kind


def _kind(name: str) -> Kind | None:
    """Return how files keep gains of a class; of fields only where they are met."""
    if name == _SHAPES.made.__name__:
        return _SHAPES
    from struck.files.fields_file import FIELDS

    return FIELDS.get(name)


# Mode shapes on a surface


def _keep_shapes(gains: ShapeGains) -> tuple[dict[str, Any], Arrays]:
    arrays: Arrays = {}
    formula = None if gains.formula is None else to_plain(gains.formula, _formulas(), arrays)
    text = {
        "centre": np.asarray(gains.centre, dtype=np.float64).tolist(),
        "radiation": _radiation_name(gains.radiation),
        "formula": formula,
    }
    return text, {_FORMULA + name: array for name, array in arrays.items()}


def _radiation_name(radiation: Radiation) -> str:
    """Return the name of an estimate of radiation; FileFormatError when it was changed."""
    known = by_name(radiation.name)
    if type(known) is not type(radiation) or vars(known) != vars(radiation):
        raise FileFormatError(
            f"its radiation {radiation.name!r} was changed, and files keep the name alone: make "
            f"the model with by_name({radiation.name!r})"
        )
    return radiation.name


def _make_shapes(text: Text, tensors: Tensors, surface: Mesh | None) -> ShapeGains:
    if surface is None:
        raise FileFormatError("its mode shapes have no surface: give vertices and faces")
    return ShapeGains(
        surface=surface,
        shapes=tensors["shapes"],
        outputs=from_pairs(tensors["outputs"]),
        centre=vector(text["centre"]),
        radiation=by_name(text["radiation"]),
        formula=_formula(text.get("formula"), tensors),
    )


def _formula(plain: object, tensors: Tensors) -> TransverseShapes | None:
    """Return the mode shapes in closed form that a JSON value and tensors describe."""
    if plain is None:
        return None
    named = {
        name.removeprefix(_FORMULA): array
        for name, array in tensors.items()
        if name.startswith(_FORMULA)
    }
    formula = from_plain(plain, {kind.__name__: kind for kind in _formulas()}, named)
    if not isinstance(formula, TransverseShapes):
        raise FileFormatError(f"its formula is a {type(formula).__name__}, not TransverseShapes")
    return formula


def _formulas() -> tuple[type, ...]:
    # With SciPy's special functions, for those who need them.
    from struck.shapes.beam import BendingForms
    from struck.shapes.circular_membrane import RoundForms
    from struck.shapes.particular_solutions import PolygonForms
    from struck.shapes.rectangular_membrane import SineForms
    from struck.shapes.rectangular_plate import RitzForms
    from struck.shapes.string import StringForms

    forms = (BendingForms, PolygonForms, RitzForms, RoundForms, SineForms, StringForms)
    return (TransverseShapes, *forms)


# Lengths by letter: M modes, V vertices, F faces.
_SHAPES = Kind(
    made=ShapeGains,
    layout={
        "vertices": Tensor("float64", ("V", 3)),
        "faces": Tensor("uint32", ("F", 3)),
        "shapes": Tensor("float32", ("V", 3, "M"), "shapes"),
        "outputs": Tensor("float64", ("M", 2), "outputs"),
    },
    keep=_keep_shapes,
    make=_make_shapes,
)
