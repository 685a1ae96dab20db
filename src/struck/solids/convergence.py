"""How far frequencies are off, told from two resolutions, and how fine the next one must be.

On a finer mesh the errors told on one mesh alone shrink; frequencies move meanwhile. How far they
move for what is told to have gone is the scale of what is told to be left, and holds even where
both meshes share a defect, as walls of one layer do. The figures were set on spheres, cubes,
tubes and plates whose frequencies are known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.modes import Modes

Array = NDArray[np.float64]
# How many times an error told by residuals bounds the true one: where it stands alone, and where
# two resolutions scale it.
ALONE, _SCALED = 4.0, 2.3
# Power of the edges with which errors fall; 4 is the most that quadratic elements reach.
_POWER = 3.0
# How many times larger the errors are of which a mesh of given nodes is chosen.
_TYPICAL = 2.5
# Less than so many times the nodes tell nothing.
_LEAST_RATIO = 1.05
# Of an error told by residuals, the least share that the finer mesh counts as having removed.
_LEAST_GAIN = 0.05
_MOST_MODES = 0.9
# Frequencies miss so many times what the volume does, where edges are cut off.
_OF_VOLUME = 1.5
# No error is told smaller than this. Where a mode looks so many times as exact as the modes beside
# it, two meshes happen to agree on it: it gets this share of theirs.
_LEAST, _BESIDE, _OUTLYING, _SHARE = 1e-4, 4, 0.07, 0.6


def stated_errors(modes: Modes, nodes: int, coarse: Modes | None, coarse_nodes: int) -> Array:
    """Return the relative error of each frequency (M,).

    Parameters
    ----------
    modes : Modes
        Whose errors are those of one mesh alone.
    nodes : int
    coarse : Modes or None
        Of a coarser mesh, over a wider band, with errors of the same kind.
    coarse_nodes : int
    """
    if coarse is None or not comparable(nodes, coarse_nodes):
        return np.maximum(modes.errors, _LEAST)
    known = min(len(modes.frequencies), len(coarse.frequencies))
    ratio = coarse.frequencies[:known] / modes.frequencies[:known]
    before, after = coarse.errors[:known], modes.errors[:known]
    # Errors are told in energy, and as shares of what their own mesh found.
    gone = np.abs(1 - ratio**-2) / 2
    scale = gone / np.maximum(before - after, _LEAST_GAIN * before)
    # Where modes cross from mesh to mesh one's own scale means little: that of most holds too.
    scaled = _SCALED * np.maximum(scale, np.median(scale)) * after
    fallen = np.abs(ratio - 1) / ((nodes / coarse_nodes) ** (_POWER / 3) - 1)
    errors = modes.errors.copy()
    errors[:known] = np.minimum(scaled, np.maximum(after, fallen))
    return _levelled(errors)


def comparable(nodes: int, coarse_nodes: int) -> bool:
    """Tell whether a coarser mesh of so many nodes says something about one of `nodes`."""
    return coarse_nodes > 0 and nodes / coarse_nodes >= _LEAST_RATIO


def _levelled(errors: Array) -> Array:
    spans = [errors[max(i - _BESIDE, 0) : i + _BESIDE + 1] for i in range(len(errors))]
    beside = np.array([np.median(span) for span in spans])
    believed = np.where(errors < _OUTLYING * beside, _SHARE * beside, errors)
    return np.maximum(believed, _LEAST)


def nodes_needed(coarse: Modes, nodes: int, target: float) -> int:
    """Return how many nodes bring most modes' errors below `target`, from a coarser mesh's."""
    error = float(np.quantile(coarse.errors, _MOST_MODES)) * (_TYPICAL / ALONE)
    return int(nodes * max(error / target, 1e-9) ** 0.75)


def with_shape(errors: Array, volume_error: float) -> Array:
    """Return errors (M,) with what the body's own shape misses, as crisp edges cut off do."""
    return np.hypot(errors, _OF_VOLUME * volume_error)
