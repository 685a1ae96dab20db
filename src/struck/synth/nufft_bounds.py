"""Which blocks and modes the block transform is for, and what it refuses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

BLOCKS = (16, 4096)
"""Shortest and longest block."""
HEAVIEST = 16.0
"""Nepers a block that a mode may decay: d B / rate."""
_FEWEST, _SHORTEST, _LEAST = 1024, 64, 400_000


def wins(modes: int, block: int) -> bool:
    """Tell whether the transform takes less time than resonators stepped sample by sample.

    Measured on a Zen 4 core at 48 kHz (30 Hz to 18 kHz, 0.5 to 200 1/s, one output), Python and
    all: times as fast ringing, and under one push,

    ======  ==========  ==========  ==========  ==========  ==========
    modes   B = 64      B = 128     B = 256     B = 512     B = 2048
    ======  ==========  ==========  ==========  ==========  ==========
    512     0.5, 0.3    0.6, 0.3    1.0, 0.5    1.2, 0.6    1.0, 0.4
    1024    0.7, 0.3    1.1, 0.5    1.6, 0.8    2.2, 1.0    1.9, 0.8
    2048    1.1, 0.4    1.3, 0.7    1.8, 1.4    3.9, 1.7    4.1, 1.5
    4096    1.7, 0.7    2.9, 1.2    4.6, 2.1    6.6, 2.9    6.7, 2.8
    16384   3.2, 1.2    5.2, 2.3    8.8, 4.2    15.8, 7.0   22.1, 9.3
    ======  ==========  ==========  ==========  ==========  ==========

    For few modes the calls of the FFT take longer than all modes.

    Parameters
    ----------
    modes : int
        Modes that sound into the same outputs.
    block : int
        Samples.
    """
    return modes >= _FEWEST and block >= _SHORTEST and modes * block >= _LEAST


def suits(poles: Complex, sample_rate: float, block: int) -> Mask:
    """Tell which modes decay by no more than `HEAVIEST` nepers in a block (N,)."""
    return -poles.real * block <= HEAVIEST * sample_rate


def check_poles(poles: Complex, sample_rate: float, block: int) -> None:
    """Refuse what cannot be planned with an OptionError."""
    if not BLOCKS[0] <= block <= BLOCKS[1]:
        raise OptionError(f"block is {block} samples: {BLOCKS[0]} to {BLOCKS[1]} can be used")
    if poles.ndim != 1 or not len(poles):
        raise OptionError(f"poles have shape {poles.shape}, not (N,) with N of at least 1")
    frequencies = poles.imag / (2 * np.pi)
    known = np.isfinite(poles) & (poles.real <= 0.0)
    bad = ~(known & (frequencies >= 0.0) & (frequencies < sample_rate / 2))
    if bad.any():
        raise OptionError(
            f"pole {poles[bad][0]} 1/s of mode {np.flatnonzero(bad)[0]} must be finite, decay, and"
            f" turn at 0 to {sample_rate / 2:g} Hz: leave out modes above half the sample rate"
        )
    suited = suits(poles, sample_rate, block)
    if not suited.all():
        raise OptionError(
            f"mode {np.flatnonzero(~suited)[0]} decays by more than {HEAVIEST:g} nepers in a block"
            f" of {block} samples: take a shorter block, or only the modes that suit"
        )


def check_shape(name: str, array: Array | Complex, shape: tuple[int, ...]) -> None:
    """Refuse what compiled loops would read beyond its end."""
    if array.shape != shape:
        raise OptionError(f"{name} has shape {array.shape}, not {shape}")
