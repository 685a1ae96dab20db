"""How far the fitted frequencies and decays may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing
from struck.recordings.poles.told import told_by
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Errors:
    """Standard errors of a fit.

    Parameters
    ----------
    frequencies : array (M,)
        Hz.
    decays : array (M,)
        1/s.
    gains : array (C, M)
        Of the complex gains' sizes, in the unit of the samples.
    """

    frequencies: Array
    decays: Array
    gains: Array


def standard_errors(segments: Sequence[Segment], ringing: Ringing) -> Errors:
    """Return how far a fit may be off.

    The Cramer-Rao bound of all channels and hits together: the inverse of the Fisher information
    of the poles of a group, its complex gains eliminated. For exponentials in noise it is the same
    for the angular frequency as for the decay rate. Where a fit leaves more than the noise, what
    it leaves takes the noise's place. Gains are bounded with the poles as they are.
    """
    told = told_by(segments, ringing)
    errors = np.sqrt(told.variances / 2)
    return Errors(frequencies=errors / (2 * np.pi), decays=errors, gains=np.sqrt(told.sizes))
