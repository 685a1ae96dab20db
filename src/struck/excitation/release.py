"""A body brought into a form and let go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.bounds import require_at_least_zero, require_positive
from struck.excitation.excitation import Burst
from struck.excitation.pluck import Pluck
from struck.model.model import ModalModel
from struck.shapes.impact import initial_amplitudes

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A flat body pulled into any form, softly, and let go (1998, eq. 5).

    Parameters
    ----------
    displacement : callable
        Takes points on top of the body, m (K, 3), and returns how far each is moved along z, m.
    rise : float
        How long it takes to bring the body there, s; see `Pluck`.
    time : float
        When that begins, s; it is let go at time + rise.

    Raises
    ------
    OptionError
        On a number outside its bound.
    """

    displacement: Callable[[Array], Array]
    rise: float = 0.05
    time: float = 0.0

    def __post_init__(self) -> None:
        require_positive(rise=self.rise)
        require_at_least_zero(time=self.time)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin on a model at sample number `start`; see `struck.excitation.pushing`.

        Raises
        ------
        OptionError
            When the model is not of a body of struck.shapes, or the displacement is not finite.
        """
        require_positive(sample_rate=sample_rate)
        _, amplitudes = initial_amplitudes(model, displacement=self.displacement)
        if not np.isfinite(amplitudes).all():
            raise OptionError("displacement returned numbers that are not finite: give metres")
        load = Pluck(force=1.0, rise=self.rise, time=self.time).sampled(sample_rate)
        stiffness = np.square(2 * np.pi * model.natural_frequencies)
        return Burst(load, stiffness * amplitudes * np.sqrt(model.mass or 1.0), start=start)
