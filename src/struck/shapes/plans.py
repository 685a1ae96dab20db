"""What bodies with a plan in x and y share: places by name, and how many modes are too many."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]

# Places near an edge stand off it by this share.
INSET = 0.01
_MOST_MODES = 100_000


def places_on(plan: Mapping[str, tuple[float, float]], thickness: float) -> Mapping[str, Array]:
    """Return contacts on the top face of a body whose middle plane is z = 0, by name, m (3,)."""
    places = {name: np.array([x, y, thickness / 2]) for name, (x, y) in plan.items()}
    for place in places.values():
        place.setflags(write=False)
    return MappingProxyType(places)


def require_tension(body: str, tension: float) -> None:
    """Raise OptionError unless `tension` is a positive, finite force over a length, N/m."""
    if not (math.isfinite(tension) and tension > 0):
        raise OptionError(f"tension of the {body} is {tension} N/m: it must exceed 0")


def require_countable(body: str, area: float, wavenumber: float, highest: float) -> None:
    """Refuse bands with more modes than a file can hold, by Weyl's law.

    Raises
    ------
    OptionError
        When about area wavenumber^2 / (4 pi) exceeds 100,000.
    """
    count = area * wavenumber**2 / (4 * math.pi)
    if not count <= _MOST_MODES:
        raise OptionError(
            f"the {body} has about {count:.2g} modes up to {highest:g} Hz: at most {_MOST_MODES} "
            "are computed; end the band lower, or check the lengths (m)"
        )
