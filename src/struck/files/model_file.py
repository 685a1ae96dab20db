"""Model files: a whole modal model (.struck, one safetensors container), or its gains (.sofa)."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, OptionError, StruckError, rounded
from struck.files.atomic import ended, is_file, read_bytes, writable, write_bytes
from struck.files.container import (
    UNEXPECTED,
    Arrays,
    Kind,
    Layout,
    Tensor,
    Tensors,
    Text,
    from_pairs,
    from_plain,
    kept_tensors,
    near,
    pack,
    refuse_constant,
    require_layout,
    to_plain,
    unpack,
)
from struck.files.model_schema import require_schema
from struck.files.recognition import MODELS, explain_not_model, kind_by_name
from struck.model.air_losses import AirLosses
from struck.model.arrays import Array, checked, require_numbers
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh
from struck.model.gains import Gains, Radiation, ShapeGains, TransverseShapes
from struck.model.material import AIR, Air, Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.recoil import Recoil
from struck.model.residual import Residual
from struck.radiation import by_name

if TYPE_CHECKING:
    from struck.files.sofa_fields import Places
    from struck.model.chart import Chart
    from struck.radiation.boundary_elements import SurfaceField


# Gains: mode shapes on a surface; kinds of recorded gains by name, from `fields_file`.

_FORMULA, _NEAR = "formula.", "near."
# By annotation of a formula's part: NumPy's kind of number, and the largest size.
_PARTS = {"float": ("f", 1e100), "Array": ("f", 1e100), "Index": ("i", 10_000)}
_SAMPLE_COUNT, _MAX_DEVIATION = 8, 1e-3  # vertices, share of the largest displacement
GAINS = ("ShapeGains", "RadiatingGains", "TimbreField", "TimbreTable", "SinglePoint")


def kind_of(gains: Gains) -> Kind:
    """Return how files keep these gains; FileFormatError when they do not."""
    name = type(gains).__name__
    kind = kind_named(name) if name in GAINS else None
    if kind is None or type(gains) is not kind.made:
        raise FileFormatError(
            f"its gains are {name}, and files keep {', '.join(GAINS)} alone: save the model that "
            "it was made from"
        )
    return kind


def kind_named(name: str) -> Kind:
    """Return how files keep gains of a class of `GAINS`; of fields only where they are met."""
    if name == _SHAPES.made.__name__:
        return _SHAPES
    if name == "RadiatingGains":
        return _radiating()
    from struck.files.fields_file import FIELDS

    return FIELDS[name]


# Mode shapes on a surface


def _keep_shapes(gains: ShapeGains) -> tuple[dict[str, Any], Arrays]:
    arrays: Arrays = {}
    formula = None if gains.formula is None else to_plain(gains.formula, _formulas(), arrays)
    text = {
        "centre": np.asarray(gains.centre, dtype=np.float64).tolist(),
        "radiation": _radiation_name(gains.radiation),
        "formula": formula,
    }
    arrays_by_name = {_FORMULA + name: array for name, array in arrays.items()}
    if gains.losses is not None:
        arrays_by_name |= {name: getattr(gains.losses, part) for name, part in _LOSSES.items()}
    return text, arrays_by_name


def _radiation_name(radiation: Radiation) -> str:
    """Return the name of an estimate of radiation; FileFormatError when it was changed."""
    known = by_name(radiation.name)
    if type(known) is not type(radiation) or known.__getstate__() != radiation.__getstate__():
        raise FileFormatError(
            f"its radiation {radiation.name!r} was changed, and files keep the name alone: make "
            f"the model with by_name({radiation.name!r})"
        )
    return radiation.name


def _make_shapes(text: Text, tensors: Tensors, surface: Mesh | None) -> ShapeGains:
    if surface is None:
        raise FileFormatError("its mode shapes have no surface: give vertices and faces")
    gains = ShapeGains(
        surface=surface,
        shapes=tensors["shapes"],
        outputs=from_pairs(tensors["outputs"]),
        centre=np.array(text["centre"], np.float64),
        radiation=by_name(text["radiation"]),
        formula=_formula(text.get("formula"), tensors),
        losses=_losses(tensors),
    )
    _require_same_shapes(gains)
    return gains


def _losses(tensors: Tensors) -> AirLosses | None:
    """Return the losses to the air in a file; None in older files."""
    if not tensors.keys() & _LOSSES.keys():
        return None
    if missing := sorted(_LOSSES.keys() - tensors.keys()):
        raise FileFormatError(
            f"its tensor {missing[0]!r} is missing: write all of {', '.join(_LOSSES)}"
        )
    return AirLosses(**{part: tensors[name] for name, part in _LOSSES.items()})


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


def _require_same_shapes(gains: ShapeGains) -> None:
    """Refuse a formula with damaged parts, or with other shapes than the vertices have."""
    formula, points = gains.formula, gains.surface.points
    if formula is None:
        return
    parts: tuple[Any, ...] = (formula, formula.forms)
    for part in parts:
        for field in fields(part):
            kind, largest = _PARTS.get(str(field.type), ("", 0))
            value = np.asarray(getattr(part, field.name))
            if kind and (
                (value.dtype.kind, value.ndim > 0) != (kind, field.type != "float")
                or not -largest <= value.min(initial=0) <= value.max(initial=0) <= largest
            ):
                raise FileFormatError(
                    f"its formula's {field.name} is damaged, no {field.type} of at most "
                    f"{rounded(largest)} in size: save the model again"
                )
    sample = np.linspace(0, len(points) - 1, _SAMPLE_COUNT).astype(np.int64)
    with np.errstate(all="ignore"):
        formula_shapes, shapes = formula.displacements(points[sample]), gains.shapes[sample]
        deviation = (
            np.abs(formula_shapes - shapes).max(initial=0.0)
            if formula_shapes.shape == shapes.shape
            else np.inf
        )
    if not deviation <= _MAX_DEVIATION * np.abs(shapes).max(initial=0.0):
        raise FileFormatError(
            "its formula gives other mode shapes than its vertices have: save the model again"
        )


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


_LOSSES = {"air_sound": "sound", "air_surface": "surface", "air_uncertainty": "uncertainty"}
# Lengths by letter: M modes, V vertices, F faces.
_SHAPES = Kind(
    made=ShapeGains,
    layout={
        "vertices": Tensor("float64", ("V", 3)),
        "faces": Tensor("uint32", ("F", 3)),
        "shapes": Tensor("float32", ("V", 3, "M"), "shapes"),
        "outputs": Tensor("float64", ("M", 2), "outputs"),
        **dict.fromkeys(_LOSSES, Tensor("float64", ("M",), optional=True)),
    },
    keep=_keep_shapes,
    make=_make_shapes,
)


# Computed fields of such shapes


def _radiating() -> Kind:
    """Return how files keep computed fields: as mode shapes, with waves about the centre."""
    from struck.radiation.boundary_elements import SurfaceField
    from struck.radiation.directivity import RadiatingGains
    from struck.radiation.multipoles import Multipoles

    kinds = (SurfaceField, Mesh, Air)

    def keep(gains: RadiatingGains) -> tuple[dict[str, Any], Arrays]:
        text, arrays = _keep_shapes(gains)
        near_arrays: Arrays = {}
        near = to_plain(gains.near, kinds, near_arrays) if gains.near else None
        arrays |= {_NEAR + name: array for name, array in near_arrays.items()}
        return {**text, "radius": float(gains.field.radius), "near": near}, arrays

    def make(text: Text, tensors: Tensors, surface: Mesh | None) -> RadiatingGains:
        shaped = _make_shapes(text, tensors, surface)
        field = Multipoles(
            wave_numbers=tensors["multipole_wave_numbers"],
            degrees=tensors["multipole_degrees"].astype(np.int64),
            amplitudes=from_pairs(tensors["multipoles"]),
            radius=float(text["radius"]),
            errors=tensors["multipole_errors"],
        )
        return RadiatingGains.with_field(
            shaped, field=field, near=_near(text["near"], tensors, kinds)
        )

    # T waves of all modes.
    waves = {
        "multipoles": Tensor("float64", ("T", 2), "field.amplitudes"),
        "multipole_degrees": Tensor("uint32", ("M",), "field.degrees"),
        "multipole_wave_numbers": Tensor("float64", ("M",), "field.wave_numbers"),
        "multipole_errors": Tensor("float64", ("M", 2), "field.errors", gaps=True),
    }
    layout = {**_SHAPES.layout, **waves}
    return Kind(made=RadiatingGains, layout=layout, keep=keep, make=make, version=2)


def _near(plain: object, tensors: Tensors, kinds: tuple[type, ...]) -> tuple[SurfaceField, ...]:
    """Return the fields on the body's surface in a file; FileFormatError where it is damaged."""
    if plain is None:
        return ()
    arrays = {
        name.removeprefix(_NEAR): array for name, array in tensors.items() if name.startswith(_NEAR)
    }
    parts = from_plain(plain, {kind.__name__: kind for kind in kinds}, arrays)
    for part in parts:
        shape, modes = (len(part.mesh.faces), len(part.modes)), len(tensors["multipole_degrees"])
        require_numbers("its near pressures", part.pressures, (2, *shape))
        require_numbers("its near velocities", part.velocities, shape)
        require_numbers("its near errors", part.errors, shape[1:], gaps=True, least=0)
        require_numbers("its near wave_numbers", part.wave_numbers, shape[1:], least=0)
        known = part.modes.dtype == np.int64 and (part.modes < modes).all()
        if part.air != AIR or not known or not isinstance(part.mesh, Mesh):
            raise FileFormatError("its near fields are damaged: save the model again")
    return tuple(parts)


ENDINGS = tuple(f".{ending}" for ending in MODELS)  # of model files
SHAPES = ".vtu"  # of shapes that `save` writes, and that are not read as models
VERSION = 2  # the newest; files that older readers can read are written as 1
_SOFA = ".sofa"
_DAMPINGS: dict[str, Callable[..., Damping]] = {
    kind.__name__: kind for kind in (InternalFriction, Rayleigh, Measured)
}
# Lengths by letter: M modes, V vertices, F faces. Gains add further tensors.
_LAYOUT: Layout = {
    "frequencies": Tensor("float64", ("M",), "frequencies"),
    "natural_frequencies": Tensor("float64", ("M",), "natural_frequencies"),
    "decays": Tensor("float64", ("M",), "decays"),
    "vertices": Tensor("float64", ("V", 3), optional=True),
    "faces": Tensor("uint32", ("F", 3), optional=True),
    "poisson_slopes": Tensor("float64", ("M",), "poisson_slopes", optional=True, gaps=True),
    "errors": Tensor("float64", ("M",), "errors", optional=True, gaps=True),
}
_RESIDUAL: Layout = {
    "residual_attack": Tensor("float32", ("A",), "attack"),
    "residual_edges": Tensor("float64", ("E",), "edges"),
    "residual_levels": Tensor("float64", ("B",), "levels"),
    "residual_decays": Tensor("float64", ("B",), "decays"),
}


def write_struck(model: ModalModel, path: str | os.PathLike[str]) -> None:
    """Write a model so that `read_struck` returns the very same numbers.

    Parameters
    ----------
    model : ModalModel
        With gains of one of struck's kinds, and one of its dampings and estimates of radiation.
    path : path
        Where to write, by custom ending in ``.struck``; a file there is replaced as a whole.

    Raises
    ------
    FileFormatError
        When the model holds what files cannot keep, or the file cannot be written.
    """
    try:
        data = to_bytes(model)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    write_bytes(path, data)


def read_struck(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model that `write_struck` wrote.

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
    if re.fullmatch(r"[a-z-]{2,}:(\w+=.*)?", f"{path}") and not is_file(path):
        raise FileFormatError(f"{path} is a body, not a model: analyze it first (struck analyze)")
    require_model(path)
    data = read_bytes(path)
    try:
        return from_bytes(data)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error


def to_bytes(model: ModalModel) -> bytes:
    """Return a model as the content of a model file."""
    try:
        text, tensors = _serialise(model)
        json_text = json.dumps(text, allow_nan=False, default=_plain)
        require_schema(json.loads(json_text))
        version = str(kind_of(model.gains).version)
        metadata = {"format": "struck", "version": version, "json": json_text}
        return pack(tensors, metadata)
    except (FileFormatError, TypeError, ValueError) as error:
        raise FileFormatError(f"the model cannot be saved: {error}") from error


def from_bytes(data: bytes) -> ModalModel:
    """Return the model that the content of a model file holds."""
    try:
        metadata, tensors = unpack(data, kind="struck", newest=VERSION)
        text = json.loads(metadata["json"], parse_constant=refuse_constant)
        require_schema(text)
        return _model(text, tensors)
    except StruckError as error:
        raise FileFormatError(str(error)) from error
    except UNEXPECTED as error:
        raise FileFormatError(
            f"its metadata is not as the format demands ({type(error).__name__}: {error}): "
            "write it by docs/reference/model_file.md"
        ) from error


def model_path(
    path: str | os.PathLike[str], *, unlike: Iterable[str | os.PathLike[str]] = ()
) -> Path:
    """Return the path of a model to write, refused early as by `writable` or by its ending."""
    _require_ending(path)
    return writable(path, unlike=unlike)


def is_model(path: str | os.PathLike[str]) -> bool:
    """Return whether a file's ending is one of `ENDINGS`."""
    return Path(path).suffix.lower() in ENDINGS


def require_model(path: str | os.PathLike[str]) -> None:
    """Refuse a file of another kind where a model belongs, by its content or its ending."""
    named = kind_by_name(path)
    known = is_file(path) or (named is not None and named.group != "model")
    if known and (other := explain_not_model(path)):
        raise FileFormatError(f"{path} {other}")


@checked
def save(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Places | None = None,
    listeners: ArrayLike | None = None,
) -> None:
    """Save a model to a file.

    Parameters
    ----------
    model : ModalModel
        The model.
    path : path
        The ending selects the format: ``.struck`` holds the whole model, ``.sofa`` its gains,
        ``.vtu`` its surface with one vector field for each mode shape.
    contacts : array-like (K, 3) or sequence of str, optional
        Contacts of a ``.sofa`` file, m, or names of contacts. Default: the recorded ones.
    listeners : array-like (L, 3), optional
        Listeners of a ``.sofa`` file, m. Default: the recorded ones.

    Raises
    ------
    FileFormatError
        If the folder does not exist or cannot be written, or the model holds what files cannot
        keep.
    OptionError
        If the ending is unknown, contacts or listeners are given for another format, or are missing
        for the ``.sofa`` file of a computed model, or the model has no mode shapes for a ``.vtu``
        file.

    Warns
    -----
    LossWarning
        If the model has parts that a ``.sofa`` file cannot hold: a residual, a shape, a material.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> struck.save(struck.analyze(bar, "steel", progress=None), "bar.struck")
    """
    shapes = Path(path).suffix.lower() == SHAPES
    if not shapes:
        _require_ending(path)
    if _is_sofa(path):
        from struck.files.sofa_fields import export

        export(model, path, contacts=contacts, listeners=listeners)
        return
    if contacts is not None or listeners is not None:
        raise OptionError(
            f"{path} keeps all contacts: leave contacts= and listeners= out, or end in .sofa"
        )
    if shapes:
        from struck.files.mesh_formats import write_shapes

        write_shapes(model, path)
    else:
        write_struck(model, path)


@checked
def load(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model from a file.

    Parameters
    ----------
    path : path
        A ``.struck`` file, or a ``.sofa`` file of gains of modes.

    Returns
    -------
    ModalModel
        The model.

    Raises
    ------
    FileFormatError
        If the file is missing, damaged, not a model, or of a newer version.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> struck.save(model, "bar.struck")
    >>> bool((struck.load("bar.struck").frequencies == model.frequencies).all())
    True
    """
    if not _is_sofa(path):
        return read_struck(path)
    require_model(path)
    from struck.files.sofa_fields import load_sofa_field

    field = load_sofa_field(path)
    try:
        return field.model()
    except OptionError as error:
        raise FileFormatError(f"{path}: no model can be made of it: {error}") from error


def _require_ending(path: str | os.PathLike[str]) -> None:
    if not is_model(path):
        path = Path(path)
        raise OptionError(
            f"{path} {ended(path)}: models end in .struck, as {path.stem or 'model'}"
            ".struck, or in .sofa for their gains alone; `struck export` writes shapes, as .vtu"
        )


def _is_sofa(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix.lower() == _SOFA


# Writing


def _serialise(model: ModalModel) -> tuple[dict[str, Any], Arrays]:
    """Return the JSON values and tensors that a file keeps of a model."""
    kind, surface = kind_of(model.gains), _surface(model)
    gains, tensors = kind.keep(model.gains)
    tensors |= kept_tensors(model, _LAYOUT) | kept_tensors(model.gains, kind.layout)
    if surface is not None:
        tensors["vertices"] = near(surface.points, "surface")
        tensors["faces"] = surface.faces.astype(np.uint32)
    text = _description(model, surface, gains)
    if model.residual is not None:
        tensors |= kept_tensors(model.residual, _RESIDUAL)
    require_layout(tensors, {**_LAYOUT, **kind.layout})
    _make_residual(text, tensors)
    kind.make(gains, tensors, surface)
    return text, tensors


def _surface(model: ModalModel) -> Mesh | None:
    """Return the only surface that a file keeps."""
    gains, geometry = model.gains, model.geometry
    if not isinstance(gains, ShapeGains):
        return geometry
    if geometry is not None and not (
        geometry is gains.surface
        or (
            geometry.up == gains.surface.up
            and np.array_equal(geometry.points, gains.surface.points)
            and np.array_equal(geometry.faces, gains.surface.faces)
        )
    ):
        raise FileFormatError(
            "its geometry is not the surface of its gains, and one surface is kept: make them one"
        )
    return gains.surface


def _description(model: ModalModel, surface: Mesh | None, gains: Text) -> dict[str, Any]:
    residual = model.residual
    return {
        "units": "SI",
        "material": None if model.material is None else _material_to_json(model.material),
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
        "provenance": {
            "method": model.provenance.method,
            "references": list(model.provenance.references),
            "dropped": list(model.provenance.dropped),
            "details": dict(model.provenance.details),
        },
        "residual": None
        if residual is None
        else {"sample_rate": int(residual.sample_rate), "lead": float(residual.lead)},
        **({"air": True} if model.air else {}),
        **({} if model.playing_place is None else {"playing_place": model.playing_place}),
        **_recoil_to_json(model.recoil),
        **_chart_to_json(model.chart),
    }


def _recoil_to_json(recoil: Recoil | None) -> dict[str, Any]:
    """Return recoil as a JSON object under its key; an empty object for models without it."""
    if recoil is None:
        return {}
    return {"recoil": {field.name: _list(getattr(recoil, field.name)) for field in fields(Recoil)}}


def _chart_to_json(chart: Chart | None) -> dict[str, Any]:
    """Return a chart as a JSON object under its key; an empty object for models without it."""
    if chart is None:
        return {}
    outline = _list(chart.outline)
    plain = {"pitch": _list(chart.pitch), "around": bool(chart.around), "outline": outline}
    return {"chart": plain}


def _list(array: Array | None) -> list[Any] | None:
    return None if array is None else np.asarray(array, dtype=np.float64).tolist()


def _material_to_json(material: Material) -> dict[str, Any]:
    """Return a material as a JSON object; FileFormatError on a foreign damping law."""
    damping = material.damping
    kind = type(damping).__name__
    if not isinstance(damping, InternalFriction | Rayleigh | Measured) or kind not in _DAMPINGS:
        raise FileFormatError(
            f"its damping is {kind}, and files keep {', '.join(_DAMPINGS)} alone: use one of them"
        )
    law = {"kind": kind, **asdict(damping)}
    if damping.contains_air == isinstance(damping, Measured):  # the default of each law
        del law["contains_air"]
    return {**asdict(material), "damping": law}


def _plain(value: object) -> object:
    """Return NumPy's numbers as Python's own, for `json.dumps`."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"provenance holds {value!r}, and JSON values are kept alone")


# Reading


def _model(text: Text, tensors: Tensors) -> ModalModel:
    kind = kind_named(text["gains"]["kind"])
    require_layout(tensors, {**_LAYOUT, **kind.layout})
    surface, provenance = _given_surface(text, tensors), text["provenance"]
    given = text["material"]
    return ModalModel(
        frequencies=tensors["frequencies"],
        natural_frequencies=tensors["natural_frequencies"],
        decays=tensors["decays"],
        gains=kind.make(text["gains"], tensors, surface),
        material=given and Material(**{**given, "damping": _damping(given["damping"])}),
        mass=text["mass"],
        centre=_array(text["centre"]),
        inertia=_array(text["inertia"]),
        geometry=surface if text["geometry"] == "surface" else None,
        supported=text["supported"],
        tensioned=text.get("tensioned", False),
        air=text.get("air", False),
        complete_to=text["complete_to"],
        poisson_slopes=tensors.get("poisson_slopes"),
        errors=tensors.get("errors"),
        places={name: _array(place) for name, place in text["places"].items()},
        playing_place=text.get("playing_place"),
        coordinates=tuple(text["coordinates"]),
        chart=_chart(text.get("chart")),
        residual=_make_residual(text, tensors),
        recoil=_recoil(text.get("recoil")),
        provenance=Provenance(
            method=provenance["method"],
            references=tuple(provenance["references"]),
            dropped=tuple(provenance["dropped"]),
            details=provenance["details"],
        ),
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
        up=text["up"],
    )


def _chart(text: Text | None) -> Chart | None:
    if text is None:
        return None
    from struck.model.chart import Chart  # computed bodies need none

    return Chart(
        pitch=_array(text["pitch"]),
        around=text["around"],
        outline=_array(text["outline"]),
    )


def _array(value: object) -> Any:  # noqa: ANN401  None, or an array that the model checks
    """Return a JSON list of numbers as an array; null as None."""
    return None if value is None else np.array(value, np.float64)


def _damping(text: Text) -> Damping:
    given = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in text.items()
        if name != "kind"
    }
    return _DAMPINGS[text["kind"]](**given)


def _recoil(text: Text | None) -> Recoil | None:
    """Return the recoil that a file describes; None where it has none."""
    if text is None:
        return None
    return Recoil(**{field.name: _array(text[field.name]) for field in fields(Recoil)})


def _make_residual(text: Text, tensors: Tensors) -> Residual | None:
    """Return attack and noise that a file describes; None where it has none."""
    description = text.get("residual")
    if description is None:
        return None
    require_layout(tensors, _RESIDUAL)
    return Residual(
        attack=tensors["residual_attack"],
        sample_rate=description["sample_rate"],
        lead=float(description["lead"]),
        edges=tensors["residual_edges"],
        levels=tensors["residual_levels"],
        decays=tensors["residual_decays"],
    )
