"""What a kind of content looks like in a model file: its tensors, and how it is told and made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError
from struck.files.packing import Arrays
from struck.model.gains import Gains
from struck.model.mesh import Mesh

Tensors = Mapping[str, NDArray[Any]]
Text = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Tensor:
    """One array of a file.

    Parameters
    ----------
    dtype : str
        "float64", "float32" or "uint32".
    shape : tuple
        Lengths, or letters for lengths that all tensors with the letter share.
    optional : bool
        Whether it may be absent.
    gaps : bool
        Whether it may hold what is not finite, for unknown.
    """

    dtype: str
    shape: tuple[str | int, ...]
    optional: bool = False
    gaps: bool = False


Layout = Mapping[str, Tensor]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """What a file keeps of something.

    Parameters
    ----------
    text : dict
        Values that JSON holds.
    tensors : dict
        Arrays by name.
    """

    text: dict[str, Any]
    tensors: Arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kind:
    """How files keep one kind of gains.

    Parameters
    ----------
    made : type
        The class of the gains.
    layout : Layout
        Of its tensors.
    keep : callable
        Tells what a file keeps of the gains.
    make : callable
        Makes them again from text and tensors, and the body's surface if there is one.
    coordinates : callable
        Tells how many numbers name a contact, or None where any will do.
    """

    made: type[Gains]
    layout: Layout
    keep: Callable[[Any], Kept]
    make: Callable[[Text, Tensors, Mesh | None], Gains]
    coordinates: Callable[[Any], int | None] = lambda _: None


def require_layout(tensors: Tensors, layout: Layout) -> None:
    """Refuse tensors that are missing, or whose types, shapes or values are others.

    Tensors that the layout does not name may be there too.

    Raises
    ------
    FileFormatError
        On the first one that does not fit.
    """
    sizes: dict[str, int] = {}
    for name, wanted in layout.items():
        if name in tensors:
            _require_fit(name, tensors[name], wanted, sizes)
        elif not wanted.optional:
            raise FileFormatError(f"its tensor {name!r} is missing: write all of {_names(layout)}")


def _require_fit(name: str, array: NDArray[Any], wanted: Tensor, sizes: dict[str, int]) -> None:
    fits = array.dtype.name == wanted.dtype and array.ndim == len(wanted.shape)
    if not fits or any(
        size != (length if isinstance(length, int) else sizes.setdefault(length, size))
        for length, size in zip(wanted.shape, array.shape, strict=True)
    ):
        raise FileFormatError(
            f"its tensor {name!r} is {array.dtype.name} {array.shape}, not {wanted.dtype} "
            f"({', '.join(str(length) for length in wanted.shape)}): make the tensors fit"
        )
    if not wanted.gaps and not np.isfinite(array).all():
        raise FileFormatError(f"its tensor {name!r} holds numbers that are not finite")


def _names(layout: Layout) -> str:
    return ", ".join(name for name, tensor in layout.items() if not tensor.optional)


def in_pairs(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return complex numbers (...) as real and imaginary parts (..., 2)."""
    return np.stack([values.real, values.imag], axis=-1)


def from_pairs(pairs: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return real and imaginary parts (..., 2) as complex numbers (...)."""
    return np.ascontiguousarray(pairs).view(np.complex128)[..., 0]
