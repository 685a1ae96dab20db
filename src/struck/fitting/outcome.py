"""What a fit of recordings comes to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.model import ModalModel
from struck.model.residual import Residual
from struck.model.survey import Survey
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitting:
    """A model of recordings, with all that is known of how well it fits.

    Parameters
    ----------
    model : ModalModel
    fitted : Fitted
        Shared poles, gains of each channel of each hit, standard errors, verdict and notes.
    recorded : Recorded
        The takes and their places.
    survey : Survey or None
        Gains over contact and listener; None for a model of a single point.
    lead : float
        From the arrival of a hit to the moment that gains are as of, s: until then the object is
        still being struck.
    room : array (M,), bool, or None
        Which modes the room may have; None where nobody told its reverberation.
    residual : Residual
        Attack and noise of the loudest hit, which the model has where it was asked for.
    """

    model: ModalModel
    fitted: Fitted
    recorded: Recorded
    survey: Survey | None
    lead: float
    room: NDArray[np.bool_] | None
    residual: Residual
