"""Recoil: the sound of a free body that a push sets moving as a whole (acceleration noise).

A hit does two things to a body: its modes ring, and all of it is accelerated. The second moves air
to and fro as well and is over within the time that sound takes across the body: the click of dice,
of marbles, of a key that falls, whose modes are inaudible (Chadwick, Zheng & James 2012).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Complex, require_numbers

_SQUARE = 1e-6  # how far the axes may be from orthonormal
DAMPINGS = (0.4, 0.99)  # the least and the greatest damping ratio
_FASTEST = 3.0  # corner over sample rate, rad: faster poles lie there, and zeros compensate them
_LOWEST_CORNER = 1e-9  # Hz: of a body wider than any; squares of its ratio to others are finite
_MATCHED = np.pi / 2  # rad a sample, where the sampled response is right
_OVER = np.log(1e7)  # it lasts till it has fallen by 140 dB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recoil:
    """One damped mode of recoil for each of three axes of a free body.

    A force F along an axis gives, at 1 m, the pressure

        p(s) = level s F(s) / (1 + 2 damping s / w + (s / w)^2),   w = 2 pi corner,

    the root mean square over directions. On a sphere of radius a in air of sound speed c this is
    exact, with the poles s = (c / a) (-1 +- i).

    Parameters
    ----------
    axes : array (3, 3)
        Unit vectors, a row each, orthogonal.
    levels : array (3,)
        Pressure at 1 m for a force that grows by 1 N/s, Pa s/N, where waves are longer than the
        body.
    corners : array (3,)
        Natural frequencies, Hz: of waves about as long as the body.
    dampings : array (3,)
        Damping ratios, 0.4 to 0.99.

    Raises
    ------
    OptionError
        When a number is not finite or outside its bound, or the axes are not orthonormal.
    """

    axes: Array
    levels: Array
    corners: Array
    dampings: Array

    def __post_init__(self) -> None:
        require_numbers("recoil's axes", self.axes, (3, 3))
        for name in ("levels", "corners", "dampings"):
            require_numbers(f"recoil's {name}", getattr(self, name), (3,), least=0)
        if not np.allclose(self.axes @ self.axes.T, np.eye(3), atol=_SQUARE):
            raise OptionError(f"recoil's axes are {self.axes.tolist()}: give orthonormal rows")
        least, most = DAMPINGS
        is_damped = least <= self.dampings.min() and self.dampings.max() <= most
        if not (is_damped and self.corners.min() >= _LOWEST_CORNER):
            raise OptionError(
                f"recoil has corners {self.corners.tolist()} Hz and dampings "
                f"{self.dampings.tolist()}: give corners from {rounded(_LOWEST_CORNER)} Hz on and "
                f"dampings from {rounded(least)} to {rounded(most)}"
            )

    def drives(self, directions: ArrayLike) -> Array:
        """Return how strongly unit pushes along directions (K, 3) wake each axis (K, 3).

        What is radiated is the power of all axes together, as they look to different sides. A push
        between them counts for each by the square of its component, put so that the sum is the
        root of the powers' sum where waves are long; the push's sign is not heard.
        """
        shares = np.square(np.atleast_2d(directions) @ self.axes.T)
        strengths = np.sqrt(shares @ np.square(self.levels))
        return shares * self.levels / np.maximum(strengths, np.finfo(float).tiny)[:, None]

    def changed(self, size: float, density: float) -> Recoil:
        """Return the recoil of a body `size` times as large and `density` times as dense."""
        return replace(self, levels=self.levels / density, corners=self.corners / size)

    # As resonators play it. Forces are band-limited, so the response need only be right below half
    # the sample rate. A sampled impulse response is not: that of a small body is far from over
    # there, and what lies beyond folds down (8 dB at 1 kHz for a die). So the poles are kept and
    # the zeros chosen, as in "matched" second-order filters (Vicanek 2016): silent under a steady
    # force, right where waves are long and at a quarter of the sample rate. Two poles with such
    # zeros are a resonator with a complex output gain.

    def poles(self, sample_rate: float) -> Complex:
        """Return the poles of the recoil along each axis at a sample rate, 1/s (3,)."""
        corners = np.minimum(2 * np.pi * self.corners, _FASTEST * sample_rate)
        return corners * (-self.dampings + 1j * np.sqrt(1 - np.square(self.dampings)))

    def outputs(self, sample_rate: float) -> Complex:
        """Return the output gains of the recoil's poles at 1 m, Pa m/(N s) (3,)."""
        poles: Complex = np.exp(self.poles(sample_rate) / sample_rate)
        middle, last = -2 * poles.real, np.square(np.abs(poles))
        # The numerator's power, b1 sin^2 + b2 4 sin^2 cos^2 of half the angle: 0 at 0 Hz.
        slope = np.square(sample_rate * (1 + middle + last))
        sine = np.sin(_MATCHED / 2) ** 2
        curve = 4 * sine * (1 - sine)
        turn: Complex = np.exp(-1j * _MATCHED)
        response = self._response(_MATCHED * sample_rate / (2 * np.pi))
        squared_response = np.square(np.abs(response * (1 + middle * turn + last * turn**2)))
        rising = np.maximum((squared_response - slope * curve) / (sine - curve / 4), 0.0)
        bending = slope - rising / 4
        # From it the coefficients: of this sample's force, -half of the last, and of that before.
        half = np.sqrt(rising) / 2
        first = (half + np.sqrt(np.maximum(half**2 + bending, 0.0))) / 2
        third = -bending / (4 * first)
        # A resonator gives Im[a c], and takes off what a steady force would end in.
        direct = third / last
        now = first - direct
        real = (now * poles.real - half - direct * middle) / poles.imag
        return np.asarray(sample_rate * self.levels * (real + 1j * now), np.complex128)

    def _response(self, frequency: float) -> Complex:
        """Return the response of each axis over its level at a frequency, Hz (3,)."""
        below = 1j * frequency / self.corners
        denominator = 1 + 2 * self.dampings * below + np.square(below)
        return np.asarray(2j * np.pi * frequency / denominator, np.complex128)

    def answers(self, sample_rate: float, most: int) -> Array:
        """Return the response (3, n) at 1 m to a force of one sample along each axis."""
        phase_steps, gains = self.poles(sample_rate) / sample_rate, self.outputs(sample_rate)
        count = int(min(np.ceil(_OVER / np.abs(phase_steps.real).min()), max(most, 1)))
        responses = np.imag(gains[:, None] * np.exp(np.outer(phase_steps, np.arange(count))))
        responses[:, 0] -= np.imag(gains / (1 - np.exp(phase_steps)))
        return responses / sample_rate
