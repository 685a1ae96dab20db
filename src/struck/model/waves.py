"""Sound around a body as a sum of outgoing spherical waves, fitted to measured listeners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from struck.model.arrays import Array, Complex, Index, Mask
from struck.model.survey import shares

ORDER = 4  # the highest degree of waves fitted to recordings


def degrees(order: int) -> tuple[Index, Index]:
    """Return degree l and order m of all harmonics, m from -l to l; below 0 the sines."""
    pairs = [(degree, m) for degree in range(order + 1) for m in range(-degree, degree + 1)]
    degree, angular = np.array(pairs).T
    return degree, angular


def real_harmonics(places: Array, order: int) -> Array:
    """Return real harmonics r^l Y_lm at places (n, 3), of mean square 1 on a unit sphere."""
    from scipy.special import sph_harm_y  # not loaded with every model file

    degree, angular = degrees(order)
    x, y, z = places.T[:, :, None]
    flat = np.hypot(x, y)
    values = sph_harm_y(degree, np.abs(angular), np.arctan2(flat, z), np.arctan2(y, x))
    parts = np.where(angular < 0, values.imag, values.real)
    scale = np.sqrt(4 * np.pi * (1 + (angular != 0)))
    return scale * np.hypot(flat, z) ** degree * parts


def near_field(order: int) -> Complex:
    """Return the coefficient of x^-k in h_l(x) / h_0(x) i^-l at [k, l]: 1 far away."""
    # Time goes as exp(+i omega t), and h_l / h_0 is a polynomial in 1/x (Williams 1999, sec. 6.4).
    coefficients = np.zeros((order + 1, order + 1), np.complex128)
    for degree in range(order + 1):
        for power in range(degree + 1):
            ways = math.comb(degree + power, power) * math.perm(degree, power)
            coefficients[power, degree] = ways * (-0.5j) ** power
    return coefficients


# Bayesian regression of the waves' amplitudes, mode by mode: shares that the variance of the noise
# may have of the scale of the amplitudes, whose own variance falls with the degree.
NOISES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
_DEGREES, _ANGULAR = degrees(ORDER)
_FREE = 100.0  # for the monopole: what a single listener heard must not shrink
_VARIANCES = np.where(_DEGREES == 0, _FREE, 1 / (1.0 + _DEGREES * (_DEGREES + 1)))
_POWERS = np.arange(1.0, ORDER + 2)
_EXPLAINED = 0.75  # share of the energy that waves must explain for their phases to be believed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DistanceLaw:
    """How waves of each harmonic go with the distance: powers r^-(k+1) with coefficients."""

    coefficients: Complex  # (ORDER + 1, B, M or 1)

    @classmethod
    def same(cls, reference: float) -> DistanceLaw:
        """Keep directions at all distances: reference / r."""
        coefficients = np.zeros((ORDER + 1, len(_DEGREES), 1), np.complex128)
        coefficients[0] = reference
        return cls(coefficients=coefficients)

    @classmethod
    def waves(cls, reference: float, wave_numbers: Array) -> DistanceLaw:
        """Solve the wave equation; of absolute value 1 at the reference distance, m."""
        inverse = (1 / wave_numbers) ** np.arange(ORDER + 1)[:, None, None]
        coefficients = near_field(ORDER)[:, _DEGREES, None] * inverse
        size = np.abs(np.einsum("kbm,k->bm", coefficients, reference**-_POWERS))
        return cls(coefficients=coefficients / size)

    def at(self, distances: Array) -> Complex:
        """Return the waves at distances (Q,): (M or 1, Q, B)."""
        return np.einsum("qk,kbm->mqb", distances[:, None] ** -_POWERS, self.coefficients)


def fit_waves(
    laws: Sequence[DistanceLaw], places: Array, outputs: Complex, weights: Array, *, mirrored: bool
) -> Complex:
    """Return parts (ORDER + 1, B, M) of r^-(k+1) Y_lm, fitted to outputs at places."""
    # Law, highest degree and noise are averaged over by their evidence (Rasmussen & Williams,
    # Gaussian Processes for Machine Learning, MIT Press, 2006, chapters 2 and 5). There are never
    # more harmonics than listeners; outputs that are `mirrored` are even in y.
    distances = np.linalg.norm(places, axis=1)
    harmonics = real_harmonics(places / distances[:, None], ORDER)
    usable = (_ANGULAR >= 0) | (not mirrored)
    choices = [usable & (order >= _DEGREES) for order in range(ORDER + 1)]
    choices = [each for each in choices if np.count_nonzero(each) <= len(places)]
    problems = [_Problem.of(harmonics * law.at(distances), outputs, weights) for law in laws]
    cases = list(product(range(len(laws)), choices, NOISES))
    fits = [problems[number].solved(chosen, noise) for number, chosen, noise in cases]
    believed = shares(np.stack([evidence for evidence, _ in fits]))
    parts = np.zeros((ORDER + 1, len(_DEGREES), outputs.shape[1]), np.complex128)
    for share, (number, chosen, _), (_, found) in zip(believed, cases, fits, strict=True):
        parts[:, chosen] += laws[number].coefficients[:, chosen] * (share * found.T)
    return parts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Problem:
    """Normal equations of one law; its `count` (M,) positive weights have the mean 1."""

    matrices: Complex
    sides: Complex
    energies: Array
    count: Array

    @classmethod
    def of(cls, design: Complex, outputs: Complex, weights: Array) -> _Problem:
        count = np.maximum(np.count_nonzero(weights, axis=0), 1)
        even = (weights * count / np.maximum(weights.sum(axis=0), np.finfo(float).tiny)).T
        weighted = design.conj().transpose(0, 2, 1) * even[:, None]
        return cls(
            matrices=weighted @ design,
            sides=(weighted @ outputs.T[:, :, None])[:, :, 0],
            energies=(even * np.square(np.abs(outputs.T))).sum(axis=1),
            count=count,
        )

    def solved(self, chosen: Mask, noise: float) -> tuple[Array, Complex]:
        """Return evidence (M,) and amplitudes (M, B) of the chosen harmonics for one noise."""
        matrices = self.matrices[:, chosen][:, :, chosen] + noise * np.diag(1 / _VARIANCES[chosen])
        sides = self.sides[:, chosen]
        found = np.linalg.solve(matrices, sides[:, :, None])[:, :, 0]
        misfit = self.energies - (sides.conj() * found).real.sum(axis=1)
        spread = np.linalg.slogdet(matrices)[1] + np.log(_VARIANCES[chosen]).sum()
        unused = self.count - np.count_nonzero(chosen)
        tiny = np.finfo(np.float64).tiny
        evidence = -self.count * np.log(np.maximum(misfit, tiny) / noise)
        evidence -= spread + unused * np.log(noise)
        return evidence, np.asarray(found, np.complex128)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SphericalWaves:
    """Sound around a body, relative to the arrival: p = sum_k r^-(k+1) sum_lm parts_klm Y_lm."""

    parts: Complex  # (ORDER + 1, (ORDER + 1)^2, M)
    limit: float  # distance down to which the law is trusted, m; nearer, Y_lm goes as r^l Y_lm
    # (M,), modes with more lobes than listeners: levels alone, of one phase
    levelled: Mask

    @classmethod
    def of(
        cls,
        places: Array,
        outputs: Complex,
        weights: Array,
        wave_numbers: Array,
        *,
        radius: float = 0.0,
        mirrored: bool = False,
    ) -> SphericalWaves:
        """Fit outputs (Q, M) with weights (Q, M) at places (Q, 3) around a body of `radius` m."""
        # Waves, and sound with the same directions at all distances, are tried, trusted down to
        # `radius` or half the distance of the nearest listener. Where both explain less than 3/4
        # of the energy, what they make of phases would only cancel out: there levels are fitted.
        distances = np.linalg.norm(places, axis=1)
        reference = float(np.exp(np.log(distances).mean()))
        same, levels = DistanceLaw.same(reference), np.abs(outputs)
        laws = (same, DistanceLaw.waves(reference, wave_numbers))
        waves = cls(
            parts=fit_waves(laws, places, outputs, weights, mirrored=mirrored),
            limit=max(radius, float(distances.min()) / 2),
            levelled=np.zeros(outputs.shape[1], np.bool_),
        )
        missing = (weights * np.square(np.abs(waves.at(places) - outputs))).sum(axis=0)
        levelled = missing > (1 - _EXPLAINED) * (weights * levels**2).sum(axis=0)
        parts = fit_waves((same,), places, levels + 0j, weights, mirrored=mirrored)
        return replace(waves, parts=np.where(levelled, parts, waves.parts), levelled=levelled)

    def at(self, places: Array) -> Complex:
        """Return the pressure at places (L, 3) from the centre: (L, M)."""
        return np.einsum("lkb,kbm->lm", self._seen(places), self.parts)

    def turned(self, places: Array) -> Complex:
        """Return the pressure by angular order: (L, 2 ORDER + 1, M)."""
        # A contact at azimuth a is heard as the sum with the factors 1, cos a, sin a, cos 2 a ...
        seen = self._seen(places)
        sides = [0, *(side for order in range(1, ORDER + 1) for side in (order, -order))]
        heard = [
            np.einsum(
                "lkb,kbm->lm", seen[:, :, side == _ANGULAR], self.parts[:, abs(side) == _ANGULAR]
            )
            for side in sides
        ]
        return np.stack(heard, axis=1)

    def chosen(self, modes: Index, size: float, factor: complex | Complex) -> SphericalWaves:
        """Return some modes of a body `size` times as large, which rings as much lower."""
        powers = size ** _POWERS[:, None, None]
        return SphericalWaves(
            parts=np.ascontiguousarray(self.parts[:, :, modes] * powers * factor),
            limit=self.limit * size,
            levelled=self.levelled[modes],
        )

    def _seen(self, places: Array) -> Array:
        """Return r^-(k+1) Y_lm at places (L, ORDER + 1, B)."""
        distances = np.maximum(np.linalg.norm(places, axis=1), self.limit)[:, None]
        harmonics = real_harmonics(places / distances, ORDER)
        return distances[:, :, None] ** -_POWERS[:, None] * harmonics[:, None]
