"""Model files (.struck): a modal model in one safetensors container."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, StruckError
from struck.files.atomic import write_bytes
from struck.files.container import pack, unpack
from struck.files.description import (
    material_from_json,
    material_to_json,
    plain,
    provenance_from_json,
    provenance_to_json,
)
from struck.files.gains_file import SHAPES, kind_named, kind_of
from struck.files.layout import Kept, Kind, Layout, Tensor, Tensors, Text, require_layout
from struck.files.residual_file import keep_residual, make_residual
from struck.files.values import (
    flag,
    near,
    numbers,
    numbers_or_none,
    one_of,
    refuse_constant,
    texts,
    vector,
)
from struck.model.gains import Gains, ShapeGains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel

Array = NDArray[np.float64]

VERSION = 1
# What Python raises on JSON of another form than is read.
_UNEXPECTED = (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
# Lengths by letter: M modes, V vertices, F faces. Gains add tensors of their own.
_LAYOUT: Layout = {
    "frequencies": Tensor("float64", ("M",)),
    "natural_frequencies": Tensor("float64", ("M",)),
    "decays": Tensor("float64", ("M",)),
    "vertices": Tensor("float64", ("V", 3), optional=True),
    "faces": Tensor("uint32", ("F", 3), optional=True),
    "poisson_slopes": Tensor("float64", ("M",), optional=True, gaps=True),
    "errors": Tensor("float64", ("M",), optional=True, gaps=True),
}


def save(model: ModalModel, path: str | os.PathLike[str]) -> None:
    """Write a model so that `load` returns the very same numbers.

    Parameters
    ----------
    model : ModalModel
        With gains of one of struck's kinds, and one of its dampings and estimates of radiation.
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
        kept = _kept(model)
        text = json.dumps(kept.text, allow_nan=False, default=plain)
        metadata = {"format": "struck", "version": str(VERSION), "json": text}
        return pack(kept.tensors, metadata)
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
        text = json.loads(metadata["json"], parse_constant=refuse_constant)
        return _model(text, tensors)
    except StruckError as error:
        raise FileFormatError(str(error)) from error
    except _UNEXPECTED as error:
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


def _kept(model: ModalModel) -> Kept:
    """Return what a file keeps of a model: each part brings JSON, tensors or both."""
    kind, surface = kind_of(model.gains), _surface(model)
    gains, residual = kind.keep(model.gains), keep_residual(model.residual)
    tensors = {
        "frequencies": model.frequencies,
        "natural_frequencies": model.natural_frequencies,
        "decays": model.decays,
        "vertices": None if surface is None else near(surface.points, "surface"),
        "faces": None if surface is None else surface.faces.astype(np.uint32),
        "poisson_slopes": model.poisson_slopes,
        "errors": model.errors,
        **gains.tensors,
        **residual.tensors,
    }
    present = {name: np.asarray(array) for name, array in tensors.items() if array is not None}
    require_layout(present, {**_LAYOUT, **kind.layout})
    text = {**_description(model, surface, gains.text), **residual.text}
    make_residual(text, present)
    _require_coordinates(kind, kind.make(gains.text, present, surface), model.coordinates)
    _places(text["places"], kind, model.coordinates)
    return Kept(text=text, tensors=present)


def _surface(model: ModalModel) -> Mesh | None:
    """Return the one surface that is kept."""
    gains, geometry = model.gains, model.geometry
    if not isinstance(gains, ShapeGains):
        return geometry
    if geometry is not None and not _same(geometry, gains.surface):
        raise FileFormatError(
            "its geometry is not the surface of its gains, and one surface is kept: make them one"
        )
    return gains.surface


def _same(left: Mesh, right: Mesh) -> bool:
    return left is right or (
        left.up == right.up
        and np.array_equal(left.points, right.points)
        and np.array_equal(left.faces, right.faces)
    )


def _description(model: ModalModel, surface: Mesh | None, gains: Text) -> dict[str, Any]:
    return {
        "units": "SI",
        "material": None if model.material is None else material_to_json(model.material),
        "mass": None if model.mass is None else float(model.mass),
        "centre": _list(model.centre),
        "inertia": _list(model.inertia),
        "geometry": None if model.geometry is None else "surface",
        "supported": model.supported,
        "tensioned": model.tensioned,
        "up": None if surface is None else surface.up,
        "gains": {"kind": type(model.gains).__name__, **gains},
        "complete_to": float(model.complete_to),
        "coordinates": list(model.coordinates),
        "places": {name: _list(point) for name, point in model.places.items()},
        "provenance": provenance_to_json(model.provenance),
    }


def _list(array: Array | None) -> list[Any] | None:
    return None if array is None else np.asarray(array, dtype=np.float64).tolist()


# Reading


def _model(text: Text, tensors: Tensors) -> ModalModel:
    kind = kind_named(text["gains"]["kind"])
    require_layout(tensors, {**_LAYOUT, **kind.layout})
    surface, coordinates = _given_surface(text, tensors), texts(text["coordinates"], "coordinates")
    gains = kind.make(text["gains"], tensors, surface)
    _require_coordinates(kind, gains, coordinates)
    return ModalModel(
        frequencies=tensors["frequencies"],
        natural_frequencies=tensors["natural_frequencies"],
        decays=tensors["decays"],
        gains=gains,
        material=None if text["material"] is None else material_from_json(text["material"]),
        mass=None if text["mass"] is None else float(numbers(text["mass"], ())),
        centre=numbers_or_none(text["centre"], (3,)),
        inertia=numbers_or_none(text["inertia"], (3, 3)),
        geometry=surface if text["geometry"] == "surface" else None,
        supported=flag(text["supported"], "supported"),
        tensioned=flag(text.get("tensioned", False), "tensioned"),
        complete_to=float(numbers(text["complete_to"], ())),
        poisson_slopes=tensors.get("poisson_slopes"),
        errors=tensors.get("errors"),
        places=_places(text["places"], kind, coordinates),
        coordinates=coordinates,
        residual=make_residual(text, tensors),
        provenance=provenance_from_json(text["provenance"]),
    )


def _given_surface(text: Text, tensors: Tensors) -> Mesh | None:
    given = [name for name in ("vertices", "faces") if name in tensors]
    if not given and text["geometry"] is None:
        return None
    if len(given) < 2:
        raise FileFormatError(
            f"of vertices and faces it has {' '.join(given) or 'none'}, and its geometry is "
            f"{text['geometry']!r}: give both, or neither and null"
        )
    return Mesh(
        points=near(tensors["vertices"], "tensor 'vertices'"),
        faces=tensors["faces"].astype(np.int64),
        up=one_of(text["up"], "up", ("x", "y", "z")),
    )


def _places(text: Text, kind: Kind, coordinates: tuple[str, ...]) -> dict[str, Array]:
    """Return contacts by name: points of a surface, or what recordings call a contact."""
    count = 3 if kind is SHAPES else len(coordinates)
    return {name: vector(place, count) for name, place in text.items()}


def _require_coordinates(kind: Kind, gains: Gains, coordinates: tuple[str, ...]) -> None:
    wanted = kind.coordinates(gains)
    if wanted not in {None, len(coordinates)}:
        raise FileFormatError(
            f"its contacts have {len(coordinates)} coordinates, {', '.join(coordinates)}, and its "
            f"{kind.made.__name__} knows {wanted}: name as many"
        )
