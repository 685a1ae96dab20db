"""Contacts of a trajectory: impulses found where the motion of bodies has a kink.

An animation tells where bodies are, frame by frame, and nothing of what they touch. But a body that
nothing touches flies on a parabola; where it is hit, its speed leaps by the impulse over its mass.
With the fall taken off, flights are straight lines, and a hit between two frames bends the second
differences D of the place at these two frames alone:

    D[k] + D[k+1] = h dv,    t = t[k+1] - h D[k] / (D[k] + D[k+1])

where h is the time between frames, dv the leap and t the time of the hit. Where flights on both
sides are long enough, both are extrapolated to where they meet, which also holds for a body that
rolls, swings or rests before or after. What touched it is what is nearest at that time, and where
it gives way too, it must have leapt the other way.

What carries a body for longer bends all second differences: that is a load, and told as rows of the
length of a frame.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from struck.errors import FileFormatError, OptionError, counted
from struck.files.archives import open_source
from struck.files.gltf import read_animation
from struck.files.messages import ReadingLimits
from struck.model.arrays import Array, Index, checked
from struck.model.mesh import Mesh
from struck.scene.body import Body, Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.events import seen_from

_QUIETEST = 0.02  # m/s, the least leap of speed that is a hit
_SHARE = 0.01  # of the fastest motion: smaller leaps are not told from errors of the frames
_NEAR = 0.03  # of the smaller body's extent: bodies as near as that may touch
_CLOSE = 5e-3  # m, or as near as that
_SLACK = 0.02  # m, beyond that
_TIE = 1e-3  # m: places whose distances differ by less touch together
_CARRIED = 0.2  # of gravity: with less a body flies
_UNMATCHED = 0.5  # share by which the leaps of two bodies may miss each other
_BESIDE = 0.25  # frames, that a hit may lie beside those it was found between
_BESIDES = 9  # frames, over which the median is a load: what hits is shorter
_ASIDE = 1e-3  # of what two frames bend aside, by which a pair of them is the worse
_AGAINST = 0.7  # cosine of what is against a load
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

    def standing(self, k: int, time: float, leaps: set[int]) -> Body:
        """Return the body where the flight into frame `k`, or out of the next, has it at a time.

        Frames in `leaps` are those after which its velocity leaps too.
        """
        near, far = (k, k - 1) if k - 1 not in leaps else (k + 1, k + 2)
        if not 0 <= far < len(self.times) or (near > k and k + 1 in leaps):
            near, far = k, k + 1
        x = (time - self.times[near]) / (self.times[near] - self.times[far])
        centre = self.centre[near] + x * (self.centre[near] - self.centre[far])
        turns = Rotation.from_matrix(self.body.orientation.at(self.times[[far, near]]))
        turn = Rotation.from_rotvec(x * (turns[1] * turns[0].inv()).as_rotvec()) * turns[1]
        place = centre + self.gravity * time**2 / 2 - turn.apply(_centre(self.body))
        return replace(self.body, position=place, rotation=turn.as_matrix())


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
    """Find the contacts of bodies of which only the motion is known.

    Parameters
    ----------
    scene : Scene
        With the masses of its bodies and their surfaces, and the gravity under which they fell.
    motion : Contacts
        With poses, as `load_contacts` reads them of a file without contacts, or `load_animation`
        of an animation.

    Returns
    -------
    Contacts
        A row without duration for each hit, and rows of a frame's length where bodies are carried;
        `notes` tell of leaps for which nothing was near.

    Raises
    ------
    OptionError
        On bodies that the scene does not have, or a log without poses.

    Notes
    -----
    Of hits at least three frames apart the impulse is found as well as the frames are exact; what
    comes closer is told in sum. The friction of a contact that lasts is part of its load.
    """
    if motion.poses is None:
        raise OptionError("the log has no poses: give some, as load_animation reads them")
    posed = scene.posed(motion)
    flights = _flights(posed, motion)
    parted = [_leaps(flight) for flight in flights]
    touches, lost = _paired(posed, motion.names, [leap for leaps, _ in parted for leap in leaps])
    for flight, (_, loads) in zip(flights, parted, strict=True):
        touches += _carried(posed, motion.names, flight, loads)
    notes = (f"{counted(lost, 'leap')} of speed with nothing near: left out",) if lost else ()
    return _log(motion, touches, notes)


@checked
def load_animation(path: str | os.PathLike[str]) -> Contacts:
    """Read how the parts of a glTF or GLB file move.

    Parameters
    ----------
    path : path
        A file with animations; names of bodies are those of its nodes.

    Returns
    -------
    Contacts
        Without rows: poses alone, from where the file has its parts at rest, which is where
        ``struck.analyze(path, ..., part=name)`` reads them.

    Raises
    ------
    FileFormatError, MeshError
        On a file that cannot be read, or in which nothing moves.
    """
    limits = ReadingLimits()
    try:
        found = read_animation(open_source(Path(path), limits), limits)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path} has no animation that can be read: {error}") from None
    if not found:
        raise FileFormatError(f"{path} has no animation of a mesh: export it with one")
    sizes = [len(each.times) for each in found.values()]
    poses = Poses(
        time=np.concatenate([each.times for each in found.values()]),
        body=np.repeat(np.arange(len(sizes)), sizes),
        position=np.concatenate([each.positions for each in found.values()]),
        rotation=np.concatenate([each.rotations for each in found.values()]),
    )
    return Contacts.of_motion(tuple(found), poses)


def _flights(scene: Scene, motion: Contacts) -> Sequence[_Flight]:
    """Return the bodies that move and give way."""
    flights, gravity = [], np.asarray(scene.gravity)
    for number, name in enumerate(motion.names):
        body = scene.bodies[name]
        times = motion.poses.of(number)[0] if motion.poses is not None else np.zeros(0)
        mass = body.model.mass
        if body.fixed or body.model.supported or mass is None or len(times) < _FRAMES:
            continue
        even = np.linspace(times[0], times[-1], len(times))
        if np.abs(even - times).max() > 0.01 * (even[1] - even[0]):
            raise OptionError(
                f"{name!r} has poses at uneven times: sample its motion at even ones, such as 60 "
                "a second"
            )
        centre = body.carried(_centre(body)).at(even) - np.outer(even**2 / 2, gravity)
        flights.append(
            _Flight(body=body, number=number, times=even, centre=centre, mass=mass, gravity=gravity)
        )
    return flights


_FRAMES = 8  # the fewest of which anything can be said


def _centre(body: Body) -> Array:
    """Return a body's centre of mass, m (3,)."""
    model = body.model
    if model.centre is not None or model.geometry is None:
        return np.zeros(3) if model.centre is None else np.asarray(model.centre, np.float64)
    return model.geometry.bounds.mean(axis=0)


def _leaps(flight: _Flight) -> tuple[Sequence[_Leap], Array]:
    """Return the leaps of a body's velocity, and the second differences of the rest (T, 3)."""
    frame, centre = flight.frame, flight.centre
    bent = _second_differences(centre)
    speeds = np.linalg.norm(np.diff(centre, axis=0), axis=1) / frame
    least = max(_QUIETEST, _SHARE * float(speeds.max(initial=0.0)))
    base = median_filter(bent, (_BESIDES, 1), mode="nearest")
    above = bent - base
    frames, leaps = _hit(above, base, least * frame), []
    for k in frames:
        change = (above[k] + above[k + 1]) / frame
        share = float(above[k] @ change / max(frame * change @ change, 1e-30))
        time = flight.times[k + 1] - frame * float(np.clip(share, 0, 1))
        leaps.append(_refined(flight, k, change, time, set(frames) - {k}))
        bent[k : k + 2] = (bent[k] + bent[k + 1] - leaps[-1].change * frame) / 2
    return leaps, bent


def _hit(above: Array, base: Array, least: float) -> list[int]:
    """Return the frames after which a body is hit.

    Of all ways to part frames into pairs with a hit between them and single ones without, that
    which leaves the least: of single frames all that they bend beyond a load, `least` for each
    pair, and a little of what it bends in two directions, as two hits do. What bears a body does
    not pull it: where a load is less for a while there is no hit.
    """
    alone = np.linalg.norm(above, axis=1)
    sums, loads = above[:-1] + above[1:], base[:-1] + base[1:]
    sizes = np.linalg.norm(sums, axis=1)
    aside = np.linalg.norm(np.cross(above[:-1], above[1:]), axis=1) / np.maximum(sizes, 1e-30)
    against = np.einsum("kd,kd->k", sums, loads) < -_AGAINST * sizes * np.linalg.norm(loads, axis=1)
    pulled = np.einsum("kd,kd->k", sums + loads, loads) < -_CARRIED * np.square(loads).sum(axis=1)
    together = np.where((sizes < least) | (against & ~pulled), np.inf, least + _ASIDE * aside)
    # The best of what ends before each frame, from the first on, and then back from the last.
    best = np.zeros(len(above) + 1)
    for k, single in enumerate(alone):
        best[k + 1] = min(best[k] + single, best[k - 1] + together[k - 1] if k else np.inf)
    frames, k = [], len(above)
    while k > 1:
        paired = best[k] < best[k - 1] + alone[k - 1]
        frames += [k - 2] if paired else []
        k -= 2 if paired else 1
    return frames[::-1]


def _second_differences(centre: Array) -> Array:
    """Return second differences of places (T, 3); the end values repeat their neighbours."""
    inner = centre[2:] - 2 * centre[1:-1] + centre[:-2]
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _refined(flight: _Flight, k: int, change: Array, time: float, others: set[int]) -> _Leap:
    """Return a leap as the flights before and after meet, where both are three frames long."""
    frame, start = flight.frame, flight.times[k]
    if 2 <= k < len(flight.times) - 3 and not others & {k - 2, k - 1, k + 1, k + 2}:
        before = _parabola(flight.centre[k - 2 : k + 1], -2)
        apart = _parabola(flight.centre[k + 1 : k + 4], 1) - before
        bend, slope, level = apart.T @ (change / np.linalg.norm(change))
        x = float(np.clip((time - start) / frame, 0, 1))
        for _ in range(20):  # Newton's method
            x -= (bend * x * x + slope * x + level) / ((2 * bend * x + slope) or 1.0)
        if -_BESIDE <= x <= 1 + _BESIDE:
            time, change = start + x * frame, (2 * apart[:, 0] * x + apart[:, 1]) / frame
    body = flight.standing(k, time, others)
    return _Leap(flight=flight, frame=k, time=time, change=change, body=body)


def _parabola(points: Array, first: int) -> Array:
    """Return the coefficients (axes, 3), over frames, of parabolas through three frames."""
    x = first + np.arange(3.0)
    return np.asarray(
        np.linalg.solve(np.stack([x**2, x, np.ones(3)], axis=1), points).T, np.float64
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Touch:
    """A contact that was found; the impulse acts on `second`."""

    time: float
    dt: float
    first: int
    second: int
    position: Array
    impulse: Array


def _paired(scene: Scene, names: Sequence[str], leaps: Sequence[_Leap]) -> tuple[list[_Touch], int]:
    """Return contacts for leaps, and the number of leaps that no contact explains."""
    open_leaps = sorted(leaps, key=lambda leap: -leap.flight.mass * np.linalg.norm(leap.change))
    used: set[int] = set()
    touches, lost = [], 0
    for leap in open_leaps:
        if id(leap) in used:
            continue
        used.add(id(leap))
        touch = _touch_of(scene, names, leap, [e for e in leaps if id(e) not in used])
        if touch is None:
            lost += 1
            continue
        touches.append(touch[0])
        used.add(id(touch[1]))
    return touches, lost


def _touch_of(
    scene: Scene, names: Sequence[str], leap: _Leap, others: Sequence[_Leap]
) -> tuple[_Touch, _Leap | None] | None:
    """Return the contact that explains a leap best, and the leap that answers it, if any."""
    impulse = leap.flight.mass * leap.change
    # Of several hits between two frames one is found, farther from where the bodies met.
    slack = max(_SLACK, float(np.linalg.norm(leap.change)) * leap.flight.frame)
    choices = []
    for other, name in enumerate(names):
        partner = _answer(leap, other, impulse, others)
        moot = partner is None and _gives_way(scene.bodies[name], impulse)
        if other == leap.flight.number or moot:
            continue
        its = scene.bodies[name] if partner is None else partner.body
        found = nearest_places(leap.body, its, leap.time, slack)
        if found is not None:
            choices.append((found[0] - (partner is not None) * _CLOSE, other, found[1], partner))
    if not choices:
        return None
    _, other, place, partner = min(choices, key=lambda choice: choice[0])
    time = leap.time
    if partner is not None:
        own, its = np.linalg.norm(leap.change), np.linalg.norm(partner.change)
        time = (own * leap.time + its * partner.time) / (own + its)
        if its > own:  # the lighter body tells it better
            impulse = -partner.flight.mass * partner.change
    touch = _Touch(
        time=max(float(time), 0.0),
        dt=0.0,
        first=other,
        second=leap.flight.number,
        position=place,
        impulse=impulse,
    )
    return touch, partner


def _answer(leap: _Leap, other: int, impulse: Array, leaps: Sequence[_Leap]) -> _Leap | None:
    """Return the simultaneous leap of another body that best balances the momentum of this one."""
    best, least = None, _UNMATCHED
    for each in leaps:
        if each.flight.number != other or abs(each.frame - leap.frame) > 1:
            continue
        missed = impulse + each.flight.mass * each.change
        share = float(np.linalg.norm(missed) / np.linalg.norm(impulse))
        if share < least:
            best, least = each, share
    return best


def _gives_way(body: Body, impulse: Array) -> bool:
    """Return whether a body would visibly leap under an impulse."""
    mass = body.model.mass
    if body.fixed or body.model.supported or mass is None:
        return False
    return float(np.linalg.norm(impulse)) / mass > 2 * _QUIETEST


def nearest_places(
    body: Body, other: Body, time: float, slack: float = _SLACK
) -> tuple[float, Array] | None:
    """Return how far apart two bodies are, m, and where they are nearest, in the scene (3,).

    None where they are too far apart to touch, beyond a slack, m, or one has no surface.
    """
    mine, its = body.model.geometry, other.model.geometry
    moment = np.array([time])
    if mine is None or its is None:
        return None
    reach = max(_CLOSE, _NEAR * min(mine.extent, its.extent)) + slack
    pairs = []
    for one, two, mesh, target in ((body, other, mine, its), (other, body, its, mine)):
        points = np.concatenate([mesh.points, mesh.centroids])
        placed = _placed(one, moment, points)
        seen = _in_body(two, moment, placed)
        box = _near(target, seen, reach)
        if not len(box):
            continue
        apart, _, at = target.locator.closest(seen[box])
        pairs.append((apart, placed[box], _placed(two, moment, at)))
    if not pairs:
        return None
    apart = np.concatenate([each[0] for each in pairs])
    middles = np.concatenate([(each[1] + each[2]) / 2 for each in pairs])
    near = apart <= apart.min() + _TIE
    place = _between(body, other, moment, middles[near].mean(axis=0))
    distance = float(apart.min())
    return (distance, place) if distance <= reach else None


def _near(mesh: Mesh, points: Array, reach: float) -> Index:
    """Return which points (n, 3) lie in the box of a mesh, or near it."""
    low, high = mesh.bounds
    return np.flatnonzero(((points > low - reach) & (points < high + reach)).all(axis=1))


def _between(body: Body, other: Body, moment: Array, place: Array) -> Array:
    """Return the place between two surfaces that is nearest to both, from one near it."""
    ends = [place, place]
    for _ in range(_ROUNDS):
        for side, one in enumerate((body, other)):
            mesh = one.model.geometry
            if mesh is not None:
                near = mesh.locator.closest(_in_body(one, moment, ends[1 - side][None]))[2]
                ends[side] = _placed(one, moment, near)[0]
    return (ends[0] + ends[1]) / 2


def _placed(body: Body, moment: Array, points: Array) -> Array:
    """Return points (n, 3) of a body's coordinates in the scene at one time."""
    return body.origin.at(moment) + points @ body.orientation.at(moment)[0].T


def _in_body(body: Body, moment: Array, places: Array) -> Array:
    return seen_from(body, np.broadcast_to(moment, len(places)), places, places)[0]


def _carried(scene: Scene, names: Sequence[str], flight: _Flight, bent: Array) -> Sequence[_Touch]:
    """Return the frames in which another body carries this one."""
    frame, gravity = flight.frame, float(np.linalg.norm(scene.gravity))
    loads = np.linalg.norm(bent, axis=1) > _CARRIED * gravity * frame**2
    rows, last = [], None
    for k in np.flatnonzero(loads).tolist():
        # A body that is hit often is a little off what bears it in most frames.
        last = _bearer(scene, names, flight, k, last, float(np.linalg.norm(bent[k])))
        if last is not None:
            rows.append(
                _Touch(
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
    """Return which body carries another in a frame, the last one first asked, and where."""
    time = float(flight.times[k])
    order = ([last[0]] if last else []) + [n for n in range(len(names)) if not last or n != last[0]]
    for other in order:
        if other == flight.number:
            continue
        found = nearest_places(flight.body, scene.bodies[names[other]], time)
        if found is not None and found[0] < _CLOSE + slack:
            return other, found[1]
    return None


def _log(motion: Contacts, touches: Sequence[_Touch], notes: tuple[str, ...]) -> Contacts:
    ordered = sorted(touches, key=lambda touch: touch.time)

    def column(name: str, width: int = 0) -> Array:
        values = [getattr(each, name) for each in ordered]
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
