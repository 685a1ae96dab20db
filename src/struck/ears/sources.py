"""Bodies as ears know them, and their images in the walls of a room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.ears.head import Array
from struck.ears.room import Room
from struck.ears.trajectory import Trajectory
from struck.model.air import AIR


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emitter:
    """Where the sound of a body comes from.

    Parameters
    ----------
    centre : Trajectory
        Where it seems to come from, m.
    radius : float
        Of the ball about it that nobody may enter, m.
    field : bool
        Whether the body's own gains tell what each ear gets: then it has a line for each ear, and
        no distance law and no head shadow comes on top.
    """

    centre: Trajectory
    radius: float = 0.0
    field: bool = False


class Sources:
    """Bodies and their mirror images.

    Parameters
    ----------
    emitters : sequence of Emitter
    signs, offsets : array (I, 3)
        An image of what is at p is at signs * p + offsets; the first is the body itself.
    """

    def __init__(self, emitters: Sequence[Emitter], signs: Array, offsets: Array) -> None:
        self._emitters, self._signs, self._offsets = emitters, signs, offsets
        images = len(signs)
        self.emitter = np.repeat(np.arange(len(emitters)), images)
        self.image = np.tile(np.arange(images), len(emitters))
        self.direct = images * self.emitter
        self.field = np.repeat([each.field for each in emitters], images)
        self.radius = np.repeat([each.radius for each in emitters], images)

    @classmethod
    def of(cls, emitters: Sequence[Emitter], room: Room | None) -> Sources:
        """Return bodies alone, or with the images that walls make."""
        if room is None:
            return cls(emitters, np.ones((1, 3)), np.zeros((1, 3)))
        images = room.images()
        return cls(emitters, images.signs, images.offsets)

    @property
    def moves(self) -> bool:
        """Whether any body may move."""
        return any(each.centre.moves for each in self._emitters)

    def at(self, times: Array, ways: Array) -> Array:
        """Return where sources were when they sent what has gone a way.

        Parameters
        ----------
        times : array (n,)
            Of arrival, s.
        ways : array (n, sources)
            m.

        Returns
        -------
        array (n, sources, 3)
        """
        sent = times[:, None] - ways / AIR.sound_speed
        shape = len(times), len(self._emitters), len(self._signs)
        moments = sent.reshape(shape).swapaxes(0, 1).reshape(len(self._emitters), -1)
        centres = [each.centre.at(its) for each, its in zip(self._emitters, moments, strict=True)]
        apart = np.array(centres).reshape(shape[1], shape[0], shape[2], 3).swapaxes(0, 1)
        return (self._signs * apart + self._offsets).reshape(*ways.shape, 3)
