"""The core's compiled loops as Python functions: one table of signatures, by ctypes.

ctypes lets other threads run while a loop does. The library is the best one that the processor
takes, or the one that ``STRUCK_CORE`` names: ``v2``, ``v3``, ``v4``, or ``off`` for plain NumPy.
"""

from __future__ import annotations

import ctypes
import os
import sys
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import CoreWarning, DeviceError, require_choice

_LIBRARIES = Path(__file__).parent / "libraries"
CHOICES = ("v2", "v3", "v4", "off")
_PLACE = ctypes.c_char * 0  # an array of which only the address counts


class _Array:
    """An argument that is a contiguous array of one type, or the address of one."""

    kind: np.dtype[Any]

    @classmethod
    def from_param(cls, value: np.ndarray[Any, Any] | int) -> ctypes.c_void_p | ctypes.Array[Any]:
        """Return the address of an array that a function of the core gets."""
        if isinstance(value, int):
            return ctypes.c_void_p(value)
        flags = value.flags
        if value.dtype != cls.kind or not (flags.c_contiguous and flags.aligned):
            raise TypeError(f"an array of {value.dtype} is not a contiguous one of {cls.kind}")
        buffer: Any = value
        try:
            return _PLACE.from_buffer(buffer)  # a microsecond less than `value.ctypes`
        except TypeError:  # not to be written to
            return ctypes.c_void_p(value.ctypes.data)


class _Reals(_Array):
    kind = np.dtype(np.float64)


class _Singles(_Array):
    kind = np.dtype(np.float32)


class _Wholes(_Array):
    kind = np.dtype(np.int64)


class _Complexes(_Array):
    kind = np.dtype(np.complex128)


class _Bytes(_Array):
    kind = np.dtype(np.uint8)


# Letters of signatures: arrays by the type of their numbers, then single numbers.
_TYPES: dict[str, Any] = {
    "D": _Reals,
    "F": _Singles,
    "I": _Wholes,
    "C": _Complexes,
    "B": _Bytes,
    "P": ctypes.c_void_p,
    "d": ctypes.c_double,
    "i": ctypes.c_int64,
    "-": None,
}
_BLOCKS = "iiIIIIICCDDId"  # groups, segments and the fields of `GroupBlocks`
# Each entry of the library: letters of its arguments, a blank, the letter of what it returns.
SIGNATURES: dict[str, str] = {
    "bank_make_block": "PP -",
    "bank_refresh": "PPi -",
    "bank_settle": "PPi -",
    "bank_stand": "PPi -",
    "bessel_series_slope": "iiDDD -",
    "bessel_series_sum": "iiDDD -",
    "boundary_layers": "iDiiDDDDDddiCC -",
    "core_fingerprint": " i",
    "core_level": " i",
    "ears_hear": "FiiFiiIIDDiFFiiiFiF -",
    "friction_add_reading": "PPPiDiddddD -",
    "friction_weigh": "DDDiDiDDiDD -",
    "limiter_is_closed": "D i",
    "limiter_limit": "DiDiii -",
    "lines_expect": "IidddDI -",
    "lines_fill": "IIDDiiiiiD -",
    "lines_join": "IIDDiii -",
    "lines_read": "IIDDiiiIiD -",
    "lines_smooth": "DDiiD -",
    "poles_add_unique": f"{_BLOCKS}iCCDDD -",
    "poles_take_turns": f"{_BLOCKS}iCCIiiCCDDD -",
    "queue_publish": "I -",
    "queue_release": "I -",
    "queue_waiting": "I i",
    "shapes_along": "DFiIDDiD -",
    "texture_add_heights": "DDIiDiPiiiD -",
    "uncertainty_write_statistics": f"{_BLOCKS}iCCDDDCDD -",
}


@cache
def library() -> ctypes.CDLL | None:
    """Return the library of this processor; None, with one warning, if there is no library."""
    chosen = os.environ.get("STRUCK_CORE", "")
    if chosen:
        require_choice("STRUCK_CORE", chosen, CHOICES, more=", or leave it out")
    if chosen == "off":
        return None
    try:
        return _opened(chosen)
    except OSError as error:
        _warn(str(error))
        return None


def _opened(chosen: str) -> ctypes.CDLL:
    """Return the chosen library, or the best one; raise OSError with the reason where none fits."""
    from struck.core.build import TARGETS, this_platform

    targets = TARGETS.get(this_platform())
    if not targets:
        raise OSError(f"there is no library for {this_platform()}")
    base_library = _checked(targets[0].name + targets[0].ending)
    level = base_library.core_level()
    if level == 0:
        return base_library
    target_level = int(chosen[1:]) if chosen else min(level, 4)
    if not 2 <= target_level <= level:
        raise OSError(
            f"it requires a processor of x86-64-v{max(target_level, 2)}, this is a v{level}"
        )
    return _checked(f"core_v{target_level}{targets[0].ending}")


def _checked(name: str, folder: Path = _LIBRARIES) -> ctypes.CDLL:
    """Return the opened library of that file name; refuse one compiled from other sources."""
    from struck.core.build import fingerprint

    path = folder / name
    if not path.is_file():
        raise OSError(f"{path} is missing")
    loaded_library = ctypes.CDLL(str(path))
    try:
        for entry, signature in SIGNATURES.items():
            arguments, result = signature.split(" ")
            function = getattr(loaded_library, entry)
            function.argtypes = [_TYPES[letter] for letter in arguments]
            function.restype = _TYPES[result]
        is_current = loaded_library.core_fingerprint() == fingerprint()
    except AttributeError:
        is_current = False
    if not is_current:
        raise OSError(f"{path} was compiled from other sources than those next to it")
    return loaded_library


def _warn(reason: str) -> None:
    warnings.warn(
        f"sounds are computed in plain NumPy, many times slower, for the compiled core cannot be "
        f"used: {reason}; install struck again (pip install --force-reinstall struck; in a source "
        f"tree pip install -e .)",
        CoreWarning,
        stacklevel=2,
    )


@cache
def entry(name: str) -> Callable[..., Any] | None:
    """Return a compiled loop by its name in the library; None where there is no library."""
    core_library = library()
    return None if core_library is None else getattr(core_library, name)


def compiled(name: str) -> Callable[..., Any]:
    """Return a function of the compiled core that has no equivalent in Python.

    Raises
    ------
    DeviceError
        Without a compiled core.
    """
    function = entry(name)
    if function is None:
        raise DeviceError(
            f"the compiled core is not there on {sys.platform}, and nothing plays or records live "
            "without it: install struck again, or render to a file"
        )
    return function


def address(name: str) -> int:
    """Return the address of a compiled function, for a library that calls it itself.

    Raises
    ------
    DeviceError
        Without a compiled core.
    """
    function: Any = compiled(name)
    return ctypes.cast(function, ctypes.c_void_p).value or 0
