"""What a recording tells of a body's modes, whoever fitted it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import RecordingError
from struck.model.model import ModalModel

Array = NDArray[np.float64]

_BESIDE = 1.0
"""Where a model is heard from, m beyond its centre."""


class FittedModes(Protocol):
    """Modes fitted to a recording.

    `frequency_errors` (Hz) and `decay_errors` (1/s), standard errors of (M,) modes, count where
    the object has them.
    """

    @property
    def frequencies(self) -> ArrayLike:
        """Ringing, Hz (M,)."""
        ...

    @property
    def decays(self) -> ArrayLike:
        """1/s (M,)."""
        ...

    @property
    def gains(self) -> ArrayLike:
        """Complex, (M,) or (channels, M)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Partials:
    """Modes as heard, in any order.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing, Hz.
    decays : array (M,)
        1/s.
    amplitudes : array (M,)
        Of the gains; root mean square over channels.
    frequency_errors, decay_errors : array (M,)
        Standard errors, Hz and 1/s; 0 where unknown.

    Raises
    ------
    RecordingError
        When there are no modes, arrays differ in length, or numbers are none that modes can have.
    """

    frequencies: Array
    decays: Array
    amplitudes: Array
    frequency_errors: Array
    decay_errors: Array

    def __post_init__(self) -> None:
        count = len(self.frequencies)
        if not count:
            raise RecordingError("the recording has 0 fitted modes: there is nothing to pair")
        for name in self.__slots__:
            values = getattr(self, name)
            if values.shape != (count,):
                raise RecordingError(f"{name} of {count} modes have shape {values.shape}")
            if not (np.isfinite(values).all() and values.min() >= 0):
                raise RecordingError(f"{name} hold {values.min():g}: leave such modes out")
        if self.frequencies.min() <= 0:
            raise RecordingError("a mode rings at 0 Hz: leave it out")

    @classmethod
    def of(cls, fitted: FittedModes | ModalModel) -> Partials:
        """Take fitted modes of any make; of a model, as its default contact sounds."""
        if isinstance(fitted, ModalModel):
            return cls._of_model(fitted)
        frequencies = np.asarray(fitted.frequencies, np.float64)
        gains = np.atleast_2d(np.asarray(fitted.gains, np.complex128))
        return cls(
            frequencies=frequencies,
            decays=np.asarray(fitted.decays, np.float64),
            amplitudes=np.sqrt(np.square(np.abs(gains)).mean(axis=0)),
            frequency_errors=_errors(fitted, "frequency_errors", len(frequencies)),
            decay_errors=_errors(fitted, "decay_errors", len(frequencies)),
        )

    @classmethod
    def _of_model(cls, model: ModalModel) -> Partials:
        contact = model.contact()
        drives = model.gains.at(contact.point[None], contact.direction[None])[0]
        centre = np.zeros(3) if model.centre is None else model.centre
        reach = _BESIDE if model.geometry is None else _BESIDE + 2 * model.geometry.extent
        outputs = model.gains.toward(centre[None] + [reach, 0.0, 0.0])[0]
        unknown = np.zeros(len(model.frequencies))
        errors = unknown if model.errors is None else np.nan_to_num(model.errors)
        return cls(
            frequencies=model.frequencies,
            decays=model.decays,
            amplitudes=np.abs((drives * outputs).sum(axis=0)),
            frequency_errors=errors * model.frequencies,
            decay_errors=unknown,
        )

    @property
    def natural_frequencies(self) -> Array:
        """Without damping, Hz (M,)."""
        return np.hypot(self.frequencies, self.decays / (2 * np.pi))


def _errors(fitted: Any, name: str, count: int) -> Array:  # noqa: ANN401 - whoever fitted it
    stated = getattr(fitted, name, None)
    return np.zeros(count) if stated is None else np.nan_to_num(np.asarray(stated, np.float64))
