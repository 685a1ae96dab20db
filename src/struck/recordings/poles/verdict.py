"""Whether a take is the ringing of a struck object at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.model.exponentials import Exponentials
from struck.recordings.poles.uncertainty import standard_errors
from struck.recordings.segments import Segment

LEAST = 8.0
"""Signal over what the model cannot explain, dB."""
MODES = 128
"""With so many modes."""
_STEADY = 0.5
_SLOW = 0.05
"""1/s: it would ring for more than two minutes."""
_LATE, _EARLY = 0.1, 0.05
_SWELLS = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalVerdict:
    """Whether the sound is modal, and if not, why not.

    Parameters
    ----------
    modal : bool
        Whether decaying modes explain it.
    reason : str
        Why not, in one sentence; empty where it is.
    signal_to_residual : float
        Energy of the segments over that of what is left, dB.
    signal_to_misfit : float
        The same without the noise's own share of what is left, dB; infinite where noise alone is.
    """

    modal: bool
    reason: str
    signal_to_residual: float
    signal_to_misfit: float


def judged(segments: Sequence[Segment], ringing: Exponentials) -> ModalVerdict:
    """Return what to think of a fit."""
    signal = sum(float((each.samples**2).sum()) for each in segments)
    left = sum(float((each.residual(ringing) ** 2).sum()) for each in segments)
    noise = sum(float(each.noise.energy(each.samples.shape[1]).sum()) for each in segments)
    misfit = _decibels(signal, left - noise)
    reason = _reason(segments, ringing, misfit)
    return ModalVerdict(
        modal=not reason,
        reason=reason,
        signal_to_residual=_decibels(signal, left),
        signal_to_misfit=misfit,
    )


def _reason(segments: Sequence[Segment], ringing: Exponentials, misfit: float) -> str:
    if not ringing.count:
        return "nothing rings that stands out of the noise"
    if _steady(segments, ringing) > _STEADY:
        return "most of it is a steady tone that does not decay: nothing was struck"
    if misfit < LEAST:
        return (
            f"what {ringing.count} decaying modes leave is only {misfit:.1f} dB below the sound, "
            f"and {LEAST:g} dB are needed: it is noise-like, as of a cymbal, or moves in pitch, as "
            "speech does"
        )
    if _swelling(segments) > _SWELLS:
        return "it grows louder after its beginning: nothing was struck there"
    return ""


def _steady(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the share of energy in what hardly decays, and is known to."""
    errors = standard_errors(segments, ringing).decays
    steady = ringing.of(ringing.decays + errors < _SLOW)
    if not steady.count:
        return 0.0
    whole = sum(float((each.samples**2).sum()) for each in segments)
    return sum(float((each.model(steady) ** 2).sum()) for each in segments) / whole


def _swelling(segments: Sequence[Segment]) -> float:
    """Return how far the level rises after the first moments, dB, in the loudest segment."""
    segment = max(segments, key=lambda each: float((each.samples**2).sum()))
    size = max(1, round(_EARLY * segment.sample_rate))
    count = segment.samples.shape[1] // size
    if count < 2 * _LATE / _EARLY:
        return 0.0
    blocks = (segment.samples[:, : count * size].reshape(-1, count, size) ** 2).sum(axis=(0, 2))
    late = round(_LATE / _EARLY)
    return _decibels(float(blocks[late:].max()), float(blocks[:late].max()))


def _decibels(above: float, below: float) -> float:
    return float(10 * np.log10(above / below)) if below > 0 else np.inf
