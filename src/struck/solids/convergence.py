"""How far frequencies are off, told from two resolutions, and how fine the next one must be.

The errors of quadratic elements fall with the fourth power of the edges at best. A lower power,
and strains recovered on the finer mesh, make the statement a bound for nearly all modes; the
figures were set on spheres, cubes, tubes and plates whose frequencies are known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.modes import Modes

Array = NDArray[np.float64]
# Power of the edges, and how many times a recovered error bounds the true one: where it stands
# alone, beside a coarser resolution, and in the middle of all modes.
_POWER = 2.5
ALONE, _BESIDE, _TYPICAL = 4.0, 1.5, 2.5
# Less than so many times the nodes tell too little.
_LEAST_RATIO = 1.4
_MOST_MODES = 0.9


def stated_errors(modes: Modes, nodes: int, coarse: Modes | None, coarse_nodes: int) -> Array:
    """Return the relative error of each frequency (M,).

    Parameters
    ----------
    modes : Modes
        Whose errors are those of recovered strains alone.
    nodes : int
    coarse : Modes or None
        Of a coarser mesh, over a wider band.
    coarse_nodes : int
    """
    ratio = nodes / max(coarse_nodes, 1)
    if coarse is None or ratio < _LEAST_RATIO:
        return modes.errors
    known = min(len(modes.frequencies), len(coarse.frequencies))
    apart = np.abs(coarse.frequencies[:known] / modes.frequencies[:known] - 1)
    errors = modes.errors.copy()
    recovered = errors[:known] * (_BESIDE / ALONE)
    errors[:known] = np.maximum(apart / (ratio ** (_POWER / 3) - 1), recovered)
    return errors


def nodes_needed(coarse: Modes, nodes: int, target: float) -> int:
    """Return how many nodes bring most modes' errors below `target`, from a coarser mesh's."""
    error = float(np.quantile(coarse.errors, _MOST_MODES)) * (_TYPICAL / ALONE)
    return int(nodes * max(error / target, 1e-9) ** 0.75)
