"""Spheres for heads: by the exact series, by Woodworth's delay, and by that delay alone.

The head's own frame has x forward, y to the left and z up; ear 0 is the left one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import numpy as np

from struck.ears.sphere import HEAD_RADIUS, arrival_delay, nearness, pressure
from struck.errors import OptionError, SolverError, rounded
from struck.model.arrays import Array, Single, checked
from struck.model.material import AIR

LOWEST_RATE = 4000.0  # Hz; below, a head changes next to nothing
_HIGHEST_RATE = 384_000.0  # Hz, of spheres


class Filters(Protocol):
    """Filters of a head, from directions to both ears, at one sample rate."""

    @property
    def taps(self) -> int:
        """Length of the head's impulse responses, samples."""
        ...

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return delays and responses of the ears to sound from some places.

        Parameters
        ----------
        directions : array (n, 3)
            From the head's centre to the source, of length one, in the head's frame.
        distances : array (n,)
            m, from the head's centre.

        Returns
        -------
        delays : array (n, 2)
            How much later than at the head's centre, were there no head, s; may be negative.
        responses : array (n, 2, taps), float32
            What to convolve that sound with.
        """
        ...


class Head(Protocol):
    """A head whose filters can be made for any sample rate."""

    @property
    def name(self) -> str:
        """Name of the head."""
        ...

    @property
    def references(self) -> tuple[str, ...]:
        """Keys of the papers behind a head's filters."""
        ...

    def prepared(self, sample_rate: float) -> Filters:
        """Compute the filters of the head, and keep them.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.

        Returns
        -------
        Filters
            Filters from directions to both ears.
        """
        ...


def require_rate(sample_rate: float, max_rate: float) -> None:
    """Raise OptionError on a sample rate, Hz, for which no head can be prepared."""
    if not LOWEST_RATE <= sample_rate <= max_rate:
        raise OptionError(
            f"sample_rate {rounded(sample_rate)} Hz must be between {LOWEST_RATE:g} and "
            f"{rounded(max_rate)} Hz; 48000 Hz is enough for ears"
        )


STEPS = 180  # between angles 0 and pi
NEAR, FAR = 1.15, 230.0  # radii: distances between them count (0.1 m and 20 m for a mean head)
KNOTS = 16  # distances in a table; one below NEAR and two beyond FAR for the curves' ends
ROUNDING = 0.15  # rad: how far from the point opposite to the source its delay's corner is rounded
LEAD = 12  # samples ahead of the wave front
LASTING = 1.5e-3  # s, of a response for a mean head: nearly a turn of sound around it
SPECTRUM = 15e-3  # s, length of the whole inverse transform, of which a response is cut out
PASS = 0.4  # share of the sample rate above which responses fade out
MIN_ENERGY_FRACTION = 0.999  # of a response's energy that is within its taps, at least
DECAYS = 9  # time constants that the shadow filter's response lasts

# Catmull & Rom 1974: the weights of four neighbours are cubics (rows: powers 0 to 3).
CATMULL_ROM = 0.5 * np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], float)
POWERS = np.arange(4)

# Knots are even over the logarithm of the height above the sphere, by which near fields go.
KNOT_STEP = math.log((FAR - 1) / (NEAR - 1)) / (KNOTS - 4)
HEIGHTS = (NEAR - 1) * np.exp(KNOT_STEP * (np.arange(KNOTS) - 1.0))  # radii
NEIGHBOURS = (np.arange(-1, 3)[:, None] * (STEPS + 4) + np.arange(-1, 3)).reshape(-1)
ANGLES = np.linspace(0, np.pi, STEPS + 1)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class SphereHead:
    """A rigid sphere with two points for ears, by the exact series for near and far sources.

    Sources nearer than 1.15 radii count as at 1.15 radii, those beyond 230 as at 230. Responses
    follow the series within 0.5 dB up to 0.4 of the sample rate, or to 20 kHz at higher rates.

    Parameters
    ----------
    radius : float, default 0.0875
        Radius of the sphere, m.
    ear_angle : float, default 90.0
        Angle from the front to each ear, degrees.

    Raises
    ------
    OptionError
        If the radius is not between 0.05 and 0.15 m, or the angle not between 0 and 180 degrees.

    Examples
    --------
    >>> from struck.ears import SphereHead
    >>> filters = SphereHead().prepared(48_000)
    >>> left = np.array([[0.0, 1.0, 0.0]])
    >>> delays, responses = filters.toward(left, np.array([2.0]))
    >>> bool(delays[0, 0] < delays[0, 1])  # the left ear is nearer
    True
    """

    name: str = field(default="sphere", init=False, repr=False)
    references: tuple[str, ...] = field(
        default=("rayleigh1904", "duda1998", "woodworth1954"), init=False, repr=False
    )
    radius: float = HEAD_RADIUS  # m, 0.05 to 0.15
    ear_angle: float = 90.0

    def __post_init__(self) -> None:
        _require_radius(self.radius)
        if not 0 < self.ear_angle < 180:
            raise OptionError(
                f"ear_angle {rounded(self.ear_angle)} must be between 0 and 180 degrees from the "
                "front; heads have 90 to 100"
            )

    def prepared(self, sample_rate: float) -> Filters:
        """Compute the filters of the head, and keep them.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz, from 4,000 to 384,000.

        Returns
        -------
        Filters
            Filters from directions to both ears.

        Raises
        ------
        OptionError
            If the sample rate is out of range.
        """
        require_rate(sample_rate, _HIGHEST_RATE)
        return _sphere_filters(self.radius, self.ear_angle, sample_rate)


@dataclass(frozen=True, slots=True, kw_only=True)
class WoodworthHead:
    """Woodworth's delay, and the head's shadow by a filter of one pole and one zero.

    The source's distance does not count; the ears are at 90 degrees from the front.
    """

    name: str = field(default="woodworth", init=False, repr=False)
    references: tuple[str, ...] = field(
        default=("woodworth1938", "brown1998"), init=False, repr=False
    )
    radius: float = HEAD_RADIUS  # m, 0.05 to 0.15

    def __post_init__(self) -> None:
        _require_radius(self.radius)

    def prepared(self, sample_rate: float) -> Filters:
        """Return the head's filters (kept, once made); OptionError outside 4 to 384 kHz."""
        require_rate(sample_rate, _HIGHEST_RATE)
        return _woodworth_filters(self.radius, sample_rate)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimpleHead:
    """Left and right by Woodworth's delay alone, as in 1998: no shadow, one level at both ears.

    The source's distance does not count; the ears are at 90 degrees from the front.
    """

    name: str = field(default="simple1998", init=False, repr=False)
    references: tuple[str, ...] = field(
        default=("doel1998", "begault1994", "woodworth1938"), init=False, repr=False
    )
    radius: float = HEAD_RADIUS  # m, 0.05 to 0.15

    def __post_init__(self) -> None:
        _require_radius(self.radius)

    def prepared(self, sample_rate: float) -> Filters:
        """Return the head's filters (kept, once made); OptionError outside 4 to 384 kHz."""
        require_rate(sample_rate, _HIGHEST_RATE)
        return _make_simple_filters(self.radius)


def _require_radius(radius: float) -> None:
    if not 0.05 <= radius <= 0.15:
        raise OptionError(
            f"radius {rounded(radius)} m must be between 0.05 and 0.15 m; a mean head has 0.0875 m"
        )


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedFilters:
    """Delays and impulse responses of a head in a table over angles and distances."""

    ears: Array  # (3, 2): directions of the ears, in columns
    radius: float  # m
    table: Array  # (K * (STEPS + 4), 1 + taps): delay, s, and response by distance and angle

    @property
    def taps(self) -> int:
        """Length of the impulse responses, samples."""
        return self.table.shape[1] - 1

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return delays (n, 2), s, and responses (n, 2, taps); see `Filters`."""
        positions = self._positions(directions, distances)
        cells = positions.astype(np.intp)
        weights = (positions - cells)[..., None] ** POWERS @ CATMULL_ROM
        node_weights = weights[:, 2:, :, None] * weights[:, :2, None, :]
        rows = cells[:, 2:] * (STEPS + 4) + cells[:, :2]
        node_values = self.table.take(rows[..., None] + NEIGHBOURS, axis=0)
        mixed = (node_weights.reshape(-1, 2, 1, 16) @ node_values)[:, :, 0]
        return mixed[..., 0], mixed[..., 1:].astype(np.float32)

    def _positions(self, directions: Array, distances: Array) -> Array:
        """Return positions of the two ears' angles and of the distance in the table (n, 3)."""
        positions = np.empty((len(distances), 3))
        cosines = np.maximum(np.minimum(directions @ self.ears, 1), -1)
        positions[:, :2] = np.arccos(cosines) * (STEPS / np.pi) + 1
        height = np.maximum(distances / self.radius, NEAR) - 1
        knot_positions = np.log(height / (NEAR - 1)) / KNOT_STEP
        positions[:, 2] = np.minimum(knot_positions, KNOTS - 4) + 1
        return positions


@lru_cache(maxsize=8)
def _sphere_filters(radius: float, ear_angle: float, sample_rate: float) -> TabulatedFilters:
    tables = [_sphere_table(radius, sample_rate, (1 + height) * radius) for height in HEIGHTS]
    return TabulatedFilters(_ears(ear_angle), radius, np.concatenate(tables))


@lru_cache(maxsize=8)
def _woodworth_filters(radius: float, sample_rate: float) -> TabulatedFilters:
    table = _make_table(arrival_delay(ANGLES, None, radius), _shadow(radius, sample_rate))
    return TabulatedFilters(_ears(90), radius, np.tile(table, (KNOTS, 1)))


@lru_cache(maxsize=8)
def _make_simple_filters(radius: float) -> TabulatedFilters:
    table = _make_table(arrival_delay(ANGLES, None, radius), np.ones((STEPS + 1, 1)))
    return TabulatedFilters(_ears(90), radius, np.tile(table, (KNOTS, 1)))


def _make_table(delays: Array, responses: Array) -> Array:
    """Join delays and responses over ANGLES, mirrored beyond both ends for the cubics."""
    return np.pad(np.column_stack([delays, responses]), ((1, 2), (0, 0)), mode="reflect")


def _sphere_table(radius: float, sample_rate: float, distance: float) -> Array:
    """Return the table of one distance: the series' responses from the arrival on."""
    delays = _arrival_with_round_corner(radius, distance) - LEAD / sample_rate
    size = 2 ** math.ceil(math.log2(SPECTRUM * radius / HEAD_RADIUS * sample_rate + 4 * LEAD))
    frequencies = np.arange(size // 2 + 1) * sample_rate / size
    spectra = pressure(frequencies, ANGLES, distance, radius)
    spectra *= np.exp(2j * np.pi * np.outer(frequencies, delays))
    spectra *= fading(frequencies / sample_rate, PASS, 0.5)[:, None]
    return _make_table(delays, _cut(np.fft.irfft(spectra, size, axis=0).T, radius, sample_rate))


def _cut(responses: Array, radius: float, sample_rate: float) -> Array:
    """Return the responses' first taps, with eased ends."""
    taps = 2 * LEAD + math.ceil(LASTING * radius / HEAD_RADIUS * sample_rate)
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(LEAD // 2) + 0.5) / (LEAD // 2))
    first_taps = responses[:, :taps].copy()
    first_taps[:, : LEAD // 2] *= ramp
    first_taps[:, -LEAD // 2 :] *= ramp[::-1]
    energy_fraction = np.min(np.sum(first_taps**2, axis=1) / np.sum(responses**2, axis=1))
    if not energy_fraction >= MIN_ENERGY_FRACTION:
        raise SolverError(
            f"{taps} taps hold {energy_fraction:.4f} of a response's energy, less than "
            f"{MIN_ENERGY_FRACTION}, at {rounded(sample_rate)} Hz for a radius of "
            f"{rounded(radius)} m; choose a higher sample rate"
        )
    return first_taps


def _arrival_with_round_corner(radius: float, distance: float) -> Array:
    """Return `arrival_delay` over ANGLES, with its corner opposite to the source rounded.

    There, the waves around either side meet, and the pressure is smooth over angle only with a
    delay that is smooth as well. What the delay lacks is in the responses.
    """
    edge = math.acos(nearness(distance, radius))
    opposite_angles = np.pi - ANGLES
    rounded_angles = (
        np.hypot(opposite_angles, ROUNDING) - np.hypot(np.pi - edge, ROUNDING) + np.pi - edge
    )
    return arrival_delay(np.where(edge <= ANGLES, np.pi - rounded_angles, ANGLES), distance, radius)


def fading(frequencies: Array, first: float, last: float) -> Array:
    """Return a gain of one up to `first`, then half a cosine down to zero at `last`."""
    return 0.5 + 0.5 * np.cos(np.pi * np.clip((frequencies - first) / (last - first), 0, 1))


def minimum_phase(logarithms: Array) -> Array:
    """Return responses (n, 2 bins) of minimum phase by log magnitudes (n, bins + 1).

    The complex cepstrum of minimum phase is twice the causal half of the real one (Oppenheim &
    Schafer, Discrete-Time Signal Processing, 3rd ed., 2010, section 13.5).
    """
    count = 2 * (logarithms.shape[1] - 1)
    cepstra = np.fft.irfft(logarithms, count)
    cepstra[:, 1 : count // 2] *= 2
    cepstra[:, count // 2 + 1 :] = 0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstra)), count)


def _shadow(radius: float, sample_rate: float) -> Array:
    """Return Brown & Duda's (1998) head shadow over ANGLES, as responses.

    (1 + alpha i omega tau) / (1 + i omega tau) with tau = a / 2 c is alpha at once plus
    (1 - alpha) of a low-pass of one pole, which is put into samples by the bilinear transform.
    """
    min_alpha, darkest_angle = 0.1, np.radians(150)
    alpha = 1 + min_alpha / 2 + (1 - min_alpha / 2) * np.cos(np.pi * ANGLES / darkest_angle)
    tau = radius / (2 * AIR.sound_speed)
    time_constant = 2 * sample_rate * tau
    pole = (time_constant - 1) / (time_constant + 1)
    decay = (1 + pole) * pole ** np.arange(math.ceil(DECAYS * tau * sample_rate) + 8)
    low_pass = np.insert(decay, 0, 1)
    responses = np.outer(1 - alpha, low_pass / np.sum(low_pass))
    responses[:, 0] += alpha
    return responses


def _ears(ear_angle: float) -> Array:
    """Return the directions of the left and the right ear, in columns."""
    cosine, sine = math.cos(math.radians(ear_angle)), math.sin(math.radians(ear_angle))
    return np.array([[cosine, cosine], [sine, -sine], [0.0, 0.0]])
