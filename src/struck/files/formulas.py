"""Mode shapes known by formula, as JSON and tensors of a model file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from struck.errors import FileFormatError
from struck.files.packing import Arrays, from_plain, to_plain
from struck.forms import TransverseShapes

_PREFIX = "formula."


def formula_to_json(formula: TransverseShapes | None) -> tuple[Any, Arrays]:
    """Return a formula as a JSON value and the tensors that it names.

    Raises
    ------
    FileFormatError
        When its forms are none of struck's own.
    """
    arrays: Arrays = {}
    plain = None if formula is None else to_plain(formula, _kinds(), arrays)
    return plain, {_PREFIX + name: array for name, array in arrays.items()}


def formula_from_json(
    plain: object, tensors: Mapping[str, NDArray[Any]]
) -> TransverseShapes | None:
    """Return the formula that a JSON value and tensors describe.

    Raises
    ------
    FileFormatError
        When they describe something else.
    """
    if plain is None:
        return None
    named = {
        name.removeprefix(_PREFIX): array
        for name, array in tensors.items()
        if name.startswith(_PREFIX)
    }
    formula = from_plain(plain, {kind.__name__: kind for kind in _kinds()}, named)
    if not isinstance(formula, TransverseShapes):
        raise FileFormatError(f"its formula is a {type(formula).__name__}, not TransverseShapes")
    return formula


def _kinds() -> tuple[type, ...]:
    from struck.shapes import FORMS  # with SciPy's special functions, for those who need them

    return (TransverseShapes, *FORMS)
