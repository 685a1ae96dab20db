"""SOFA files (AES69) as containers: named arrays of doubles over letters, with attributes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import FileFormatError, MissingDependencyError, OptionError
from struck.files.atomic import write_bytes
from struck.files.sampled_field import WAYS, Origin, SampledField
from struck.model.arrays import Array
from struck.model.provenance import Provenance, bibliography
from struck.model.survey import SYMMETRIES

if TYPE_CHECKING:
    import h5py

MOST_VALUES = 2**27
"""Numbers in a variable."""
LONGEST = 60_000
"""Bytes in an attribute: HDF5 holds 64 KiB with its head."""
# What netCDF-4 calls a dimension that is no variable.
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable.{:>10}"
_CHARACTERS = "utf-8"
_COMMON = {
    "Conventions": "SOFA",
    "Version": "2.1",
    "APIName": "struck",
    "ApplicationName": "struck",
    "RoomType": "free field",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Variable:
    """An array with the letters of its dimensions, as "MRNE", and texts about it."""

    values: Array
    letters: str
    attributes: Mapping[str, str] = field(default_factory=dict)


def metres(values: Array, letters: str) -> Variable:
    """Return Cartesian places, m."""
    return Variable(
        values=values, letters=letters, attributes={"Type": "cartesian", "Units": "metre"}
    )


def write_container(
    path: str | os.PathLike[str],
    variables: Mapping[str, Variable],
    attributes: Mapping[str, str],
) -> None:
    """Write a SOFA file, whole or not at all.

    Parameters
    ----------
    path : path
    variables : mapping
        Letters mean sizes: all variables agree on them. A variable named by a letter tells the
        values along that dimension.
    attributes : mapping
        Of the whole file, beside those that all files of struck have.

    Raises
    ------
    OptionError
        When a variable or a text is too large.
    FileFormatError
        When the file cannot be written.
    MissingDependencyError
        Without h5py.
    """
    for name, variable in variables.items():
        if variable.values.size > MOST_VALUES:
            raise OptionError(
                f"{name} has {variable.values.size:,} numbers, more than {MOST_VALUES:,}: choose "
                "fewer contacts, listeners or samples"
            )
    h5py = _library()
    now = datetime.now(tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
    told = {"APIVersion": version("struck"), "DateCreated": now, "DateModified": now}
    buffer = BytesIO()
    with h5py.File(buffer, "w", track_order=True) as file:
        _describe(file, {**_COMMON, **told, **attributes})
        sizes = dict[str, int]()
        for variable in variables.values():
            sizes.update(zip(variable.letters, variable.values.shape, strict=True))
        scales = _made_dimensions(file, sizes, variables)
        for name, variable in variables.items():
            _fill(file, name, variable, scales)
    write_bytes(path, buffer.getvalue())


def _made_dimensions(
    file: h5py.File, sizes: Mapping[str, int], variables: Mapping[str, Variable]
) -> dict[str, h5py.Dataset]:
    """Make a dimension of each letter, as netCDF-4 has them."""
    scales: dict[str, h5py.Dataset] = {}
    for number, (letter, size) in enumerate(sorted(sizes.items())):
        named = letter in variables
        scale = file.create_dataset(letter, (size,), "f8" if named else "f4")
        scale.make_scale(letter if named else _NO_VARIABLE.format(size))
        scale.attrs["_Netcdf4Dimid"] = np.int32(number)
        scales[letter] = scale
    return scales


def _fill(
    file: h5py.File, name: str, variable: Variable, scales: Mapping[str, h5py.Dataset]
) -> None:
    """Write a variable and tie it to its dimensions."""
    if name in scales:
        found = scales[name]
        found[...] = variable.values
    else:
        found = file.create_dataset(name, data=np.asarray(variable.values, np.float64))
        for axis, letter in enumerate(variable.letters):
            found.dims[axis].attach_scale(scales[letter])
    _describe(found, variable.attributes)


def _describe(holder: h5py.File | h5py.Dataset, attributes: Mapping[str, str]) -> None:
    """Write texts of fixed length, which every reader of SOFA takes."""
    h5py = _library()
    for name, text in attributes.items():
        data = text.encode(_CHARACTERS)
        if len(data) > LONGEST:
            raise OptionError(f"{name} has {len(data):,} bytes, more than {LONGEST:,}: shorten it")
        kind = h5py.string_dtype(_CHARACTERS, max(1, len(data)))
        holder.attrs.create(name, data, dtype=kind)


class Container:
    """A SOFA file that is open for reading; its errors are put to the file by `opened`."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file

    def __contains__(self, name: str) -> bool:
        return name in self._file

    def require_convention(self, convention: str) -> None:
        """Refuse a file of another convention."""
        found = self.text("SOFAConventions")
        if found != convention:
            raise FileFormatError(
                f"its convention is {found or 'not said'!r}, and {convention!r} is read here: use "
                "struck.load for GeneralTF-E, load_sofa_responses for GeneralFIR-E, and a "
                "listener's hrtf= for measured heads"
            )

    def text(self, name: str, of: str | None = None) -> str:
        """Return an attribute of the file, or of a variable; nothing where there is none."""
        holder = self._file if of is None else self._file[of]
        value = holder.attrs.get(name)
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.item()
        if isinstance(value, bytes):
            value = value.decode(_CHARACTERS, errors="replace")
        return value.strip() if isinstance(value, str) else ""

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a variable."""
        return self._variable(name).shape

    def numbers(self, name: str, *shapes: tuple[int, ...], gaps: bool = False) -> Array:
        """Return a variable that has one of some shapes and is finite, or NaN with `gaps`."""
        variable = self._variable(name)
        if math.prod(variable.shape) > MOST_VALUES:
            raise FileFormatError(
                f"its variable {name} has shape {variable.shape}, more than {MOST_VALUES:,} "
                "numbers: split the file"
            )
        if shapes and variable.shape not in shapes:
            raise FileFormatError(
                f"its variable {name} has shape {variable.shape}, and "
                f"{' or '.join(map(str, shapes))} is demanded: save it again with a SOFA library"
            )
        values = np.asarray(variable[...], dtype=np.float64)
        wrong = np.count_nonzero(np.isinf(values) if gaps else ~np.isfinite(values))
        if wrong:
            raise FileFormatError(
                f"its variable {name} holds {wrong} values that are NaN or infinite: take those "
                "measurements out"
            )
        return values

    def places(self, name: str) -> Array:
        """Return places (n, 3) as Cartesian, m; those that change over measurements are refused."""
        shape = self.shape(name)
        if len(shape) not in {2, 3} or shape[1] != 3 or shape[2:] not in {(), (1,)}:
            raise FileFormatError(
                f"its variable {name} has shape {shape}, and (n, 3) is read: save it again with "
                "places that do not change over measurements"
            )
        return self.points(name, shape)

    def points(self, name: str, *shapes: tuple[int, ...], typed: str | None = None) -> Array:
        """Return points of one of some shapes (n, 3, ..) as Cartesian (n, 3), m.

        Parameters
        ----------
        name : str
        *shapes : tuple of int
            Along a third axis the first point counts.
        typed : str, optional
            The variable that tells type and units, where `name` itself does not.
        """
        read = self.numbers(name, *shapes)
        values, told = read.reshape(len(read), 3, -1)[:, :, 0], typed or name
        kind, units = self.text("Type", told).lower(), self.text("Units", told).lower()
        singular = [unit.removesuffix("s") for unit in units.replace(",", " ").split()]
        singular = ["metre" if unit == "meter" else unit for unit in singular]
        if kind == "cartesian" and set(singular) == {"metre"}:
            return values
        if kind == "spherical" and singular == ["degree", "degree", "metre"]:
            azimuth, elevation = np.radians(values[:, :2]).T
            flat = np.cos(elevation)
            directions = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
            return np.stack(directions, axis=1) * values[:, 2:]
        raise FileFormatError(
            f"its {name} is of type {kind!r} in {units!r}, and 'cartesian' in 'metre' or "
            "'spherical' in 'degree, degree, metre' is read: save it again with a SOFA library"
        )

    def _variable(self, name: str) -> h5py.Dataset:
        import h5py

        found = self._file.get(name)
        if not isinstance(found, h5py.Dataset):
            raise FileFormatError(
                f"its variable {name} is missing: save it again with a SOFA library"
            )
        if found.dtype.kind not in "fiu" or found.external or found.is_virtual:
            raise FileFormatError(
                f"its variable {name} holds {found.dtype} or lies in another file, and numbers in "
                "this one are read: save it again with a SOFA library"
            )
        return found


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[Container]:
    """Open a file for reading; whatever goes wrong inside is one error that names the file.

    Raises
    ------
    FileFormatError
        When it is no such file.
    MissingDependencyError
        Without h5py.
    """
    h5py = _library()
    try:
        with h5py.File(Path(path), "r") as file:
            yield Container(file)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise FileFormatError(
            f"{path}: it cannot be read as HDF5, the container of SOFA files ({reason}): it is "
            "missing, truncated, damaged or another format; fetch it again"
        ) from error


def _library() -> ModuleType:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'SOFA files are read and written by h5py: pip install "struck[sofa]"'
        ) from error
    return h5py


# Where a body, its contacts and its listeners are in a SOFA file, and what a file tells of it.

_PASCAL, _RELATIVE = "Pa/(N s)", "relative"
_AXES = ("ContactU", "ContactV")
_UNKNOWN = "unknown"
_SURFACE = (
    " ContactU and ContactV are coordinates on the surface; EmitterPosition repeats them as "
    "(u, v, 0), as their places in space are not known."
)


def attributes_of(field: SampledField, comment: str, *names: str) -> dict[str, str]:
    """Return what a file tells of a field: a comment, and title, author and licence."""
    title, author, licence = (name or "not stated" for name in names)
    axes = field.contacts.shape[1]
    return {
        "Title": title,
        "AuthorContact": author,
        "Organization": author,
        "License": licence,
        "Comment": comment + (_SURFACE if axes in {1, 2} else ""),
        "GainUnit": _PASCAL if field.calibrated else _RELATIVE,
        "Symmetry": field.symmetry,
        "Interpolation": field.way,
        **({} if axes else {"ContactPlaces": _UNKNOWN}),
    }


def geometry_of(field: SampledField) -> dict[str, Variable]:
    """Return the variables of places: measurements are listeners, emitters contacts."""
    count, axes = field.contacts.shape
    emitters = np.zeros((count, 3))
    emitters[:, :axes] = field.contacts
    origin = np.zeros((1, 3))
    places = {
        "ListenerPosition": metres(field.listeners, "MC"),
        "ReceiverPosition": metres(origin, "RC"),
        "SourcePosition": metres(origin, "IC"),
        "EmitterPosition": metres(emitters, "EC"),
        "SoundCentre": metres(field.centre[np.newaxis], "IC"),
    }
    if field.radius:
        told = {"LongName": "of a ball about SoundCentre that holds the body", "Units": "metre"}
        radius = np.array([field.radius])
        places["BodyRadius"] = Variable(values=radius, letters="I", attributes=told)
    if axes > 2:
        return places
    named = zip(_AXES, field.contacts.T, field.coordinates or ("u", "v"), strict=False)
    for axis, values, name in named:
        places[axis] = Variable(values=values, letters="E", attributes={"LongName": name})
    return places


def listeners_of(file: Container) -> Array:
    """Return one listener for each measurement (M, 3), m."""
    receivers = file.places("ReceiverPosition")
    if len(receivers) != 1:
        raise FileFormatError(
            f"it has {len(receivers)} receivers, and 1 for each listener is read: split them into "
            "measurements"
        )
    if receivers.any() and "ListenerView" in file:
        raise FileFormatError(
            "its receiver is off the listener, who looks somewhere: give ListenerPosition as the "
            "place of the microphone"
        )
    return file.places("ListenerPosition") + receivers


def contacts_of(file: Container) -> tuple[Array, tuple[str, ...]]:
    """Return contacts (E, D) and the names of their coordinates; x, y, z where no others are."""
    axes = [axis for axis in _AXES if axis in file]
    if axes:
        count = file.shape("EmitterPosition")[:1]
        values = [file.numbers(axis, count) for axis in axes]
        return np.stack(values, axis=1), tuple(file.text("LongName", axis) for axis in axes)
    if file.text("ContactPlaces") == _UNKNOWN:
        return np.zeros((file.shape("EmitterPosition")[0], 0)), ()
    sources = file.places("SourcePosition")
    if len(sources) != 1 or "SourceView" in file:
        raise FileFormatError(
            f"its source has {len(sources)} places, or a view, and a body that stands still is "
            "read: give one SourcePosition, and EmitterPosition along the axes of the room"
        )
    return file.places("EmitterPosition") + sources, ("x (m)", "y (m)", "z (m)")


def centre_of(file: Container) -> Array:
    """Return where the sound seems to come from (3,), m: the source where nothing else is told."""
    name = "SoundCentre" if "SoundCentre" in file else "SourcePosition"
    places = file.places(name)
    if len(places) != 1:
        raise FileFormatError(f"its {name} has {len(places)} places, and 1 is read: give one")
    return places[0]


def radius_of(file: Container) -> float:
    """Return the radius of a ball about the centre that holds the body, m; 0 where not known."""
    if "BodyRadius" not in file:
        return 0.0
    radius = float(file.numbers("BodyRadius", (1,))[0])
    if radius < 0:
        raise FileFormatError(f"its BodyRadius is {radius:g}: give at least 0 m")
    return radius


def symmetry_of(file: Container) -> str:
    """Return the symmetry of the body."""
    symmetry = file.text("Symmetry") or "none"
    if symmetry not in SYMMETRIES:
        raise FileFormatError(f"its Symmetry is {symmetry!r}: give one of {', '.join(SYMMETRIES)}")
    return symmetry


def way_of(file: Container) -> str:
    """Return how its model interpolates."""
    way = file.text("Interpolation") or WAYS[0]
    if way not in WAYS:
        raise FileFormatError(f"its Interpolation is {way!r}: give one of {', '.join(WAYS)}")
    return way


def is_calibrated(file: Container) -> bool:
    """Tell whether its unit is Pa/(N s)."""
    return file.text("GainUnit") == _PASCAL


# Where gains in a SOFA file came from: papers, notes, and how sure a model was of its modes.

_SOURCE, _MODEL = "GainSource", "model"
_SPARE = 100  # bytes for a last line
_PLACE = "RecordedContact"
_ERRORS, _UNMEASURED = "ModeError", "ModeUnmeasured"


def origin_attributes(origin: Origin | None) -> dict[str, str]:
    """Return the texts that tell a model; none of gains that were measured."""
    if origin is None:
        return {}
    provenance = origin.provenance
    told = {
        _SOURCE: _MODEL,
        "Method": provenance.method,
        "References": provenance.cite(),
        "ReferenceKeys": " ".join(provenance.references),
        "Notes": _lines(provenance.dropped),
        "FieldNotes": _lines(origin.notes),
        _PLACE: "" if origin.place is None else " ".join(map(repr, origin.place.tolist())),
    }
    return {name: text for name, text in told.items() if text}


def origin_variables(origin: Origin | None, count: int) -> dict[str, Variable]:
    """Return the numbers that tell a model of so many modes."""
    variables: dict[str, Variable] = {}
    if origin is None:
        return variables
    if origin.errors is not None:
        told = {"LongName": "relative error of the frequency, NaN where unknown", "Units": "1"}
        variables[_ERRORS] = Variable(values=origin.errors, letters="N", attributes=told)
    if len(origin.unmeasured):
        values = np.isin(np.arange(count), origin.unmeasured).astype(np.float64)
        told = {"LongName": "1 where a mode was not measured well", "Units": "1"}
        variables[_UNMEASURED] = Variable(values=values, letters="N", attributes=told)
    return variables


def origin_of(file: Container, count: int) -> Origin | None:
    """Return the model of so many modes that gains came from; None where they were measured."""
    if file.text(_SOURCE) != _MODEL:
        return None
    errors = file.numbers(_ERRORS, (count,), gaps=True) if _ERRORS in file else None
    if errors is not None and (errors < 0).any():
        raise FileFormatError(f"its {_ERRORS} goes down to {np.nanmin(errors):g}: give at least 0")
    unmeasured = file.numbers(_UNMEASURED, (count,)) if _UNMEASURED in file else np.zeros(count)
    known = bibliography()
    return Origin(
        provenance=Provenance(
            method=file.text("Method"),
            references=tuple(key for key in file.text("ReferenceKeys").split() if key in known),
            dropped=tuple(file.text("Notes").splitlines()),
        ),
        errors=errors,
        unmeasured=np.flatnonzero(unmeasured),
        notes=tuple(file.text("FieldNotes").splitlines()),
        place=_place_of(file.text(_PLACE)),
    )


def _place_of(text: str) -> Array | None:
    if not text:
        return None
    try:
        place = np.array([float(each) for each in text.split()])
    except ValueError:
        place = np.full(1, np.nan)
    if not np.isfinite(place).all():
        raise FileFormatError(f"its {_PLACE} is {text[:80]!r}: give finite coordinates")
    return place


def _lines(sentences: Iterable[str]) -> str:
    """Return as many sentences as an attribute holds, a line each, and how many more there are."""
    lines = [" ".join(sentence.split()) for sentence in sentences]
    lengths = np.cumsum([len(line.encode()) + 1 for line in lines])
    kept = int(np.count_nonzero(lengths < LONGEST - _SPARE))
    more = [f"... and {len(lines) - kept} notes more"] if kept < len(lines) else []
    return "\n".join([*lines[:kept], *more])
