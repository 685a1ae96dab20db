"""How far the fitted frequencies and decays may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index
from struck.model.exponentials import Exponentials
from struck.recordings.poles.normal_equations import tell
from struck.recordings.poles.refinement import blocks_around, overlapping
from struck.recordings.segments import Segment

# What the bins around all modes tell of them once they are fitted.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Told:
    """Of M modes in C channels.

    Parameters
    ----------
    order : array (M,), int
        The modes, group by group.
    variances : array (M,)
        Of the poles.
    sizes : array (C, M)
        Variances of the gains' sizes.
    energies : array (M,)
        What is left along the second derivatives of their lines, in units of what chance or the
        model leave over in a bin.
    crossed, whole : arrays (M,), complex and float
        Products of that with the modes, and of the modes with themselves.
    """

    order: Index
    variances: Array
    sizes: Array
    energies: Array
    crossed: AnyComplex
    whole: Array


def told_by(segments: Sequence[Segment], ringing: Exponentials) -> Told:
    """Return what the bins of all segments tell of the modes."""
    count, gains = ringing.count, np.ascontiguousarray(ringing.gains)
    told = Told(
        order=np.zeros(count, np.int64),
        variances=np.zeros(count),
        sizes=np.zeros(gains.shape),
        energies=np.zeros(count),
        crossed=np.zeros(count, complex),
        whole=np.zeros(count),
    )
    if count:
        duration = max(segment.duration for segment in segments)
        blocks = blocks_around(segments, ringing.poles, overlapping(ringing.poles, duration))
        told.order[:] = blocks.members
        sums = told.energies, told.crossed, told.whole
        tell(blocks, ringing.poles, gains, told.variances, told.sizes, *sums)
    return told


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


def standard_errors(segments: Sequence[Segment], ringing: Exponentials) -> Errors:
    """Return how far a fit may be off.

    The Cramer-Rao bound of all channels and hits together: the inverse of the Fisher information
    of the poles of a group, its complex gains eliminated. For exponentials in noise it is the same
    for the angular frequency as for the decay rate. Where a fit leaves more than the noise, what
    it leaves takes the noise's place. Gains are bounded with the poles as they are.
    """
    told = told_by(segments, ringing)
    errors = np.sqrt(told.variances / 2)
    return Errors(frequencies=errors / (2 * np.pi), decays=errors, gains=np.sqrt(told.sizes))
