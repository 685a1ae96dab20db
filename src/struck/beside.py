"""What strikes of a recorded object sound like beside its modes: offline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.excitation.strike import Strike
from struck.model import ModalModel
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
        contact = model.contact(strike.at, strike.direction)
        impulse = strike.resolved(model, contact).impulse
        samples = model.residual.samples(sample_rate, strike.seed)
        first = round(strike.time * sample_rate)
        part = samples[: max(0, length - first)]
        heard[:, first : first + len(part)] += np.outer(impulse / distances(strike.time), part)
    return heard
