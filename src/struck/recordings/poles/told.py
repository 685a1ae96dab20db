"""What the bins around all modes tell of them once they are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing
from struck.recordings.poles.blocks import blocks_around
from struck.recordings.poles.groups import overlapping
from struck.recordings.poles.normal_equations import tell
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]


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
    crossed: Complex
    whole: Array


def told_by(segments: Sequence[Segment], ringing: Ringing) -> Told:
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
