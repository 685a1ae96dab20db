"""Gains of one recorded place: for takes of which nobody told where."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from struck.errors import ContactError
from struck.model.gains import Gains

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SinglePoint(Gains):
    """Gains of a body struck at one place and heard from one, alike in all directions.

    Whatever contact is asked for, it is the recorded one. Where the microphone stood is not known:
    it counts as 1 m from the centre, from where sound falls as 1/r.

    Parameters
    ----------
    outputs : array (M,), complex
        As recorded, relative to the sound's arrival.
    centre : array (3,)
        Where the sound seems to come from, body coordinates, m.
    is_calibrated : bool
        Whether outputs are Pa/(N s), not relative.
    """

    outputs: Complex
    centre: Array = field(default_factory=lambda: np.zeros(3))
    is_calibrated: bool = False

    @property
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""
        return self.is_calibrated

    def at(self, points: Array, directions: Array) -> Array:
        """Return 1 for contacts (K, D) with any number of coordinates: (K, 1, M)."""
        del directions
        return np.ones((len(np.atleast_2d(points)), 1, len(self.outputs)))

    def toward(self, listeners: Array) -> Complex:
        """Return outputs that fall as 1/r at listeners (L, 3), relative to the arrival: (L, 1, M).

        Raises
        ------
        ContactError
            At the centre itself.
        """
        places = np.atleast_2d(np.asarray(listeners, np.float64))
        distances = np.linalg.norm(places - self.centre, axis=1)
        if not distances.all():
            raise ContactError(
                "a listener is 0 m from the body's centre, where 1/r has no end: move it away; "
                "what was recorded is heard at 1 m"
            )
        return self.outputs / distances[:, None, None]

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> SinglePoint:
        """Return the gains of chosen `modes` of a body with other frequencies, size or density.

        Shapes go with (density size^3)^(-1/2) where a body is pushed and where it radiates; what
        was heard at 1 m is heard at `size` m.
        """
        del frequencies
        return SinglePoint(
            outputs=self.outputs[modes] * (size / (density * size**3)),
            centre=self.centre * size,
            is_calibrated=self.is_calibrated,
        )
