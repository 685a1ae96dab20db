"""Explosions: signs that a simulation has become unphysical, and the errors about them."""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import SimulationError, rounded
from struck.model.arrays import Array
from struck.scene.contacts import Contacts
from struck.scene.engines.links import Link, mass_properties, owners, touches, triangles
from struck.scene.engines.restitution import rebound
from struck.scene.impact_detection import BRIEF_STEPS

if TYPE_CHECKING:
    import mujoco

_MAX_DEPTH_RATIO = 0.1  # of the thinner body's least width: starts that overlap by more are refused
_IGNORED_DEPTH = 1e-4  # m, and those by less are not worth a word
_DEAD_RESTITUTION = 0.05  # restitution, below which blows are dead
_MAX_SPEED, _MAX_DISTANCE = 1000.0, 1e5  # m/s or rad/s, and m: beyond it a simulation has exploded
_MAX_KINDS = 8  # of contacts that are tried
# By a blow bodies part at most as fast as they met, so that none is sped up by more than twice
# that, and a light one at the end of a row of bodies that touch by not many times more. In one
# step; and in a window of time, in which there may be several blows.
_GAIN, _GAIN_IN_WINDOW, _WINDOW_SECONDS = 4.0, 8.0, 0.02  # 1, 1, s
_RELEASE_SECONDS = (
    0.1  # s, in which a soft contact (solref's 20 ms) gives back what a blow has put in
)
_SEPARATION_SPEED = 0.5  # m/s, at which bodies that start in each other may be pushed apart


def require_slow(
    time: float, velocities: Array, positions: Array, *, has_warning: bool = False
) -> None:
    """Refuse impossibly fast or distant bodies, or a state that the engine warned of.

    Raises
    ------
    SimulationError
        With the time, s, of a simulation that has exploded.
    """
    max_speed = float(np.abs(velocities).max(initial=0.0))
    max_distance = float(np.abs(positions).max(initial=0.0))
    if has_warning or not (max_speed < _MAX_SPEED and max_distance < _MAX_DISTANCE):
        raise SimulationError(
            f"the simulation exploded at {rounded(time, 4)} s (a velocity is "
            f"{rounded(max_speed, 3)}, a position {rounded(max_distance, 3)} m): take smaller "
            "steps, start bodies apart, or soften contacts and actuators"
        )


def require_no_blast(contacts: Contacts, masses: Array) -> None:
    """Refuse a log in which a free body gains far more speed than contacts can give.

    `masses` (bodies,), kg, are infinite for bodies that are not free. The SimulationError gives the
    first such time, the body and the speeds.
    """
    if not len(contacts) or contacts.velocity is None:
        return
    time, velocity = np.asarray(contacts.time), np.asarray(contacts.velocity)
    closing = np.maximum(-np.einsum("ij,ij->i", velocity, np.asarray(contacts.normal)), 0.0)
    impulses = np.asarray(contacts.impulse)
    moments, moment_rows = np.unique(time, return_index=True)
    # A body that rests against another is pushed by what hits that one: of all pairs the fastest.
    closing_speeds = _find_window_maxima(moments, np.maximum.reduceat(closing, moment_rows))
    for number in np.flatnonzero(np.isfinite(masses)).tolist():
        first = np.asarray(contacts.body1) == number
        rows = np.flatnonzero(first | (np.asarray(contacts.body0) == number))
        if not len(rows):
            continue
        velocity_changes = np.where(first[rows, None], 1.0, -1.0) * impulses[rows] / masses[number]
        steps, first_rows = np.unique(time[rows], return_index=True)
        gains = np.add.reduceat(velocity_changes, first_rows, axis=0)
        _require_gains(
            contacts.names[number], steps, gains, closing_speeds[np.searchsorted(moments, steps)]
        )


def _find_window_maxima(times: Array, values: Array) -> Array:
    """Return the largest of values (T,) in a window about each time, as springs release late."""
    first_rows = np.searchsorted(times, times - _RELEASE_SECONDS, side="left")
    end_rows = np.searchsorted(times, times + _WINDOW_SECONDS, side="right")
    return np.array([values[a:b].max() for a, b in zip(first_rows, end_rows, strict=True)])


def _require_gains(name: str, times: Array, gains: Array, closing_speeds: Array) -> None:
    """Compare speeds gained at times (T, 3), m/s, with the fastest closing about them (T,)."""
    first_rows = np.searchsorted(times, times - _WINDOW_SECONDS, side="left")
    cumulative_gains = np.concatenate([np.zeros((1, 3)), np.cumsum(gains, axis=0)])
    window_gains = np.linalg.norm(cumulative_gains[1:] - cumulative_gains[first_rows], axis=1)
    step_gains = np.linalg.norm(gains, axis=1)
    invalid_rows = np.flatnonzero(
        (step_gains > _GAIN * closing_speeds + _SEPARATION_SPEED)
        | (window_gains > _GAIN_IN_WINDOW * closing_speeds + _SEPARATION_SPEED)
    )
    if len(invalid_rows):
        at = invalid_rows[0]
        raise SimulationError(
            f"the simulation exploded at {rounded(times[at], 4)} s: {name!r} gained "
            f"{rounded(max(step_gains[at], window_gains[at]), 3)} m/s from contacts that closed at "
            f"{rounded(closing_speeds[at], 3)} m/s: take smaller steps (step=), start bodies "
            "apart, or set restitution="
        )


def free_masses(model: mujoco.MjModel, links: Sequence[Link]) -> Array:
    """Return masses of links moved by contacts and gravity alone, kg; infinite for all others."""
    import mujoco

    masses = np.full(len(links), np.inf)
    for number, link in enumerate(links):
        if link.fixed or not link.frame_is_body:
            continue
        joints = model.body_jntnum[link.frame]
        kind = model.jnt_type[model.body_jntadr[link.frame]] if joints == 1 else -1
        is_alone = not np.any(
            (model.body_parentid[1:] == link.frame) & (model.body_weldid[1:] != link.frame)
        )
        mass = mass_properties(model, link)
        if kind == mujoco.mjtJoint.mjJNT_FREE and is_alone and mass and not model.ntendon:
            masses[number] = mass.mass
    return masses


def overlaps(model: mujoco.MjModel, data: mujoco.MjData, links: Sequence[Link]) -> list[str]:
    """Return notes about bodies that overlap at the start; refuse deep overlaps."""
    owner = owners(model, links)
    max_depths: dict[tuple[int, int], float] = {}
    for contact in data.contact[: data.ncon]:
        link_a, link_b = sorted(owner[np.maximum(contact.geom, 0)])
        if link_a != link_b:
            max_depths[link_a, link_b] = max(max_depths.get((link_a, link_b), 0.0), -contact.dist)
    notes = []
    for (link_a, link_b), depth in max_depths.items():
        if depth < _IGNORED_DEPTH:
            continue
        names = f"{links[link_a].name!r} and {links[link_b].name!r}"
        min_width = min(_width(model, links[link_a]), _width(model, links[link_b]))
        if depth > _MAX_DEPTH_RATIO * min_width:
            raise SimulationError(
                f"{names} start {rounded(depth, 3)} m deep in each other, more than "
                f"{rounded(_MAX_DEPTH_RATIO * min_width, 3)} m: move them apart"
            )
        notes.append(
            f"{names} start {rounded(depth, 2)} m deep in each other, and are pushed apart"
        )
    return notes


def _width(model: mujoco.MjModel, link: Link) -> float:
    """Return the shortest edge of the boxes around a link's colliding geoms, m."""
    widths = [
        float(np.ptp(triangles(model, int(geom))[0], axis=0).min())
        for geom in link.geoms
        if touches(model, int(geom)) and model.geom_type[geom] > 1
    ]
    return min(widths, default=np.inf)


def dead(model: mujoco.MjModel) -> list[str]:
    """Return a note on bodies that cannot rebound by the solver settings of the file."""
    kinds: dict[tuple[float, ...], str] = {}
    for geom in range(model.ngeom):
        if touches(model, geom):
            kind = (*model.geom_solref[geom], *model.geom_solimp[geom])
            kinds.setdefault(tuple(map(float, kind)), model.geom(geom).name)
    restitutions = [
        (name, rebound((kind[0], kind[1]), kind[2:], model.opt))
        for kind, name in list(kinds.items())[:_MAX_KINDS]
    ]
    notes = []
    dead_names = [name for name, restitution in restitutions if restitution < _DEAD_RESTITUTION]
    if dead_names:
        notes.append(
            f"by the file's solref a ball does not rebound from {dead_names[0]!r} (restitution "
            "below "
            f'{_DEAD_RESTITUTION}): blows are dead; restitution="materials" lets bodies bounce'
        )
    step = float(model.opt.timestep)
    contact_seconds = max(kinds, default=(0.0,))[0]
    if contact_seconds > BRIEF_STEPS * step:
        notes.append(
            f"by the file's solref a blow takes about {rounded(1e3 * contact_seconds, 3)} ms, or "
            f"{contact_seconds / step:.0f} steps, of which more than {BRIEF_STEPS} count as a load "
            "that hardly sounds: set restitution= to the pairs, or take larger steps"
        )
    energy_gains = [(name, value) for name, value in restitutions if value > 1]
    if energy_gains:
        notes.append(
            f"by the file's solref a ball rebounds from {energy_gains[0][0]!r} with "
            f"{energy_gains[0][1]:.2f} times its speed, and gains energy: take smaller steps, or "
            "set restitution="
        )
    return notes
