"""Where a listener is and looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from struck.ears.head import Array
from struck.ears.listeners import Listener, axes
from struck.ears.sources import Emitter
from struck.ears.trajectory import Trajectory


class Posed(Protocol):
    """A head that is somewhere and looks somewhere; see `Pose`."""

    @property
    def ear_points(self) -> Array:
        """In the head's frame, m (ears, 3)."""
        ...

    @property
    def moves(self) -> bool:
        """Whether it may change."""
        ...

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the places of the head's centre and the ears, and its axes."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """A listener's head over time.

    Parameters
    ----------
    position, facing, up : Trajectory
    ear_points : array (ears, 3)
        In the head's frame, m.
    """

    position: Trajectory
    facing: Trajectory
    up: Trajectory
    ear_points: Array

    @classmethod
    def of(cls, listener: Listener, emitters: Sequence[Emitter]) -> Pose:
        """Return that of a listener.

        Where he does not say he is beside the first body and faces the middle of all, level; above,
        below or in the middle of them he looks along x, or y where x is up.
        """
        start = np.zeros(1)
        centres = np.concatenate([each.centre.at(start) for each in emitters])
        given = listener.position
        beside = centres[0] + aside(emitters[0].radius)
        position = Trajectory.of("position", beside if given is None else given)
        up, facing = Trajectory.of("up", listener.up), listener.facing
        if facing is None:
            ahead = centres.mean(axis=0) - position.at(start)[0]
            facing = _level(ahead, up.at(start)[0])
        return cls(
            position=position,
            facing=Trajectory.of("facing", facing),
            up=up,
            ear_points=listener.ear_points,
        )

    @property
    def moves(self) -> bool:
        """Whether it may change."""
        return self.position.moves or self.facing.moves or self.up.moves

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the places of the head's centre and the ears, and its axes.

        Returns
        -------
        places : array (n, 1 + ears, 3)
        axes : array (n, 3, 3)
            Rows forward, left and up.
        """
        if self.moves:
            return self._at(times)
        places, turned = self._rest
        return np.repeat(places, len(times), axis=0), np.repeat(turned, len(times), axis=0)

    @cached_property
    def _rest(self) -> tuple[Array, Array]:
        """What `at` says of who stays where he is."""
        return self._at(np.zeros(1))

    def _at(self, times: Array) -> tuple[Array, Array]:
        turned = axes(self.facing.at(times), self.up.at(times))
        centre = self.position.at(times)[:, None]
        return np.concatenate([centre, centre + self.ear_points @ turned], axis=1), turned


def aside(radius: float) -> Array:
    """Return a place well outside a ball, from its centre: along x, 1 m or two radii away (3,)."""
    return np.array([max(1.0, 2 * radius), 0.0, 0.0])


def _level(ahead: Array, up: Array) -> Array:
    """Return the part of a direction across `up`, or of x, or of y, where that is nothing."""
    for direction in (ahead, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        across = direction - up * (direction @ up) / max(up @ up, 1e-30)
        if np.linalg.norm(across) > 1e-6 * max(np.linalg.norm(ahead), 1.0):
            return across
    return ahead
