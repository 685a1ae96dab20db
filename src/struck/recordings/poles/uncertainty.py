"""How far the fitted frequencies and decays may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.block import Block, Projection, misfit
from struck.recordings.poles.groups import overlapping
from struck.recordings.poles.refine import normal_equations
from struck.recordings.takes.ringing import Ringing
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
    duration = max(segment.duration for segment in segments)
    variances, gains = np.zeros(ringing.count), np.zeros(ringing.gains.shape)
    for group in overlapping(ringing.poles, duration):
        blocks = [Block.cleared(segment, ringing, group) for segment in segments]
        projections = [Projection.of(block, ringing.poles[group]) for block in blocks]
        over = misfit(projections)
        variances[group] = over * _pole_variances(projections)
        for block, projection in zip(blocks, projections, strict=True):
            own = np.sqrt(over) * _residue_errors(projection)
            gains[block.rows, group] = np.abs(block.spectrum.gains(ringing.poles[group], own))
    errors = np.sqrt(variances / 2)
    return Errors(frequencies=errors / (2 * np.pi), decays=errors, gains=gains)


def _pole_variances(projections: list[Projection]) -> Array:
    information, _ = normal_equations(projections)
    scale = np.sqrt(np.maximum(np.diag(information).real, 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    return np.diag(inverse).real / scale**2


def _residue_errors(projection: Projection) -> NDArray[np.complex128]:
    """Return the errors (C, M) of the lines' factors, from the inverse of their Gram matrix."""
    inverse = np.linalg.inv(projection.triangle)
    spread = (np.abs(inverse) ** 2).sum(axis=1)
    return np.sqrt(np.outer(1 / projection.block.weights, spread)).astype(np.complex128)
