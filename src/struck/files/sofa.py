"""SOFA files (AES69) as containers: named arrays of doubles over letters, with attributes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
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
from struck.files.atomic import open_ordinary, unread, write_bytes
from struck.model.arrays import Array

if TYPE_CHECKING:
    import h5py

CONVENTIONS = ("GeneralTF-E", "GeneralFIR-E")  # gains of modes; impulse responses
MOST_VALUES = 2**27  # numbers in a variable
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
    buffer = BytesIO()
    with h5py.File(buffer, "w", track_order=True) as file:
        _describe(file, {**_COMMON, **general, **attributes})
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


class Container:
    """A SOFA file open for reading; `opened` adds the file's name to its errors."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file

    def __contains__(self, name: str) -> bool:
        return name in self._file

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
        bad_count = np.count_nonzero(np.isinf(values) if gaps else ~np.isfinite(values))
        if bad_count:
            raise FileFormatError(
                f"its variable {name} holds {bad_count} values that are NaN or infinite: take "
                "those measurements out"
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

    def _variable(self, name: str) -> h5py.Dataset:
        import h5py

        dataset = self._file.get(name)
        if not isinstance(dataset, h5py.Dataset):
            raise FileFormatError(
                f"its variable {name} is missing: save it again with a SOFA library"
            )
        if dataset.dtype.kind not in "fiu" or dataset.external or dataset.is_virtual:
            raise FileFormatError(
                f"its variable {name} holds {dataset.dtype} or lies in another file, and numbers "
                "in this one are read: save it again with a SOFA library"
            )
        return dataset


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[Container]:
    """Open a file for reading; errors inside become one FileFormatError that names the file."""
    h5py = _library()
    try:
        open_ordinary(path).close()  # HDF5 would wait for a pipe
        with h5py.File(Path(path), "r") as file:
            yield Container(file)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise FileFormatError(f"{path} {unread(path, error)}") from error
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise FileFormatError(
            f"{path}: it cannot be read as HDF5, the container of SOFA files ({reason}): it is "
            "truncated, damaged or another format; fetch it again"
        ) from error


def _library() -> ModuleType:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'SOFA files are read and written by h5py: pip install "struck[sofa]"'
        ) from error
    return h5py
