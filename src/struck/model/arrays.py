"""Short names for NumPy arrays in annotations, and the check of what such an array holds."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, StruckError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]
AnyComplex = NDArray[np.complexfloating]
Single = NDArray[np.float32]
AnyArray = NDArray[Any]


def require_numbers(
    name: str,
    values: object,
    shape: tuple[int, ...],
    *,
    least: float | None = None,
    gaps: bool = False,
) -> None:
    """Refuse all but an array of numbers of that shape; with `gaps` some may be NaN or infinite."""
    array = values if isinstance(values, np.ndarray) or shape else np.asarray(values)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iufc":
        raise TypeError(f"{name}: a {type(values).__name__} where an array of numbers belongs")
    if array.shape != shape:
        raise OptionError(f"{name}: the shape is {array.shape} and must be {shape}: make them fit")
    with np.errstate(all="ignore"):
        total = array.sum()  # takes no memory; not finite where it is merely too large, too
    if not (gaps or np.isfinite(total) or np.isfinite(array).all()):
        wrong = array[~np.isfinite(array)]
        raise OptionError(
            f"{name}: {wrong.size} of {array.size} numbers are not finite, as {wrong[0]}: leave "
            "those out"
        )
    if least is not None and np.any(array < least):
        raise OptionError(f"{name}: some go down to {np.nanmin(array):g}: give at least {least:g}")


def require_number(
    name: str,
    value: object,
    least: float = 0.0,
    most: float = 1e100,
    *,
    wanted: str = "it must be a finite number of at least 0",
    above: bool = False,
    whole: bool = False,
    unit: str = "",
    error: type[StruckError] = OptionError,
) -> None:
    """Refuse all but a number from `least` (with `above`: above it) to `most`.

    `wanted` says what belongs there, for numbers that are not `least` or not finite.
    """
    if not isinstance(value, Real):
        raise TypeError(f"{name} is {value!r}: give a number{unit and ' in' + unit}")
    try:
        number = float(value)
    except OverflowError:  # whole numbers have no end, and no text beyond 4,300 digits
        number = value = math.inf
    within = least < number if above else least <= number
    if not within or number == math.inf or (whole and number % 1):
        raise error(f"{name} is {value}{unit}: {wanted}")
    if number > most:
        raise error(f"{name} is {number:.6g}{unit}: it must be at most {most:g}")
