"""A rigid sphere in the way of sound: the simplest head.

Pressures are amplitudes of exp(+i omega t), as in NumPy's ``rfft``: what arrives later has the
more negative phase. Angles are between source and ear, seen from the sphere's centre, in radians:
0 is the point that faces the source.

With x = k a (a the radius), rho = r / a (r the distance) and the spherical Hankel functions h_n of
the second kind, a point source makes on the sphere, relative to its free field at the centre
(Rayleigh 1904; Duda & Martens 1998, there for the other sign of time)

    H = -(rho / x) exp(i x rho) sum_n (2 n + 1) P_n(cos angle) h_n(x rho) / h_n'(x).

The Hankel functions overflow, their ratios s_n(x) = x h_n(x) / h_{n-1}(x) do not: they start at
s_1 = 1 + i x, go on as s_{n+1} = 2 n + 1 - x^2 / s_n, and turn the series into

    H = sum_n (2 n + 1) P_n(cos angle) c_n / (s_{n+1}(x) - n),
    c_0 = exp(i x),  c_n = c_{n-1} s_n(x rho) / (rho s_n(x)),

which holds at frequency zero and for plane waves (s_n(x rho) / rho tends to i x) as well.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError
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
    """Return the pressure on a rigid sphere, relative to the free field at its centre.

    Parameters
    ----------
    frequencies : array (F,)
        Hz, zero included.
    angles : array (A,)
        Between source and ear, rad.
    distance : float, optional
        Of a point source from the centre, m; a plane wave where there is none.
    radius : float
        m.
    sound_speed : float
        m/s.

    Returns
    -------
    array (F, A), complex
        Amplitudes of exp(+i omega t): its phase is that relative to the arrival at the centre,
        were there no sphere; an earlier arrival has a positive phase.

    Raises
    ------
    OptionError
        If a frequency is negative, the source nearer than 1.01 radii, or the radius or the speed
        not positive.

    References
    ----------
    Rayleigh 1904, Phil. Trans. R. Soc. A 203, 87; Duda & Martens 1998, JASA 104(5), 3048.
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
    """Return by how much a head's response grows from a reference distance to another.

    The law 1/r at the head's centre is not in it: responses at all distances are relative to the
    free field there. It corrects responses measured at one distance for nearer sources.

    Parameters
    ----------
    frequencies : array (F,)
        Hz.
    angles : array (A,)
        Between source and ear, rad.
    distance, reference : float, optional
        m, from the centre; a plane wave where there is none.
    radius : float
        m.
    sound_speed : float
        m/s.

    Returns
    -------
    array (F, A)
        ``|pressure(distance)| / |pressure(reference)|``.

    Raises
    ------
    OptionError
        As by `pressure`.

    References
    ----------
    Kan, Jin & van Schaik 2009, JASA 125(4), 2233 (distance variation function).
    """
    here = pressure(frequencies, angles, distance, radius, sound_speed)
    return np.abs(here / pressure(frequencies, angles, reference, radius, sound_speed))


def arrival_delay(
    angles: ArrayLike,
    distances: ArrayLike | None = None,
    radius: float = HEAD_RADIUS,
    sound_speed: float = AIR.sound_speed,
) -> Array:
    """Return how much later a wave front comes to an ear than to the head's centre.

    By the straight line where the source sees the ear, else by the tangent to the sphere and on
    along it. Value and slope are continuous at the edge of the shadow; at the point opposite to
    the source, where the ways around either side are equal, the delay has its peak, a corner.

    Parameters
    ----------
    angles : array
        Between source and ear, from 0 to pi rad.
    distances : array, optional
        From the centre to the source, m, of a shape that broadcasts with the angles; endless
        where there are none.
    radius : float
        m.
    sound_speed : float
        m/s.

    Returns
    -------
    array
        s; negative where the sound comes to the ear first.

    Raises
    ------
    OptionError
        If a source is nearer than 1.01 radii, or the radius or the speed not positive.

    References
    ----------
    Woodworth & Schlosberg 1954, Experimental Psychology, 349-361.
    """
    nearby = nearness(distances, radius)
    angle = np.asarray(angles, dtype=np.float64)
    # Differences of ways that may be long, written without differences.
    seen = np.sqrt(1 + nearby**2 - 2 * nearby * np.cos(angle))
    straight = (nearby - 2 * np.cos(angle)) / (1 + seen)
    around = angle - np.arccos(nearby) - nearby / (1 + np.sqrt(1 - nearby**2))
    return _crossing(radius, sound_speed) * np.where(np.cos(angle) >= nearby, straight, around)


def woodworth_delay(
    azimuths: ArrayLike, radius: float = HEAD_RADIUS, sound_speed: float = AIR.sound_speed
) -> Array:
    """Return the interaural delay of wave fronts from afar, a (sin theta + theta) / c.

    Parameters
    ----------
    azimuths : array
        Of the source in the ears' plane, from the front and to the left, rad. Behind the ears it
        counts as in front of them, mirrored.
    radius : float
        m; the ears are at its opposite ends.
    sound_speed : float
        m/s.

    Returns
    -------
    array
        s; positive where the left ear leads.

    Raises
    ------
    OptionError
        If the radius or the speed is not positive.

    References
    ----------
    Woodworth 1938, Experimental Psychology, 520-523.
    """
    sines = np.sin(np.asarray(azimuths, dtype=np.float64))
    return _crossing(radius, sound_speed) * (sines + np.arcsin(sines))


def kuhn_delay(
    azimuths: ArrayLike, radius: float = HEAD_RADIUS, sound_speed: float = AIR.sound_speed
) -> Array:
    """Return the interaural phase delay at low frequencies, 3 a sin(theta) / c.

    Parameters
    ----------
    azimuths : array
        Of the source in the ears' plane, from the front and to the left, rad.
    radius : float
        m; the ears are at its opposite ends.
    sound_speed : float
        m/s.

    Returns
    -------
    array
        s; positive where the left ear leads.

    Raises
    ------
    OptionError
        If the radius or the speed is not positive.

    References
    ----------
    Kuhn 1977, JASA 62(1), 157.
    """
    return 3 * _crossing(radius, sound_speed) * np.sin(np.asarray(azimuths, dtype=np.float64))


def nearness(distances: ArrayLike | None, radius: float) -> Array:
    """Return radius over distance: zero for a plane wave.

    Raises
    ------
    OptionError
        If a source is nearer than 1.01 radii, or the radius not positive.
    """
    far = np.asarray(np.inf if distances is None else distances, dtype=np.float64)
    if not np.all(far >= NEAREST * _checked_radius(radius)):
        raise OptionError(
            f"distance {np.min(far):g} m is too near to a sphere of radius {radius:g} m; keep "
            f"sources at least {NEAREST * radius:g} m from its centre"
        )
    return radius / far


def _coefficients(ka: Array, nearby: Array) -> Iterator[Complex]:
    """Yield the factors of the Legendre polynomials, until no more than REMAINDER is left."""
    size = np.exp(1j * ka)
    at_sphere = 1 + 1j * ka
    at_source = nearby + 1j * ka
    order, left = 0, np.inf
    # Beyond order ka, terms fall at least as fast as nearness^order.
    while order <= np.max(ka) or left > REMAINDER:
        term = (2 * order + 1) * size / (at_sphere - order)
        yield term
        left = np.max(np.abs(term)) / (1 - nearby)
        order += 1
        size = size * at_source / at_sphere
        at_sphere = 2 * order + 1 - ka**2 / at_sphere
        if nearby > 0:
            at_source = (2 * order + 1) * nearby - ka**2 / at_source


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
            f"sound_speed {sound_speed:g} m/s must be positive and finite; air has 343 m/s"
        )
    return _checked_radius(radius) / sound_speed


def _checked_radius(radius: float) -> float:
    if not 0 < radius < np.inf:
        raise OptionError(f"radius {radius:g} m must be positive and finite; a head has 0.0875 m")
    return radius
