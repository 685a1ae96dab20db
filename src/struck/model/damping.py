"""Damping: from natural frequencies, in Hz or as notes (A4 = 440 Hz), to decay rates."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import InitVar, dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import MaterialError, OptionError, StruckError, rounded
from struck.model.arrays import Array, checked, numbers, require_number, short_text

_STEPS, _PRECISION = 200, 1e-14


@runtime_checkable
class Damping(Protocol):
    """A damping law: the decay rate of each mode as a function of its frequency.

    It may have an attribute `contains_air`: True if its rates contain the losses to the air, which
    are otherwise added.

    Examples
    --------
    >>> friction = struck.InternalFriction(loss_tangent=0.01)
    >>> isinstance(friction, struck.Damping)
    True
    """

    def decays(self, frequencies: ArrayLike) -> Array:
        """Compute the decay rate of each mode.

        Parameters
        ----------
        frequencies : array-like (M,)
            Natural frequencies, Hz.

        Returns
        -------
        array (M,)
            Amplitude decay rates d of exp(-d t), 1/s.
        """
        ...


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class InternalFriction:
    """Losses in the material, and external ones (van den Doel & Pai 1998, eq. 12 and 13).

    Parameters
    ----------
    loss_tangent : float
        Tangent of the loss angle phi, constant over frequency: d = pi f tan(phi).
    external : float, default 0.0
        Decay rate added to every mode by support or hand, 1/s.
    contains_air : bool, default False
        Whether the law contains the losses to the air, which are then not added.

    Raises
    ------
    MaterialError
        If a value is negative or not finite.

    Examples
    --------
    >>> friction = struck.InternalFriction(loss_tangent=0.01)
    >>> friction.decays([100.0, 1000.0]).round(2)
    array([ 3.14, 31.42])
    """

    loss_tangent: float
    external: float = 0.0
    contains_air: bool = False

    def __post_init__(self) -> None:
        _require_at_least_zero(loss_tangent=self.loss_tangent, external=self.external)

    def decays(self, frequencies: ArrayLike) -> Array:
        """Compute d = pi f tan(phi) + external.

        Parameters
        ----------
        frequencies : array-like (M,)
            Natural frequencies, Hz.

        Returns
        -------
        array (M,)
            Amplitude decay rates d of exp(-d t), 1/s.
        """
        return np.pi * self.loss_tangent * np.asarray(frequencies, float) + self.external


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Rayleigh:
    """Losses in proportion to mass and stiffness (O'Brien et al. 2002, eq. 6 and 9).

    Parameters
    ----------
    mass : float
        Coefficient of the mass matrix, 1/s: alpha_2 of 2002, alpha of others.
    stiffness : float
        Coefficient of the stiffness matrix, s: alpha_1 of 2002, beta of others.
    external : float, default 0.0
        Decay rate added to every mode by support or hand, 1/s.
    contains_air : bool, default False
        Whether the law contains the losses to the air, which are then not added.

    Raises
    ------
    MaterialError
        If a value is negative or not finite.

    Examples
    --------
    >>> struck.Rayleigh(mass=2.0, stiffness=1e-7).decays([100.0, 1000.0]).round(2)
    array([1.02, 2.97])
    """

    mass: float
    stiffness: float
    external: float = 0.0
    contains_air: bool = False

    def __post_init__(self) -> None:
        _require_at_least_zero(mass=self.mass, stiffness=self.stiffness, external=self.external)

    def decays(self, frequencies: ArrayLike) -> Array:
        """Compute d = (mass + stiffness (2 pi f)^2) / 2 + external.

        Parameters
        ----------
        frequencies : array-like (M,)
            Natural frequencies, Hz.

        Returns
        -------
        array (M,)
            Amplitude decay rates d of exp(-d t), 1/s.
        """
        squares = np.square(2 * np.pi * np.asarray(frequencies, float))
        return (self.mass + self.stiffness * squares) / 2 + self.external


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Decay rates known at some frequencies, interpolated linearly in log f and log d.

    Beyond the first and the last frequency their rates are constant.

    Parameters
    ----------
    frequencies : tuple of float or str
        Frequencies in ascending order, Hz, or notes such as "A5".
    rates : tuple of float, optional
        Decay rates at these frequencies, 1/s.
    t60 : tuple of float, optional
        Instead of `rates`: times of a decay by 60 dB, s; d = ln 1000 / T60.
    contains_air : bool, default True
        Whether the rates contain the losses to the air, as those of a recorded body do. These
        are then not added.

    Raises
    ------
    MaterialError
        If the two differ in length, values are not positive, frequencies do not ascend, or `rates`
        and `t60` are both given or both missing.

    Examples
    --------
    >>> law = struck.Measured(frequencies=(100.0, 10_000.0), t60=(2.0, 0.2))
    >>> law.decays([100.0, 1000.0, 10_000.0]).round(2)
    array([ 3.45, 10.92, 34.54])
    """

    frequencies: tuple[float | str, ...]
    rates: tuple[float, ...] = ()
    t60: InitVar[tuple[float, ...] | None] = None
    contains_air: bool = True

    def __post_init__(self, t60: tuple[float, ...] | None) -> None:
        if t60 is not None:
            if np.size(self.rates):
                raise MaterialError("both rates= and t60= are given: leave one of them out")
            times = numbers("t60", t60, error=MaterialError)
            with np.errstate(divide="ignore", invalid="ignore"):
                object.__setattr__(self, "rates", np.log(1000) / times)
        frequencies = in_hertz("frequencies", self.frequencies, error=MaterialError)
        object.__setattr__(self, "frequencies", frequencies)
        for name in ("frequencies", "rates"):
            values = numbers(name, getattr(self, name), error=MaterialError)
            object.__setattr__(self, name, tuple(np.atleast_1d(values).ravel().tolist()))
        if len(self.frequencies) != len(self.rates) or not self.rates:
            name = "rates" if t60 is None else "t60"
            raise MaterialError(
                f"there are {len(self.frequencies)} frequencies and {len(self.rates)} of {name}=: "
                "give as many of both, at least one"
            )
        is_finite = np.isfinite((*self.frequencies, *self.rates)).all()
        if not is_finite or np.any(np.diff((0.0, *self.frequencies)) <= 0) or min(self.rates) <= 0:
            raise MaterialError(
                "frequencies must ascend from above 0 Hz, decay rates exceed 0, and all be finite"
            )

    def decays(self, frequencies: ArrayLike) -> Array:
        """Interpolate the decay rates.

        Parameters
        ----------
        frequencies : array-like (M,)
            Natural frequencies, Hz.

        Returns
        -------
        array (M,)
            Amplitude decay rates d of exp(-d t), 1/s.
        """
        log_frequencies = np.log(np.maximum(np.asarray(frequencies, float), np.finfo(float).tiny))
        return np.exp(np.interp(log_frequencies, np.log(self.frequencies), np.log(self.rates)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Each:
    """The decay rate of each mode of one body, from any law of damping."""

    rates: Array  # (M,), 1/s
    contains_air: bool = True

    def decays(self, frequencies: ArrayLike) -> Array:
        """Return the rates of these M modes, 1/s."""
        return np.broadcast_to(self.rates, np.shape(frequencies))


def contains_air(damping: Damping) -> bool:
    """Return whether a law contains the losses to the air."""
    return bool(getattr(damping, "contains_air", False))


def ringing(natural: ArrayLike, decays: ArrayLike) -> Array:
    """Return the damped frequencies f = sqrt(f0^2 - (d / 2 pi)^2), Hz; 0 where overdamped."""
    squares = np.square(np.asarray(natural, float)) - np.square(np.asarray(decays) / (2 * np.pi))
    return np.sqrt(np.maximum(squares, 0.0))


def natural_at(frequency: float | str, decay_at: Callable[[float], float]) -> float:
    """Return the natural frequency that rings at `frequency`, Hz; MaterialError where none does.

    `decay_at` returns the decay rate, 1/s, at a natural frequency, Hz.
    """
    frequency = hertz("lowest", frequency, error=MaterialError)
    natural = frequency
    for _ in range(_STEPS):
        decay = decay_at(natural)
        better = float(np.hypot(frequency, decay / (2 * np.pi)))
        if abs(better - natural) <= _PRECISION * better:
            return better
        natural = better
    raise MaterialError(
        f"with this damping no mode rings at {rounded(frequency)} Hz: lower the damping, or tune "
        "higher"
    )


def _require_at_least_zero(**coefficients: float) -> None:
    for name, value in coefficients.items():
        hint = "damping needs a finite number of at least 0"
        require_number(name, value, hint=hint, error=MaterialError)


# Frequencies as people say them.

NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_NOTE = re.compile(
    r"([A-G])([#b\u266f\u266d]?)(-1|10|\d)\s*(?:([+-]\d+(?:\.\d+)?)\s*c?)?", re.IGNORECASE
)
_ALTERED = {"": 0, "#": 1, "\u266f": 1, "b": -1, "\u266d": -1}
_PLAIN = re.compile(r"\s*(\S+?)\s*(k?)(?:hz)?\s*", re.IGNORECASE)


def hertz(name: str, pitch: float | str, *, error: type[StruckError] = OptionError) -> float:
    """Return a pitch in Hz: a number, "880", "1.2 kHz", or a note as "A5" or "A5+12c".

    Parameters
    ----------
    name : str
        Of the argument, for messages.
    pitch : float or str
        Above 0 Hz; notes from C-1 to B10, with "#" or "b", and cents after a sign.
    error : type
        Raised on anything else.
    """
    hint = "give Hz, as 880, or a note from C-1 to B10, as A5, Bb3 or A5+12c"
    if isinstance(pitch, str):
        note, plain = _NOTE.fullmatch(pitch.strip()), _PLAIN.fullmatch(pitch)
        if note:
            letter, sign, octave, cents = note.groups()
            semitones = NAMES.index(letter.upper()) + _ALTERED[sign.lower()] + 12 * int(octave) - 57
            return 440 * 2 ** ((semitones + float(cents or 0) / 100) / 12)
        try:
            pitch = float(plain[1]) * (1000 if plain[2] else 1) if plain else math.nan
        except ValueError:
            german_hint = " (H is B here)" if pitch.strip()[:1] in {"H", "h"} else ""
            raise error(f"{name} is {pitch!r}, no frequency: {hint}{german_hint}") from None
    require_number(name, pitch, above=True, hint=hint, unit=" Hz", error=error)
    return float(pitch)


def in_hertz(
    name: str, pitches: Iterable[Any], *, error: type[StruckError] = OptionError
) -> list[Any]:
    """Return pitches in Hz, texts among them by `hertz`."""
    return [
        hertz(name, pitch, error=error) if isinstance(pitch, str) else pitch for pitch in pitches
    ]


Band = tuple[float | str, float | str]  # Hz or notes, the lower first


def require_band(band: object) -> tuple[float, float]:
    """Return a band, of numbers or notes, in Hz, the lower end first; OptionError otherwise."""
    pitches: list[Any] = []
    if isinstance(band, tuple | list) or (isinstance(band, np.ndarray) and band.ndim):
        pitches = [*band]
    is_pair = all(np.isscalar(pitch) for pitch in pitches)
    ends = np.asarray(in_hertz("band", pitches)) if is_pair else np.zeros(0)
    if ends.shape != (2,) or ends.dtype.kind not in "iuf" or not 0 <= ends[0] < ends[1] < np.inf:
        raise OptionError(
            f"band is {short_text(band)}: give two frequencies in Hz, or notes, the lower first"
        )
    return float(ends[0]), float(ends[1])
