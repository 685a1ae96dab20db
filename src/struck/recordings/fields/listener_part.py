"""Listener parts between the places that were listened at, outside of a body and inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.survey import distinct
from struck.recordings.fields.outgoing import ORDER
from struck.recordings.fields.waves import Waves

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inside:
    """What is added to outgoing waves around listeners inside a body.

    Parameters
    ----------
    places : array (I, 3)
        From the centre, m.
    corrections : array (I, M), complex
    reach : float
        From where on nothing is added, m: up to the nearest listener outside.
    """

    places: Array
    corrections: Complex
    reach: float

    @classmethod
    def of(cls, places: Array, missing: Complex, outside: Array) -> Inside:
        """Let what is missing (I, M) at places (I, 3) fade away up to the listeners outside."""
        gaps = np.linalg.norm(places[:, None] - outside, axis=2)
        reach = float(gaps.min()) if gaps.size else 1.0
        matrix = _closeness(places, places, reach)
        return cls(places=places, corrections=_solved(matrix, missing), reach=reach)

    def at(self, places: Array) -> Complex:
        """Return what is added at places (L, 3): (L, M)."""
        return _closeness(places, self.places, self.reach) @ self.corrections

    def chosen(self, modes: Index, size: float, factor: float) -> Inside:
        """Return some modes of a body `size` times as large, times a factor."""
        return Inside(
            places=self.places * size,
            corrections=np.ascontiguousarray(self.corrections[:, modes] * factor),
            reach=self.reach * size,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ListenerPart:
    """Complex outputs over places, relative to the arrival time r/c.

    Parameters
    ----------
    waves : Waves
    inside : Inside
    mirrored, turned : bool
        Whether outputs are even in y; whether they are given by angular order.
    """

    waves: Waves
    inside: Inside
    mirrored: bool
    turned: bool

    @classmethod
    def of(
        cls,
        places: Array,
        outputs: Complex,
        weights: Array,
        wave_numbers: Array,
        *,
        radius: float = 0.0,
        mirrored: bool = False,
        turned: bool = False,
    ) -> ListenerPart:
        """Fit outputs (Q, M), each counting with its weight, at places (Q, 3) from the centre.

        Places nearer than `radius` are inside.

        Raises
        ------
        OptionError
            When no listener is outside, or one stands on the centre without a radius.
        """
        distances = np.linalg.norm(places, axis=1)
        outside = (distances >= radius) & (distances > 0)
        if not outside.any() or np.any(distances[~outside] >= radius):
            raise OptionError(
                f"{np.count_nonzero(outside)} of {len(places)} listeners are off the centre and at "
                f"least radius={radius:g} m from it: one must be, and one on the centre needs a "
                "radius= above 0"
            )
        waves = Waves.of(
            places[outside],
            outputs[outside],
            weights[outside],
            wave_numbers,
            radius=radius,
            mirrored=mirrored,
        )
        part = cls(
            waves=waves,
            inside=Inside.of(np.zeros((0, 3)), np.zeros((0, len(wave_numbers)), complex), places),
            mirrored=mirrored,
            turned=turned,
        )
        return part._with_inside(places[~outside], outputs[~outside], places[outside])

    @property
    def rank(self) -> int:
        """How many products there are."""
        return 2 * ORDER + 1 if self.turned else 1

    def at(self, places: Array) -> Complex:
        """Return outputs at places (L, 3) from the centre: (L, R, M)."""
        if not self.turned:
            heard = self.waves.at(places) + self.inside.at(self._folded(places))
            return heard[:, None]
        heard = self.waves.turned(places)
        heard[:, 0] += self.inside.at(self._folded(places))
        return heard

    def chosen(self, modes: Index, size: float, factor: float) -> ListenerPart:
        """Return some modes of a body `size` times as large, times a factor."""
        return ListenerPart(
            waves=self.waves.chosen(modes, size, factor),
            inside=self.inside.chosen(modes, size, factor),
            mirrored=self.mirrored,
            turned=self.turned,
        )

    def _with_inside(self, places: Array, outputs: Complex, outside: Array) -> ListenerPart:
        if not len(places):
            return self
        missing = outputs - self.waves.at(places)
        folded, number = distinct(self._folded(places))
        share = np.eye(len(folded))[number]
        missing = share.T @ missing / share.sum(axis=0)[:, None]
        inside = Inside.of(folded, missing, self._folded(outside))
        return ListenerPart(
            waves=self.waves, inside=inside, mirrored=self.mirrored, turned=self.turned
        )

    def _folded(self, places: Array) -> Array:
        """Return places with those that sound alike inside as one.

        A contact may lie at any azimuth: then only the distance from the axis counts.
        """
        x, y, z = places.T
        if self.turned:
            return np.stack([np.hypot(x, y), np.zeros_like(x), z], axis=1)
        return np.stack([x, np.abs(y) if self.mirrored else y, z], axis=1)


def _solved(matrix: Array, sides: Complex) -> Complex:
    return np.asarray(np.linalg.solve(matrix, sides), np.complex128)


def _closeness(some: Array, others: Array, reach: float) -> Array:
    """Return 1 at no distance and 0 from `reach` on, twice differentiable (Wendland 1995)."""
    distances = np.linalg.norm(some[:, None] - others, axis=2) / reach
    return np.maximum(1 - distances, 0.0) ** 4 * (4 * distances + 1)
