"""Sound: samples that travel with their rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sound:
    """Samples with their rate.

    Parameters
    ----------
    samples : array (channels, n), float32
        Pressure in Pa when `calibrated`, else relative.
    sample_rate : int
        Hz.
    calibrated : bool
        Whether the samples are Pa.
    """

    samples: NDArray[np.float32]
    sample_rate: int
    calibrated: bool = False
