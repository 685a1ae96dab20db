"""How far the fitted frequencies and decays may be off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.block import Block, Projection, misfit
from struck.recordings.poles.groups import overlapping
from struck.recordings.poles.refine import normal_equations
from struck.recordings.takes.ringing import Ringing
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]


def standard_errors(segments: Sequence[Segment], ringing: Ringing) -> tuple[Array, Array]:
    """Return standard errors of frequencies, Hz, and of decays, 1/s, both (M,).

    The Cramer-Rao bound of all channels and hits together: the inverse of the Fisher information
    of the poles of a group, its complex gains eliminated. For exponentials in noise it is the same
    for the angular frequency as for the decay rate. Where a fit leaves more than the noise, what
    it leaves takes the noise's place.
    """
    duration = max(segment.duration for segment in segments)
    variances = np.zeros(ringing.count)
    for group in overlapping(ringing.poles, duration):
        blocks = [Block.cleared(segment, ringing, group) for segment in segments]
        projections = [Projection.of(block, ringing.poles[group]) for block in blocks]
        information, _ = normal_equations(projections)
        scale = np.sqrt(np.maximum(np.diag(information).real, 1e-300))
        inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
        variances[group] = misfit(projections) * np.diag(inverse).real / scale**2
    errors = np.sqrt(variances / 2)
    return errors / (2 * np.pi), errors
