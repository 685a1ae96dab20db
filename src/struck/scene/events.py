"""Events: the contacts of a simulation sorted into blows and lasting contacts.

The force of a simulation is no sound: its steps are longer than a blow, and a soft solver makes a
blow longer still. Impulses are accurate. So rows of a log are separated into blows and loads
(`struck.scene.impact_detection`). A blow keeps impulse, time, place and direction of its rows, and
gets the duration that elastic impact of the two bodies gives (Hertz: materials, curvatures, and
effective masses there). A lasting load alone is silent; bodies that slide or roll under it sound by
their roughness (`struck.scene.sustained_contact`).

Both bodies get the same force, with opposite sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from struck.errors import ContactError, OptionError, counted, require_choice, rounded
from struck.excitation.hertz import CONTACT_CONSTANT, contact_modulus
from struck.excitation.pulses import SOFTNESS
from struck.excitation.strike import Strike
from struck.model.arrays import Array, Index, Mask, checked, require_number
from struck.model.gains import ShapeGains
from struck.model.mesh import barycentric
from struck.model.model import ModalModel
from struck.scene.body import Action, Body, Scene, centre_of, material_of
from struck.scene.contacts import Contacts
from struck.scene.impact_detection import ImpactDetection, Pair, detect_impacts, pairs_of
from struck.scene.sustained_contact import SustainedContact, find_sustained

FORCES = ("events", "impulses2002", "gaussian2002", "noise2002")
MIN_SPEED_CHANGE = 2e-3  # m/s, the least change of the speed of two bodies by a blow
_PATCH_RATIO = 0.1  # of the smaller body's extent: points of a blow as near as that are one
_REBOUND = 1.5  # 1 + restitution, if the approach speed is unknown
_MIN_RADIUS, _MAX_RADIUS = 5e-4, 1.0  # m, the least and largest radius of curvature of two bodies
_OFF_SURFACE_RATIO = 0.1  # of a body's extent: contacts farther off its surface are counted
_NOISE = 1.0  # level of noise in the force, for the roughness of 2002
_MAX_POSE_GAP = 0.05  # s, or three times the median: longer gaps between poses are noted
_FAINT_RATIO = 1e-6  # of the largest impulse of a point: weaker ones are counted, not listed
_TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Impacts:
    """Blows, one row for each contact point; points of one blow share its time."""

    blow: Index  # (P,), number of the blow
    first: Index  # (P,), body that gets the opposite impulse
    second: Index  # (P,)
    time: Array  # (P,), of the midpoint of the blow, s
    pose_time: Array  # (P,), when the bodies are so that the position holds, s
    position: Array  # (P, 3), in the scene, m
    impulse: Array  # (P, 3), on the second body, N s
    approach: Array  # (P,), approach speed of the bodies, m/s; NaN: unknown

    def __len__(self) -> int:
        return len(self.time)

    @property
    def is_faint(self) -> Mask:
        """Whether points have less than 1e-6 of the largest impulse (P,)."""
        sizes = np.linalg.norm(self.impulse, axis=1)
        return sizes < _FAINT_RATIO * np.max(sizes, initial=0.0)

    def chosen(self, rows: Index) -> Impacts:
        """Return the impacts at some of the contact points."""
        return Impacts(**{name: getattr(self, name)[rows] for name in Impacts.__slots__})

    @classmethod
    def together(cls, parts: Sequence[Impacts]) -> Impacts:
        """Return the impacts of several pairs joined, in order of time, blows numbered again."""
        firsts = np.cumsum([0, *(int(part.blow.max(initial=-1)) + 1 for part in parts)])
        columns = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__
        }
        columns["blow"] = np.concatenate(
            [part.blow + first for part, first in zip(parts, firsts, strict=False)]
        )
        return cls(**columns).chosen(np.argsort(columns["time"], kind="stable"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Events:
    """Blows and sustained contacts of a scene.

    Parameters
    ----------
    scene : Scene
        Scene with its bodies at the poses of the log.
    contacts : Contacts
        The log.
    impacts : Impacts
        Impacts that were detected in it.
    sustained : sequence of SustainedContact
        Sliding and rolling contacts.
    notes : tuple of str
        Losses, and how often they occurred.
    """

    scene: Scene
    contacts: Contacts
    impacts: Impacts
    sustained: Sequence[SustainedContact]
    notes: tuple[str, ...]

    def table(self) -> Sequence[Mapping[str, object]]:
        """List the impacts and the sustained contacts, in order of time.

        Impacts below 1e-6 of the largest impulse are left out; `notes` count them.

        Returns
        -------
        sequence of mapping
            One row for each point of an impact and for each sustained contact.
        """
        names, durations = self.contacts.names, self.durations
        rows: list[Mapping[str, object]] = [
            {
                "event": "impact",
                "time": float(self.impacts.time[k]),
                "body0": names[self.impacts.first[k]],
                "body1": names[self.impacts.second[k]],
                "position": self.impacts.position[k].tolist(),
                "impulse": self.impacts.impulse[k].tolist(),
                "duration": float(durations[k]),
            }
            for k in np.flatnonzero(~self.impacts.is_faint).tolist()
        ]
        rows += [contact.row(names) for contact in self.sustained]
        return sorted(rows, key=lambda row: float(str(row["time"])))

    @property
    def silence(self) -> str:
        """Reason why these events make no sound; "" if they excite a body that has a model."""
        sounding = np.array([not self.scene.bodies[n].silent for n in self.contacts.names], bool)
        pairs = [*zip(self.impacts.first, self.impacts.second, strict=True)]
        pairs += [(contact.first, contact.second) for contact in self.sustained]
        if any(sounding[first] or sounding[second] for first, second in pairs):
            return ""
        rows = counted(len(self.contacts), "row")
        if pairs:
            blows = counted(len(np.unique(self.impacts.blow)), "blow")
            lasting = counted(len(self.sustained), "lasting contact")
            return (
                f"silence: {blows} and {lasting} are between bodies without a model of their "
                "sound: give one a ModalModel, or a material in a simulation"
            )
        if not len(self.contacts):
            suggestion = "; struck.scene.infer_contacts finds those of a motion"
            has_poses = self.contacts.poses is not None
            return f"silence: the log has no contacts{suggestion if has_poses else ''}"
        return (
            f"silence: no blow that counts in {rows} of contacts, and nothing slides or rolls: a "
            "load at rest makes no sound"
        )

    @cached_property
    def durations(self) -> Array:
        """How long each point of a blow is pushed, s (P,)."""
        return durations_of(self)

    @checked
    def on(self, *, forces: str = "events", seed: int = 0) -> Scene:
        """Return the scene with its bodies excited by these events.

        Parameters
        ----------
        forces : {"events", "impulses2002", "gaussian2002", "noise2002"}, default "events"
            "events": detected impacts and sustained contacts. The others, as in 2002, use the rows
            of the log as they are: "impulses2002": ideal impulses; "gaussian2002": convolved with a
            Gaussian kernel, for soft collisions; "noise2002": with noise, for roughness below the
            resolution of the simulation.
        seed : int, default 0
            Seed of the positions on their roughness where bodies begin to slide, and of the noise.

        Returns
        -------
        Scene
            The scene with excited bodies.

        Raises
        ------
        OptionError
            If the forces are unknown, or a model was recorded, so that its contacts are not points
            in space.
        ContactError
            If a contact is far from its body.
        """
        require_choice("forces", forces, FORCES)
        require_number("seed", seed, 0, 2.0**63, whole=True)
        if forces == "events":
            impacts, lasting = self.impacts, self.sustained
        else:
            impacts, lasting = _rows_of(self.contacts), ()
        notes, bodies = list(self.notes), dict(self.scene.bodies)
        for number, name in enumerate(self.contacts.names):
            body = bodies[name]
            if body.silent:
                continue
            strikes, note = self._strikes(number, body, impacts, forces, seed)
            notes += note
            rubs = [
                contact.on(body.sounding, first=contact.first == number, seed=seed + place)
                for place, contact in enumerate(lasting)
                if number in {contact.first, contact.second}
            ]
            bodies[name] = replace(body, excitations=(*body.actions, *strikes, *rubs))
        if not any(body.pushed for body in bodies.values()):
            notes.append(self.silence or "silence: no row of contacts pushes a body with a model")
        return replace(
            self.scene,
            bodies=bodies,
            notes=(*self.scene.notes, *notes),
            logged=_end_of(self.contacts),
        )

    def _strikes(
        self, number: int, body: Body, impacts: Impacts, forces: str, seed: int
    ) -> tuple[Sequence[Action], Sequence[str]]:
        """Return a body's strikes, and a note where they lie off its surface."""
        mine = np.flatnonzero((impacts.first == number) | (impacts.second == number))
        if not len(mine):
            return (), ()
        body_impacts = impacts.chosen(mine)
        sign = np.where(body_impacts.second == number, 1.0, -1.0)[:, None]
        points, impulses = seen_from(
            body, body_impacts.pose_time, body_impacts.position, sign * body_impacts.impulse
        )
        points, note = project_onto_surface(self.contacts.names[number], body.sounding, points)
        sizes = np.linalg.norm(impulses, axis=1)
        durations = self.durations[mine] if forces == "events" else None
        strikes = [
            _strike(forces, None if durations is None else float(durations[k]), seed + int(mine[k]))
            for k in range(len(mine))
        ]
        return [
            replace(
                strike,
                at=tuple(points[k]),
                impulse=float(sizes[k]),
                direction=tuple(impulses[k]),
                time=max(0.0, float(body_impacts.time[k]) - (strike.duration or 0.0) / 2),
            )
            for k, strike in enumerate(strikes)
            if sizes[k] > 0
        ], note


@checked
def events_of(scene: Scene, contacts: Contacts) -> Events:
    """Detect the impacts and sustained contacts that make a scene sound.

    Parameters
    ----------
    scene : Scene
        The bodies.
    contacts : Contacts
        Log with names of bodies of the scene. Its poses, if any, replace those of the scene.

    Returns
    -------
    Events
        Impacts and sustained contacts.

    Raises
    ------
    OptionError
        If the scene lacks a body of the log.
    """
    posed_scene = scene.posed(contacts)
    blows, lasting, weak_count = [], [], 0
    strengths = np.linalg.norm(contacts.impulse, axis=1)
    approach, is_still, velocities = (
        _approach(contacts),
        _find_still(posed_scene, contacts),
        contacts.velocity,
    )
    for pair in pairs_of(contacts):
        rows = pair.rows
        coming = None if approach is None else approach[rows]
        detection = detect_impacts(contacts.time[rows], contacts.dt[rows], strengths[rows], coming)
        bodies = tuple(
            posed_scene.bodies[contacts.names[number]] for number in (pair.first, pair.second)
        )
        pair_impacts, missed_count = _impacts(pair, detection, contacts, bodies)
        blows.append(pair_impacts)
        weak_count += missed_count
        is_settled = is_still[[pair.first, pair.second]].all()
        is_settled &= velocities is not None and np.abs(velocities[rows]).max() < MIN_SPEED_CHANGE
        if not is_settled and not all(body.silent for body in bodies):
            lasting += find_sustained(pair, detection, contacts, bodies)
    notes = [*contacts.notes, *_note_pose_gaps(contacts)]
    if weak_count:
        weak_blows = counted(weak_count, "blow")
        notes.append(
            f"{weak_blows} left out: no speed changes by more than {1e3 * MIN_SPEED_CHANGE:g} mm/s"
        )
    impacts = Impacts.together(blows) if blows else _empty_impacts()
    if faint_count := np.count_nonzero(impacts.is_faint):
        notes.append(
            f"{counted(faint_count, 'impact')} of less than {_FAINT_RATIO:g} of the largest "
            "impulse left out of the table of events"
        )
    return Events(
        scene=posed_scene,
        contacts=contacts,
        impacts=impacts,
        sustained=tuple(lasting),
        notes=tuple(notes),
    )


def _end_of(contacts: Contacts) -> float:
    """Return when the last row of a log has ended, of contacts or poses, s; 0 at least."""
    ends = [np.asarray(contacts.time) + contacts.dt]
    ends += [] if contacts.poses is None else [contacts.poses.time]
    return max(0.0, *(float(np.max(values, initial=0.0)) for values in ends))


def _find_still(scene: Scene, contacts: Contacts) -> Mask:
    """Return which bodies of a log (B,) neither move nor rotate by their poses."""
    is_still, poses = np.zeros(len(contacts.names), np.bool_), contacts.poses
    if poses is not None and len(poses.time):
        bodies, firsts, counts = np.unique(poses.body, return_index=True, return_counts=True)
        rows = np.hstack([poses.position, poses.rotation, poses.time[:, None]])
        span = np.maximum.reduceat(rows, firsts) - np.minimum.reduceat(rows, firsts)
        posed_bodies = [scene.bodies[name] for name in np.array(contacts.names)[bodies].tolist()]
        meshes = [body.model.geometry for body in posed_bodies]
        sizes = np.array([1.0 if mesh is None else mesh.extent for mesh in meshes])
        displacement = np.maximum(span[:, :3].max(axis=1), 2 * sizes * span[:, 3:7].max(axis=1))
        is_known = (counts > 1) | np.array([body.fixed for body in posed_bodies])
        is_still[bodies] = is_known & (displacement <= MIN_SPEED_CHANGE / 4 * span[:, 7])
    return is_still


def _note_pose_gaps(contacts: Contacts) -> Sequence[str]:
    """Return notes of contacts at times for which the log has no poses of their bodies."""
    notes, poses = [], contacts.poses
    for number, name in enumerate(contacts.names if poses is not None else ()):
        times = np.zeros(0) if poses is None else poses.of(number)[0]
        contact_times = contacts.time[(contacts.body0 == number) | (contacts.body1 == number)]
        if len(times) < 2 or not len(contact_times):
            continue
        gap = max(_MAX_POSE_GAP, 3 * float(np.median(np.diff(times))))
        next_rows = np.searchsorted(times, contact_times)
        delays = contact_times - times[np.maximum(next_rows - 1, 0)]
        leads = times[np.minimum(next_rows, len(times) - 1)] - contact_times
        gap_count = int(np.count_nonzero(np.maximum(delays, leads) > gap))
        if gap_count:
            notes.append(
                f"{counted(gap_count, 'contact')} of {name!r} in gaps of over "
                f"{rounded(1e3 * gap, 3)} ms between its poses, where it moves evenly, or beyond "
                "them, where it stands still"
            )
    return notes


def _approach(contacts: Contacts) -> Array | None:
    """Return how fast bodies come together at each row, m/s (K,)."""
    if contacts.velocity is None:
        return None
    return -np.einsum("kd,kd->k", contacts.velocity, contacts.normal)


def _impacts(
    pair: Pair, detection: ImpactDetection, contacts: Contacts, bodies: Sequence[Body]
) -> tuple[Impacts, int]:
    """Return the blows of a pair, and how many were too weak to count."""
    blow_rows = np.flatnonzero(detection.blow >= 0)
    if not len(blow_rows):
        return _empty_impacts(), 0
    rows, blow = pair.rows[blow_rows], detection.blow[blow_rows]
    impulses = contacts.impulse[rows] * (pair.sign * detection.fraction)[blow_rows, None]
    weights = np.linalg.norm(impulses, axis=1)
    mid_times = contacts.time[rows] + contacts.dt[rows] / 2
    time = _means(blow, weights, mid_times[:, None])[:, 0]
    pose_times = _means(blow, weights, contacts.time[rows][:, None])[:, 0]
    centre = _means(blow, weights, contacts.position[rows])
    approach = _approach(contacts)
    approach_speeds = np.full(len(time), np.nan)
    if approach is not None:
        approach_speeds = np.zeros(len(time))
        np.maximum.at(approach_speeds, blow, approach[rows])
    sums = _sums(blow, impulses)
    mass = joint_masses(bodies, pose_times, centre, sums)
    is_strong = np.bincount(blow, weights) >= MIN_SPEED_CHANGE * mass
    patch, point = _patches(blow, contacts.position[rows] - centre[blow], bodies)
    place = _means(point, weights, contacts.position[rows])
    is_strong_patch = is_strong[patch]
    impacts = Impacts(
        blow=patch,
        first=np.full(len(patch), pair.first),
        second=np.full(len(patch), pair.second),
        time=time[patch],
        pose_time=pose_times[patch],
        position=place,
        impulse=_sums(point, impulses),
        approach=approach_speeds[patch],
    )
    return impacts.chosen(np.flatnonzero(is_strong_patch)), int(np.count_nonzero(~is_strong))


def _patches(blow: Index, offsets: Array, bodies: Sequence[Body]) -> tuple[Index, Index]:
    """Return the blow of each patch of contact (P,), and the patch of each row (n,)."""
    extents = [b.model.geometry.extent for b in bodies if b.model.geometry is not None]
    size = _PATCH_RATIO * min(extents, default=1.0)
    cells = np.round(np.clip(offsets / size, -1e5, 1e5)).astype(np.int64)
    keys = np.column_stack([blow, cells])
    patches, point = np.unique(keys, axis=0, return_inverse=True)
    return patches[:, 0], point.ravel()


def _sums(groups: Index, values: Array) -> Array:
    """Return the sums of rows (n, 3) over groups numbered from 0 (G, 3)."""
    sums = [np.bincount(groups, column) for column in values.T]
    return np.stack(sums, axis=1).astype(np.float64)


def _means(groups: Index, weights: Array, values: Array) -> Array:
    """Return weighted means over groups (G, D); plain ones where all weights are zero."""
    weights = np.maximum(weights, _TINY)
    return _sums(groups, values * weights[:, None]) / np.bincount(groups, weights)[:, None]


def durations_of(events: Events) -> Array:
    """Return how long elastic impact takes at each point of a blow, s (P,)."""
    impacts, durations = events.impacts, np.zeros(len(events.impacts))
    pairs = impacts.first * len(events.contacts.names) + impacts.second
    for key in np.unique(pairs):
        rows = np.flatnonzero(pairs == key)
        pair_impacts = impacts.chosen(rows)
        ends = int(pair_impacts.first[0]), int(pair_impacts.second[0])
        names = [events.contacts.names[number] for number in ends]
        durations[rows] = _hertz([events.scene.bodies[name] for name in names], pair_impacts)
    return durations


def _hertz(bodies: Sequence[Body], impacts: Impacts) -> Array:
    """Return the durations of blows between two bodies, s (P,)."""
    materials = [material_of(body.model) for body in bodies]
    solids = [material for material in materials if material is not None]
    if not solids:
        return np.zeros(len(impacts))
    sizes = np.linalg.norm(impacts.impulse, axis=1)
    mass = joint_masses(bodies, impacts.pose_time, impacts.position, impacts.impulse)
    bulge = sum(_curvatures(body, impacts.pose_time, impacts.position) for body in bodies)
    radius = 1 / np.clip(bulge, 1 / _MAX_RADIUS, 1 / _MIN_RADIUS)
    min_speed, max_speed = sizes / (2 * mass), sizes / mass
    is_known = np.isfinite(impacts.approach)
    speed = np.where(
        is_known, np.clip(impacts.approach, min_speed, max_speed), sizes / (_REBOUND * mass)
    )
    speed = np.maximum(speed, MIN_SPEED_CHANGE / 2)
    return CONTACT_CONSTANT * (mass**2 / (radius * contact_modulus(*solids) ** 2 * speed)) ** 0.2


def _curvatures(body: Body, times: Array, places: Array) -> Array:
    """Return the mean curvature of a body at places of the scene, 1/m (P,)."""
    mesh = body.model.geometry
    if mesh is None:
        return np.zeros(len(places))
    points, _ = seen_from(body, times, places, places)
    _, faces, nearest_points = mesh.locator.closest(points)
    corners = mesh.faces[faces]
    weights = barycentric(mesh.points[corners], nearest_points)
    return np.einsum("kc,kc->k", weights, mesh.mean_curvatures[corners])


def joint_masses(bodies: Sequence[Body], times: Array, places: Array, directions: Array) -> Array:
    """Return the effective mass of two bodies for a push at places of the scene, kg (P,)."""
    mobility = sum(_mobility(body, times, places, directions) for body in bodies)
    # Where neither moves freely, the lightest body counts as moving: a hand has moved it.
    fallback_mass = min((b.model.mass for b in bodies if b.model.mass is not None), default=1.0)
    return 1 / np.where(mobility > 0, mobility, 1 / fallback_mass)


def _mobility(body: Body, times: Array, places: Array, directions: Array) -> Array:
    """Return the speed that a unit impulse gives a rigid body where it acts, 1/kg (P,)."""
    model = body.model
    if body.fixed or model.supported or model.mass is None:
        return np.zeros(len(places))
    points, local_directions = seen_from(body, times, places, directions)
    local_directions /= np.maximum(np.linalg.norm(local_directions, axis=1, keepdims=True), _TINY)
    mobility = np.full(len(places), 1 / model.mass)
    if model.inertia is not None:
        torques = np.cross(points - centre_of(model), local_directions)
        angular_velocities = np.linalg.solve(np.asarray(model.inertia, np.float64), torques.T).T
        mobility += np.einsum("kd,kd->k", torques, angular_velocities)
    return mobility


def seen_from(body: Body, times: Array, places: Array, vectors: Array) -> tuple[Array, Array]:
    """Return places and vectors of the scene at times (P,) in a body's coordinates (P, 3) each."""
    rotations = body.orientation.at(times)
    points = np.einsum("kd,kde->ke", places - body.origin.at(times), rotations)
    return points, np.einsum("kd,kde->ke", vectors, rotations)


def project_onto_surface(
    name: str, model: ModalModel, points: Array
) -> tuple[Array, Sequence[str]]:
    """Return points (P, 3) moved onto a model's surface, and a note where that was far."""
    mesh = model.geometry
    if mesh is None or not isinstance(model.gains, ShapeGains):
        raise OptionError(
            f"{name!r} is a model of recordings, whose contacts are no places in space: give the "
            "scene a computed model for it, or RigidBody()"
        )
    distances, _, nearest_points = model.gains.locator.closest(points)
    if np.median(distances) > mesh.extent:
        raise ContactError(
            f"contacts of {name!r} are {rounded(np.median(distances), 3)} m off its surface, and "
            f"it is {rounded(mesh.extent, 3)} m large: check the units of the log, and the "
            "body's pose"
        )
    far_count = np.count_nonzero(distances > _OFF_SURFACE_RATIO * mesh.extent)
    if not far_count:
        return nearest_points, ()
    note = (
        f"{far_count} of {len(points)} contacts of {name!r} lay up to "
        f"{rounded(distances.max(), 2)} m off its surface and were moved onto it"
    )
    return nearest_points, (note,)


def _strike(forces: str, duration: float | None, seed: int) -> Strike:
    """Return the strike at a point of contact, without its place and strength."""
    if forces == "gaussian2002":
        return Strike(impulse=1.0, duration=SOFTNESS, shape="gaussian")
    if forces == "noise2002":
        return Strike(impulse=1.0, duration=SOFTNESS, shape="gaussian", transient=_NOISE, seed=seed)
    return Strike(impulse=1.0, duration=duration or 0.0)


def _rows_of(contacts: Contacts) -> Impacts:
    """Return the rows of a log as if each were a blow."""
    rows = np.flatnonzero(contacts.impulse.any(axis=1))
    return Impacts(
        blow=np.arange(len(rows)),
        first=contacts.body0[rows],
        second=contacts.body1[rows],
        time=contacts.time[rows] + contacts.dt[rows] / 2,
        pose_time=contacts.time[rows],
        position=contacts.position[rows],
        impulse=contacts.impulse[rows],
        approach=np.full(len(rows), np.nan),
    )


def _empty_impacts() -> Impacts:
    no_numbers, no_values, no_vectors = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3))
    return Impacts(
        blow=no_numbers,
        first=no_numbers,
        second=no_numbers,
        time=no_values,
        pose_time=no_values,
        position=no_vectors,
        impulse=no_vectors,
        approach=no_values,
    )
