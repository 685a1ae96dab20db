"""Where a computed model expects its modes to lie, for any Poisson's ratio."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from struck.model.model import ModalModel
from struck.model.modes import Stiffness, changed

Array = NDArray[np.float64]

LEAST_RATIO, GREATEST_RATIO = -0.9, 0.49
"""Poisson's ratios that a search may try."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """The modes of a body, whatever it is made of.

    Parameters
    ----------
    model : ModalModel
        The body as computed.
    """

    model: ModalModel

    @cached_property
    def stiffness(self) -> Stiffness:
        """What the model tells of its modes."""
        model = self.model
        return Stiffness(
            frequencies=model.natural_frequencies,
            poisson_slopes=model.poisson_slopes,
            errors=model.errors,
            complete_to=model.complete_to,
            tensioned=model.tensioned,
        )

    @property
    def poisson_ratio(self) -> float:
        """The model's own; NaN where its material is unknown."""
        return np.nan if self.model.material is None else self.model.material.poisson_ratio

    @property
    def follows(self) -> bool:
        """Whether the model tells how its modes follow Poisson's ratio."""
        slopes = self.model.poisson_slopes
        known = slopes is not None and bool(np.isfinite(slopes).all())
        return known and self.model.material is not None and not self.model.tensioned

    def remade(self, ratio: float) -> Stiffness:
        """Return the modes with another Poisson's ratio, Young's modulus and density kept."""
        material = self.model.material
        if not self.follows or material is None:
            return self.stiffness
        return changed(self.stiffness, material, replace(material, poisson_ratio=ratio))

    def logarithms(self, ratios: Array) -> tuple[Array, Array]:
        """Return ln f0 and its slopes over Poisson's ratio, both (H, M), for ratios (H,)."""
        if not self.follows:
            own = np.log(self.stiffness.frequencies)
            return np.tile(own, (len(ratios), 1)), np.zeros((len(ratios), len(own)))
        every = [self.remade(float(ratio)) for ratio in ratios]
        slopes = [np.asarray(each.poisson_slopes, np.float64) for each in every]
        return np.log([each.frequencies for each in every]), np.array(slopes)
