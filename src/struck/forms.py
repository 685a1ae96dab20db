"""Mode shapes as functions of a place: exact everywhere, not only at vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Forms(Protocol):
    """Functions Psi_n over the plan of a body (1998, eq. 3), with a mean square of 1."""

    @property
    def dimensions(self) -> int:
        """How many coordinates a place in the plan has, D."""
        ...

    def values(self, places: Array) -> Array:
        """Return the functions at places in the plan, m (K, D): (K, M)."""
        ...

    def chosen(self, modes: Index) -> Self:
        """Return the functions of some modes, in that order."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransverseShapes:
    """Mode shapes of a body that moves along z alone, known over its plan.

    Parameters
    ----------
    forms : Forms
        Over the plan of the body as it was computed.
    weights : array (M,)
        Values of the forms times these are mass-normalised shapes, kg^-1/2.
    size : float
        How many times larger the body has become.
    """

    forms: Forms
    weights: Array
    size: float = 1.0

    @classmethod
    def of(cls, forms: Forms, count: int, mass: float) -> TransverseShapes:
        """Make the shapes of a body of `mass` kg from `count` forms with a mean square of 1."""
        return cls(forms=forms, weights=np.full(count, mass**-0.5))

    def displacements(self, points: Array) -> Array:
        """Return the shapes at points of the body, m (K, 3): (K, 3, M), kg^-1/2."""
        plan = np.asarray(points)[:, : self.forms.dimensions] / self.size
        shapes = np.zeros((len(plan), 3, len(self.weights)))
        shapes[:, 2] = self.forms.values(plan) * self.weights
        return shapes

    def chosen(self, modes: Index, size: float = 1.0, density: float = 1.0) -> TransverseShapes:
        """Return some modes of a body `size` times as large and `density` times as dense."""
        return replace(
            self,
            forms=self.forms.chosen(modes),
            weights=self.weights[modes] * (density * size**3) ** -0.5,
            size=self.size * size,
        )

    def signed(self, signs: Array) -> TransverseShapes:
        """Return the shapes times `signs` (M,)."""
        return replace(self, weights=self.weights * signs)
