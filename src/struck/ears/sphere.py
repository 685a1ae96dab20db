"""Pressure and arrival of sound on a rigid sphere, the simplest head.

Pressures are amplitudes of exp(+i omega t), as in NumPy's ``rfft``: a later arrival has the
more negative phase. Angles are between source and ear, seen from the sphere's centre, in radians:
0 is the point that faces the source.

With x = k a (a the radius), rho = r / a (r the distance) and the spherical Hankel functions h_n of
the second kind, a point source makes on the sphere, relative to its free field at the centre
(Rayleigh 1904, Phil. Trans. R. Soc. A 203, 87; Duda & Martens 1998, JASA 104(5), 3048, there for
the other sign of time)

    H = -(rho / x) exp(i x rho) sum_n (2 n + 1) P_n(cos angle) h_n(x rho) / h_n'(x).

SciPy's Hankel functions overflow beyond moderate orders, their ratios s_n(x) = x h_n(x) /
h_{n-1}(x) do not: they start at s_1 = 1 + i x, continue as s_{n+1} = 2 n + 1 - x^2 / s_n, and turn
the series into

    H = sum_n (2 n + 1) P_n(cos angle) c_n / (s_{n+1}(x) - n),
    c_0 = exp(i x),  c_n = c_{n-1} s_n(x rho) / (rho s_n(x)),

which holds at frequency zero and for plane waves (s_n(x rho) / rho tends to i x) as well.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Complex
from struck.model.material import AIR

HEAD_RADIUS = 0.0875  # m, the customary mean head (Hartley & Fry 1921)
NEAREST = 1.01  # radii from the centre: the nearer the source, the more terms the series needs
REMAINDER = 1e-12  # of the pressure in the free field, left out of the series


def pressure(
    frequencies: ArrayLike,
    angles: ArrayLike,
    distance: float | None = None,
    radius: float = HEAD_RADIUS,
    sound_speed: float = AIR.sound_speed,
) -> Complex:
    """Return the pressure on a rigid sphere (F, A), relative to the free field at its centre.

    Frequencies (F,) in Hz, angles (A,) in rad; without a distance (m) the wave is plane. The phase
    is relative to the arrival at the centre, were there no sphere.
    """
    ka = 2 * np.pi * _checked_frequencies(frequencies) * _crossing(radius, sound_speed)
    coefficients = np.stack(list(_coefficients(ka, nearness(distance, radius))), axis=1)
    cosines = np.cos(np.atleast_1d(np.asarray(angles, dtype=np.float64)))
    return coefficients @ np.polynomial.legendre.legvander(cosines, coefficients.shape[1] - 1).T


def distance_gain(
    frequencies: ArrayLike,
    angles: ArrayLike,
    distance: float | None,
    reference: float | None = None,
    radius: float = HEAD_RADIUS,
    sound_speed: float = AIR.sound_speed,
) -> Array:
    """Return the ratio of pressures at a distance and at a reference distance (F, A).

    The distance variation function of Kan, Jin & van Schaik 2009, JASA 125(4), 2233: pressures are
    relative to the free field at the head's centre, so that the law 1/r is not in it.
    """
    pressures = pressure(frequencies, angles, distance, radius, sound_speed)
    return np.abs(pressures / pressure(frequencies, angles, reference, radius, sound_speed))


def arrival_delay(
    angles: ArrayLike,
    distances: ArrayLike | None = None,
    radius: float = HEAD_RADIUS,
    sound_speed: float = AIR.sound_speed,
) -> Array:
    """Return how much later than at the head's centre a wave front comes to an ear, s.

    By the straight line where the source sees the ear, else by the tangent to the sphere and on
    along it (Woodworth & Schlosberg 1954, Experimental Psychology, 349-361); from afar without
    distances (m). Continuous with its slope at the shadow's edge, with a corner opposite to the
    source.
    """
    radius_ratio = nearness(distances, radius)
    angle = np.asarray(angles, dtype=np.float64)
    # Differences of path lengths, written without cancellation.
    distance_ratio = np.sqrt(1 + radius_ratio**2 - 2 * radius_ratio * np.cos(angle))
    straight_delay = (radius_ratio - 2 * np.cos(angle)) / (1 + distance_ratio)
    diffracted_delay = (
        angle - np.arccos(radius_ratio) - radius_ratio / (1 + np.sqrt(1 - radius_ratio**2))
    )
    return _crossing(radius, sound_speed) * np.where(
        np.cos(angle) >= radius_ratio, straight_delay, diffracted_delay
    )


def nearness(distances: ArrayLike | None, radius: float) -> Array:
    """Return radius over distance: zero for a plane wave; OptionError within 1.01 radii."""
    values = np.asarray(np.inf if distances is None else distances, dtype=np.float64)
    if not np.all(values >= NEAREST * _checked_radius(radius)):
        raise OptionError(
            f"distance {rounded(np.min(values))} m is too near to a sphere of radius "
            f"{rounded(radius)} m; keep sources at least {rounded(NEAREST * radius)} m from its "
            "centre"
        )
    return radius / values


def _coefficients(ka: Array, radius_ratio: Array) -> Iterator[Complex]:
    """Yield the factors (F,) of the Legendre polynomials, until no more than REMAINDER is left."""
    size = np.exp(1j * ka)
    at_sphere = 1 + 1j * ka
    at_source = radius_ratio + 1j * ka
    order, left = 0, np.inf
    # Beyond order ka, terms fall at least as fast as nearness^order.
    while order <= np.max(ka) or left > REMAINDER:
        term = (2 * order + 1) * size / (at_sphere - order)
        yield term
        left = np.max(np.abs(term)) / (1 - radius_ratio)
        order += 1
        size = size * at_source / at_sphere
        at_sphere = 2 * order + 1 - ka**2 / at_sphere
        if radius_ratio > 0:
            at_source = (2 * order + 1) * radius_ratio - ka**2 / at_source


def _checked_frequencies(frequencies: ArrayLike) -> Array:
    values = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if values.size == 0 or not np.all(np.isfinite(values) & (values >= 0)):
        raise OptionError(
            f"frequencies {frequencies!r} must be finite and not negative, and at least one; "
            "pass magnitudes in Hz"
        )
    return values


def _crossing(radius: float, sound_speed: float) -> float:
    """Return the time that sound takes along a radius, s."""
    if not 0 < sound_speed < np.inf:
        raise OptionError(
            f"sound_speed {rounded(sound_speed)} m/s must be positive and finite; air has 343 m/s"
        )
    return _checked_radius(radius) / sound_speed


def _checked_radius(radius: float) -> float:
    if not 0 < radius < np.inf:
        raise OptionError(
            f"radius {rounded(radius)} m must be positive and finite; a head has 0.0875 m"
        )
    return radius
