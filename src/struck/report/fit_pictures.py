"""What a report plays and shows of hits: as recorded, their modes, and what these leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from struck.fitting.arrival import arrivals
from struck.model.residual import Residual
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted

Array = NDArray[np.float64]

MOST = 6
"""Hits that are played."""
LEAD = 0.1
"""Of a recording before its hit, s."""
_EARS = 2
_BACKWARDS = 0.003
_FADE_IN, _FADE_OUT = 0.01, 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Played:
    """One hit, from shortly before it on.

    Parameters
    ----------
    take : int
        Which, counted from 0.
    onset : float
        When the hit began in its take, s.
    lead : float
        From the beginning of the samples to the hit, s.
    original, modes : array (channels, n)
        As recorded, and what was fitted, both faded alike at the ends.
    beside : array (channels, n) or None
        Attack and noise as the model has them.
    sample_rate : int
        Hz.
    """

    take: int
    onset: float
    lead: float
    original: Array
    modes: Array
    beside: Array | None
    sample_rate: int

    @property
    def rest(self) -> Array:
        """Return what the modes leave (channels, n)."""
        return self.original - self.modes

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.original.shape[1] / self.sample_rate

    def sounds(self) -> Iterator[tuple[str, Array]]:
        """Yield captions and samples (channels, n), all on one scale."""
        yield "original", self.original
        yield "model", self.modes
        if self.beside is not None:
            yield "model with residual", self.modes + self.beside
        yield "residual", self.rest

    def shortened(self, seconds: float) -> Played:
        """Return its beginning, faded out."""
        length = round(seconds * self.sample_rate)
        if length >= self.original.shape[1]:
            return self
        fade = _fades(length, 0, round(_FADE_OUT * self.sample_rate))
        parts = {
            name: getattr(self, name)[:, :length] * fade
            for name in ("original", "modes", "beside")
            if getattr(self, name) is not None
        }
        return replace(self, **parts)

    def in_one_channel(self) -> Played:
        """Return the loudest channel."""
        best = int((self.original**2).sum(axis=1).argmax())
        return replace(
            self,
            original=self.original[best, None],
            modes=self.modes[best, None],
            beside=None if self.beside is None else self.beside[best, None],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Energies:
    """How much was recorded, and how much of it is left.

    Parameters
    ----------
    signal, left : array (rows,)
        Sums of squares over the stretch that was fitted.
    """

    signal: Array
    left: Array

    @classmethod
    def of(cls, fitted: Fitted) -> Energies:
        """Add up every channel of every hit."""
        heard = (fitted.heard_in(row) for row in range(len(fitted.rows)))
        both = [((one**2).sum(), ((one - modes) ** 2).sum()) for one, modes in heard]
        signal, left = np.array(both).reshape(-1, 2).T
        return cls(signal=signal, left=left)

    def ratio(self, rows: Sequence[int]) -> float:
        """Return signal to residual of some rows, dB; infinite where nothing is left."""
        chosen = list(rows)
        signal, left = float(self.signal[chosen].sum()), float(self.left[chosen].sum())
        return 10 * np.log10(signal / left) if left > 0 else np.inf


def hits_of(fitted: Fitted) -> list[list[int]]:
    """Return the rows of each hit."""
    found: dict[tuple[int, int], list[int]] = {}
    for row, what in enumerate(fitted.rows):
        found.setdefault((what.take, what.hit), []).append(row)
    return list(found.values())


def chosen_hits(fitted: Fitted, energies: Energies, most: int = MOST) -> list[list[int]]:
    """Return the rows of hits worth hearing: the loudest, then others spread over the takes."""
    every = sorted(hits_of(fitted), key=lambda rows: -energies.signal[rows].max())
    loudest, others = every[0], every[1:]
    takes: dict[int, list[int]] = {}
    for rows in others:
        takes.setdefault(fitted.rows[rows[0]].take, rows)
    several = len({row.take for row in fitted.rows}) > 1
    if several:
        takes.pop(fitted.rows[loudest[0]].take, None)
    spread = sorted(takes.values() if several else others)
    count = min(most - 1, len(spread))
    places = np.linspace(0, len(spread) - 1, count).round().astype(int)
    return [loudest, *(spread[place] for place in places)]


def setting_in(fitted: Fitted, recorded: Recorded, lead: float) -> Array:
    """Return when the modes of each row set in (rows,), s in its take.

    So long after the sound arrived as the model has it, but hardly before what was fitted: run
    backwards, fast modes grow beyond all bounds.
    """
    times = np.array([row.time for row in fitted.rows])
    return np.maximum(arrivals(fitted, recorded) + lead, times - _BACKWARDS)


def played(fitted: Fitted, recorded: Recorded, rows: Sequence[int], times: Array) -> Played:
    """Return one hit, its modes from the times (all rows,) on; of many channels the loudest."""
    heard = [fitted.heard_in(row)[0] for row in rows]
    if len(rows) > _EARS:
        best = int(np.argmax([(each**2).sum() for each in heard]))
        rows, heard = [rows[best]], [heard[best]]
    what = fitted.rows[rows[0]]
    take = recorded.takes[what.take]
    rate = take.sample_rate
    onset = round(what.onset * rate)
    first, last = max(0, onset - round(LEAD * rate)), round(what.time * rate) + len(heard[0])
    original = take.samples[[fitted.rows[row].channel for row in rows], first:last]
    modes = np.zeros_like(original)
    for channel, row in enumerate(rows):
        start = min(max(first, round(times[row] * rate)), last)
        modes[channel, start - first :] = fitted.ringing(row, start / rate, last - start)
    fade = _fades(last - first, round(_FADE_IN * rate), round(_FADE_OUT * rate))
    return Played(
        take=what.take,
        onset=what.onset,
        lead=(onset - first) / rate,
        original=original * fade,
        modes=modes * fade,
        beside=None,
        sample_rate=rate,
    )


def with_residual(hit: Played, residual: Residual, distance: float) -> Played:
    """Return the loudest hit with attack and noise as well, recorded from so many m away.

    They are those of the channel that holds most; in another they are as loud as what is left
    there.
    """
    found = residual.samples(hit.sample_rate) / distance
    first = round(hit.lead * hit.sample_rate)
    heard = np.zeros(hit.original.shape[1])
    part = found[: len(heard) - first]
    heard[first : first + len(part)] = part
    levels = np.sqrt((hit.rest**2).sum(axis=1))
    loudest = int((hit.original**2).sum(axis=1).argmax())
    shares = levels / max(float(levels[loudest]), 1e-300)
    fade = _fades(len(heard), 0, round(_FADE_OUT * hit.sample_rate))
    return replace(hit, beside=cast("Array", np.outer(shares, heard * fade)))


def _fades(length: int, rising: int, falling: int) -> Array:
    """Return factors (length,) that rise from 0 at the beginning and fall to it at the end."""
    factors = np.ones(length)
    up, down = min(rising, length), min(falling, length)
    factors[:up] *= np.sin(np.linspace(0, np.pi / 2, up)) ** 2
    factors[length - down :] *= np.cos(np.linspace(0, np.pi / 2, down)) ** 2
    return factors
