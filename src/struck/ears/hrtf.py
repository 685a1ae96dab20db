"""Measured head-related impulse responses: what one set holds, and the sets bundled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]

BUNDLED = ("kemar",)
_FULL_SCALE = 32768.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HrtfSet:
    """Responses of two ears to sources around a head, all at one distance.

    Parameters
    ----------
    name : str
        What it is called.
    directions : array (M, 3)
        From the head's centre to each source, of length one, in the head's frame.
    distance : float
        Of the sources from the head's centre, m.
    responses : array (M, 2, N)
        Left ear first, at any level that all share.
    delays : array (M, 2)
        By which the responses have to be delayed, s; zero at any time that all share.
    sample_rate : float
        Hz.
    references : tuple of str
        Keys in ``references.toml``.
    source, licence : str
        What the file says of its origin and its terms.
    """

    name: str
    directions: Array
    distance: float
    responses: Array
    delays: Array
    sample_rate: float
    references: tuple[str, ...] = ()
    source: str = ""
    licence: str = ""


@cache
def bundled(name: str) -> HrtfSet:
    """Return a set that comes with struck.

    Raises
    ------
    OptionError
        When none is called that.
    """
    if name not in BUNDLED:
        raise OptionError(
            f"no head called {name!r} is bundled: use one of {', '.join(BUNDLED)}, or the path of "
            "a .sofa file"
        )
    with (
        resources.files("struck.ears").joinpath(f"{name}.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as stored,
    ):
        left = stored["left"] / _FULL_SCALE
        return HrtfSet(
            name=name,
            directions=directions_of(stored["azimuths"], stored["elevations"]),
            distance=float(stored["distance"]),
            responses=np.stack([left, left[stored["mirrored"]]], axis=1),
            delays=np.full((len(left), 2), float(stored["start"])),
            sample_rate=float(stored["sample_rate"]),
            references=("gardner1994",),
            source=str(stored["source"]),
            licence=str(stored["licence"]),
        )


def directions_of(azimuths: Array, elevations: Array) -> Array:
    """Return the unit vectors (M, 3) of angles in degrees: forward, left, up."""
    azimuth, elevation = np.radians(azimuths), np.radians(elevations)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
