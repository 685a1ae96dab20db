"""The one loop over samples here: read a periodic table along a way."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def add_reading(values, starts, counts, turns, levels, weights, out):  # noqa: ANN001, ANN201 - compiled
    """Add what a table in several levels holds at `turns` of its period.

    Parameters
    ----------
    values, starts, counts : arrays
        Of a `struck.excitation.friction.Rung`.
    turns : array (n,)
        Where to read, in periods.
    levels : pair of float
        Level at the first sample and after the last, at least 0; read between levels.
    weights : pair of float
        Factor at the first sample and after the last.
    out : array (n,)
        Added to.
    """
    count = len(out)
    for sample in range(count):
        share = sample / count
        level = (1 - share) * levels[0] + share * levels[1]
        low = int(level)
        blend = level - low
        value = 0.0
        if low < len(counts):
            value += (1 - blend) * _cubic(values, starts[low], counts[low], turns[sample])
        if low + 1 < len(counts):
            value += blend * _cubic(values, starts[low + 1], counts[low + 1], turns[sample])
        out[sample] += ((1 - share) * weights[0] + share * weights[1]) * value


@njit(cache=True, nogil=True, error_model="numpy")
def _cubic(values, start, count, turn):  # noqa: ANN001, ANN202 - compiled
    """Return the cubic through the four points about a place (Lagrange)."""
    place = (turn - np.floor(turn)) * count
    whole = int(place)
    x = place - whole
    before = values[start + (whole - 1) % count]
    here = values[start + whole % count]
    after = values[start + (whole + 1) % count]
    beyond = values[start + (whole + 2) % count]
    return (
        here
        + x * (after - before / 3 - here / 2 - beyond / 6)
        + x * x * ((before + after) / 2 - here)
        + x * x * x * ((beyond - before) / 6 + (here - after) / 2)
    )
