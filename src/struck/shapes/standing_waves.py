"""Standing waves of a uniform beam: the four motions it can have at one frequency.

Lengths are shares of the beam's; frequencies omega stand as omega^2 = squared^2 E I / (rho A L^4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[[Array, Array], Array]

# Below this (b h)^2 differences of like terms lose digits, and a series takes over.
_SLOW = 1e-2
_TINY = 1e-200


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """A uniform beam of unit length.

    Parameters
    ----------
    rotary : float
        I / (A L^2): turning sections are heavy. 0 in the theory of Euler and Bernoulli.
    shear : float
        E I / (kappa G A L^2): sections slip. 0 in the theory of Euler and Bernoulli.
    """

    rotary: float
    shear: float

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


class Values(NamedTuple):
    """The four waves at a distance from their origin: first and second, even and odd."""

    cosine: Array
    level: Array
    sine: Array
    rising: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """Waves at M frequencies (Timoshenko 1921; Huang 1961).

    Even and odd ones about an origin are cos(a u) and cosh(b u), sin(a u) and sinh(b u). The
    second wave number b is imaginary beyond the critical frequency, where that wave stops decaying.

    Parameters
    ----------
    beam : Beam
    squared : array (M,)
        Squared frequencies, above 0.
    span : float
        How far u reaches.
    first : array (M,)
        Wave number a.
    second : array (M,)
        Signed square b^2 of the second wave number, below 0 where that wave travels.
    ratio : array (M,)
        Quotient b^2 / a^2.
    turnings : pair of arrays (M,)
        Turning of sections over slope, of the first wave and (times b^2 / a^2) the second.
    """

    beam: Beam
    squared: Array
    span: float
    first: Array
    second: Array
    ratio: Array
    turnings: tuple[Array, Array]

    @classmethod
    def at(cls, beam: Beam, squared: Array, span: float) -> Waves:
        """Find the waves of a beam at squared frequencies."""
        half = squared * (beam.shear - beam.rotary) / 2
        root = np.hypot(half, np.sqrt(squared))
        wave = squared * (beam.shear + beam.rotary) / 2 + root
        second = squared * (1 - squared * beam.rotary * beam.shear) / wave
        # Of two turnings whose product is known, the smaller one follows from the larger one.
        larger = (np.abs(half) + root) / wave
        smaller = squared / (larger * wave**2)
        slips = beam.shear >= beam.rotary
        return cls(
            beam=beam,
            squared=squared,
            span=span,
            first=np.sqrt(wave),
            second=second,
            ratio=second / wave,
            turnings=(smaller, larger) if slips else (larger, smaller),
        )

    def at_end(self) -> Values:
        """Return the waves at u = span, the last one times a."""
        phase = self.first * self.span
        return Values(
            np.cos(phase),
            level(self.second, self.span, np.array(self.span)),
            np.sin(phase),
            self.first * rising(self.second, self.span, np.array(self.span)),
        )

    def products(self) -> tuple[Array, Array]:
        """Return the mean products (M, 2, 2) of the even waves, and of the odd ones."""
        cosine, high, sine, rise = self.at_end()
        phase = self.first * self.span
        swing, growth = cosine * sine / phase, high * rise / phase
        middle = level(self.second, self.span, np.zeros(1)) ** 2
        mixed = phase * (1 + self.ratio)
        even = _symmetric(
            (1 + swing) / 2,
            (sine * high + self.ratio * cosine * rise) / mixed,
            (middle + growth) / 2,
        )
        odd = _symmetric(
            (1 - swing) / 2,
            (sine * high - cosine * rise) / mixed,
            self._mean_square_of_rise(middle, growth),
        )
        return even, odd

    def _mean_square_of_rise(self, middle: Array, growth: Array) -> Array:
        argument = self.second * self.span**2
        slow = np.abs(argument) < _SLOW
        series = 1 / 3 + argument * (1 / 15 + argument * (2 / 315 + argument / 2835))
        return np.where(
            slow,
            (self.first * self.span) ** 2 * middle * series,
            (growth - middle) / (2 * np.where(slow, 1.0, self.ratio)),
        )


def level(second: Array, span: float, u: Array) -> Array:
    """Return cosh(b u) / cosh(b span), or cos(|b| u) where b^2 = `second` lies below 0."""
    return _either(
        second, u, lambda b, at: _decaying_level(b, span, at), lambda b, at: np.cos(b * at)
    )


def rising(second: Array, span: float, u: Array) -> Array:
    """Return sinh(b u) / (b cosh(b span)), or sin(|b| u) / |b| where b^2 lies below 0."""
    return _either(
        second, u, lambda b, at: _decaying_rise(b, span, at), lambda b, at: np.sin(b * at) / b
    )


def _either(second: Array, u: Array, decaying: Function, travelling: Function) -> Array:
    """Return one function of |b| and u where the second wave decays, the other where not."""
    b = np.sqrt(np.maximum(np.abs(second), _TINY))
    values = np.empty(np.broadcast_shapes(second.shape, u.shape))
    for which, function in ((second >= 0, decaying), (second < 0, travelling)):
        values[..., which] = function(b[which], u)
    return values


def _decaying_level(b: Array, span: float, u: Array) -> Array:
    far = np.abs(u)
    return np.exp(b * (far - span)) * (1 + np.exp(-2 * b * far)) / (1 + np.exp(-2 * b * span))


def _decaying_rise(b: Array, span: float, u: Array) -> Array:
    far = np.abs(u)
    rise = -np.expm1(-2 * b * far) / (b * (1 + np.exp(-2 * b * span)))
    return np.sign(u) * np.exp(b * (far - span)) * rise


def _symmetric(first: Array, mixed: Array, second: Array) -> Array:
    rows = [np.stack([first, mixed], axis=-1), np.stack([mixed, second], axis=-1)]
    return np.stack(rows, axis=-2)
