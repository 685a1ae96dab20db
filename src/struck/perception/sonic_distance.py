"""How different two struck bodies, or two contacts of one, sound to an ear."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError
from struck.model.contact import Place
from struck.model.model import ModalModel
from struck.perception.auditory_scale import (
    decibels,
    erb_number,
    frequency_of,
    sensitivity,
    spreading,
    threshold_in_quiet,
)
from struck.perception.heard import Heard

Array = NDArray[np.float64]
METHODS = ("erb", "doel1998", "doel1998-mean")

# Filters a half of their bandwidth apart: every tone passes the nearest with a loss below 1.4 dB.
_STEP = 0.5
_LOWEST, _HIGHEST = 20.0, 20_000.0


def sonic_distance(
    a: ModalModel,
    b: ModalModel,
    *,
    at: Place = None,
    against: Place = None,
    listener: ArrayLike | None = None,
    level: float | None = None,
    method: str = "erb",
) -> float:
    """Return how different two impacts sound, dB.

    Parameters
    ----------
    a, b : ModalModel
        What is struck; one model twice to compare two of its contacts.
    at : place, optional
        Where `a` is struck, as for `ModalModel.contact`; the loudest contact unless given.
    against : place, optional
        Where `b` is struck; as `a` unless given.
    listener : array-like (3,), optional
        In the coordinates of each model, m; beside it unless given.
    level : float, optional
        What the loudest contact of each model reaches, dB re 20 micropascal; 85 unless given. So
        bodies are compared by their timbre, contacts of one body by their level too.
    method : str
        "erb": levels behind the ear's filters, above the threshold in quiet; root mean square over
        those filters where either is heard. Filters stand every half bandwidth and pass the flanks
        of what lies beside them, so a mode that louder neighbours mask counts for little, and
        changes within one band for nothing.
        "doel1998": the sum of section 5 over modes; its root grows with their number.
        "doel1998-mean": the same with the sum of S(f) divided out, a weighted root mean square.

    Returns
    -------
    float
        0 for sounds that cannot be told apart.

    Raises
    ------
    OptionError
        On an unknown method, or by those of 1998 for models without a common set of modes.
    ContactError
        On a place off the body.

    Notes
    -----
    The paper leaves S(f), E_0 and the logarithm open. S is
    `struck.perception.auditory_scale.sensitivity`, from the
    contour of 40 phon; 10 log10 gives dB; E_0 is the energy, E = (a f)^2, of the softest audible
    partial of the same frequency and decay, so that f cancels from E / E_0.
    """
    if method not in METHODS:
        raise OptionError(f"method is {method!r}: give one of {', '.join(METHODS)}")
    hearing = Heard.at(a, listener, level)
    other = hearing if a is b else Heard.at(b, listener, level)
    first, second = _struck(hearing, at), _struck(other, at if against is None else against)
    if method == "erb":
        return erb_distance(
            band_excess(a.frequencies, first), band_excess(b.frequencies, second)
        ).item()
    _require_common(a, b)
    return doel_distance(a.frequencies, first, second, mean=method.endswith("mean"))


def filter_centres(step: float = _STEP) -> Array:
    """Return the middles of the ear's filters, every `step` of their bandwidth, Hz (B,)."""
    low, high = erb_number([_LOWEST, _HIGHEST]) / step
    return frequency_of(np.arange(np.ceil(low), np.floor(high) + 1) * step)


def band_excess(frequencies: Array, intensities: Array) -> Array:
    """Return by how much modes exceed the threshold in quiet behind each filter, dB (..., B).

    Parameters
    ----------
    frequencies : array (M,)
        Hz.
    intensities : array (..., M)
        Over that of 20 micropascal.
    """
    centres = filter_centres()
    excitation = decibels(intensities @ spreading(frequencies, centres).T)
    return np.maximum(excitation - threshold_in_quiet(centres), 0.0)


def erb_distance(first: Array, second: Array) -> Array:
    """Return the root mean square difference of two excesses (..., B) where either is heard."""
    heard = np.count_nonzero((first > 0) | (second > 0), axis=-1)
    return np.sqrt(np.square(first - second).sum(axis=-1) / np.maximum(heard, 1))


def doel_distance(frequencies: Array, first: Array, second: Array, *, mean: bool) -> float:
    """Return the distance of 1998, section 5, of two sets of intensities (M,), dB."""
    weights = sensitivity(frequencies)
    quiet = threshold_in_quiet(frequencies)
    one, other = (np.maximum(decibels(each) - quiet, 0.0) for each in (first, second))
    total = weights @ np.square(one - other)
    return float(np.sqrt(total / weights.sum() if mean else total))


def _struck(hearing: Heard, at: Place) -> Array:
    """Return the intensities of the modes of a body struck somewhere (M,)."""
    contact = hearing.model.contact(at)
    return hearing.intensities(contact.point[None], contact.direction[None])[0, 0]


def _require_common(a: ModalModel, b: ModalModel) -> None:
    one, other = a.frequencies, b.frequencies
    if len(one) != len(other) or not np.allclose(one, other, rtol=1e-9, atol=0):
        raise OptionError(
            f"models of {len(one)} and {len(other)} modes at frequencies of their own have no "
            "common set of modes, which the distance of 1998 sums over: take method='erb'"
        )
