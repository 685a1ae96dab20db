"""A body in space: a model, where it is, and what pushes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.ears.pose import Emitter
from struck.ears.trajectory import Course3, Trajectory
from struck.errors import OptionError
from struck.excitation.hold import Hold
from struck.excitation.pushing import Excitation
from struck.model import ModalModel

Array = NDArray[np.float64]
Action = Excitation | Hold
"""What may happen to a body."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A model among others.

    Parameters
    ----------
    model : ModalModel
    excitations : an excitation, a Hold, or several of them
        In the body's own coordinates and the scene's time.
    position : array-like (3,), (times, points) or function of time
        Where the origin of the body's coordinates is in the scene, m.
    rotation : array-like (3, 3)
        From the body's coordinates to the scene's.

    Raises
    ------
    OptionError
        On nothing to happen, a position that is none, or a matrix that is no rotation.
    """

    model: ModalModel
    excitations: Action | Sequence[Action]
    position: Course3 = (0.0, 0.0, 0.0)
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        _require_actions(self.actions)
        Trajectory.of("position", self.position)
        object.__setattr__(self, "rotation", _rotation(self.rotation))

    @property
    def actions(self) -> Sequence[Action]:
        """All that happens to it."""
        if isinstance(self.excitations, Sequence):
            return tuple(self.excitations)
        return (self.excitations,)

    @property
    def radius(self) -> float:
        """Of the ball about its centre that holds it, m; 0 where its shape is unknown."""
        if self.model.geometry is None:
            return 0.0
        apart = self.model.geometry.points - self.centre
        return float(np.linalg.norm(apart, axis=1).max())

    @property
    def centre(self) -> Array:
        """Where its sound seems to come from, in its own coordinates, m."""
        return np.zeros(3) if self.model.centre is None else np.asarray(self.model.centre)

    @property
    def emitter(self) -> Emitter:
        """What ears need to know of it."""
        moved = np.asarray(self.rotation) @ self.centre
        origin = Trajectory.of("position", self.position)
        if origin.function is not None:
            place = origin.function
            centre = Trajectory.of("position", lambda time: np.asarray(place(time)) + moved)
        else:
            centre = Trajectory(name=origin.name, times=origin.times, points=origin.points + moved)
        return Emitter(centre=centre, radius=self.radius, field=self.model.gains.directional)


def _require_actions(actions: Sequence[object]) -> None:
    if not actions:
        raise OptionError("there is nothing to render: give at least one Strike")
    for each in actions:
        if not (isinstance(each, Hold) or callable(getattr(each, "begin", None))):
            raise OptionError(f"{each!r} is no excitation: give Strike(...) or several of them")


def _rotation(values: ArrayLike) -> Array:
    matrix = np.array(values, np.float64)
    if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6):
        raise OptionError(f"rotation is {values!r}: give a matrix (3, 3) with orthonormal rows")
    if np.linalg.det(matrix) < 0:
        raise OptionError(f"rotation is {values!r}: it mirrors; give one that turns")
    matrix.setflags(write=False)
    return matrix
