"""Head-related impulse responses from SOFA files (AES69), convention SimpleFreeFieldHRIR."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from struck.ears.hrtf import HrtfSet, directions_of
from struck.errors import FileFormatError, MissingDependencyError

if TYPE_CHECKING:
    import h5py

Array = NDArray[np.float64]

CONVENTION = "SimpleFreeFieldHRIR"
FEWEST_DIRECTIONS = 4
MOST_DIRECTIONS = 20_000
MOST_TAPS = 16_384
MOST_VALUES = 2**25
SAMPLE_RATES = (8_000.0, 192_000.0)
DISTANCES = (0.1, 100.0)
# Measured radii scatter by a few per cent; sets of several distances differ by far more.
_DISTANCE_SPREAD = 0.1


def read_sofa(path: str | Path) -> HrtfSet:
    """Read measured responses of a head.

    Parameters
    ----------
    path : str or Path
        A SOFA file of convention SimpleFreeFieldHRIR, all sources at one distance.

    Raises
    ------
    FileFormatError
        When it is no such file, or what it holds is out of bounds.
    MissingDependencyError
        When h5py is not installed.

    Notes
    -----
    AES69-2022, AES standard for file exchange: spatial acoustic data file format.
    """
    path = Path(path)
    with _opened(path) as file:
        _require_convention(file)
        responses = _responses(file)
        directions, distance = _sources(file, len(responses))
        left_first = _left_first(file)
        sample_rate = _sample_rate(file)
        return HrtfSet(
            name=_text(file, "Title") or path.stem,
            directions=directions,
            distance=distance,
            responses=responses[:, left_first],
            delays=_delays(file, responses.shape)[:, left_first] / sample_rate,
            sample_rate=sample_rate,
            source=_text(file, "References"),
            licence=_text(file, "License"),
        )


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open for reading; whatever goes wrong inside is one error that names the file."""
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError(
            'SOFA files are read by h5py: pip install "struck[sofa]"'
        ) from error
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise FileFormatError(
            f"{path}: it cannot be read as HDF5, the container of SOFA files ({reason}): it is "
            "missing, truncated, damaged or another format; fetch it again"
        ) from error


def _require_convention(file: h5py.File) -> None:
    convention = _text(file, "SOFAConventions")
    if convention != CONVENTION:
        raise FileFormatError(
            f"its convention is {convention or 'not said'!r}, and {CONVENTION!r} is read: convert "
            "it, or fetch the set in that form"
        )


def _text(holder: h5py.File | h5py.Dataset, name: str) -> str:
    value = holder.attrs.get(name)
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return value.strip() if isinstance(value, str) else ""


def _variable(file: h5py.File, name: str) -> h5py.Dataset:
    import h5py

    found = file.get(name)
    if not isinstance(found, h5py.Dataset):
        raise FileFormatError(
            f"its variable {name} is missing, and {CONVENTION} demands it: save it again with a "
            "SOFA library"
        )
    if found.dtype.kind not in "fiu" or found.external or found.is_virtual:
        raise FileFormatError(
            f"its variable {name} holds {found.dtype} or lies in another file, and numbers in this "
            "one are read: save it again with a SOFA library"
        )
    return found


def _numbers(file: h5py.File, name: str, *shapes: tuple[int, ...]) -> Array:
    """Read a variable that has one of some shapes; its values are finite."""
    variable = _variable(file, name)
    if variable.shape not in shapes:
        raise FileFormatError(
            f"its variable {name} has shape {variable.shape}, and "
            f"{' or '.join(map(str, shapes))} is demanded: save it again with a SOFA library"
        )
    values = np.asarray(variable[...], dtype=np.float64)
    if not np.isfinite(values).all():
        raise FileFormatError(
            f"its variable {name} holds {np.count_nonzero(~np.isfinite(values))} values that are "
            "NaN or infinite: take those measurements out"
        )
    return values


def _responses(file: h5py.File) -> Array:
    shape: tuple[Any, ...] = _variable(file, "Data.IR").shape
    if len(shape) != 3 or shape[1] != 2:
        raise FileFormatError(
            f"its variable Data.IR has shape {shape}, and (directions, 2 ears, taps) is demanded: "
            "save it again with a SOFA library"
        )
    if not FEWEST_DIRECTIONS <= shape[0] <= MOST_DIRECTIONS:
        raise FileFormatError(
            f"it holds {shape[0]} directions, and {FEWEST_DIRECTIONS} to {MOST_DIRECTIONS:,} are "
            "read: use a set of that size"
        )
    if not 1 <= shape[2] <= MOST_TAPS or np.prod(shape) > MOST_VALUES:
        raise FileFormatError(
            f"its responses have {shape[2]} taps in {shape[0]} directions, and 1 to {MOST_TAPS:,} "
            f"taps and {MOST_VALUES:,} values in all are read: cut them"
        )
    responses = _numbers(file, "Data.IR", shape)
    if not responses.any(axis=2).all():
        raise FileFormatError("a response in Data.IR is all zeros: take that measurement out")
    return responses


def _sample_rate(file: h5py.File) -> float:
    rates = np.unique(
        _numbers(file, "Data.SamplingRate", (1,), _variable(file, "Data.IR").shape[:1])
    )
    lowest, highest = SAMPLE_RATES
    if len(rates) != 1 or not lowest <= rates[0] <= highest:
        raise FileFormatError(
            f"its sample rate is {', '.join(f'{rate:g}' for rate in rates[:3])} Hz, and one from "
            f"{lowest:g} to {highest:g} Hz is read: resample it"
        )
    return float(rates[0])


def _delays(file: h5py.File, shape: tuple[int, ...]) -> Array:
    """Return the delays (M, 2) in samples."""
    delays = _numbers(file, "Data.Delay", (1, 2), shape[:2])
    if np.ptp(delays) > MOST_TAPS:
        raise FileFormatError(
            f"its delays spread over {np.ptp(delays):g} samples, and {MOST_TAPS:,} are the bound: "
            "give Data.Delay in samples"
        )
    return np.broadcast_to(delays, shape[:2])


def _sources(file: h5py.File, count: int) -> tuple[Array, float]:
    """Return unit vectors (M, 3) in the head's frame, and the distance they share in m."""
    if np.any(_numbers(file, "ListenerPosition", (1, 3), (count, 3))):
        raise FileFormatError(
            "its ListenerPosition is not the origin: give SourcePosition relative to the listener"
        )
    positions = _points(file, "SourcePosition", (count, 3))
    distances = np.linalg.norm(positions, axis=1)
    distance = float(np.median(distances))
    if not DISTANCES[0] <= distance <= DISTANCES[1]:
        raise FileFormatError(
            f"its sources are {distance:g} m away, and {DISTANCES[0]:g} to {DISTANCES[1]:g} m are "
            "read: give SourcePosition in metres"
        )
    if np.ptp(distances) > _DISTANCE_SPREAD * distance:
        raise FileFormatError(
            f"its sources are {distances.min():g} to {distances.max():g} m away, and one distance "
            "is read: keep the measurements of one"
        )
    return positions / distances[:, np.newaxis] @ _frame(file, count).T, distance


def _frame(file: h5py.File, count: int) -> Array:
    """Return the head's axes in the file's frame: forward, left and up, as rows."""
    view = _points(file, "ListenerView", (1, 3), (count, 3))
    up = _points(file, "ListenerUp", (1, 3), (count, 3), typed="ListenerView")
    left = np.cross(up[0], view[0])
    if np.ptp(view, axis=0).any() or np.ptp(up, axis=0).any() or np.linalg.norm(left) < 1e-3:
        raise FileFormatError(
            f"its ListenerView {view[0]} and ListenerUp {up[0]} change, vanish or are parallel, "
            "and one head held still is read: write view (1, 0, 0) and up (0, 0, 1)"
        )
    axes = np.stack([view[0], left, np.cross(view[0], left)])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _left_first(file: h5py.File) -> list[int]:
    """Return which receivers are the left and the right ear; y points to the left."""
    one = _variable(file, "ReceiverPosition").shape
    positions = _points(file, "ReceiverPosition", (2, 3), (2, 3, 1), (2, 3, one[-1]))
    lateral = positions.reshape(2, 3, -1)[:, 1, 0]
    if np.isclose(*lateral):
        raise FileFormatError(
            f"its ReceiverPosition has both ears at y = {lateral[0]:g} m, so left is not known: "
            "write the left ear at y > 0, the right one at y < 0"
        )
    return [0, 1] if lateral[0] > lateral[1] else [1, 0]


def _points(
    file: h5py.File, name: str, *shapes: tuple[int, ...], typed: str | None = None
) -> Array:
    """Read points (.., 3) or (.., 3, 1) as Cartesian, by the type and units of `typed`."""
    values = _numbers(file, name, *shapes)
    described = _variable(file, typed or name)
    kind, units = _text(described, "Type").lower(), _text(described, "Units").lower()
    singular = [unit.removesuffix("s") for unit in units.replace(",", " ").split()]
    singular = ["metre" if unit == "meter" else unit for unit in singular]
    if kind == "cartesian" and set(singular) == {"metre"}:
        return values
    if kind == "spherical" and singular == ["degree", "degree", "metre"]:
        flat = values.reshape(len(values), 3, -1)[:, :, 0]
        return directions_of(flat[:, 0], flat[:, 1]) * flat[:, 2:]
    raise FileFormatError(
        f"its {name} is of type {kind!r} in {units!r}, and 'cartesian' in 'metre' or 'spherical' "
        "in 'degree, degree, metre' is read: save it again with a SOFA library"
    )
