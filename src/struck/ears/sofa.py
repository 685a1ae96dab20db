"""Head-related impulse responses from SOFA files (AES69), convention SimpleFreeFieldHRIR."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck.ears.hrtf import HrtfSet
from struck.errors import FileFormatError
from struck.files.sofa import Container, opened

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
    with opened(path) as file:
        file.require_convention(CONVENTION)
        responses = _responses(file)
        directions, distance = _sources(file, len(responses))
        left_first = _left_first(file)
        sample_rate = _sample_rate(file)
        return HrtfSet(
            name=file.text("Title") or path.stem,
            directions=directions,
            distance=distance,
            responses=responses[:, left_first],
            delays=_delays(file, responses.shape)[:, left_first] / sample_rate,
            sample_rate=sample_rate,
            source=file.text("References"),
            licence=file.text("License"),
        )


def _responses(file: Container) -> Array:
    shape = file.shape("Data.IR")
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
    responses = file.numbers("Data.IR", shape)
    if not responses.any(axis=2).all():
        raise FileFormatError("a response in Data.IR is all zeros: take that measurement out")
    return responses


def _sample_rate(file: Container) -> float:
    rates = np.unique(file.numbers("Data.SamplingRate", (1,), file.shape("Data.IR")[:1]))
    lowest, highest = SAMPLE_RATES
    if len(rates) != 1 or not lowest <= rates[0] <= highest:
        raise FileFormatError(
            f"its sample rate is {', '.join(f'{rate:g}' for rate in rates[:3])} Hz, and one from "
            f"{lowest:g} to {highest:g} Hz is read: resample it"
        )
    return float(rates[0])


def _delays(file: Container, shape: tuple[int, ...]) -> Array:
    """Return the delays (M, 2) in samples."""
    delays = file.numbers("Data.Delay", (1, 2), shape[:2])
    if np.ptp(delays) > MOST_TAPS:
        raise FileFormatError(
            f"its delays spread over {np.ptp(delays):g} samples, and {MOST_TAPS:,} are the bound: "
            "give Data.Delay in samples"
        )
    return np.broadcast_to(delays, shape[:2])


def _sources(file: Container, count: int) -> tuple[Array, float]:
    """Return unit vectors (M, 3) in the head's frame, and the distance they share in m."""
    if np.any(file.numbers("ListenerPosition", (1, 3), (count, 3))):
        raise FileFormatError(
            "its ListenerPosition is not the origin: give SourcePosition relative to the listener"
        )
    positions = file.points("SourcePosition", (count, 3))
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


def _frame(file: Container, count: int) -> Array:
    """Return the head's axes in the file's frame: forward, left and up, as rows."""
    view = file.points("ListenerView", (1, 3), (count, 3))
    up = file.points("ListenerUp", (1, 3), (count, 3), typed="ListenerView")
    left = np.cross(up[0], view[0])
    if np.ptp(view, axis=0).any() or np.ptp(up, axis=0).any() or np.linalg.norm(left) < 1e-3:
        raise FileFormatError(
            f"its ListenerView {view[0]} and ListenerUp {up[0]} change, vanish or are parallel, "
            "and one head held still is read: write view (1, 0, 0) and up (0, 0, 1)"
        )
    axes = np.stack([view[0], left, np.cross(view[0], left)])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _left_first(file: Container) -> list[int]:
    """Return which receivers are the left and the right ear; y points to the left."""
    one = file.shape("ReceiverPosition")
    lateral = file.points("ReceiverPosition", (2, 3), (2, 3, 1), (2, 3, one[-1]))[:, 1]
    if np.isclose(*lateral):
        raise FileFormatError(
            f"its ReceiverPosition has both ears at y = {lateral[0]:g} m, so left is not known: "
            "write the left ear at y > 0, the right one at y < 0"
        )
    return [0, 1] if lateral[0] > lateral[1] else [1, 0]
