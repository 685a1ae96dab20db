"""Sustained contact: two bodies that slide or roll on each other, as one force on both.

A lasting load is silent; the roughness that passes under it sounds. The speed is computed for each
body separately: the contact of a box that slides over a floor rests on the box and sweeps the
floor, so that the roughness of the floor is read at the speed of the box, that of the box not at
all. Where a wheel rolls, both are read at the same speed. The compressions of the dent by both add
up to one force, which pushes the two bodies with opposite sign, each at its own place.

The speed of sweeping is how fast the points of contact move in a body's own coordinates. A
simulation moves its load from point to point as it likes, so only points that are there in both of
two steps count, those that leap farther than the bodies move left out.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from struck.excitation.excitation import Push, drives_at
from struck.excitation.hertz import contact_modulus
from struck.excitation.roughness import finish
from struck.excitation.scraping_force import (
    FADE_SECONDS,
    ROLLER_FRACTION,
    TIP_FRACTION,
    Reader,
    SlidingContact,
    fading,
    force_variation,
)
from struck.excitation.texture import CHUNK
from struck.model.arrays import Array, Index
from struck.model.material import Material, materials
from struck.model.model import ModalModel
from struck.scene.body import Body, centre_of, material_of
from struck.scene.contacts import Contacts
from struck.scene.impact_detection import ImpactDetection, Pair

_SMOOTHING_SECONDS = (
    30e-3  # s, over which load, place and speed are averaged: no step of the solver is left
)
_CONTROL_SECONDS = 5e-3  # s, from one value of these to the next
_MIN_SPEED, _FULL_SPEED = 1e-3, 3e-3  # m/s: slower is at rest, faster sounds in full
_LEAP_RATIO = 3.0  # times the speed of the bodies there: faster points are others than before
_SLACK_SPEED = 0.02  # m/s, that a point may move beyond that
_TIP_RADIUS = 5e-3  # m, radius of the bumps on which flat things touch
_ROLLING_RATIO = (
    0.5  # of the faster sweep: where the slower one is as fast as that, something rolls
)
_SAME_DISTANCE = 1e-6  # m, or of a unit vector: smaller steps count as none
_GROUPS = {
    "metal": "steel",
    "glass": "glass",
    "ceramic": "ceramic",
    "stone": "concrete",
    "wood": "wood",
    "plastic": "plastic",
}
_HARD_MODULUS = 3e10  # Pa: unknown materials of a higher modulus are as smooth as steel
_MIN_VALUES = 4  # values of a contact that lasts


@dataclass(frozen=True, kw_only=True, eq=False)
class SustainedContact:
    """A contact of two bodies under a load, over time.

    Parameters
    ----------
    first : int
        Number of the body that the load pushes against its direction.
    second : int
        Number of the body that the load pushes.
    times : array (S,)
        Evenly spaced, s.
    load : array (S,)
        N.
    normals : pair of arrays (S, 3)
        Direction of the load in the coordinates of each body.
    points : pair of arrays (S, 3)
        Position of the contact in the coordinates of each body, m.
    sweeps : pair of arrays (S, 3)
        How fast the contact moves over each body, in its coordinates, m/s.
    surfaces : pair of SlidingContact
        Roughness of each body, with the stiffness of the contact.
    begins : pair of arrays (3,), or None
        Start on the roughness of each body, m. Default: its first points.
    """

    first: int
    second: int
    times: Array
    load: Array
    normals: Sequence[Array]
    points: Sequence[Array]
    sweeps: Sequence[Array]
    surfaces: Sequence[SlidingContact]
    begins: Sequence[Array] | None = None
    _forces: dict[tuple[float, int], Array] = field(init=False, default_factory=dict, repr=False)
    _making: threading.Lock = field(init=False, default_factory=threading.Lock, repr=False)

    def row(self, names: Sequence[str]) -> Mapping[str, object]:
        """Return the contact as a row of the table of events."""
        return {
            "event": "sustained",
            "time": float(self.times[0]),
            "seconds": float(self.times[-1] - self.times[0]),
            "body0": names[self.first],
            "body1": names[self.second],
            "load": float(self.load.mean()),
            "sweep0": float(self.speeds[0].max()),
            "sweep1": float(self.speeds[1].max()),
        }

    @property
    def speeds(self) -> Sequence[Array]:
        """How fast the contact moves over each body, m/s (S,)."""
        return [np.linalg.norm(sweep, axis=1) for sweep in self.sweeps]

    @property
    def rolls(self) -> bool:
        """Whether the contact moves at similar speeds over both bodies, as that of a wheel does."""
        return _rolling(self.sweeps)

    @property
    def surface_paths(self) -> Sequence[Array]:
        """Path of the contact on the roughness of each body, m (S, 3).

        It is the integral of the sweep, without leaps of the load from point to point.
        """
        start_points = [points[0] for points in self.points] if self.begins is None else self.begins
        gaps = np.diff(self.times)[:, None]
        steps = (gaps * (sweep[1:] + sweep[:-1]) / 2 for sweep in self.sweeps)
        displacements = (
            np.cumsum(np.vstack([np.zeros((1, 3)), side_steps]), axis=0) for side_steps in steps
        )
        return [
            start + displacement
            for start, displacement in zip(start_points, displacements, strict=True)
        ]

    def cut(self, begin: float, end: float) -> SustainedContact:
        """Return the part of the contact between two times, s."""
        times = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / _CONTROL_SECONDS)) + 1))

        def interpolate(values: Array) -> Array:
            return np.stack([np.interp(times, self.times, column) for column in values.T], axis=1)

        return replace(
            self,
            times=times,
            load=np.interp(times, self.times, self.load),
            normals=[_unit(interpolate(values)) for values in self.normals],
            points=[interpolate(values) for values in self.points],
            sweeps=[interpolate(values) for values in self.sweeps],
            begins=[interpolate(values)[0] for values in self.surface_paths],
        )

    def on(self, model: ModalModel, *, first: bool, seed: int) -> Rub:
        """Return the force of the contact on one of its two bodies."""
        side = 0 if first else 1
        sign = -1.0 if first else 1.0
        locator = getattr(model.gains, "locator", None)
        points = self.points[side]
        if locator is not None:
            points = locator.closest(points)[2]
        return Rub(contact=self, points=points, directions=sign * self.normals[side], seed=seed)

    def force(self, sample_rate: float, seed: int) -> Array:
        """Return the force beyond the load, sample by sample from the first time on, N (n,)."""
        with self._making:
            if (sample_rate, seed) not in self._forces:
                self._forces[sample_rate, seed] = self._read(sample_rate, seed)
            return self._forces[sample_rate, seed]

    def _read(self, sample_rate: float, seed: int) -> Array:
        count = max(1, round((self.times[-1] - self.times[0]) * sample_rate))
        control_times = self.times[0] + np.arange(0, count + 2 * CHUNK, CHUNK) / sample_rate
        loads = np.interp(control_times, self.times, self.load)
        compressions = np.zeros(count)
        for number, surface, sweep, path in zip(
            (self.first, self.second), self.surfaces, self.sweeps, self.surface_paths, strict=True
        ):
            if sweep.any():
                reader = Reader(replace(surface, seed=seed + number), sample_rate)
                self._add_compression(reader, sample_rate, path, sweep, loads, compressions)
        moments = self.times[0] + np.arange(count) / sample_rate
        fade_samples = max(1, round(FADE_SECONDS * sample_rate))
        fade_gains = fading(0, count, fade_samples, max(0, count - fade_samples))
        return force_variation(compressions, np.interp(moments, self.times, self.load)) * fade_gains

    def _add_compression(
        self,
        reader: Reader,
        sample_rate: float,
        path: Array,
        sweep: Array,
        loads: Array,
        out: Array,
    ) -> None:
        """Add to `out` (n,) the change of the dent by a body's surface, a second at a time."""
        speeds = np.linalg.norm(sweep, axis=1)
        path_lengths = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
        )
        for first in range(0, len(out), _BLOCK_SAMPLES):
            part = slice(first, min(first + _BLOCK_SAMPLES, len(out)))
            moments = self.times[0] + np.arange(part.start, part.stop) / sample_rate
            rows = slice(first // CHUNK, -(-part.stop // CHUNK) + 1)
            control_times = self.times[0] + np.arange(rows.start, rows.stop) * (CHUNK / sample_rate)
            pace = np.interp(control_times, self.times, speeds)
            moving = np.clip((pace - _MIN_SPEED) / (_FULL_SPEED - _MIN_SPEED), 0, 1)
            points = np.stack([np.interp(moments, self.times, axis) for axis in path.T], axis=1)
            distances = np.interp(moments, self.times, path_lengths)
            compressions = reader.compressions(0, points, distances, pace, loads[rows])
            out[part] += compressions * np.interp(moments, control_times, moving)


_BLOCK_SAMPLES = 750 * CHUNK  # samples, so that memory does not grow with how long a contact lasts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rub:
    """One side of a sustained contact: an excitation.

    Parameters
    ----------
    contact : SustainedContact
    points : array (S, 3)
        On the body's surface, m.
    directions : array (S, 3)
        Unit vectors of the force, in the body's coordinates.
    seed : int
        Where on their roughness the two begin.
    """

    contact: SustainedContact
    points: Array
    directions: Array
    seed: int

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Playing:
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`."""
        return Playing(self, model, sample_rate, start=start)


class Playing:
    """A `Pushing` that plays one side of a sustained contact."""

    def __init__(self, rub: Rub, model: ModalModel, sample_rate: float, *, start: int) -> None:
        self._rub, self._rate, self._next_sample = rub, sample_rate, start
        self._force = rub.contact.force(sample_rate, rub.seed)
        times = rub.contact.times
        self._start, self._interval = float(times[0]), float(times[1] - times[0])
        self._first = round(self._start * sample_rate)
        self.change(model)

    def put_off(self, samples: int) -> int:
        """Delay the start by a number of samples; return the first sample."""
        self._start += samples / self._rate
        self._first += samples
        return self._first

    def resume(self, sample: int) -> None:
        """Continue in the block that begins at this sample."""
        self._next_sample = sample

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        offset = self._next_sample - self._first
        self._next_sample += length
        force = self._force[max(offset, 0) : max(offset + length, 0)]
        if not len(force):
            return None
        if len(force) < length:
            before = max(-offset, 0)
            force = np.pad(force, (before, length - before - len(force)))
        return Push(force=force, drive=self._drive_at(self._next_sample / self._rate))

    def change(self, model: ModalModel) -> None:
        """Push at the same places of a body that has changed."""
        points, directions = self._rub.points, self._rub.directions
        steps = np.abs(np.diff(np.hstack([points, directions]), axis=0)).max(axis=1, initial=0)
        is_new = np.concatenate([[True], steps > _SAME_DISTANCE])
        drives = list(drives_at(model, points[is_new], directions[is_new]))
        self._places = [drives[number] for number in (np.cumsum(is_new) - 1).tolist()]

    def _drive_at(self, time: float) -> Array:
        """Return how strongly each mode answers at the place of a time, s (M,)."""
        position = min(max((time - self._start) / self._interval, 0.0), len(self._places) - 1.0)
        low = min(int(position), len(self._places) - 2)
        low_drive, high_drive = self._places[low], self._places[low + 1]
        if low_drive is high_drive:
            return low_drive
        fraction = position - low
        return (1 - fraction) * low_drive + fraction * high_drive

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._next_sample >= self._first + len(self._force)


def find_sustained(
    pair: Pair, detection: ImpactDetection, contacts: Contacts, bodies: Sequence[Body]
) -> Sequence[SustainedContact]:
    """Return the sustained contacts of a pair, in which a contact point moves."""
    rows = np.flatnonzero(detection.contact >= 0)
    parts = np.split(rows, np.flatnonzero(np.diff(detection.contact[rows])) + 1)
    candidates = (
        _build_contact(pair, detection, contacts, bodies, part) for part in parts if len(part)
    )
    return [contact for contact in candidates if contact is not None]


def _build_contact(
    pair: Pair,
    detection: ImpactDetection,
    contacts: Contacts,
    bodies: Sequence[Body],
    part_rows: Index,
) -> SustainedContact | None:
    """Return one sustained contact; None where its contact point rests."""
    rows = pair.rows[part_rows]
    steps = np.round((contacts.time[rows] - contacts.time[rows[0]]) / detection.step)
    step = np.unique(steps, return_inverse=True)[1].astype(np.int64)
    strengths = np.linalg.norm(contacts.impulse[rows], axis=1)
    moments = np.zeros(step[-1] + 1)
    moments[step] = contacts.time[rows]
    track = _Track(moments=moments, step=step, weights=np.maximum(strengths, 1e-12))
    times = track.control()
    if len(times) < _MIN_VALUES:
        return None
    frames = [_Frame.of(body, moments) for body in bodies]
    velocity = None if contacts.velocity is None else contacts.velocity[rows]
    max_speeds = _compute_speeds(frames, track, velocity)
    if max_speeds.max() <= _MIN_SPEED:
        return None
    points = contacts.position[rows]
    partners = track.partners(points, None if contacts.id is None else contacts.id[rows])
    sides = [frame.to_body(points, step) for frame in frames]
    normals = contacts.normal[rows] * pair.sign[part_rows, None]
    local_normals = [frame.to_axes(normals, step) for frame in frames]
    sweeps = [
        track.sweep(points, directions, partners, max_speeds, times)
        for points, directions in zip(sides, local_normals, strict=True)
    ]
    if not any(sweep.any() for sweep in sweeps):
        return None
    load = np.zeros(len(moments))
    load[step] = detection.load[part_rows]
    return SustainedContact(
        first=pair.first,
        second=pair.second,
        times=times,
        load=track.smooth(load[:, None], times)[:, 0],
        normals=[_unit(track.smooth(track.mean(vectors), times)) for vectors in local_normals],
        points=[track.smooth(track.mean(vectors), times) for vectors in sides],
        sweeps=sweeps,
        surfaces=_make_surfaces(bodies, sweeps),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Track:
    """The steps of a contact that lasts, and the rows in each."""

    moments: Array  # (T,), begin of each step, s
    step: Index  # (n,), of each row
    weights: Array  # (n,), its impulse, N s

    def mean(self, values: Array) -> Array:
        """Return the weighted mean of rows (n, D) in each step (T, D)."""
        sums, weights = np.zeros((len(self.moments), values.shape[1])), np.zeros(len(self.moments))
        np.add.at(sums, self.step, self.weights[:, None] * values)
        np.add.at(weights, self.step, self.weights)
        return sums / weights[:, None]

    def control(self) -> Array:
        """Return evenly spaced times over the contact, s (S,)."""
        seconds = self.moments[-1] - self.moments[0]
        return np.linspace(self.moments[0], self.moments[-1], int(seconds / _CONTROL_SECONDS) + 1)

    def smooth(self, values: Array, times: Array, weights: Array | None = None) -> Array:
        """Return values of steps (T, D), averaged over a Hann window about each time (S, D)."""
        step_weights = np.ones(len(self.moments)) if weights is None else weights
        # Straight lines through the sums up to each step are averaged exactly, twice: a triangle.
        half = _SMOOTHING_SECONDS / 2
        sums = np.zeros((len(times), values.shape[1] + 1))
        for shift, weight in ((-half / 2, 0.25), (0.0, 0.5), (half / 2, 0.25)):
            sums += weight * self._box(
                np.column_stack([values * step_weights[:, None], step_weights]), times + shift, half
            )
        return sums[:, :-1] / np.maximum(sums[:, -1:], 1e-12)

    def _box(self, values: Array, times: Array, width: float) -> Array:
        """Return means of values (T, D) over a width about times (S, D), s."""
        gaps = np.diff(self.moments, append=2 * self.moments[-1] - self.moments[-2])
        edges = np.concatenate([self.moments - gaps / 2, [self.moments[-1] + gaps[-1] / 2]])
        cumulative_sums = np.concatenate(
            [np.zeros((1, values.shape[1])), np.cumsum(values * gaps[:, None], axis=0)]
        )
        low, high = (
            np.stack(
                [np.interp(times + side, edges, column) for column in cumulative_sums.T], axis=1
            )
            for side in (-width / 2, width / 2)
        )
        return high - low

    def partners(self, points: Array, ids: Index | None) -> Index:
        """Return the row of the next step that is the same point of contact (n,), -1 for none."""
        size = float(np.ptp(points, axis=0).max()) + 1e-3
        step_offset = 4.0 * size
        keys = np.column_stack([self.step * step_offset, points])
        if ids is not None:
            keys = np.column_stack([keys, (ids % 4096) * step_offset])
        next_keys = keys.copy()
        next_keys[:, 0] += step_offset
        distances, partner = cKDTree(keys).query(next_keys, distance_upper_bound=2 * size)
        return np.where(np.isfinite(distances), partner, -1)

    def sweep(
        self, points: Array, normals: Array, partners: Index, max_speeds: Array, times: Array
    ) -> Array:
        """Return how fast the contact moves over a body, in its coordinates, m/s (S, 3)."""
        rows = np.flatnonzero(partners >= 0)
        gap = self.moments[self.step[partners[rows]]] - self.moments[self.step[rows]]
        speeds = (points[partners[rows]] - points[rows]) / gap[:, None]
        # Along the normal a soft solver lets bodies sink into each other: that sweeps nothing. A
        # chord of a round surface is at right angles to the mean of its normals there.
        mean_normals = _unit(normals[rows] + normals[partners[rows]])
        normal_speeds = np.einsum("kd,kd->k", speeds, mean_normals)
        speeds = speeds - normal_speeds[:, None] * mean_normals
        is_same = (
            np.linalg.norm(speeds, axis=1)
            <= _LEAP_RATIO * max_speeds[self.step[rows]] + _SLACK_SPEED
        )
        rows, speeds = rows[is_same], speeds[is_same]
        step_weights: Array = np.zeros(len(self.moments))
        means: Array = np.zeros((len(self.moments), 3))
        np.add.at(step_weights, self.step[rows], self.weights[rows])
        np.add.at(means, self.step[rows], self.weights[rows, None] * speeds)
        means /= np.maximum(step_weights, 1e-300)[:, None]
        velocities = self.smooth(means, times, step_weights)
        return np.where(
            np.linalg.norm(velocities, axis=1, keepdims=True) > _MIN_SPEED, velocities, 0.0
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Frame:
    """Where a body is at each step of a contact."""

    origins: Array  # (T, 3), m
    rotations: Array  # (T, 3, 3)
    centres: Array  # (T, 3), of the body, in the scene, m

    @classmethod
    def of(cls, body: Body, moments: Array) -> _Frame:
        """Return where a body is at moments (T,), s."""
        origins, rotations = body.origin.at(moments), body.orientation.at(moments)
        return cls(
            origins=origins,
            rotations=rotations,
            centres=origins + rotations @ centre_of(body.model),
        )

    def to_body(self, points: Array, step: Index) -> Array:
        """Return places of the scene in steps (n,) in the body's coordinates, m (n, 3)."""
        return self.to_axes(points - self.origins[step], step)

    def to_axes(self, vectors: Array, step: Index) -> Array:
        """Return vectors of the scene in steps (n,) in the body's coordinates (n, 3)."""
        return np.einsum("kd,kde->ke", vectors, self.rotations[step])


def _compute_speeds(frames: Sequence[_Frame], track: _Track, velocity: Array | None) -> Array:
    """Return how fast two bodies move along each other, rolling included, m/s (T,)."""
    moments, speeds = track.moments, np.zeros(len(track.moments))
    if len(moments) > 1:
        step_numbers = np.arange(len(moments))
        for frame, other_frame in (frames, frames[::-1]):
            steps = np.gradient(other_frame.to_body(frame.centres, step_numbers), axis=0)
            steps /= np.gradient(moments)[:, None]
            speeds = np.maximum(speeds, np.linalg.norm(steps, axis=1))
    if velocity is not None:
        speeds = np.maximum(speeds, np.linalg.norm(track.mean(velocity), axis=1))
    return speeds


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _rolling(sweeps: Sequence[Array]) -> bool:
    """Return whether the slower of two sweeps (S, 3) is about as fast as the other one."""
    slow_speed, fast_speed = sorted(float(np.linalg.norm(sweep, axis=1).mean()) for sweep in sweeps)
    return slow_speed > _ROLLING_RATIO * fast_speed


def _make_surfaces(bodies: Sequence[Body], sweeps: Sequence[Array]) -> Sequence[SlidingContact]:
    """Return the sliding contact of each body, for a sliding tip or a rolling body."""
    body_materials = [material_of(body.model) for body in bodies]
    solids = [material for material in body_materials if material is not None]
    extents = [b.model.geometry.extent for b in bodies if b.model.geometry is not None]
    rolls = _rolling(sweeps)
    return [
        SlidingContact(
            roughness=finish(body.roughness or _default_roughness(material_of(body.model))),
            modulus=contact_modulus(*solids),
            radius=max(_TIP_RADIUS, min(extents, default=0.0) / 2) if rolls else _TIP_RADIUS,
            height_fraction=ROLLER_FRACTION if rolls else TIP_FRACTION,
        )
        for body in bodies
    ]


def _default_roughness(material: Material | None) -> str:
    if material is None:
        return "plastic"
    group = materials().get(material.name, {}).get("group", "")
    return _GROUPS.get(group) or ("steel" if material.youngs_modulus > _HARD_MODULUS else "plastic")
