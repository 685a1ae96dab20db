"""Bending modes of a uniform beam by its ends: all up to a bound, none missed or doubled.

A hinged or sliding end is a mirror: motions are odd or even about it, and what remains are the two
conditions at the other end. A beam with equal ends has its mirror in the middle. Lengths are shares
of the beam's; frequencies omega stand as omega^2 = squared^2 E I / (rho A L^4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Index

Function = Callable[[Array, Array], Array]

# Below this (b h)^2 differences of like terms lose digits, and a series takes over.
_SERIES_BOUNDARY = 1e-2
_TINY = 1e-200


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """Uniform beam of unit length (Timoshenko; both numbers are 0 for Euler and Bernoulli)."""

    rotary: float  # I / (A L^2), the inertia of turning sections
    shear: float  # E I / (kappa G A L^2), the compliance in shear

    def first(self, wave: Array) -> Array:
        """Return the squared frequencies of bending waves with wave numbers `wave`."""
        linear, root = self._dispersion(wave)
        return 2 * wave**4 / (linear + root)

    def second(self, wave: Array) -> Array:
        """Return the squared frequencies of waves of shear with wave numbers `wave`."""
        linear, root = self._dispersion(wave)
        return (linear + root) / (2 * self.rotary * self.shear)

    def _dispersion(self, wave: Array) -> tuple[Array, Array]:
        """Return linear and root: rotary shear squared^2 - linear squared + wave^4 = 0."""
        linear = 1 + (self.rotary + self.shear) * wave**2
        # The discriminant as a sum, so that no digits are lost.
        slant = 1 + (self.rotary - self.shear) * wave**2
        return linear, np.sqrt(slant**2 + 4 * self.shear * wave**2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandingWaves:
    """Standing waves of a uniform beam at M frequencies (Timoshenko 1921; Huang 1961).

    Even and odd ones about an origin are cos(a u) and cosh(b u), sin(a u) and sinh(b u). The second
    wave number b is imaginary beyond the critical frequency, where that wave stops decaying.
    """

    beam: Beam
    squared: Array  # (M,), squared frequencies, above 0, in E I / (rho A L^4)
    span: float  # largest u
    first: Array  # (M,), wave number a
    second: Array  # (M,), b^2, below 0 where that wave travels
    ratio: Array  # (M,), b^2 / a^2
    # (M,) each: turning of sections over slope, of the first wave and (times b^2 / a^2) the second
    turnings: tuple[Array, Array]

    @classmethod
    def at(cls, beam: Beam, squared: Array, span: float) -> StandingWaves:
        """Find the waves of a beam at squared frequencies."""
        half = squared * (beam.shear - beam.rotary) / 2
        root = np.hypot(half, np.sqrt(squared))
        wave = squared * (beam.shear + beam.rotary) / 2 + root
        second = squared * (1 - squared * beam.rotary * beam.shear) / wave
        # The product of both turnings is known, so the smaller one follows from the larger one.
        large_turning = (np.abs(half) + root) / wave
        small_turning = squared / (large_turning * wave**2)
        is_soft_in_shear = beam.shear >= beam.rotary
        return cls(
            beam=beam,
            squared=squared,
            span=span,
            first=np.sqrt(wave),
            second=second,
            ratio=second / wave,
            turnings=(small_turning, large_turning)
            if is_soft_in_shear
            else (large_turning, small_turning),
        )

    def at_end(self) -> tuple[Array, Array, Array, Array]:
        """Return the waves at u = span: first and second, even and odd, the last one times a."""
        phase = self.first * self.span
        high, rise = (wave(self.second, self.span, np.array(self.span)) for wave in (level, rising))
        return np.cos(phase), high, np.sin(phase), self.first * rise

    def products(self) -> tuple[Array, Array]:
        """Return mean products (M, 2, 2) of the even waves, and of the odd ones."""
        cosine, high, sine, rise = self.at_end()
        phase = self.first * self.span
        swing, growth = cosine * sine / phase, high * rise / phase
        origin_square = level(self.second, self.span, np.zeros(1)) ** 2
        mixed = phase * (1 + self.ratio)
        even = _stack_symmetric(
            (1 + swing) / 2,
            (sine * high + self.ratio * cosine * rise) / mixed,
            (origin_square + growth) / 2,
        )
        odd = _stack_symmetric(
            (1 - swing) / 2,
            (sine * high - cosine * rise) / mixed,
            self._mean_square_of_rise(origin_square, growth),
        )
        return even, odd

    def _mean_square_of_rise(self, origin_square: Array, growth: Array) -> Array:
        argument = self.second * self.span**2
        is_slow = np.abs(argument) < _SERIES_BOUNDARY
        series = 1 / 3 + argument * (1 / 15 + argument * (2 / 315 + argument / 2835))
        return np.where(
            is_slow,
            (self.first * self.span) ** 2 * origin_square * series,
            (growth - origin_square) / (2 * np.where(is_slow, 1.0, self.ratio)),
        )


def level(second: Array, span: float, u: Array) -> Array:
    """Return cosh(b u) / cosh(b span), or cos(|b| u) where b^2 = `second` lies below 0."""
    return _evaluate_waves(
        second, u, lambda b, at: _decaying_level(b, span, at), lambda b, at: np.cos(b * at)
    )


def rising(second: Array, span: float, u: Array) -> Array:
    """Return sinh(b u) / (b cosh(b span)), or sin(|b| u) / |b| where b^2 lies below 0."""
    return _evaluate_waves(
        second, u, lambda b, at: _decaying_rise(b, span, at), lambda b, at: np.sin(b * at) / b
    )


def _evaluate_waves(second: Array, u: Array, decaying: Function, travelling: Function) -> Array:
    """Return one function of |b| and u where the second wave decays, the other where not."""
    b = np.sqrt(np.maximum(np.abs(second), _TINY))
    values = np.empty(np.broadcast_shapes(second.shape, u.shape))
    for is_chosen, function in ((second >= 0, decaying), (second < 0, travelling)):
        values[..., is_chosen] = function(b[is_chosen], u)
    return values


def _decaying_level(b: Array, span: float, u: Array) -> Array:
    distances = np.abs(u)
    return (
        np.exp(b * (distances - span))
        * (1 + np.exp(-2 * b * distances))
        / (1 + np.exp(-2 * b * span))
    )


def _decaying_rise(b: Array, span: float, u: Array) -> Array:
    distances = np.abs(u)
    rise = -np.expm1(-2 * b * distances) / (b * (1 + np.exp(-2 * b * span)))
    return np.sign(u) * np.exp(b * (distances - span)) * rise


def _stack_symmetric(first: Array, mixed: Array, second: Array) -> Array:
    rows = [np.stack([first, mixed], axis=-1), np.stack([mixed, second], axis=-1)]
    return np.stack(rows, axis=-2)


ENDS = ("free", "clamped", "hinged", "sliding")
_MIRRORS = {"sliding": "even", "hinged": "odd"}
_COLUMNS = {"even": slice(0, 2), "odd": slice(2, 4), "both": slice(0, 4)}
# Signs by which the even and odd waves at one end differ from those at the other.
REFLECTION = np.array([1.0, 1.0, -1.0, -1.0])
# No beam at least as long as its radius of gyration has an elastic mode whose first wave turns by
# less from the origin to the end.
_MIN_PHASE = 0.01
# Until the square root of a frequency is known to its last digit, for up to a thousand modes.
_HALVINGS = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Motions of one symmetry about an origin, with conditions at an end of the beam."""

    # "even" or "odd"; "both" between a free and a clamped end, where there is no symmetry
    kind: str
    end: str  # one of ENDS
    span: float  # from the origin to the end, in lengths of the beam

    def frequencies(self, beam: Beam, max_eigenvalue: float) -> tuple[Array, Array]:
        """Return squared frequencies (M,) up to a maximum, unsorted, and wave amplitudes (M, 4)."""
        if self.end in _MIRRORS:
            return self._find_between_mirrors(beam, max_eigenvalue)
        eigenvalues = self._find_by_count(beam, max_eigenvalue)
        waves = StandingWaves.at(beam, eigenvalues, self.span)
        amplitudes = np.zeros((len(eigenvalues), 4))
        # What the conditions let through: the direction that they map to nothing.
        amplitudes[:, _COLUMNS[self.kind]] = np.linalg.svd(self._conditions(waves))[2][:, -1]
        return eigenvalues, amplitudes

    def _find_between_mirrors(self, beam: Beam, max_eigenvalue: float) -> tuple[Array, Array]:
        """Return modes of one wave alone: whole numbers of quarter waves fit between mirrors."""
        limit_waves = StandingWaves.at(beam, np.array([max_eigenvalue]), self.span)
        shift = 0.5 if (self.end == "hinged") == (self.kind == "even") else 0.0
        bending_eigenvalues = beam.first(self._fitting(limit_waves.first, shift))
        shear_eigenvalues = np.empty(0)
        if limit_waves.second < 0:
            shear_eigenvalues = beam.second(self._fitting(np.sqrt(-limit_waves.second), shift))
            if self.end == "hinged" and self.kind == "odd":
                # Sections turn to and fro all along while the bar stays straight.
                shear_eigenvalues = np.append(shear_eigenvalues, beam.second(np.zeros(1)))
        amplitudes = np.zeros((len(bending_eigenvalues) + len(shear_eigenvalues), 4))
        column = _COLUMNS[self.kind].start
        amplitudes[: len(bending_eigenvalues), column] = amplitudes[
            len(bending_eigenvalues) :, column + 1
        ] = 1.0
        eigenvalues = np.concatenate([bending_eigenvalues, shear_eigenvalues])
        return eigenvalues[eigenvalues <= max_eigenvalue], amplitudes[eigenvalues <= max_eigenvalue]

    def _fitting(self, max_wave_numbers: Array, shift: float) -> Array:
        """Return the wave numbers up to the largest (and one more) that fit."""
        _require_few(float(max_wave_numbers[0] * self.span / np.pi))
        count = int(max_wave_numbers[0] * self.span / np.pi) + 1
        return (np.arange(1.0, count + 1) - shift) * (np.pi / self.span)

    def _find_by_count(self, beam: Beam, max_eigenvalue: float) -> Array:
        """Return squared frequencies by halving intervals until each holds one root."""

        def count(root: Array) -> Index:
            return self.count(StandingWaves.at(beam, root**4, self.span))

        low = beam.first(np.array([_MIN_PHASE / self.span])) ** 0.25
        high = np.array([max_eigenvalue**0.25])
        if high <= low:
            return np.empty(0)
        _require_few(float(count(high)[0]))
        return _bisect(count, np.arange(count(low)[0], count(high)[0]) + 1, low, high) ** 4

    def count(self, waves: StandingWaves) -> Index:
        """Return the number of natural frequencies below each wave's, rigid motions included.

        With the end hinged the count is known. To free the end, or to clamp it, moves each
        frequency at most to its neighbour, and the characteristic determinant changes its sign at
        each frequency, which decides between two neighbouring counts (Wittrick and Williams 1971,
        one member).
        """
        if self.kind == "both":
            hinged_family = Family(kind="odd", end="clamped", span=2 * self.span)
            full_waves = StandingWaves.at(waves.beam, waves.squared, 2 * self.span)
            min_counts, step = hinged_family.count(full_waves), 1
        else:
            min_counts, step = self._count_hinged(waves), 1 if self.end == "free" else -1
        determinant = np.linalg.det(self._conditions(waves))
        has_positive_start = self.end == "clamped" and self.kind != "both"
        return min_counts + step * (
            (min_counts % 2 == 0) != ((determinant > 0) == has_positive_start)
        )

    def _count_hinged(self, waves: StandingWaves) -> Index:
        """Return how many frequencies lie below with the end hinged."""
        phase = waves.first * self.span / np.pi
        is_travelling = waves.second < 0
        second_phase = np.sqrt(np.abs(waves.second)) * self.span / np.pi
        if self.kind == "even":
            counts = np.floor(phase + 0.5) + is_travelling * np.floor(second_phase + 0.5)
        else:
            counts = np.floor(phase) + is_travelling * (np.floor(second_phase) + 1)
        return counts.astype(np.int64)

    def _conditions(self, waves: StandingWaves) -> Array:
        """Return matrices (M, n, n) with zero determinant at natural frequencies, n = 2 or 4."""
        rows = _at(self.end, waves)
        if self.kind == "both":
            other_end = "free" if self.end == "clamped" else "clamped"
            rows = np.concatenate([_at(other_end, waves) * REFLECTION, rows], axis=1)
        return rows[:, :, _COLUMNS[self.kind]]


def families(ends: tuple[str, str]) -> tuple[float, list[Family]]:
    """Return the origin, in lengths from x = 0, and the families of motions of a beam."""
    start, end = ends
    if start in _MIRRORS:
        return 0.0, [Family(kind=_MIRRORS[start], end=end, span=1.0)]
    if end in _MIRRORS:
        return 1.0, [Family(kind=_MIRRORS[end], end=start, span=1.0)]
    kinds = ("even", "odd") if start == end else ("both",)
    return 0.5, [Family(kind=kind, end=end, span=0.5) for kind in kinds]


def _at(end: str, waves: StandingWaves) -> Array:
    """Return the two quantities (M, 2, 4) that vanish at an end, of each wave, of order 1.

    Deflection and turning at a clamp; moment and shear force at a free end.
    """
    cosine, high, sine, rise = waves.at_end()
    first, second = waves.turnings
    if end == "clamped":
        rows = [
            [cosine, high, sine, waves.ratio * rise],
            [-first * sine, second * rise, first * cosine, second * high],
        ]
    else:
        rows = [
            [-first * cosine, second * high, -first * sine, second * waves.ratio * rise],
            [-sine, -rise, cosine, -high],
        ]
    return np.moveaxis(np.array(rows), -1, 0)


def _bisect(count: Callable[[Array], Index], numbers: Index, low: Array, high: Array) -> Array:
    """Return the values at which a count first reaches each of `numbers`, by bisection."""
    lows, highs = np.full(len(numbers), low[0]), np.full(len(numbers), high[0])
    for _ in range(_HALVINGS):
        midpoints = (lows + highs) / 2
        reached = count(midpoints) >= numbers
        lows, highs = np.where(reached, lows, midpoints), np.where(reached, midpoints, highs)
    return (lows + highs) / 2


def _require_few(count: float) -> None:
    """Refuse beams with more modes of one kind than any model takes, before they are computed."""
    if not count <= _MAX_MODES_OF_A_KIND:
        raise OptionError(
            f"the bar has about {rounded(count, 2)} modes of one kind in the band, and at most "
            f"{_MAX_MODES_OF_A_KIND} are computed: check its lengths (m) and Young's modulus (Pa; "
            "200 GPa is 200e9), or end the band lower"
        )


_MAX_MODES_OF_A_KIND = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BendingForms:
    """Deflections along a bar: two standing waves each, even and odd about an origin."""

    length: float  # m
    origin: float  # of u, in lengths
    span: float  # largest u, in lengths
    first: Array  # (M,), wave numbers a of cos(a u) and sin(a u), in 1 / length
    second: Array  # (M,), b^2 of cosh(b u) and sinh(b u), below 0 where that wave travels
    # (M, 4), of cos(a u), cosh(b u) / cosh(b span), sin(a u), sinh(b u) / (b cosh(b span))
    amplitudes: Array
    dimensions = 1  # coordinates of a place: x

    def values(self, places: Array) -> Array:
        """Return the deflections at x in m (K, 1): (K, M)."""
        u = np.clip(np.asarray(places)[:, :1] / self.length, 0.0, 1.0) - self.origin
        functions = (
            lambda modes: np.cos(u * self.first[modes]),
            lambda modes: level(self.second[modes], self.span, u),
            lambda modes: np.sin(u * self.first[modes]),
            lambda modes: rising(self.second[modes], self.span, u),
        )
        values = np.zeros((len(u), len(self.first)))
        for amplitudes, function in zip(self.amplitudes.T, functions, strict=True):
            # Even and odd modes need half of the functions each.
            modes = np.flatnonzero(amplitudes)
            values[:, modes] += amplitudes[modes] * function(modes)
        return values

    def chosen(self, modes: Index) -> Self:
        """Return the deflections of some modes, in that order."""
        return replace(
            self,
            first=self.first[modes],
            second=self.second[modes],
            amplitudes=self.amplitudes[modes],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bending:
    """Bending modes of a beam."""

    squared: Array  # (M,), squared frequencies, ascending, in E I / (rho A L^4)
    forms: BendingForms  # normalised to the kinetic energy of a rigid motion by 1, turning included
    shear_shares: Array  # (M,), potential energy of shear over all potential energy


def bending(beam: Beam, ends: tuple[str, str], max_eigenvalue: float, length: float) -> Bending:
    """Return all elastic modes up to the squared frequency `max_eigenvalue`, E I / (rho A L^4)."""
    origin, kinds = families(ends)
    family_modes = [family.frequencies(beam, max_eigenvalue) for family in kinds]
    eigenvalues = np.concatenate([one for one, _ in family_modes])
    order = np.argsort(eigenvalues, kind="stable")
    waves = StandingWaves.at(beam, eigenvalues[order], kinds[0].span)
    amplitudes = np.concatenate([one for _, one in family_modes])[order]
    amplitudes, shear_ratios = _normalise(waves, amplitudes)
    forms = BendingForms(
        length=length,
        origin=origin,
        span=waves.span,
        first=waves.first,
        second=waves.second,
        amplitudes=_deflections(waves, amplitudes),
    )
    return Bending(squared=waves.squared, forms=forms, shear_shares=shear_ratios)


def _normalise(waves: StandingWaves, amplitudes: Array) -> tuple[Array, Array]:
    """Return amplitudes of modes with unit kinetic energy, and their fractions of shear energy."""
    even, odd = amplitudes[:, :2], amplitudes[:, 2:]
    first, second = (part[:, None] for part in waves.turnings)
    one, ratio = np.ones_like(first), waves.ratio[:, None]
    even_products, odd_products = waves.products()

    def mean_square(even_part: Array, odd_part: Array) -> Array:
        return _sum_products(even_products, even_part) + _sum_products(odd_products, odd_part)

    deflection = mean_square(even, odd * np.hstack([one, ratio]))
    turning = mean_square(odd * np.hstack([first, second]), even * np.hstack([-first, second]))
    force = mean_square(odd * np.hstack([one, -one]), even)
    beam, wave = waves.beam, waves.first**2
    energy = deflection + beam.rotary * wave * turning
    shear_ratios = beam.shear * waves.squared / wave * force / energy
    return amplitudes / np.sqrt(energy)[:, None], shear_ratios


def _sum_products(products: Array, amplitudes: Array) -> Array:
    return np.einsum("mi,mij,mj->m", amplitudes, products, amplitudes)


def _deflections(waves: StandingWaves, amplitudes: Array) -> Array:
    """Return amplitudes of cos(a u), cosh(b u), sin(a u) and sinh(b u) / b."""
    scales = np.ones_like(amplitudes)
    scales[:, 3] = waves.ratio * waves.first
    return amplitudes * scales
