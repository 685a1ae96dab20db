"""Contacts of a trajectory: impulses found where the motion of bodies has a kink.

An animation contains the poses of bodies, frame by frame, and no contacts. But a body without
contact flies on a parabola; where it is hit, its speed leaps by the impulse over its mass. With the
fall taken off, flights are straight lines, and a hit between two frames bends the second
differences D of the place at these two frames alone:

    D[k] + D[k+1] = h dv,    t = t[k+1] - h D[k] / (D[k] + D[k+1])

where h is the time between frames, dv the leap and t the time of the hit. Where flights on both
sides are long enough, both are extrapolated to where they meet, which also holds for a body that
rolls, swings or rests before or after. It was hit by the nearest body at that time; if that one is
free to move, its velocity must have leapt the other way.

A body that carries it for longer bends all second differences: that is a load, in rows of the
length of a frame.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from struck.errors import FileFormatError, MeshError, OptionError, counted
from struck.files.atomic import require_readable
from struck.files.gltf import motions_of
from struck.files.guard import read_foreign
from struck.model.arrays import Array, Index, checked
from struck.model.mesh import Mesh
from struck.scene.body import Body, Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.events import seen_from

_MIN_LEAP = 0.02  # m/s, the least leap of speed that is a hit
_LEAP_RATIO = 0.01  # of the fastest motion: smaller leaps may be errors of the frames
_NEAR_RATIO = 0.03  # of the smaller body's extent: bodies as near as that may touch
_NEAR_DISTANCE = 5e-3  # m, or as near as that
_SLACK_DISTANCE = 0.02  # m, beyond that
_TIE_DISTANCE = 1e-3  # m: places whose distances differ by less touch together
_CARRIED_RATIO = 0.2  # of gravity: with less a body flies
_MAX_MISMATCH = 0.5  # relative imbalance allowed between the leaps of two bodies
_MAX_FRAME_SHIFT = 0.25  # frames, by which a hit may lie outside those around it
_MEDIAN_FRAMES = 9  # frames, over which the median is a load: hits are shorter
_BEND_WEIGHT = 1e-3  # of what two frames bend aside, by which a pair of them is the worse
_OPPOSITE_COSINE = 0.7  # cosine of what is against a load
_ROUNDS = 12  # of projection from one surface to the other


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Flight:
    """A body's centre of mass, frame by frame, the fall taken off."""

    body: Body
    number: int
    times: Array  # (T,), s, evenly spaced
    centre: Array  # (T, 3), m
    mass: float  # kg
    gravity: Array  # (3,), m/s^2

    @property
    def frame(self) -> float:
        """Duration of a frame, s."""
        return float(self.times[1] - self.times[0])

    def extrapolate(self, k: int, time: float, leaps: set[int]) -> Body:
        """Return the body where the flight into frame `k`, or out of the next, has it at a time.

        Frames in `leaps` are those after which its velocity leaps too.
        """
        near_frame, far_frame = (k, k - 1) if k - 1 not in leaps else (k + 1, k + 2)
        if not 0 <= far_frame < len(self.times) or (near_frame > k and k + 1 in leaps):
            near_frame, far_frame = k, k + 1
        x = (time - self.times[near_frame]) / (self.times[near_frame] - self.times[far_frame])
        centre = self.centre[near_frame] + x * (self.centre[near_frame] - self.centre[far_frame])
        rotations = Rotation.from_matrix(
            self.body.orientation.at(self.times[[far_frame, near_frame]])
        )
        rotation = (
            Rotation.from_rotvec(x * (rotations[1] * rotations[0].inv()).as_rotvec()) * rotations[1]
        )
        position = centre + self.gravity * time**2 / 2 - rotation.apply(_centre(self.body))
        return replace(self.body, position=position, rotation=rotation.as_matrix())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Leap:
    """A leap of a body's velocity between two frames."""

    flight: _Flight
    frame: int  # the one before it
    time: float  # s
    change: Array  # (3,), m/s
    body: Body  # where it was then


@checked
def infer_contacts(scene: Scene, motion: Contacts) -> Contacts:
    """Estimate the contacts of bodies from their motion.

    Parameters
    ----------
    scene : Scene
        Masses and surfaces of the bodies, and gravity.
    motion : Contacts
        Poses, as read by `load_contacts` from a file without contacts, or by `load_animation`.

    Returns
    -------
    Contacts
        A row without duration for each impact, and rows of the length of a frame for bodies that
        are carried; `notes` report jumps without a body nearby.

    Raises
    ------
    OptionError
        If the scene lacks a body of the log, or the log has no poses.

    Notes
    -----
    Of hits at least three frames apart the impulse is found as well as the frames are exact; what
    comes closer is told in sum. The friction of a contact that lasts is part of its load.
    """
    if motion.poses is None:
        raise OptionError("the log has no poses: give some, as load_animation reads them")
    posed_scene = scene.posed(motion)
    flights = _flights(posed_scene, motion)
    leaps_and_loads = [_leaps(flight) for flight in flights]
    contacts, lost_count = _pair_leaps(
        posed_scene, motion.names, [leap for leaps, _ in leaps_and_loads for leap in leaps]
    )
    for flight, (_, loads) in zip(flights, leaps_and_loads, strict=True):
        contacts += _find_carried(posed_scene, motion.names, flight, loads)
    notes = (
        (f"{counted(lost_count, 'leap')} of speed with nothing near: left out",)
        if lost_count
        else ()
    )
    return _log(motion, contacts, notes)


@checked
def load_animation(path: str | os.PathLike[str]) -> Contacts:
    """Read the motion of the parts of a glTF or GLB file.

    Parameters
    ----------
    path : path
        A file with animations. Names of bodies are those of its nodes.

    Returns
    -------
    Contacts
        A log without rows, but with poses, relative to the parts at rest, as ``struck.analyze(path,
        ..., part=name)`` reads them.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or nothing moves in it.
    """
    require_readable(path)
    try:
        animations = read_foreign("animation", path, motions_of, advice="export fewer nodes")
    except (FileFormatError, MeshError) as error:
        raise FileFormatError(f"{path} has no animation that can be read: {error}") from None
    if not animations:
        raise FileFormatError(f"{path} has no animation of a mesh: export it with one")
    sizes = [len(animation.times) for animation in animations.values()]
    poses = Poses(
        time=np.concatenate([animation.times for animation in animations.values()]),
        body=np.repeat(np.arange(len(sizes)), sizes),
        position=np.concatenate([animation.positions for animation in animations.values()]),
        rotation=np.concatenate([animation.rotations for animation in animations.values()]),
    )
    return Contacts.of_motion(tuple(animations), poses)


def _flights(scene: Scene, motion: Contacts) -> Sequence[_Flight]:
    """Return the flights of bodies that move freely."""
    flights, gravity = [], np.asarray(scene.gravity)
    for number, name in enumerate(motion.names):
        body = scene.bodies[name]
        times = motion.poses.of(number)[0] if motion.poses is not None else np.zeros(0)
        mass = body.model.mass
        if body.fixed or body.model.supported or mass is None or len(times) < _MIN_FRAMES:
            continue
        even_times = np.linspace(times[0], times[-1], len(times))
        if np.abs(even_times - times).max() > 0.01 * (even_times[1] - even_times[0]):
            raise OptionError(
                f"{name!r} has poses at uneven times: sample its motion at even ones, such as 60 "
                "a second"
            )
        centre = body.carried(_centre(body)).at(even_times) - np.outer(even_times**2 / 2, gravity)
        flights.append(
            _Flight(
                body=body,
                number=number,
                times=even_times,
                centre=centre,
                mass=mass,
                gravity=gravity,
            )
        )
    return flights


_MIN_FRAMES = 8  # of a flight


def _centre(body: Body) -> Array:
    """Return a body's centre of mass, m (3,)."""
    model = body.model
    if model.centre is not None or model.geometry is None:
        return np.zeros(3) if model.centre is None else np.asarray(model.centre, np.float64)
    return model.geometry.bounds.mean(axis=0)


def _leaps(flight: _Flight) -> tuple[Sequence[_Leap], Array]:
    """Return the leaps of a body's velocity, and the second differences of the rest (T, 3)."""
    frame, centre = flight.frame, flight.centre
    differences = _compute_second_differences(centre)
    speeds = np.linalg.norm(np.diff(centre, axis=0), axis=1) / frame
    min_leap = max(_MIN_LEAP, _LEAP_RATIO * float(speeds.max(initial=0.0)))
    base = median_filter(differences, (_MEDIAN_FRAMES, 1), mode="nearest")
    excess = differences - base
    frames, leaps = _find_hits(excess, base, min_leap * frame), []
    for k in frames:
        change = (excess[k] + excess[k + 1]) / frame
        fraction = float(excess[k] @ change / max(frame * change @ change, 1e-30))
        time = flight.times[k + 1] - frame * float(np.clip(fraction, 0, 1))
        leaps.append(_refine_leap(flight, k, change, time, set(frames) - {k}))
        differences[k : k + 2] = (
            differences[k] + differences[k + 1] - leaps[-1].change * frame
        ) / 2
    return leaps, differences


def _find_hits(excess: Array, base: Array, threshold: float) -> list[int]:
    """Return the frames after which a body is hit.

    Frames are divided into pairs with a hit between them and single frames without, at the least
    cost: the bend of single frames beyond a load, `threshold` for each pair, and a little of the
    bend of a pair in two directions, as of two hits. A support does not pull a body: a load that is
    less for a while is no hit.
    """
    single_costs = np.linalg.norm(excess, axis=1)
    sums, loads = excess[:-1] + excess[1:], base[:-1] + base[1:]
    sizes = np.linalg.norm(sums, axis=1)
    bends = np.linalg.norm(np.cross(excess[:-1], excess[1:]), axis=1) / np.maximum(sizes, 1e-30)
    is_against = np.einsum("kd,kd->k", sums, loads) < -_OPPOSITE_COSINE * sizes * np.linalg.norm(
        loads, axis=1
    )
    is_pulled = np.einsum("kd,kd->k", sums + loads, loads) < -_CARRIED_RATIO * np.square(loads).sum(
        axis=1
    )
    pair_costs = np.where(
        (sizes < threshold) | (is_against & ~is_pulled), np.inf, threshold + _BEND_WEIGHT * bends
    )
    # The best of what ends before each frame, from the first on, and then back from the last.
    best_costs = np.zeros(len(excess) + 1)
    for k, single in enumerate(single_costs):
        best_costs[k + 1] = min(
            best_costs[k] + single, best_costs[k - 1] + pair_costs[k - 1] if k else np.inf
        )
    frames, k = [], len(excess)
    while k > 1:
        is_pair = best_costs[k] < best_costs[k - 1] + single_costs[k - 1]
        frames += [k - 2] if is_pair else []
        k -= 2 if is_pair else 1
    return frames[::-1]


def _compute_second_differences(centre: Array) -> Array:
    """Return second differences of places (T, 3); the end values repeat their neighbours."""
    inner = centre[2:] - 2 * centre[1:-1] + centre[:-2]
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _refine_leap(flight: _Flight, k: int, change: Array, time: float, others: set[int]) -> _Leap:
    """Return a leap where the flights before and after meet, if both are three frames long."""
    frame, start = flight.frame, flight.times[k]
    if 2 <= k < len(flight.times) - 3 and not others & {k - 2, k - 1, k + 1, k + 2}:
        first_parabola = _parabola(flight.centre[k - 2 : k + 1], -2)
        difference = _parabola(flight.centre[k + 1 : k + 4], 1) - first_parabola
        bend, slope, level = difference.T @ (change / np.linalg.norm(change))
        x = float(np.clip((time - start) / frame, 0, 1))
        for _ in range(20):  # Newton's method
            x -= (bend * x * x + slope * x + level) / ((2 * bend * x + slope) or 1.0)
        if -_MAX_FRAME_SHIFT <= x <= 1 + _MAX_FRAME_SHIFT:
            time, change = start + x * frame, (2 * difference[:, 0] * x + difference[:, 1]) / frame
    body = flight.extrapolate(k, time, others)
    return _Leap(flight=flight, frame=k, time=time, change=change, body=body)


def _parabola(points: Array, first: int) -> Array:
    """Return the coefficients (axes, 3), over frames, of parabolas through three frames."""
    x = first + np.arange(3.0)
    return np.asarray(
        np.linalg.solve(np.stack([x**2, x, np.ones(3)], axis=1), points).T, np.float64
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Contact:
    """A contact that was found; the impulse acts on `second`."""

    time: float
    dt: float
    first: int
    second: int
    position: Array
    impulse: Array


def _pair_leaps(
    scene: Scene, names: Sequence[str], leaps: Sequence[_Leap]
) -> tuple[list[_Contact], int]:
    """Return contacts for leaps, and the number of leaps that no contact explains."""
    open_leaps = sorted(leaps, key=lambda leap: -leap.flight.mass * np.linalg.norm(leap.change))
    used_ids: set[int] = set()
    contacts, lost_count = [], 0
    for leap in open_leaps:
        if id(leap) in used_ids:
            continue
        used_ids.add(id(leap))
        match = _explain_leap(scene, names, leap, [e for e in leaps if id(e) not in used_ids])
        if match is None:
            lost_count += 1
            continue
        contacts.append(match[0])
        used_ids.add(id(match[1]))
    return contacts, lost_count


def _explain_leap(
    scene: Scene, names: Sequence[str], leap: _Leap, others: Sequence[_Leap]
) -> tuple[_Contact, _Leap | None] | None:
    """Return the contact that explains a leap best, and the leap that answers it, if any."""
    impulse = leap.flight.mass * leap.change
    # Several hits between two frames give one leap, farther from the contact.
    slack = max(_SLACK_DISTANCE, float(np.linalg.norm(leap.change)) * leap.flight.frame)
    choices = []
    for number, name in enumerate(names):
        partner = _find_answer(leap, number, impulse, others)
        is_unmoved = partner is None and _would_leap(scene.bodies[name], impulse)
        if number == leap.flight.number or is_unmoved:
            continue
        other_body = scene.bodies[name] if partner is None else partner.body
        nearest = find_nearest_places(leap.body, other_body, leap.time, slack)
        if nearest is not None:
            distance, place = nearest
            if partner is not None:  # a body that leaps as well is preferred
                distance -= _NEAR_DISTANCE
            choices.append((distance, number, place, partner))
    if not choices:
        return None
    _, number, place, partner = min(choices, key=lambda choice: choice[0])
    time = leap.time
    if partner is not None:
        speed, other_speed = np.linalg.norm(leap.change), np.linalg.norm(partner.change)
        time = (speed * leap.time + other_speed * partner.time) / (speed + other_speed)
        if other_speed > speed:  # the impulse is more exact from the lighter body
            impulse = -partner.flight.mass * partner.change
    contact = _Contact(
        time=max(float(time), 0.0),
        dt=0.0,
        first=number,
        second=leap.flight.number,
        position=place,
        impulse=impulse,
    )
    return contact, partner


def _find_answer(leap: _Leap, number: int, impulse: Array, leaps: Sequence[_Leap]) -> _Leap | None:
    """Return the simultaneous leap of another body that best balances the momentum of this one."""
    best_leap, min_mismatch = None, _MAX_MISMATCH
    for candidate in leaps:
        if candidate.flight.number != number or abs(candidate.frame - leap.frame) > 1:
            continue
        imbalance = impulse + candidate.flight.mass * candidate.change
        mismatch = float(np.linalg.norm(imbalance) / np.linalg.norm(impulse))
        if mismatch < min_mismatch:
            best_leap, min_mismatch = candidate, mismatch
    return best_leap


def _would_leap(body: Body, impulse: Array) -> bool:
    """Return whether a body would visibly leap under an impulse."""
    mass = body.model.mass
    if body.fixed or body.model.supported or mass is None:
        return False
    return float(np.linalg.norm(impulse)) / mass > 2 * _MIN_LEAP


def find_nearest_places(
    body: Body, other_body: Body, time: float, slack: float = _SLACK_DISTANCE
) -> tuple[float, Array] | None:
    """Return the distance of two bodies, m, and the point between their nearest points (3,).

    None where they are too far apart to touch, beyond a slack, m, or one has no surface.
    """
    body_mesh, other_mesh = body.model.geometry, other_body.model.geometry
    moment = np.array([time])
    if body_mesh is None or other_mesh is None:
        return None
    reach = max(_NEAR_DISTANCE, _NEAR_RATIO * min(body_mesh.extent, other_mesh.extent)) + slack
    pairs = []
    for one, two, mesh, target in (
        (body, other_body, body_mesh, other_mesh),
        (other_body, body, other_mesh, body_mesh),
    ):
        points = np.concatenate([mesh.points, mesh.centroids])
        scene_points = _to_scene(one, moment, points)
        local_points = _to_body(two, moment, scene_points)
        rows = _find_near(target, local_points, reach)
        if not len(rows):
            continue
        distances, _, at = target.locator.closest(local_points[rows])
        pairs.append((distances, scene_points[rows], _to_scene(two, moment, at)))
    if not pairs:
        return None
    distances = np.concatenate([part[0] for part in pairs])
    midpoints = np.concatenate([(part[1] + part[2]) / 2 for part in pairs])
    is_near = distances <= distances.min() + _TIE_DISTANCE
    place = _find_midpoint(body, other_body, moment, midpoints[is_near].mean(axis=0))
    distance = float(distances.min())
    return (distance, place) if distance <= reach else None


def _find_near(mesh: Mesh, points: Array, reach: float) -> Index:
    """Return which points (n, 3) lie in the box of a mesh, or near it."""
    low, high = mesh.bounds
    return np.flatnonzero(((points > low - reach) & (points < high + reach)).all(axis=1))


def _find_midpoint(body: Body, other_body: Body, moment: Array, place: Array) -> Array:
    """Return the place between two surfaces that is nearest to both, from one near it."""
    ends = [place, place]
    for _ in range(_ROUNDS):
        for side, one in enumerate((body, other_body)):
            mesh = one.model.geometry
            if mesh is not None:
                nearest_points = mesh.locator.closest(_to_body(one, moment, ends[1 - side][None]))[
                    2
                ]
                ends[side] = _to_scene(one, moment, nearest_points)[0]
    return (ends[0] + ends[1]) / 2


def _to_scene(body: Body, moment: Array, points: Array) -> Array:
    """Return points (n, 3) of a body's coordinates in the scene at one time."""
    return body.origin.at(moment) + points @ body.orientation.at(moment)[0].T


def _to_body(body: Body, moment: Array, points: Array) -> Array:
    return seen_from(body, np.broadcast_to(moment, len(points)), points, points)[0]


def _find_carried(
    scene: Scene, names: Sequence[str], flight: _Flight, bent: Array
) -> Sequence[_Contact]:
    """Return the frames in which another body carries this one."""
    frame, gravity = flight.frame, float(np.linalg.norm(scene.gravity))
    loads = np.linalg.norm(bent, axis=1) > _CARRIED_RATIO * gravity * frame**2
    rows, last = [], None
    for k in np.flatnonzero(loads).tolist():
        # A body that is hit often is a little off what bears it in most frames.
        last = _bearer(scene, names, flight, k, last, float(np.linalg.norm(bent[k])))
        if last is not None:
            rows.append(
                _Contact(
                    time=float(flight.times[k]) - frame / 2,
                    dt=frame,
                    first=last[0],
                    second=flight.number,
                    position=last[1],
                    impulse=flight.mass * bent[k] / frame,
                )
            )
    return rows


def _bearer(
    scene: Scene,
    names: Sequence[str],
    flight: _Flight,
    k: int,
    last: tuple[int, Array] | None,
    slack: float,
) -> tuple[int, Array] | None:
    """Return the body that carries another in a frame, the last one tried first, and the place."""
    time = float(flight.times[k])
    order = ([last[0]] if last else []) + [n for n in range(len(names)) if not last or n != last[0]]
    for number in order:
        if number == flight.number:
            continue
        proximity = find_nearest_places(flight.body, scene.bodies[names[number]], time)
        if proximity is not None and proximity[0] < _NEAR_DISTANCE + slack:
            return number, proximity[1]
    return None


def _log(motion: Contacts, contacts: Sequence[_Contact], notes: tuple[str, ...]) -> Contacts:
    ordered_contacts = sorted(contacts, key=lambda touch: touch.time)

    def column(name: str, width: int = 0) -> Array:
        values = [getattr(contact, name) for contact in ordered_contacts]
        return np.array(values, np.float64).reshape((-1, width) if width else -1)

    return Contacts(
        names=motion.names,
        time=np.maximum(column("time"), 0.0),
        dt=column("dt"),
        body0=column("first").astype(np.int64),
        body1=column("second").astype(np.int64),
        position=column("position", 3),
        impulse=column("impulse", 3),
        poses=motion.poses,
        notes=(*motion.notes, *notes),
    )
