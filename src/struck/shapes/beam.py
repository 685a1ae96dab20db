"""Frequencies of a uniform beam by its ends: all up to a bound, none missed or doubled.

A hinged or sliding end is a mirror: motions are odd or even about it, and what remains are the two
conditions at the other end. A beam with equal ends has its mirror in the middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.shapes.standing_waves import Beam, Waves

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ENDS = ("free", "clamped", "hinged", "sliding")
_MIRRORS = {"sliding": "even", "hinged": "odd"}
_COLUMNS = {"even": slice(0, 2), "odd": slice(2, 4), "both": slice(0, 4)}
# Signs by which the even and odd waves at one end differ from those at the other.
REFLECTION = np.array([1.0, 1.0, -1.0, -1.0])
# No beam at least as long as its radius of gyration has an elastic mode whose first wave turns by
# less from the origin to the end.
_LEAST_PHASE = 0.01
# Until the square root of a frequency is known to its last digit, for up to a thousand modes.
_HALVINGS = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Motions about an origin, with conditions at an end of the beam.

    Parameters
    ----------
    kind : str
        "even" or "odd"; "both" where no mirror tells them apart: then the other end is "free"
        where this one is "clamped", and the reverse.
    end : str
        One of `ENDS`.
    span : float
        From the origin to the end, in lengths of the beam.
    """

    kind: str
    end: str
    span: float

    def frequencies(self, beam: Beam, highest: float) -> tuple[Array, Array]:
        """Return squared frequencies (M,) up to `highest`, and amplitudes of the waves (M, 4).

        The waves are those of `Waves.at_end`, first and second, even and odd; amplitudes are not
        normalised, frequencies of a family not sorted.
        """
        if self.end in _MIRRORS:
            return self._between_mirrors(beam, highest)
        squared = self._counted(beam, highest)
        waves = Waves.at(beam, squared, self.span)
        amplitudes = np.zeros((len(squared), 4))
        # What the conditions let through: the direction that they map to nothing.
        amplitudes[:, _COLUMNS[self.kind]] = np.linalg.svd(self._conditions(waves))[2][:, -1]
        return squared, amplitudes

    def _between_mirrors(self, beam: Beam, highest: float) -> tuple[Array, Array]:
        """Return modes of one wave alone: whole numbers of quarter waves fit between mirrors."""
        bound = Waves.at(beam, np.array([highest]), self.span)
        shift = 0.5 if (self.end == "hinged") == (self.kind == "even") else 0.0
        first = beam.first(self._fitting(bound.first, shift))
        second = np.empty(0)
        if bound.second < 0:
            second = beam.second(self._fitting(np.sqrt(-bound.second), shift))
            if self.end == "hinged" and self.kind == "odd":
                # Sections turn to and fro all along while the bar stays straight.
                second = np.append(second, beam.second(np.zeros(1)))
        amplitudes = np.zeros((len(first) + len(second), 4))
        column = _COLUMNS[self.kind].start
        amplitudes[: len(first), column] = amplitudes[len(first) :, column + 1] = 1.0
        squared = np.concatenate([first, second])
        return squared[squared <= highest], amplitudes[squared <= highest]

    def _fitting(self, largest: Array, shift: float) -> Array:
        """Return the wave numbers up to the largest (and one more) that fit."""
        count = int(largest[0] * self.span / np.pi) + 1
        return (np.arange(1.0, count + 1) - shift) * (np.pi / self.span)

    def _counted(self, beam: Beam, highest: float) -> Array:
        """Return squared frequencies by halving intervals until each holds one root."""

        def count(root: Array) -> Index:
            return self.count(Waves.at(beam, root**4, self.span))

        low = beam.first(np.array([_LEAST_PHASE / self.span])) ** 0.25
        high = np.array([highest**0.25])
        if high <= low:
            return np.empty(0)
        numbers = np.arange(count(low)[0], count(high)[0]) + 1
        return _halved(count, numbers, low, high) ** 4

    def count(self, waves: Waves) -> Index:
        """Return how many frequencies lie below those of the waves, rigid motions included.

        Notes
        -----
        With the end hinged the count is known. To free the end, or to clamp it, moves each
        frequency at most to its neighbour, and the characteristic determinant changes its sign at
        each frequency: which of two neighbouring counts is right follows from its sign. This is
        the count of Wittrick and Williams 1971 for one member.
        """
        if self.kind == "both":
            hinged = Family(kind="odd", end="clamped", span=2 * self.span)
            whole = Waves.at(waves.beam, waves.squared, 2 * self.span)
            least, step = hinged.count(whole), 1
        else:
            least, step = self._count_hinged(waves), 1 if self.end == "free" else -1
        determinant = np.linalg.det(self._conditions(waves))
        upward = self.end == "clamped" and self.kind != "both"
        even = (determinant > 0) == upward
        return least + step * ((least % 2 == 0) != even)

    def _count_hinged(self, waves: Waves) -> Index:
        """Return how many frequencies lie below with the end hinged."""
        phase = waves.first * self.span / np.pi
        travels = waves.second < 0
        other = np.sqrt(np.abs(waves.second)) * self.span / np.pi
        if self.kind == "even":
            counts = np.floor(phase + 0.5) + travels * np.floor(other + 0.5)
        else:
            counts = np.floor(phase) + travels * (np.floor(other) + 1)
        return counts.astype(np.int64)

    def _conditions(self, waves: Waves) -> Array:
        """Return what must vanish for each wave of the family, (M, 2, 2) or (M, 4, 4)."""
        rows = _at(self.end, waves)
        if self.kind == "both":
            other = "free" if self.end == "clamped" else "clamped"
            rows = np.concatenate([_at(other, waves) * REFLECTION, rows], axis=1)
        return rows[:, :, _COLUMNS[self.kind]]


def families(ends: tuple[str, str]) -> tuple[float, list[Family]]:
    """Return the origin of the motions that a beam has, in lengths from x = 0, and their families.

    Parameters
    ----------
    ends : pair of str
        Of `ENDS`, at x = 0 and at x = length.
    """
    near, far = ends
    if near in _MIRRORS:
        return 0.0, [Family(kind=_MIRRORS[near], end=far, span=1.0)]
    if far in _MIRRORS:
        return 1.0, [Family(kind=_MIRRORS[far], end=near, span=1.0)]
    kinds = ("even", "odd") if near == far else ("both",)
    return 0.5, [Family(kind=kind, end=far, span=0.5) for kind in kinds]


def _at(end: str, waves: Waves) -> Array:
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


def _halved(count: Callable[[Array], Index], numbers: Index, low: Array, high: Array) -> Array:
    """Return where the count reaches each number, between bounds."""
    below, above = np.full(len(numbers), low[0]), np.full(len(numbers), high[0])
    for _ in range(_HALVINGS):
        middle = (below + above) / 2
        reached = count(middle) >= numbers
        below, above = np.where(reached, below, middle), np.where(reached, middle, above)
    return (below + above) / 2
