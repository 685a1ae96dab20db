"""Model files (.struck): a modal model in one safetensors container."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, LossWarning, OptionError, StruckError
from struck.files import sofa_fields
from struck.files.atomic import writable, write_bytes
from struck.files.container import (
    Kept,
    Kind,
    Layout,
    Tensor,
    Tensors,
    Text,
    flag,
    near,
    number,
    numbers,
    numbers_or_none,
    one_of,
    pack,
    refuse_constant,
    require_layout,
    texts,
    unpack,
    vector,
)
from struck.files.gains_file import SHAPES, kind_named, kind_of
from struck.files.sofa_fields import Contacts, load_sofa_field, save_sofa, save_sofa_responses
from struck.model.arrays import Array
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh
from struck.model.gains import Gains, ShapeGains
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.residual import Residual

# Materials and provenance as JSON, and back.

_DAMPINGS: dict[str, Callable[..., Damping]] = {
    kind.__name__: kind for kind in (InternalFriction, Rayleigh, Measured)
}


def material_to_json(material: Material) -> dict[str, Any]:
    """Return a material as a JSON object; FileFormatError on a foreign damping law."""
    damping = material.damping
    kind = type(damping).__name__
    if not isinstance(damping, InternalFriction | Rayleigh | Measured) or kind not in _DAMPINGS:
        raise FileFormatError(
            f"its damping is {kind}, and files keep {', '.join(_DAMPINGS)} alone: use one of them"
        )
    return {**asdict(material), "damping": {"kind": kind, **asdict(damping)}}


def provenance_to_json(provenance: Provenance) -> dict[str, Any]:
    """Return a provenance as a JSON object."""
    return {
        "method": provenance.method,
        "references": list(provenance.references),
        "dropped": list(provenance.dropped),
        "details": dict(provenance.details),
    }


def plain(value: object) -> object:
    """Return NumPy's numbers as Python's own, for `json.dumps`."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"provenance holds {value!r}, and JSON values are kept alone")


def material_from_json(text: Mapping[str, Any]) -> Material:
    """Return the material that a JSON object describes."""
    return Material(**{**text, "damping": _damping(text["damping"])})


def _damping(text: Mapping[str, Any]) -> Damping:
    if text["kind"] not in _DAMPINGS:
        raise FileFormatError(f"its damping is {text['kind']!r}, none of {', '.join(_DAMPINGS)}")
    numbers = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in text.items()
        if name != "kind"
    }
    return _DAMPINGS[text["kind"]](**numbers)


def provenance_from_json(text: Mapping[str, Any]) -> Provenance:
    """Return the provenance that a JSON object describes."""
    return Provenance(
        method=text["method"],
        references=tuple(text["references"]),
        dropped=tuple(text["dropped"]),
        details=text["details"],
    )


# How model files keep what recordings have beside their modes.

_RESIDUAL_FILE_LAYOUT: Layout = {
    "residual_attack": Tensor("float32", ("A",)),
    "residual_edges": Tensor("float64", ("E",)),
    "residual_levels": Tensor("float64", ("B",)),
    "residual_decays": Tensor("float64", ("B",)),
}


def keep_residual(residual: Residual | None) -> Kept:
    """Return what a file keeps of attack and noise; null for none."""
    if residual is None:
        return Kept(text={"residual": None}, tensors={})
    tensors = {
        "residual_attack": residual.attack,
        "residual_edges": residual.edges,
        "residual_levels": residual.levels,
        "residual_decays": residual.decays,
    }
    text = {"sample_rate": int(residual.sample_rate), "lead": float(residual.lead)}
    return Kept(text={"residual": text}, tensors=tensors)


def make_residual(text: Text, tensors: Tensors) -> Residual | None:
    """Return attack and noise that a file describes; None where it has none."""
    told = text.get("residual")
    if told is None:
        return None
    require_layout(tensors, _RESIDUAL_FILE_LAYOUT)
    return Residual(
        attack=tensors["residual_attack"],
        sample_rate=int(number(told["sample_rate"], "residual's sample rate", 1, 1e9)),
        lead=number(told["lead"], "residual's lead", 0),
        edges=tensors["residual_edges"],
        levels=tensors["residual_levels"],
        decays=tensors["residual_decays"],
    )


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
    """Return a model as the content of a model file."""
    try:
        kept = _kept(model)
        text = json.dumps(kept.text, allow_nan=False, default=plain)
        metadata = {"format": "struck", "version": str(VERSION), "json": text}
        return pack(kept.tensors, metadata)
    except (FileFormatError, TypeError, ValueError) as error:
        raise FileFormatError(f"the model cannot be saved: {error}") from error


def from_bytes(data: bytes) -> ModalModel:
    """Return the model that the content of a model file holds."""
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
    """Return the JSON values and tensors that a file keeps of a model."""
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
    """Return the only surface that a file keeps."""
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
    """Return named contacts: points of a surface, or coordinates of a recording."""
    count = 3 if kind is SHAPES else len(coordinates)
    return {name: vector(place, count) for name, place in text.items()}


def _require_coordinates(kind: Kind, gains: Gains, coordinates: tuple[str, ...]) -> None:
    wanted = kind.coordinates(gains)
    if wanted not in {None, len(coordinates)}:
        raise FileFormatError(
            f"its contacts have {len(coordinates)} coordinates, {', '.join(coordinates)}, and its "
            f"{kind.made.__name__} knows {wanted}: name as many"
        )


# Models in files of any kind that holds one, told by the ending of the name.

ENDINGS = (".struck", ".sofa")  # of model files
CONVENTIONS = (sofa_fields.CONVENTION, sofa_fields.RESPONSES_CONVENTION)  # of SOFA files
_SOFA = ".sofa"
_LONGEST = 10.0


def model_path(
    path: str | os.PathLike[str], *, unlike: Iterable[str | os.PathLike[str]] = ()
) -> Path:
    """Return the path of a model to write, refused early as by `writable` or by its ending."""
    _require_ending(path)
    return writable(path, unlike=unlike)


def is_model(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file's ending is one of `ENDINGS`."""
    return Path(path).suffix.lower() in ENDINGS


def save_model(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
) -> None:
    """Write a model to a ``.struck`` file, or its gains to a ``.sofa`` file, atomically.

    Parameters
    ----------
    model : ModalModel
    path : path
    contacts, listeners : array-like, optional
        For ``.sofa`` files, as for `export`.

    Raises
    ------
    FileFormatError
        When the file cannot be written, or cannot keep the model.
    OptionError
        On another ending, on contacts or listeners for a ``.struck`` file, and as `export`.
    ContactError, MissingDependencyError
        As `export`.

    Warns
    -----
    LossWarning
        As `export`.
    """
    _require_ending(path)
    if _is_sofa(path):
        export(model, path, contacts=contacts, listeners=listeners)
        return
    if contacts is not None or listeners is not None:
        raise OptionError(
            f"{path} keeps a model as a whole: leave contacts= and listeners= out, or end in .sofa"
        )
    save(model, path)


def load_model(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model from a ``.struck`` file, or from a ``.sofa`` file of gains of modes.

    Raises
    ------
    FileFormatError
        When the file is missing, damaged, no model, or of a newer version.
    MissingDependencyError
        When h5py, which reads SOFA files, is not installed.
    """
    if not _is_sofa(path):
        return load(path)
    field = load_sofa_field(path)
    try:
        return field.model()
    except OptionError as error:
        raise FileFormatError(f"{path}: no model can be made of it: {error}") from error


def export(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
    convention: str = sofa_fields.CONVENTION,
    seconds: float | None = None,
    sample_rate: int = 48_000,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> int:
    """Write the gains of a model as a SOFA file (AES69).

    Parameters
    ----------
    model : ModalModel
    path : path
        Ends in ``.sofa``.
    contacts : array-like (P, D), optional
        Coordinates of a recorded model, or points on a surface, m, or names. Those that were
        recorded unless given; of a computed model they must be given.
    listeners : array-like (Q, 3), optional
        Body coordinates, m; the same holds for them.
    convention : str
        "GeneralTF-E": gains, frequencies and decays of modes, which come back to the last bit;
        "GeneralFIR-E": impulse responses, for other programs.
    seconds : float, optional
        Length of impulse responses; until the slowest mode has fallen by 60 dB, at most 10 s,
        unless given.
    sample_rate : int
        Of impulse responses, Hz.
    title, author, licence : str
        What a reader should know.

    Returns
    -------
    int
        How many modes impulse responses leave out, at or above half the sample rate.

    Raises
    ------
    OptionError
        On another ending or convention, and as `save_sofa` and `save_sofa_responses`.
    ContactError
        On a contact off the body, or a listener inside it.
    FileFormatError
        When the file cannot be written.
    MissingDependencyError
        Without h5py.

    Warns
    -----
    LossWarning
        When the model has what SOFA files cannot hold; see `left_out`.
    """
    if not _is_sofa(path):
        raise OptionError(f"{path} ends in {Path(path).suffix!r}: SOFA files end in '.sofa'")
    if convention not in CONVENTIONS:
        raise OptionError(f"convention is {convention!r}: give one of {', '.join(CONVENTIONS)}")
    told = {"title": title, "author": author, "licence": licence}
    if convention == sofa_fields.CONVENTION:
        if seconds is not None:
            raise OptionError(
                f"seconds is {seconds}: {convention} holds modes, not samples; leave it out, or "
                f"choose {sofa_fields.RESPONSES_CONVENTION}"
            )
        save_sofa(model, path, contacts=contacts, listeners=listeners, **told)
        beyond = 0
    else:
        beyond = save_sofa_responses(
            model,
            path,
            seconds=_ringing(model) if seconds is None else seconds,
            sample_rate=sample_rate,
            contacts=contacts,
            listeners=listeners,
            **told,
        )
    _tell_losses(model, path)
    return beyond


def left_out(model: ModalModel) -> tuple[str, ...]:
    """Return the parts of a model that SOFA files cannot hold."""
    parts = {
        "its residual (attack and noise)": model.residual,
        "its shape": model.geometry,
        "its material": model.material,
    }
    return tuple(name for name, part in parts.items() if part is not None)


def _tell_losses(model: ModalModel, path: str | os.PathLike[str]) -> None:
    lost = left_out(model)
    if lost:
        warnings.warn(
            f"{path} holds gains alone, without {', '.join(lost)}: keep a .struck file as well",
            LossWarning,
            stacklevel=3,
        )


def _require_ending(path: str | os.PathLike[str]) -> None:
    if not is_model(path):
        ending = Path(path).suffix
        raise OptionError(
            f"{path} ends in {ending!r}: models end in .struck, or in .sofa for their gains alone"
        )


def _is_sofa(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix.lower() == _SOFA


def _ringing(model: ModalModel) -> float:
    slowest = float(np.min(model.decays, initial=np.inf))
    fallen = float(np.log(1000))
    return fallen / slowest if slowest * _LONGEST > fallen else _LONGEST
