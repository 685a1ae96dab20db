"""Radiation: how loudly the modes of a body reach a listener."""

from __future__ import annotations

from struck.errors import OptionError
from struck.model.gains import Radiation
from struck.radiation.far_field import Heuristic1998, ObrienCoupling, RadiatedPower

__all__ = ["Heuristic1998", "ObrienCoupling", "RadiatedPower", "by_name"]


def by_name(name: str) -> Radiation:
    """Return the estimate of radiation that `name` stands for.

    Parameters
    ----------
    name : str
        ``"power"`` (calibrated, the default of struck), ``"obrien2002"`` or ``"heuristic1998"``
        (both relative).

    Returns
    -------
    Radiation

    Raises
    ------
    OptionError
        When no estimate has that name.
    """
    estimates: dict[str, Radiation] = {
        estimate.name: estimate for estimate in (RadiatedPower(), ObrienCoupling(), Heuristic1998())
    }
    if name not in estimates:
        offer = " or ".join(repr(known) for known in estimates)
        raise OptionError(f"no radiation is called {name!r}: give {offer}")
    return estimates[name]
