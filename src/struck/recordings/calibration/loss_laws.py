"""Laws by which decays may depend on frequency, and their least squares of ln d."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh

Array = NDArray[np.float64]

_ROUNDS = 15


class Law(ABC):
    """A way in which decays may depend on frequency."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What people call it."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of coefficients."""

    @abstractmethod
    def fitted(self, frequencies: Array, decays: Array, weights: Array) -> tuple[Array, Array]:
        """Return the coefficients of the least squares, and the slopes of ln d over them (n, k)."""

    @abstractmethod
    def damping(self, coefficients: Array) -> Damping:
        """Return the law with these coefficients."""

    @abstractmethod
    def labels(self, coefficients: Array) -> tuple[str, ...]:
        """Return what the coefficients are called."""


@dataclass(frozen=True, kw_only=True)
class Terms(Law):
    """A sum of powers of frequency, each with a factor of at least 0."""

    title: str
    kind: type[InternalFriction | Rayleigh]
    parts: tuple[str, ...]

    @property
    def name(self) -> str:
        """What people call it."""
        return self.title

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self.parts)

    def fitted(self, frequencies: Array, decays: Array, weights: Array) -> tuple[Array, Array]:
        """Return the coefficients of the least squares, and the slopes of ln d over them (n, k)."""
        units = np.eye(self.count)
        basis = np.stack([self.damping(unit).decays(frequencies) for unit in units], axis=1)
        scale = np.median(decays) / np.median(basis, axis=0)
        basis = basis * scale
        coefficients, told = np.zeros(self.count), decays
        for _ in range(_ROUNDS):  # Gauss-Newton in ln d, from the least squares of d / told
            rows = np.sqrt(weights) / told
            aims = told * (1 + np.log(decays / told))
            coefficients, _ = nnls(basis * rows[:, None], aims * rows)
            told = np.maximum(basis @ coefficients, np.finfo(float).tiny)
        return coefficients * scale, basis / told[:, None] / scale

    def damping(self, coefficients: Array) -> Damping:
        """Return the law with these coefficients."""
        given = dict(zip(self.parts, map(float, coefficients), strict=True))
        required = {"mass": 0.0, "stiffness": 0.0} if self.kind is Rayleigh else {"loss_tangent": 0}
        return self.kind(**(required | given))

    def labels(self, coefficients: Array) -> tuple[str, ...]:
        """Return what the coefficients are called."""
        del coefficients
        return self.parts


@dataclass(frozen=True, kw_only=True)
class Curve(Law):
    """Straight lines in ln f and ln d between knots that hold equally many modes apart."""

    knots: tuple[float, ...]

    @classmethod
    def through(cls, frequencies: Array, count: int) -> Curve:
        """Place so many knots, fewer where modes fall together."""
        return cls(knots=tuple(np.unique(np.quantile(frequencies, np.linspace(0, 1, count)))))

    @property
    def name(self) -> str:
        """What people call it."""
        return f"curve of {self.count} points"

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self.knots)

    def fitted(self, frequencies: Array, decays: Array, weights: Array) -> tuple[Array, Array]:
        """Return the rates of the least squares, and the slopes of ln d over them (n, k)."""
        places, wanted = np.log(self.knots), np.log(frequencies)
        basis = np.stack([np.interp(wanted, places, unit) for unit in np.eye(self.count)], axis=1)
        rows = np.sqrt(weights)
        solution = np.linalg.lstsq(basis * rows[:, None], np.log(decays) * rows)[0]
        return np.exp(solution), basis * np.exp(-solution)

    def damping(self, coefficients: Array) -> Damping:
        """Return the law with these coefficients."""
        return Measured(frequencies=self.knots, rates=tuple(map(float, coefficients)))

    def labels(self, coefficients: Array) -> tuple[str, ...]:
        """Return what the coefficients are called."""
        del coefficients
        return tuple(f"rate at {knot:.4g} Hz" for knot in self.knots)


LAWS = (
    Terms(title="loss tangent", kind=InternalFriction, parts=("loss_tangent",)),
    Terms(
        title="loss tangent and external", kind=InternalFriction, parts=("loss_tangent", "external")
    ),
    Terms(title="Rayleigh", kind=Rayleigh, parts=("mass", "stiffness")),
)
