"""Log of a simulation: contacts and motion of its bodies, noted step by step by any engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, Index
from struck.scene.contacts import Contacts, Poses
from struck.scene.engines.links import Link

_POSE_RATE = 240.0  # Hz, at which bodies are placed that touch nothing
_IMPULSE_COLUMNS = slice(13, 16)  # columns of a row


class StepLog:
    """Rows of contacts, and poses, of the links of a model."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._links, self._last = links, -np.inf
        self._rows = [np.zeros((0, _IMPULSE_COLUMNS.stop))]
        self._poses: list[tuple[float, Array, Array]] = []

    def touch(
        self,
        time: float,
        step: float,
        pairs: Index,
        points: Array,
        normals: Array,
        velocities: Array,
        impulses: Array,
    ) -> None:
        """Record the contacts of one step, (K, ...), summed for one pair at one place."""
        clock = np.broadcast_to([time, step], (len(pairs), 2))
        rows = np.hstack([clock, pairs.astype(np.float64), points, normals, velocities, impulses])
        is_duplicate = (
            rows[1:, : _IMPULSE_COLUMNS.start] == rows[:-1, : _IMPULSE_COLUMNS.start]
        ).all(axis=1)
        if is_duplicate.any():
            first = np.flatnonzero(np.append(True, ~is_duplicate))
            sums = np.add.reduceat(rows[:, _IMPULSE_COLUMNS], first, axis=0)
            rows = rows[first]
            rows[:, _IMPULSE_COLUMNS] = sums
        self._rows.append(rows)

    def is_due(self, time: float) -> bool:
        """Return whether bodies are to be placed at a time, s, without a contact."""
        return time - self._last >= 1 / _POSE_RATE - 1e-9

    def pose(self, time: float, positions: Array, rotations: Array) -> None:
        """Note where the frames of all links are: (links, 3), and quaternions (links, 4)."""
        self._last = time
        self._poses.append((time, positions, rotations))

    def contacts(self, notes: tuple[str, ...] = (), *, forget: bool = False) -> Contacts:
        """Return the log so far, or since the last call with `forget`."""
        if not self._poses:
            raise OptionError("nothing was noted: call step(data) after each mj_step")
        rows = np.concatenate(self._rows)
        time, step, body0, body1 = rows[:, :4].T
        position, normal, velocity, impulse = np.split(rows[:, 4:], (3, 6, 9), axis=1)
        poses = self._compute_poses()
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

    def _compute_poses(self) -> Poses:
        """Return where the coordinates of all shapes are."""
        times = np.array([time for time, _, _ in self._poses])
        parts = []
        for number, link in enumerate(self._links):
            poses = self._poses[:1] if link.fixed else self._poses  # a fixed body needs one row
            positions = np.stack([position[number] for _, position, _ in poses])
            rotations = np.stack([rotation[number] for _, _, rotation in poses])
            pose_times = times[: len(poses)]
            coordinates = link.placement.carried(positions, rotations)
            parts.append((pose_times, np.full(len(pose_times), number), *coordinates))
        time, body, position, rotation = (
            np.concatenate(columns) for columns in zip(*parts, strict=True)
        )
        return Poses(time=time, body=body, position=position, rotation=rotation)
