"""Model files (.struck): a modal model in one safetensors container."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.atomic import write_bytes
from struck.errors import FileFormatError, StruckError
from struck.files.container import pack, unpack
from struck.files.description import (
    material_from_json,
    material_to_json,
    plain,
    provenance_from_json,
    provenance_to_json,
)
from struck.files.formulas import formula_from_json, formula_to_json
from struck.gains import Radiation, ShapeGains
from struck.mesh import Mesh
from struck.model import ModalModel
from struck.radiation import by_name

VERSION = 1
# Shapes by letter: M modes, V vertices, F faces.
_LAYOUT: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "frequencies": ("float64", ("M",)),
    "natural_frequencies": ("float64", ("M",)),
    "decays": ("float64", ("M",)),
    "vertices": ("float64", ("V", 3)),
    "faces": ("uint32", ("F", 3)),
    "shapes": ("float32", ("V", 3, "M")),
    "outputs": ("float64", ("M", 2)),  # real and imaginary parts
    "poisson_slopes": ("float64", ("M",)),
    "errors": ("float64", ("M",)),
}
_OPTIONAL = {"poisson_slopes", "errors"}  # may be absent, and may hold NaN for unknown


def save(model: ModalModel, path: str | os.PathLike[str]) -> None:
    """Write a model so that `load` returns the very same numbers.

    Parameters
    ----------
    model : ModalModel
        With gains from mode shapes, and one of struck's dampings and estimates of radiation.
    path : path
        Where to write, by custom ending in ``.struck``; a file there is replaced as a whole.

    Raises
    ------
    FileFormatError
        When the model holds what version 1 cannot keep, or the file cannot be written.
    """
    try:
        data = to_bytes(model)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    write_bytes(path, data)


def load(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model that `save` wrote.

    Nothing in the file is executed, and nothing is used before its SHA-256 is checked.

    Parameters
    ----------
    path : path
        A ``.struck`` file.

    Raises
    ------
    FileFormatError
        When the file is missing, damaged, truncated, no model, or of a newer version.
    """
    try:
        return from_bytes(_read(Path(path)))
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error


def to_bytes(model: ModalModel) -> bytes:
    """Return a model as the content of a model file.

    Raises
    ------
    FileFormatError
        When the model holds what version 1 cannot keep.
    """
    try:
        text = json.dumps(_description(model), allow_nan=False, default=plain)
        return pack(_tensors(model), {"format": "struck", "version": str(VERSION), "json": text})
    except (FileFormatError, TypeError, ValueError) as error:
        raise FileFormatError(f"the model cannot be saved: {error}") from error


def from_bytes(data: bytes) -> ModalModel:
    """Return the model that the content of a model file holds.

    Raises
    ------
    FileFormatError
        When it is damaged, truncated, no model, or of a newer version.
    """
    try:
        metadata, tensors = unpack(data, kind="struck", newest=VERSION)
        _require_layout(tensors)
        return _model(json.loads(metadata["json"]), tensors)
    except StruckError as error:
        raise FileFormatError(str(error)) from error
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise FileFormatError(
            f"its metadata is not as the format demands ({type(error).__name__}: {error}): "
            "write it by docs/reference/model_file.md"
        ) from error


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(
            f"it cannot be opened ({error.strerror or error}): check the name and the permissions"
        ) from error


# Writing


def _tensors(model: ModalModel) -> dict[str, NDArray[Any]]:
    gains = _shape_gains(model)
    tensors = {
        "frequencies": model.frequencies,
        "natural_frequencies": model.natural_frequencies,
        "decays": model.decays,
        "vertices": gains.surface.points,
        "faces": gains.surface.faces.astype(np.uint32),
        "shapes": gains.shapes,
        "outputs": np.stack([gains.outputs.real, gains.outputs.imag], axis=1),
        "poisson_slopes": model.poisson_slopes,
        "errors": model.errors,
    }
    present = {name: np.asarray(array) for name, array in tensors.items() if array is not None}
    _require_layout(present)
    return {**present, **formula_to_json(gains.formula)[1]}


def _shape_gains(model: ModalModel) -> ShapeGains:
    gains, geometry = model.gains, model.geometry
    if not isinstance(gains, ShapeGains):
        raise FileFormatError(
            f"its gains are {type(gains).__name__}, and version {VERSION} keeps ShapeGains alone: "
            "give the model mode shapes on a surface"
        )
    if geometry is not None and not _same(geometry, gains.surface):
        raise FileFormatError(
            "its geometry is not the surface of its gains, and one surface is kept: make them one"
        )
    return gains


def _same(left: Mesh, right: Mesh) -> bool:
    return left is right or (
        left.up == right.up
        and np.array_equal(left.points, right.points)
        and np.array_equal(left.faces, right.faces)
    )


def _description(model: ModalModel) -> dict[str, Any]:
    gains = _shape_gains(model)
    return {
        "units": "SI",
        "material": None if model.material is None else material_to_json(model.material),
        "mass": None if model.mass is None else float(model.mass),
        "centre": _numbers(model.centre),
        "inertia": _numbers(model.inertia),
        "geometry": None if model.geometry is None else "surface",
        "supported": model.supported,
        "tensioned": model.tensioned,
        "up": gains.surface.up,
        "gains": {
            "kind": "ShapeGains",
            "centre": _numbers(gains.centre),
            "radiation": _radiation_name(gains.radiation),
            "formula": formula_to_json(gains.formula)[0],
        },
        "complete_to": float(model.complete_to),
        "coordinates": list(model.coordinates),
        "places": {name: _numbers(point) for name, point in model.places.items()},
        "provenance": provenance_to_json(model.provenance),
    }


def _numbers(array: NDArray[np.float64] | None) -> list[Any] | None:
    return None if array is None else np.asarray(array, dtype=np.float64).tolist()


def _radiation_name(radiation: Radiation) -> str:
    """Return the name, where that is all there is to tell."""
    known = by_name(radiation.name)
    if type(known) is not type(radiation) or vars(known) != vars(radiation):
        raise FileFormatError(
            f"its radiation {radiation.name!r} was changed, and files keep the name alone: make "
            f"the model with by_name({radiation.name!r})"
        )
    return radiation.name


# Reading


def _require_layout(tensors: Mapping[str, NDArray[Any]]) -> None:
    """Refuse tensors whose types, shapes or values the format does not allow."""
    sizes: dict[str | int, int] = {2: 2, 3: 3}
    for name, (dtype, letters) in _LAYOUT.items():
        if name not in tensors:
            if name not in _OPTIONAL:
                raise FileFormatError(f"its tensor {name!r} is missing: write all of {_names()}")
            continue
        array = tensors[name]
        fits = array.dtype.name == dtype and array.ndim == len(letters)
        if not fits or any(
            sizes.setdefault(letter, size) != size
            for letter, size in zip(letters, array.shape, strict=True)
        ):
            raise FileFormatError(
                f"its tensor {name!r} is {array.dtype.name} {array.shape}, not {dtype} "
                f"({', '.join(str(letter) for letter in letters)}): make the tensors fit"
            )
        if name not in _OPTIONAL and not np.isfinite(array).all():
            raise FileFormatError(f"its tensor {name!r} holds numbers that are not finite")


def _names() -> str:
    return ", ".join(name for name in _LAYOUT if name not in _OPTIONAL)


def _model(text: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> ModalModel:
    surface = Mesh(
        points=tensors["vertices"], faces=tensors["faces"].astype(np.int64), up=text["up"]
    )
    return ModalModel(
        frequencies=tensors["frequencies"],
        natural_frequencies=tensors["natural_frequencies"],
        decays=tensors["decays"],
        gains=_gains(text["gains"], surface, tensors),
        material=None if text["material"] is None else material_from_json(text["material"]),
        mass=None if text["mass"] is None else float(text["mass"]),
        centre=_array(text["centre"], (3,)),
        inertia=_array(text["inertia"], (3, 3)),
        geometry=surface if text["geometry"] == "surface" else None,
        supported=bool(text["supported"]),
        tensioned=bool(text.get("tensioned", False)),
        complete_to=float(text["complete_to"]),
        poisson_slopes=tensors.get("poisson_slopes"),
        errors=tensors.get("errors"),
        places={name: _vector(point) for name, point in text["places"].items()},
        coordinates=tuple(text["coordinates"]),
        provenance=provenance_from_json(text["provenance"]),
    )


def _gains(
    text: Mapping[str, Any], surface: Mesh, tensors: Mapping[str, NDArray[Any]]
) -> ShapeGains:
    if text["kind"] != "ShapeGains":
        raise FileFormatError(f"its gains are {text['kind']!r}, not 'ShapeGains': update struck")
    return ShapeGains(
        surface=surface,
        shapes=tensors["shapes"],
        outputs=np.ascontiguousarray(tensors["outputs"]).view(np.complex128)[:, 0],
        centre=_vector(text["centre"]),
        radiation=by_name(text["radiation"]),
        formula=formula_from_json(text.get("formula"), tensors),
    )


def _array(numbers: object, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    if numbers is None:
        return None
    array = np.array(numbers, dtype=np.float64)
    if array.shape != shape:
        raise FileFormatError(f"its metadata holds {array.shape} numbers where {shape} belong")
    return array


def _vector(numbers: object) -> NDArray[np.float64]:
    vector = _array(numbers, (3,))
    if vector is None:
        raise FileFormatError("its metadata holds null where x, y and z belong")
    return vector
