"""The fit of 2007 for the same segments as the modern one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.model.exponentials import Ringing
from struck.recordings.corbett2007.method import fit_corbett2007
from struck.recordings.corbett2007.windowed_transform import WindowedTransform
from struck.recordings.takes.segment import Segment


def by_corbett2007(segments: Sequence[Segment], budget: int | None) -> Ringing:
    """Fit each channel of each hit by itself and merge what sounds alike.

    Parameters
    ----------
    segments : sequence of Segment
        The gate is used where all have a lead-in of a window, 46 ms.
    budget : int or None
        Not more modes than these, those of most energy; the paper has no such bound.

    Returns
    -------
    Ringing
        In ascending order of frequency.
    """
    rate = segments[0].sample_rate
    window = WindowedTransform.at(rate).length
    gated = all(each.before.shape[1] >= window for each in segments)
    found = fit_corbett2007(
        [each.samples for each in segments],
        rate,
        lead_ins=[each.before for each in segments] if gated else None,
    )
    poles = -found.decays + 2j * np.pi * found.frequencies
    ringing = Ringing(poles=poles, gains=found.gains)
    energies = (np.abs(found.gains) ** 2).sum(axis=0) / np.maximum(found.decays, 1e-6)
    return ringing.of(np.sort(np.argsort(-energies, kind="stable")[:budget]))
