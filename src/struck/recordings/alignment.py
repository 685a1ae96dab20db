"""How hard and when each hit was: what differs between hits that should sound alike.

Nobody strikes twice alike. Two hits of one contact, heard at one place, differ by a factor that
is smooth over frequency: strength, length of the contact, and the moment that was taken for their
beginning. Contacts heard at one place differ in their drives, which are real: what turns all
their phases in proportion to frequency is an error of the moment again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from struck.model.arrays import Array, Complex, Index

_LATEST = 1e-3  # largest error of a moment, s
_LIKELY = 3e-4  # usual error of a moment, s
_FINENESS = 8  # delays tried in a period of the highest mode
_ZOOMS = 3  # refinements of the best delay
_CLEAR = 100.0  # energy over that of its standard error from which a ratio of gains counts
_SURE = 3.0  # standard errors from which a gain counts for loudness
# scatter of modes between hits of a contact; usual b at the highest mode
_SCATTER, _SLOPE = 0.05, 1.0
_TWO = 2  # least modes that show a moment


def aligned(
    gains: Complex,
    errors: Array,
    hits: Index,
    contacts: Index,
    listeners: Index,
    poles: Complex,
) -> tuple[Complex, Array]:
    """Return gains and errors (n, M) as if a contact's hits were equal and their moments right.

    Gains are those of n recorded channels, with numbers (n,) of their hits, contacts and listeners
    and poles (M,), 1/s. From the loudest hit on, each is compared with those before it that share a
    listener: with hits of the same contact if there are any, where strength over frequency is a
    constant times exp(b f^2), else with those of other contacts, whose strengths stay.
    """
    gains, errors = gains.copy(), errors.copy()
    frequencies = poles.imag / (2 * np.pi)
    late = np.zeros(len(gains))
    leaders = hits.copy()
    for first, second in _compared(gains, errors, hits, contacts, listeners):
        own = np.flatnonzero(hits == hits[second[0]])
        repeated = contacts[first[0]] == contacts[second[0]]
        delay = _delay(gains, errors, first, second, frequencies, turned=not repeated)
        late[own], leaders[own] = delay, leaders[first[0]]
        gains[own] *= np.exp(poles * delay)
        if repeated:
            strength = _strength(gains, errors, first, second, frequencies)
            gains[own] /= strength
            errors[own] /= strength
    usual = _usual_delays(late, hits, leaders)
    return gains * np.exp(-poles * usual[:, None]), errors


def _usual_delays(late: Array, hits: Index, leaders: Index) -> Array:
    """Return the median delay (n,) of the hits that follow the same first one."""
    usual = np.zeros(len(late))
    for leader in np.unique(leaders):
        own = leaders == leader
        _, once = np.unique(hits[own], return_index=True)
        usual[own] = np.median(late[own][once])
    return usual


def _compared(
    gains: Complex, errors: Array, hits: Index, contacts: Index, listeners: Index
) -> Iterator[tuple[Index, Index]]:
    """Yield rows of known hits and those of the next hit at the same listeners."""
    energies = np.where(np.abs(gains) > _SURE * errors, np.abs(gains) ** 2, 0.0).sum(axis=1)
    numbers = np.unique(hits)
    loudness = [energies[hits == number].sum() for number in numbers]
    known: list[int] = []
    for number in numbers[np.argsort(loudness, kind="stable")[::-1]]:
        own = np.flatnonzero(hits == number)
        shared = [row for row in known if listeners[row] in listeners[own]]
        alike = [row for row in shared if contacts[row] == contacts[own[0]]]
        chosen = {int(listeners[row]): row for row in reversed(alike or shared)}
        if chosen:
            second = [own[np.argmax(listeners[own] == place)] for place in chosen]
            yield np.array(list(chosen.values())), np.array(second)
        known += own.tolist()


def averaged(gains: Complex, errors: Array, pairs: Index) -> tuple[Index, Complex, Array]:
    """Return each pair (contact, listener) once, with the weighted mean of its gains and errors."""
    distinct, number = np.unique(pairs, axis=0, return_inverse=True)
    share = np.eye(len(distinct))[number.reshape(-1)].T
    weights = 1 / errors**2
    total = share @ weights
    return distinct, (share @ (weights * gains)) / total, 1 / np.sqrt(total)


def _ratios(gains: Complex, errors: Array, first: Index, second: Index) -> tuple[Complex, Array]:
    """Return least-squares ratios of the second's gains to the first's, and their clarity (M,)."""
    weights = 1 / (errors[first] ** 2 + errors[second] ** 2)
    own = (weights * np.abs(gains[first]) ** 2).sum(axis=0)
    other = (weights * np.abs(gains[second]) ** 2).sum(axis=0)
    ratios = (weights * gains[first].conj() * gains[second]).sum(axis=0) / np.maximum(own, 1e-300)
    clear = np.minimum(own, other)
    return ratios, np.where(clear > _CLEAR, clear, 0.0)


def _strength(
    gains: Complex, errors: Array, first: Index, second: Index, frequencies: Array
) -> Array:
    """Return the second hit's strength over the first's (M,), smooth over frequency."""
    ratios, clear = _ratios(gains, errors, first, second)
    kept = (clear > 0) & (ratios != 0)
    if not kept.any():
        return np.full(len(frequencies), _overall(gains[first], gains[second]))
    squares = (frequencies / frequencies.max()) ** 2
    columns = np.stack([np.ones_like(squares), np.minimum(squares, squares[kept].max())], axis=1)
    # Modes scatter by more than noise: nobody strikes the same spot twice.
    weights = np.sqrt(np.minimum(clear[kept], 1 / _SCATTER**2))
    levels = weights * np.log(np.abs(ratios[kept]))
    design = np.vstack([columns[kept] * weights[:, None], [0.0, 1 / _SLOPE]])
    slopes, *_ = np.linalg.lstsq(design, np.append(levels, 0.0), rcond=None)
    return np.exp(columns @ slopes)


def _overall(first: Complex, second: Complex) -> float:
    """Return the ratio of total strengths; 1 where either is silent."""
    one, other = np.linalg.norm(first), np.linalg.norm(second)
    return float(other / one) if one and other else 1.0


def _delay(
    gains: Complex,
    errors: Array,
    first: Index,
    second: Index,
    frequencies: Array,
    *,
    turned: bool,
) -> float:
    """Return how late the second hit is, s: phases are 0 or, if `turned`, 0 or half a turn."""
    ratios, clear = _ratios(gains, errors, first, second)
    turns = ratios / np.maximum(np.abs(ratios), 1e-300)
    if turned:
        return _best_delay(turns**2, np.sqrt(clear), 2 * frequencies)
    return _best_delay(turns, np.sqrt(clear), frequencies)


def _best_delay(turns: Complex, weights: Array, frequencies: Array) -> float:
    """Return the delay that makes phase factors (M,) most nearly 1, s; small ones are likelier."""
    if np.count_nonzero(weights) < _TWO:
        return 0.0
    step = 1 / (_FINENESS * frequencies.max())
    delays = np.arange(-np.ceil(_LATEST / step), np.ceil(_LATEST / step) + 1) * step
    likely = np.exp(-0.5 * (delays / _LIKELY) ** 2)
    scores = _agreement(turns, weights, frequencies, delays) * likely
    best = float(delays[np.argmax(scores)])
    for _ in range(_ZOOMS):
        near = best + step * np.linspace(-1, 1, 2 * _FINENESS + 1)
        best = float(near[np.argmax(_agreement(turns, weights, frequencies, near))])
        step /= _FINENESS
    return best


def _agreement(turns: Complex, weights: Array, frequencies: Array, delays: Array) -> Array:
    waves = np.exp(2j * np.pi * np.outer(delays, frequencies))
    return np.asarray((waves @ (weights * turns)).real, np.float64)
