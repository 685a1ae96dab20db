"""A body in space: a model, where it is, and what pushes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Course3, Trajectory
from struck.ears.propagation import Emitter, aside
from struck.errors import OptionError
from struck.excitation.excitation import Excitation, Hold
from struck.model.arrays import Array, checked
from struck.model.model import ModalModel

Action = Excitation | Hold  # what may happen to a body


@checked
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
    def emitter(self) -> Emitter:
        """What ears need to know of it."""
        moved = np.asarray(self.rotation) @ centre_of(self.model)
        origin = Trajectory.of("position", self.position)
        if origin.function is not None:
            place = origin.function
            centre = Trajectory.of("position", lambda time: np.asarray(place(time)) + moved)
        else:
            centre = replace(origin, points=origin.points + moved)
        return emitter_at(self.model, centre)


def centre_of(model: ModalModel) -> Array:
    """Return where a model's sound seems to come from, in its own coordinates, m (3,)."""
    return np.zeros(3) if model.centre is None else np.asarray(model.centre)


def radius_of(model: ModalModel) -> float:
    """Return the radius of the ball about a model's centre that holds it, m; 0 where unknown."""
    if model.geometry is None:
        return 0.0
    return float(np.linalg.norm(model.geometry.points - centre_of(model), axis=1).max())


def emitter_at(model: ModalModel, centre: Trajectory) -> Emitter:
    """Return what ears need to know of a model whose centre is there."""
    return Emitter(centre=centre, radius=radius_of(model), field=model.gains.directional)


def place_beside(model: ModalModel) -> Array:
    """Return the default listener of a model, seen from its centre, m (3,)."""
    return aside(radius_of(model))


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
