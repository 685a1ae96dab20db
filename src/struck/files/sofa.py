"""SOFA files (AES69) as containers: named arrays of doubles over letters, with attributes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from struck.errors import FileFormatError, MissingDependencyError, OptionError, rounded
from struck.files.atomic import require_readable, write_bytes
from struck.files.guard import read_foreign
from struck.files.messages import Answer, Frame, ReadingLimits
from struck.model.arrays import AnyArray, Array

if TYPE_CHECKING:
    import h5py

CONVENTIONS = ("GeneralTF-E", "GeneralFIR-E")  # gains of modes; impulse responses
MOST_VALUES = 2**27  # numbers in a variable
# Squares of values, and their sums and products with rates, must stay finite.
_MAX_NUMBER = 1e100
LONGEST = 60_000  # bytes in an attribute: HDF5 holds 64 KiB with its head
# The name that netCDF-4 gives to a dimension without a variable.
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable.{:>10}"
_CHARACTERS = "utf-8"
_COMMON = {
    "Conventions": "SOFA",
    "Version": "2.1",
    "APIName": "struck",
    "ApplicationName": "struck",
    "RoomType": "free field",
}


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """An array with the letters of its dimensions, as "MRNE", and texts about it."""

    values: Array
    letters: str
    attributes: Mapping[str, str] = field(default_factory=dict)


def metres(values: Array, letters: str) -> Variable:
    """Return a variable of Cartesian places, m."""
    return Variable(values, letters, {"Type": "cartesian", "Units": "metre"})


def write_container(
    path: str | os.PathLike[str], variables: Mapping[str, Variable], attributes: Mapping[str, str]
) -> None:
    """Write a SOFA file, whole or not at all.

    Letters mean sizes, on which all variables agree; a variable named by a letter holds the values
    along that dimension. OptionError when a variable or a text is too large.
    """
    for name, variable in variables.items():
        if variable.values.size > MOST_VALUES:
            raise OptionError(
                f"{name} has {variable.values.size:,} numbers, more than {MOST_VALUES:,}: choose "
                "fewer contacts, listeners or samples"
            )
    h5py = _library()
    now = datetime.now(tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
    general = {"APIVersion": version("struck"), "DateCreated": now, "DateModified": now}
    # Not into a BytesIO: h5py replaces an interruption of its methods by another error.
    with h5py.File("memory", "w", driver="core", backing_store=False, track_order=True) as file:
        _describe(file, {**_COMMON, **general, **attributes})
        sizes = dict[str, int]()
        for variable in variables.values():
            sizes.update(zip(variable.letters, variable.values.shape, strict=True))
        scales = _made_dimensions(file, sizes, variables)
        for name, variable in variables.items():
            _fill(file, name, variable, scales)
        file.flush()
        data = file.id.get_file_image()
    write_bytes(path, data)


def _made_dimensions(
    file: h5py.File, sizes: Mapping[str, int], variables: Mapping[str, Variable]
) -> dict[str, h5py.Dataset]:
    """Make a dimension of each letter, as netCDF-4 has them."""
    scales: dict[str, h5py.Dataset] = {}
    for number, (letter, size) in enumerate(sorted(sizes.items())):
        is_named = letter in variables
        scale = file.create_dataset(letter, (size,), "f8" if is_named else "f4")
        scale.make_scale(letter if is_named else _NO_VARIABLE.format(size))
        scale.attrs["_Netcdf4Dimid"] = np.int32(number)
        scales[letter] = scale
    return scales


def _fill(
    file: h5py.File, name: str, variable: Variable, scales: Mapping[str, h5py.Dataset]
) -> None:
    """Write a variable and tie it to its dimensions."""
    if name in scales:
        dataset = scales[name]
        dataset[...] = variable.values
    else:
        dataset = file.create_dataset(name, data=np.asarray(variable.values, np.float64))
        for axis, letter in enumerate(variable.letters):
            dataset.dims[axis].attach_scale(scales[letter])
    _describe(dataset, variable.attributes)


def _describe(holder: h5py.File | h5py.Dataset, attributes: Mapping[str, str]) -> None:
    """Write texts of fixed length, which every reader of SOFA takes."""
    h5py = _library()
    for name, text in attributes.items():
        data = text.encode(_CHARACTERS)
        if len(data) > LONGEST:
            raise OptionError(f"{name} has {len(data):,} bytes, more than {LONGEST:,}: shorten it")
        kind = h5py.string_dtype(_CHARACTERS, max(1, len(data)))
        holder.attrs.create(name, data, dtype=kind)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dataset:
    """A variable of a SOFA file."""

    shape: tuple[int, ...]
    are_numbers: bool  # in this file
    attributes: Mapping[str, str]
    values: Array  # of that shape; none where there is a problem
    problem: str = ""  # why it is not


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Container:
    """Contents of a SOFA file; `opened` adds the file's name to its errors."""

    attributes: Mapping[str, str]
    variables: Mapping[str, Dataset]

    @classmethod
    def of(cls, frame: Frame) -> Container:
        """Return the contents that an answer holds."""
        arrays = iter(frame.arrays)
        variables = {
            name: Dataset(
                shape=tuple(shape),
                are_numbers=are_numbers,
                attributes=texts,
                values=np.zeros(0) if problem else next(arrays).reshape(shape),
                problem=problem,
            )
            for name, shape, are_numbers, texts, problem in frame.content["variables"]
        }
        return cls(attributes=frame.content["attributes"], variables=variables)

    def __contains__(self, name: str) -> bool:
        return name in self.variables

    def require_convention(self, convention: str) -> None:
        """Refuse a file of another convention."""
        name = self.text("SOFAConventions")
        if name != convention:
            raise FileFormatError(
                f"its convention is {name or 'not said'!r}, and {convention!r} is read here: use "
                "struck.load for GeneralTF-E, load_sofa_responses for GeneralFIR-E, and a "
                "listener's hrtf= for measured heads"
            )

    def text(self, name: str, of: str | None = None) -> str:
        """Return an attribute of the file, or of a variable; "" if it is missing."""
        attributes = self.attributes if of is None else self._variable(of).attributes
        return attributes.get(name, "")

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a variable."""
        return self._variable(name).shape

    def numbers(self, name: str, *shapes: tuple[int, ...], gaps: bool = False) -> Array:
        """Return a variable that has one of some shapes and is finite, or NaN with `gaps`."""
        variable = self._variable(name)
        if variable.problem:
            raise FileFormatError(f"its variable {name} {variable.problem}")
        if shapes and variable.shape not in shapes:
            raise FileFormatError(
                f"its variable {name} has shape {variable.shape}, and "
                f"{' or '.join(map(str, shapes))} is demanded: save it again with a SOFA library"
            )
        values = variable.values
        bad_count = np.count_nonzero(np.isinf(values) if gaps else ~np.isfinite(values))
        if bad_count:
            raise FileFormatError(
                f"its variable {name} holds {bad_count} values that are NaN or infinite: take "
                "those measurements out"
            )
        largest = float(np.nanmax(np.abs(values), initial=0.0))
        if largest > _MAX_NUMBER:
            raise FileFormatError(
                f"its variable {name} goes up to {rounded(largest)}, and {rounded(_MAX_NUMBER)} "
                "can be computed with: take those measurements out"
            )
        return values

    def places(self, name: str) -> Array:
        """Return places (n, 3) as Cartesian, m; refuse ones that change over measurements."""
        shape = self.shape(name)
        if len(shape) not in {2, 3} or shape[1] != 3 or shape[2:] not in {(), (1,)}:
            raise FileFormatError(
                f"its variable {name} has shape {shape}, and (n, 3) is read: save it again with "
                "places that do not change over measurements"
            )
        return self.points(name, shape)

    def points(self, name: str, *shapes: tuple[int, ...], typed: str | None = None) -> Array:
        """Return points of one of some shapes (n, 3, ..) as Cartesian (n, 3), m.

        Along a third axis the first point counts. `typed` names the variable that has type and
        units, where `name` itself has not.
        """
        read = self.numbers(name, *shapes)
        values, typed_name = read.reshape(len(read), 3, -1)[:, :, 0], typed or name
        kind, units = self.text("Type", typed_name).lower(), self.text("Units", typed_name).lower()
        unit_names = [unit.removesuffix("s") for unit in units.replace(",", " ").split()]
        unit_names = ["metre" if unit == "meter" else unit for unit in unit_names]
        if kind == "cartesian" and set(unit_names) == {"metre"}:
            return values
        if kind == "spherical" and unit_names == ["degree", "degree", "metre"]:
            azimuth, elevation = np.radians(values[:, :2]).T
            flat = np.cos(elevation)
            directions = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
            return np.stack(directions, axis=1) * values[:, 2:]
        raise FileFormatError(
            f"its {name} is of type {kind!r} in {units!r}, and 'cartesian' in 'metre' or "
            "'spherical' in 'degree, degree, metre' is read: save it again with a SOFA library"
        )

    def _variable(self, name: str) -> Dataset:
        if name not in self.variables:
            raise FileFormatError(
                f"its variable {name} is missing: save it again with a SOFA library"
            )
        if (variable := self.variables[name]).are_numbers:
            return variable
        raise FileFormatError(f"its variable {name} {variable.problem}")


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[Container]:
    """Read a file; errors inside become one FileFormatError that names the file."""
    _library()
    require_readable(path)
    try:
        yield read_foreign("sofa", path, Container.of, advice="split the file")
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: {_no_hdf5(error)}") from error


def answer(path: Path, limits: ReadingLimits) -> Answer:
    """Return the texts and numbers of a SOFA file as an answer.

    The content has the `attributes` of the file, and of each of its `variables` the name, the
    shape, whether it holds numbers, the attributes and why it is not read, or ""; the arrays of the
    others follow.
    """
    h5py = _library()
    variables: list[Any] = []
    arrays: list[AnyArray] = []
    rest = min(MOST_VALUES, limits.answer // 8)
    try:
        with h5py.File(path, "r") as file:
            attributes = _texts(file)
            for name, dataset in file.items():
                if not isinstance(dataset, h5py.Dataset):
                    continue
                shape, problem = dataset.shape or (), ""
                are_numbers = dataset.dtype.kind in "fiu"
                are_numbers &= not (dataset.external or dataset.is_virtual)
                if not are_numbers:
                    problem = (
                        f"holds {dataset.dtype} or lies in another file, and numbers in this one "
                        "are read: save it again with a SOFA library"
                    )
                elif math.prod(shape) > rest:
                    problem = (
                        f"has shape {shape}, and files of more than {MOST_VALUES:,} numbers are "
                        "not read: split the file"
                    )
                else:
                    rest -= math.prod(shape)
                    values = np.asarray(dataset[...], np.float64)
                    arrays.append(values.reshape(1, values.size))
                variables.append([name, list(shape), are_numbers, _texts(dataset), problem])
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(_no_hdf5(error)) from error
    return {"attributes": attributes, "variables": variables}, arrays


def _no_hdf5(error: Exception) -> str:
    reason = " ".join(str(error).split())[:160]
    return (
        f"it cannot be read as HDF5, the container of SOFA files ({reason}): it is truncated, "
        "damaged or another format; fetch it again"
    )


def _texts(holder: h5py.File | h5py.Dataset) -> dict[str, str]:
    """Return the attributes of a file or a variable that are texts."""
    texts: dict[str, str] = {}
    for name, attribute in holder.attrs.items():
        value = attribute
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.item()
        if isinstance(value, bytes):
            value = value.decode(_CHARACTERS, errors="replace")
        if isinstance(value, str):
            texts[name] = value.strip()
    return texts


def _library() -> ModuleType:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'SOFA files are read and written by h5py: pip install "struck[sofa]"'
        ) from error
    return h5py
