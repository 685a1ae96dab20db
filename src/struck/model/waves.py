"""Sound around a body as a sum of outgoing spherical waves, fitted to measured listeners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from struck.model.arrays import Array, Complex, Index, Mask
from struck.model.survey import shares

ORDER, AXIAL = 4, 8  # the highest degree of waves fitted to recordings; of one angular order


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
    return np.sqrt(4 * np.pi * (1 + (angular != 0))) * np.hypot(flat, z) ** degree * parts


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
_BESIDE = 1e-2  # rad: nearer azimuths count as one
_FREE = 100.0  # for the monopole: a single listener's output must not shrink
_LEAST_PHASE = 1e-9  # rad: wave number times the reference distance
_EXPLAINED = 0.75  # share of the energy that waves must explain for their phases to be believed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DistanceLaw:
    """How waves of each harmonic go with the distance: powers r^-(k+1) with coefficients."""

    coefficients: Complex  # (K, B, M or 1) of K = highest degree + 1 powers and B = K^2 harmonics

    @classmethod
    def same(cls, reference: float, order: int = ORDER) -> DistanceLaw:
        """Keep directions at all distances: reference / r."""
        coefficients = np.zeros((order + 1, (order + 1) ** 2, 1), np.complex128)
        coefficients[0] = reference
        return cls(coefficients=coefficients)

    @classmethod
    def waves(cls, reference: float, wave_numbers: Array, order: int = ORDER) -> DistanceLaw:
        """Solve the wave equation; of absolute value 1 at the reference distance, m."""
        # Longer waves go with the distance as these, within rounding.
        finite_numbers = np.maximum(wave_numbers, _LEAST_PHASE / reference)
        inverse = (1 / finite_numbers) ** np.arange(order + 1)[:, None, None]
        coefficients = near_field(order)[:, degrees(order)[0], None] * inverse
        size = np.abs(np.einsum("kbm,k->bm", coefficients, reference ** -_powers(order + 1)))
        return cls(coefficients=coefficients / size)

    def at(self, distances: Array) -> Complex:
        """Return the waves at distances (Q,): (M or 1, Q, B)."""
        falling = distances[:, None] ** -_powers(len(self.coefficients))
        return np.einsum("qk,kbm->mqb", falling, self.coefficients)


def _powers(count: int) -> Array:
    return np.arange(1.0, count + 1)


def fit_waves(
    laws: Sequence[DistanceLaw],
    places: Array,
    outputs: Complex,
    weights: Array,
    *,
    mirrored: bool,
    sizes: Array | None = None,
) -> tuple[Complex, Array]:
    """Return parts (K, B, M) of r^-(k+1) Y_lm, fitted to outputs at places, and their error.

    The error (M,) is that of listeners predicted from all others, over the recorded, by energy;
    infinite where the places cannot resolve an angular order, or the number of degrees that a body
    of these sizes (M,), wave number times radius, radiates.
    """
    # Law, highest degree and noise are averaged over by their evidence (Rasmussen & Williams,
    # Gaussian Processes for Machine Learning, MIT Press, 2006, chapters 2 and 5).
    distances = np.linalg.norm(places, axis=1)
    order = len(laws[0].coefficients) - 1
    harmonics = real_harmonics(places / distances[:, None], order)
    choices = _choices(order, places, mirrored=mirrored)
    problems = [_Problem.of(harmonics * law.at(distances), outputs, weights) for law in laws]
    cases = list(product(range(len(laws)), choices, NOISES))
    fits = [problems[number].solved(chosen, noise) for number, (chosen, _), noise in cases]
    evidence = np.stack([values for values, _ in fits])
    posterior = shares(evidence)
    degree = degrees(order)[0]
    parts = np.zeros((order + 1, len(degree), outputs.shape[1]), np.complex128)
    for probabilities, (number, (chosen, _), _), (_, amplitudes) in zip(
        posterior, cases, fits, strict=True
    ):
        if probabilities.any():
            parts[:, chosen] += laws[number].coefficients[:, chosen] * (
                probabilities * amplitudes.T
            )
    highest_degree = max(ORDER, int(degree[parts.any(axis=(0, 2))].max(initial=0)))
    errors = np.zeros(outputs.shape[1])
    best_cases = posterior.argmax(axis=0)
    for case in np.unique(best_cases):
        number, (chosen, _), noise = cases[case]
        modes = np.flatnonzero(best_cases == case)
        errors[modes] = problems[number].left_out_errors(modes, chosen, noise, fits[case][1])
    turns = np.array([turns for _, (_, turns), _ in cases])
    errors[_find_ambiguous(evidence, turns, best_cases, _polar_angles(places), sizes)] = np.inf
    return parts[: highest_degree + 1, : (highest_degree + 1) ** 2], errors


_ANY = -1  # instead of an angular order
_SURE = 20.0  # by which the evidence for an order exceeds that for any other
_POLAR = 0.05  # rad: nearer polar angles count as one


def _choices(order: int, places: Array, *, mirrored: bool) -> list[tuple[Mask, int]]:
    """Return sets of harmonics, never more than places, each with its angular order or `_ANY`.

    Outputs that are `mirrored` are even in y, and as a rule of one angular order, as modes of a
    body round about the z axis are; places at one azimuth cannot distinguish orders.
    """
    degree, angular = degrees(order)
    highest_order = order if azimuths_of(places) > 1 else 0
    sides = (angular >= 0) & (angular <= highest_order) | (not mirrored)
    choices = [(sides & (degree <= highest), _ANY) for highest in range(ORDER + 1)]
    for turns in range(highest_order + 1) if mirrored else ():
        highest = range(max(turns, 1), order + 1)
        choices += [((angular == turns) & (degree <= most), turns) for most in highest]
    return [item for item in choices if np.count_nonzero(item[0]) <= len(places)]


def _find_ambiguous(
    evidence: Array, turns: Index, best: Index, angles: int, sizes: Array | None
) -> Mask:
    """Return the modes (M,) whose angular order the listeners' places leave open.

    Only orders that a body of these sizes (M,) radiates count. Named are also modes whose degrees,
    from the order up to the size, outnumber polar angles.
    """
    orders = turns[best]
    sizes = np.full(len(orders), np.nan) if sizes is None else sizes
    rivals = (turns[:, None] != orders) & (turns[:, None] != _ANY) & ~(turns[:, None] > sizes)
    is_ambiguous = evidence.max(axis=0) - np.where(rivals, evidence, -np.inf).max(axis=0) < _SURE
    return (orders != _ANY) & (is_ambiguous | (np.floor(sizes) - orders + 1 > angles))


def _polar_angles(places: Array) -> int:
    """Return how many polar angles places (Q, 3) have."""
    angles = np.sort(np.arccos(places[:, 2] / np.linalg.norm(places, axis=1)))
    return 1 + int(np.count_nonzero(np.diff(angles) > _POLAR))


def azimuths_of(places: Array) -> int:
    """Return at how many azimuths off the axis, left as right, places (Q, 3) are; at least 1."""
    off_axis = np.hypot(places[:, 0], places[:, 1]) > _BESIDE * np.linalg.norm(places, axis=1)
    angles = np.arctan2(np.abs(places[off_axis, 1]), places[off_axis, 0])
    return max(1, len(np.unique(np.round(angles / _BESIDE))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Problem:
    """Normal equations of one law; its `count` (M,) positive weights have the mean 1."""

    design: Complex  # (M or 1, Q, B)
    outputs: Complex  # (Q, M)
    weights: Array  # (M, Q)
    variances: Array  # (B,)
    matrices: Complex
    sides: Complex
    energies: Array
    count: Array

    @classmethod
    def of(cls, design: Complex, outputs: Complex, weights: Array) -> _Problem:
        count = np.maximum(np.count_nonzero(weights, axis=0), 1)
        even_weights = (weights * count / np.maximum(weights.sum(axis=0), np.finfo(float).tiny)).T
        weighted = design.conj().transpose(0, 2, 1) * even_weights[:, None]
        degree = degrees(math.isqrt(design.shape[2]) - 1)[0]
        return cls(
            design=design,
            outputs=outputs,
            weights=even_weights,
            variances=np.where(degree == 0, _FREE, 1 / (1.0 + degree * (degree + 1))),
            matrices=weighted @ design,
            sides=(weighted @ outputs.T[:, :, None])[:, :, 0],
            energies=(even_weights * np.square(np.abs(outputs.T))).sum(axis=1),
            count=count,
        )

    def solved(self, chosen: Mask, noise: float) -> tuple[Array, Complex]:
        """Return evidence (M,) and amplitudes (M, B) of the chosen harmonics for one noise."""
        matrices = self._damped(chosen, noise)
        sides = self.sides[:, chosen]
        amplitudes = np.linalg.solve(matrices, sides[:, :, None])[:, :, 0]
        misfit = self.energies - (sides.conj() * amplitudes).real.sum(axis=1)
        spread = np.linalg.slogdet(matrices)[1] + np.log(self.variances[chosen]).sum()
        unused_count = self.count - np.count_nonzero(chosen)
        tiny = np.finfo(np.float64).tiny
        evidence = -self.count * np.log(np.maximum(misfit, tiny) / noise)
        evidence -= spread + unused_count * np.log(noise)
        return evidence, np.asarray(amplitudes, np.complex128)

    def left_out_errors(
        self, modes: Index, chosen: Mask, noise: float, amplitudes: Complex
    ) -> Array:
        """Return each mode's error when each listener is predicted by the others, by energy."""
        design = self.design[modes if len(self.design) > 1 else [0]][:, :, chosen]
        outputs, weights = self.outputs.T[modes], self.weights[modes]
        inverses = np.linalg.inv(self._damped(chosen, noise)[modes])
        leverages = weights * np.einsum("mqb,mbc,mqc->mq", design, inverses, design.conj()).real
        residuals = outputs - (design @ amplitudes[modes][:, :, None])[:, :, 0]
        squared_errors = weights * np.square(np.abs(residuals) / np.maximum(1 - leverages, 1e-6))
        energies = (weights * np.square(np.abs(outputs))).sum(axis=1)
        return squared_errors.sum(axis=1) / np.maximum(energies, np.finfo(float).tiny)

    def _damped(self, chosen: Mask, noise: float) -> Complex:
        matrices = self.matrices[:, chosen][:, :, chosen]
        return np.asarray(matrices + noise * np.diag(1 / self.variances[chosen]), np.complex128)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SphericalWaves:
    """Sound around a body, relative to the arrival: p = sum_k r^-(k+1) sum_lm parts_klm Y_lm."""

    parts: Complex  # (K, K^2, M)
    limit: float  # distance down to which the law is trusted, m; nearer, Y_lm goes as r^l Y_lm
    # (M,), modes with more lobes than listeners: levels alone, of one phase
    levelled: Mask
    # (M,): error of listeners predicted from all others, by energy, over that recorded; in fields
    # None
    errors: Array | None = None

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
        order = AXIAL if mirrored else ORDER
        same, levels = DistanceLaw.same(reference, order), np.abs(outputs)
        laws = (same, DistanceLaw.waves(reference, wave_numbers, order))
        sizes = wave_numbers * radius if radius else None
        parts, errors = fit_waves(laws, places, outputs, weights, mirrored=mirrored, sizes=sizes)
        waves = cls(
            parts=parts,
            errors=errors,
            limit=max(radius, float(distances.min()) / 2),
            levelled=np.zeros(outputs.shape[1], np.bool_),
        )
        missing = (weights * np.square(np.abs(waves.at(places) - outputs))).sum(axis=0)
        levelled = missing > (1 - _EXPLAINED) * (weights * levels**2).sum(axis=0)
        parts, others = fit_waves((same,), places, levels + 0j, weights, mirrored=mirrored)
        return replace(
            waves,
            parts=np.where(levelled, *_of_one_size(parts, waves.parts)),
            levelled=levelled,
            errors=np.where(levelled, np.maximum(errors, others), errors),
        )

    def at(self, places: Array) -> Complex:
        """Return the pressure at places (L, 3) from the centre: (L, M)."""
        return np.einsum("lkb,kbm->lm", self._outgoing(places), self.parts)

    def turned(self, places: Array) -> Complex:
        """Return the pressure by angular order: (L, 2 ORDER + 1, M)."""
        # A contact at azimuth a has the pressure with the factors 1, cos a, sin a, cos 2 a ...
        functions = self._outgoing(places)
        highest = len(self.parts) - 1
        angular = degrees(highest)[1]
        sides = [0, *(side for order in range(1, highest + 1) for side in (order, -order))]
        pressures = [
            np.einsum(
                "lkb,kbm->lm", functions[:, :, side == angular], self.parts[:, abs(side) == angular]
            )
            for side in sides
        ]
        return np.stack(pressures, axis=1)

    def chosen(self, modes: Index, size: float, factor: complex | Complex) -> SphericalWaves:
        """Return some modes of a body `size` times as large, which rings as much lower."""
        powers = size ** _powers(len(self.parts))[:, None, None]
        return SphericalWaves(
            parts=np.ascontiguousarray(self.parts[:, :, modes] * powers * factor),
            limit=self.limit * size,
            levelled=self.levelled[modes],
        )

    def _outgoing(self, places: Array) -> Array:
        """Return r^-(k+1) Y_lm at places (L, K, B)."""
        count = len(self.parts)
        distances = np.maximum(np.linalg.norm(places, axis=1), self.limit)[:, None]
        harmonics = real_harmonics(places / distances, count - 1)
        return distances[:, :, None] ** -_powers(count)[:, None] * harmonics[:, None]


def _of_one_size(*parts: Complex) -> list[Complex]:
    """Return parts with as many powers and harmonics as the largest."""
    most = max(len(part) for part in parts)
    padding = [most - len(part) for part in parts]
    pads = [((0, more), (0, most**2 - (most - more) ** 2), (0, 0)) for more in padding]
    return [np.pad(part, pad) for part, pad in zip(parts, pads, strict=True)]
