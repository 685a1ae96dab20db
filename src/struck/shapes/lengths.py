"""Places along slender bodies."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Places near an end stand off it by this share.
_INSET = 0.01


def places_along(length: float, height: float) -> Mapping[str, Array]:
    """Return contacts on the top of a body along x from 0 to `length`, its middle line at z = 0.

    "middle" (also "top"), "quarter" of the length, and "end" 1 % off the end at x = length.
    """
    shares = {"top": 0.5, "middle": 0.5, "quarter": 0.25, "end": 1 - _INSET}
    places = {name: np.array([share * length, 0.0, height / 2]) for name, share in shares.items()}
    for place in places.values():
        place.setflags(write=False)
    return MappingProxyType(places)
