"""Groups of modes and the bins that hold them, as compiled code reads them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]


class Blocks(NamedTuple):
    """A block for each group and segment: bins of the shortest transform in which the modes end.

    Parameters
    ----------
    members : array, int
        The modes of all groups, group by group.
    starts : array (G + 1,), int
        Where each group begins in it.
    numbers : array (G, S), int
        Of the blocks.
    firsts, offsets : arrays (G S + 1,), int
        Where the bins and the data of each block begin.
    turns : array (K,), complex
        exp(-2 pi i k / N) of all bins.
    data : array, complex
        The transforms there, (bins, channels) of each block.
    lengths : array (G S,)
        N / sample rate of the blocks, s.
    weights : array (C, G)
        One over the noise's energy in a bin.
    rows : array (S + 1,), int
        Where the gains of each segment begin.
    sample_rate : float
        Hz.
    """

    members: Index
    starts: Index
    numbers: Index
    firsts: Index
    offsets: Index
    turns: Complex
    data: Complex
    lengths: Array
    weights: Array
    rows: Index
    sample_rate: float
