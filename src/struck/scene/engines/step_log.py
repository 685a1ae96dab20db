"""Log of a simulation: contacts and motion of its bodies, noted step by step by any engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, Index
from struck.scene.contacts import Contacts, Poses
from struck.scene.engines.links import Link

_POSES = 240.0  # Hz, at which bodies are placed that touch nothing
_IMPULSE = slice(13, 16)  # columns of a row


class StepLog:
    """Rows of contacts, and poses, of the links of a model."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._links, self._last = links, -np.inf
        self._rows = [np.zeros((0, _IMPULSE.stop))]
        self._poses: list[tuple[float, Array, Array]] = []

    def touch(
        self,
        time: float,
        step: float,
        pairs: Index,
        places: Array,
        normals: Array,
        velocities: Array,
        impulses: Array,
    ) -> None:
        """Record the contacts of one step, (K, ...), summed for one pair at one place."""
        clock = np.broadcast_to([time, step], (len(pairs), 2))
        rows = np.hstack([clock, pairs.astype(np.float64), places, normals, velocities, impulses])
        alike = (rows[1:, : _IMPULSE.start] == rows[:-1, : _IMPULSE.start]).all(axis=1)
        if alike.any():
            first = np.flatnonzero(np.append(True, ~alike))
            sums = np.add.reduceat(rows[:, _IMPULSE], first, axis=0)
            rows = rows[first]
            rows[:, _IMPULSE] = sums
        self._rows.append(rows)

    def due(self, time: float) -> bool:
        """Return whether bodies are to be placed at a time, s, without a contact."""
        return time - self._last >= 1 / _POSES - 1e-9

    def pose(self, time: float, places: Array, turns: Array) -> None:
        """Note where the frames of all links are: (links, 3), and quaternions (links, 4)."""
        self._last = time
        self._poses.append((time, places, turns))

    def contacts(self, notes: tuple[str, ...] = (), *, forget: bool = False) -> Contacts:
        """Return the log so far; or since it was asked to forget all that it had returned."""
        if not self._poses:
            raise OptionError("nothing was noted: call step(data) after each mj_step")
        rows = np.concatenate(self._rows)
        time, step, body0, body1 = rows[:, :4].T
        position, normal, velocity, impulse = np.split(rows[:, 4:], (3, 6, 9), axis=1)
        poses = self._placed()
        if forget:
            self._rows, self._poses = self._rows[:1], self._poses[-1:]
        return Contacts(
            names=[link.name for link in self._links],
            time=time,
            dt=step,
            body0=body0,
            body1=body1,
            position=position,
            normal=normal,
            impulse=impulse,
            velocity=velocity,
            poses=poses,
            notes=notes,
        )

    def _placed(self) -> Poses:
        """Return where the coordinates of all shapes are."""
        times = np.array([time for time, _, _ in self._poses])
        parts = []
        for number, link in enumerate(self._links):
            poses = self._poses[:1] if link.fixed else self._poses  # what stands needs one row
            places = np.stack([place[number] for _, place, _ in poses])
            turns = np.stack([turn[number] for _, _, turn in poses])
            here = times[: len(poses)]
            moved = link.placement.carried(places, turns)
            parts.append((here, np.full(len(here), number), *moved))
        time, body, position, rotation = (np.concatenate(each) for each in zip(*parts, strict=True))
        return Poses(time=time, body=body, position=position, rotation=rotation)
