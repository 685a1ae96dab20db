"""What strikes of a recorded object sound like beside its modes: offline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.excitation.pulses import sampled
from struck.excitation.strike import Strike
from struck.model.model import ModalModel
from struck.model.residual import Residual
from struck.scene.body import Action

Array = NDArray[np.float64]


def set_back(model: ModalModel, actions: Sequence[Action]) -> list[Action]:
    """Return actions in which modes set in when the attack has led up to them."""
    if model.residual is None:
        return list(actions)
    lead = model.residual.lead
    return [
        replace(each, time=each.time + lead) if isinstance(each, Strike) else each
        for each in actions
    ]


def residual_sound(
    model: ModalModel,
    actions: Sequence[Action],
    distances: Callable[[float], Array],
    *,
    sample_rate: int,
    length: int,
) -> Array:
    """Return attacks and noise of all strikes, as strong as those (rows, length).

    Parameters
    ----------
    model : ModalModel
    actions : sequence of Action
        As they were before `set_back`; only strikes count.
    distances : callable
        Returns how far away each row is at a time (rows,), m.
    sample_rate : int
        Hz.
    length : int
        Samples.
    """
    strikes = [each for each in actions if isinstance(each, Strike)]
    rows = len(distances(0.0))
    heard = np.zeros((rows, length))
    if model.residual is None:
        return heard
    for strike in strikes:
        first, part = _sounding(model, model.residual, strike, sample_rate)
        begin, end = max(first, 0), min(first + len(part), length)
        if begin < end:
            heard[:, begin:end] += np.outer(
                1 / distances(strike.time), part[begin - first : end - first]
            )
    return heard


def _sounding(
    model: ModalModel, residual: Residual, strike: Strike, sample_rate: int
) -> tuple[int, Array]:
    """Return the sample at which a strike's attack begins, and what sounds from there on at 1 m.

    A longer push than the recorded one takes its treble off, as it does with the modes.
    """
    blow = strike.resolved(model, model.contact(strike.at, strike.direction))
    samples = residual.samples(sample_rate, strike.seed)
    if not blow.duration:
        return round(strike.time * sample_rate), blow.impulse * samples
    pulse = sampled(
        strike.shape,
        impulse=blow.impulse,
        onset=strike.time,
        duration=blow.duration,
        sample_rate=sample_rate,
    )
    from scipy.signal import oaconvolve

    return pulse.first, np.asarray(oaconvolve(samples, pulse.force), np.float64) / sample_rate
