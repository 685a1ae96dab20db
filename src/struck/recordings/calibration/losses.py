"""Which law of damping the decays of some modes follow, chosen by cross-validation.

Decays scatter by factors, not by amounts, so all fits are least squares of ln d, with errors beyond
two standard deviations counted less (P. J. Huber, Annals of Mathematical Statistics 35, 1964).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from struck.errors import RecordingError, rounded
from struck.model.arrays import Array
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh

_ROUNDS = 15


@dataclass(frozen=True, kw_only=True)
class Terms:
    """A sum of powers of frequency, each with a factor of at least 0."""

    name: str
    kind: type[InternalFriction | Rayleigh]
    labels: tuple[str, ...]  # names of the factors

    @property
    def count(self) -> int:
        """Number of coefficients of the sum."""
        return len(self.labels)

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
        given = dict(zip(self.labels, map(float, coefficients), strict=True))
        required = {"mass": 0.0, "stiffness": 0.0} if self.kind is Rayleigh else {"loss_tangent": 0}
        return self.kind(**(required | given))


@dataclass(frozen=True, kw_only=True)
class LossCurve:
    """Straight lines in ln f and ln d between knots with equally many modes in between."""

    knots: tuple[float, ...]

    @classmethod
    def through(cls, frequencies: Array, count: int) -> LossCurve:
        """Place this many knots, fewer where modes coincide."""
        return cls(knots=tuple(np.unique(np.quantile(frequencies, np.linspace(0, 1, count)))))

    @property
    def name(self) -> str:
        """Name of the law."""
        return f"curve of {self.count} points"

    @property
    def count(self) -> int:
        """Number of coefficients of the law."""
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

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the rates."""
        return tuple(f"rate at {rounded(knot, 4)} Hz" for knot in self.knots)


LossLaw = Terms | LossCurve
_BOTH = "loss tangent and external"
LAWS = (
    Terms(name="loss tangent", kind=InternalFriction, labels=("loss_tangent",)),
    Terms(name=_BOTH, kind=InternalFriction, labels=("loss_tangent", "external")),
    Terms(name="Rayleigh", kind=Rayleigh, labels=("mass", "stiffness")),
)

_CURVES = (3, 5, 8, 12)
_MODES_A_COEFFICIENT = 3
_FOLDS = 10
_HUBER = 2.0
_WORST = 3.0
_LEAST = 1e-4  # least relative error of a decay


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Losses:
    """Law of damping that the modes of a body follow, with its errors and its rivals."""

    # what predicts unseen modes best; a simpler one where it is not significantly worse
    law: Damping
    name: str
    coefficients: Mapping[str, float]  # of the law, by name, in its units
    standard_errors: Mapping[str, float]
    scatter: float  # standard deviation of ln d about the law
    # By law: root mean square of ln d of unseen modes about it, capped at three standard deviations
    # of the closest.
    scores: Mapping[str, float]


def losses(frequencies: ArrayLike, decays: ArrayLike, errors: ArrayLike | None = None) -> Losses:
    """Find the law of damping that modes follow; modes that do not decay are left out.

    A constant loss tangent, one with external losses (1998, eq. 12 and 13), Rayleigh damping (2002,
    eq. 9), or a free curve, by tenfold cross-validation. Natural frequencies (n,) in Hz, decays and
    their standard errors in 1/s.
    """
    told = np.asarray(decays, np.float64)
    stated = np.zeros_like(told) if errors is None else np.asarray(errors, np.float64)
    kept = np.flatnonzero(told > 0)
    if not kept.size:
        raise RecordingError("no fitted mode decays: there is no damping to find")
    kept = kept[np.argsort(np.asarray(frequencies)[kept], kind="stable")]
    modes = _Decays(
        frequencies=np.asarray(frequencies, np.float64)[kept],
        decays=told[kept],
        errors=np.maximum(stated[kept] / told[kept], _LEAST),
    )
    return modes.explained()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Decays:
    frequencies: Array  # ascending
    decays: Array
    errors: Array  # of ln d

    def explained(self) -> Losses:
        laws = self.laws()
        apart = {law.name: self.cross_validated(law) for law in laws}
        scale = min(_spread(each) for each in apart.values())
        capped = {name: np.minimum(each**2, (_WORST * scale) ** 2) for name, each in apart.items()}
        law = _simplest(laws, capped)
        coefficients, slopes, weights, scatter = self.settled(law)
        deviations = _standard_errors(slopes * np.sqrt(weights)[:, None])
        return Losses(
            law=law.damping(coefficients),
            name=law.name,
            coefficients=dict(zip(law.labels, map(float, coefficients), strict=True)),
            standard_errors=dict(zip(law.labels, map(float, deviations), strict=True)),
            scatter=scatter,
            scores={name: float(np.sqrt(each.mean())) for name, each in capped.items()},
        )

    def laws(self) -> list[LossLaw]:
        curves = [LossCurve.through(self.frequencies, count) for count in _CURVES]
        every: list[LossLaw] = [*LAWS, *curves]
        few = len(self.decays) / _MODES_A_COEFFICIENT
        named = {law.name: law for law in every if law.count == 1 or law.count <= few}
        return list(named.values())

    def apart(self, law: LossLaw, coefficients: Array) -> Array:
        told = law.damping(coefficients).decays(self.frequencies)
        return np.log(self.decays / np.maximum(told, np.finfo(float).tiny))

    def of(self, modes: NDArray[np.bool_]) -> _Decays:
        return _Decays(
            frequencies=self.frequencies[modes],
            decays=self.decays[modes],
            errors=self.errors[modes],
        )

    def settled(self, law: LossLaw) -> tuple[Array, Array, Array, float]:
        """Return coefficients, slopes of ln d over them, weights, and the scatter of ln d."""
        weights = np.ones_like(self.decays)
        coefficients, slopes, scatter = np.zeros(0), np.zeros(0), 0.0
        for _ in range(4):
            coefficients, slopes = law.fitted(self.frequencies, self.decays, weights)
            apart = self.apart(law, coefficients)
            freedom = max(len(apart) - law.count, 1) / len(apart)
            scatter = _spread(apart) / np.sqrt(freedom)
            own = np.maximum(scatter**2 - np.median(self.errors) ** 2, 0.0)
            deviations = np.sqrt(own + self.errors**2)
            huber = np.minimum(1.0, _HUBER * deviations / np.maximum(np.abs(apart), _LEAST**2))
            weights = huber / deviations**2
        return coefficients, slopes, weights, scatter

    def cross_validated(self, law: LossLaw) -> Array:
        """Return ln d less that of the law fitted to other modes (n,), by cross-validation."""
        count = len(self.decays)
        folds = np.arange(count) % min(_FOLDS, count)
        apart = np.zeros(count)
        for fold in np.unique(folds):
            hidden = folds == fold
            rest = self.of(~hidden) if count > 1 else self
            apart[hidden] = self.of(hidden).apart(law, rest.settled(law)[0])
        return apart


def _spread(apart: Array) -> float:
    """Return a standard deviation that a few outliers do not move."""
    return max(1.4826 * float(np.median(np.abs(apart))), _LEAST)


def _standard_errors(design: Array) -> Array:
    """Return standard errors of coefficients in any units, of equations of unit variance (n, k)."""
    sizes = np.linalg.norm(design, axis=0)
    return np.sqrt(np.diag(np.linalg.pinv((design / sizes).T @ (design / sizes)))) / sizes


def _simplest(laws: list[LossLaw], squares: Mapping[str, Array]) -> LossLaw:
    """Return the law with the fewest coefficients that is not significantly worse than the best."""
    best = min(laws, key=lambda law: squares[law.name].mean())

    def as_good(law: LossLaw) -> bool:
        more = squares[law.name] - squares[best.name]
        return law is best or more.mean() <= more.std() / np.sqrt(len(more))

    chosen = [law for law in laws if as_good(law)]
    return min(chosen, key=lambda law: (law.count, squares[law.name].mean()))
