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

_DEEP = 0.1  # of the thinner body's least width: starts that overlap by more are refused
_SHALLOW = 1e-4  # m, and those by less are not worth a word
_DEAD = 0.05  # restitution, below which blows are dead
_FASTEST, _FARTHEST = 1000.0, 1e5  # m/s or rad/s, and m: beyond it a simulation has exploded
_MOST_KINDS = 8  # of contacts that are tried
# By a blow bodies part at most as fast as they met, so that none is sped up by more than twice
# that, and a light one at the end of a row of bodies that touch by not many times more. In one
# step; and in a window of time, in which there may be several blows.
_GAIN, _GAIN_IN_WINDOW, _WINDOW = 4.0, 8.0, 0.02  # 1, 1, s
_LETS_GO = 0.1  # s, in which a soft contact (solref's 20 ms) gives back what a blow has put in
_PUSHED_OUT = 0.5  # m/s that bodies may be pushed apart with that begin in each other


def require_slow(time: float, velocities: Array, places: Array, *, warned: bool = False) -> None:
    """Refuse bodies faster or farther away than any are, or of which the engine warned.

    Raises
    ------
    SimulationError
        With the time, s, of a simulation that has exploded.
    """
    fast = float(np.abs(velocities).max(initial=0.0))
    far = float(np.abs(places).max(initial=0.0))
    if warned or not (fast < _FASTEST and far < _FARTHEST):
        raise SimulationError(
            f"the simulation exploded at {rounded(time, 4)} s (a velocity is {rounded(fast, 3)}, a "
            f"position {rounded(far, 3)} m): take smaller steps, start bodies apart, or soften "
            "contacts and actuators"
        )


def require_no_blast(contacts: Contacts, masses: Array) -> None:
    """Refuse a log in which a free body gains far more speed than contacts can give.

    `masses` (bodies,), kg, are infinite of all that is not free. A SimulationError tells the first
    moment of it, the body and the speeds.
    """
    if not len(contacts) or contacts.velocity is None:
        return
    time, velocity = np.asarray(contacts.time), np.asarray(contacts.velocity)
    closing = np.maximum(-np.einsum("ij,ij->i", velocity, np.asarray(contacts.normal)), 0.0)
    impulses = np.asarray(contacts.impulse)
    moments, places = np.unique(time, return_index=True)
    # A body that rests against another is pushed by what hits that one: of all pairs the fastest.
    fastest = _around(moments, np.maximum.reduceat(closing, places))
    for number in np.flatnonzero(np.isfinite(masses)).tolist():
        first = np.asarray(contacts.body1) == number
        rows = np.flatnonzero(first | (np.asarray(contacts.body0) == number))
        if not len(rows):
            continue
        signed = np.where(first[rows, None], 1.0, -1.0) * impulses[rows] / masses[number]
        steps, starts = np.unique(time[rows], return_index=True)
        gains = np.add.reduceat(signed, starts, axis=0)
        _require_gains(
            contacts.names[number], steps, gains, fastest[np.searchsorted(moments, steps)]
        )


def _around(times: Array, values: Array) -> Array:
    """Return the largest of values (T,) in a window about each time: springs let go late."""
    before = np.searchsorted(times, times - _LETS_GO, side="left")
    after = np.searchsorted(times, times + _WINDOW, side="right")
    return np.array([values[a:b].max() for a, b in zip(before, after, strict=True)])


def _require_gains(name: str, times: Array, gains: Array, fastest: Array) -> None:
    """Compare speeds gained at times (T, 3), m/s, with the fastest closing about them (T,)."""
    before = np.searchsorted(times, times - _WINDOW, side="left")
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(gains, axis=0)])
    in_window = np.linalg.norm(total[1:] - total[before], axis=1)
    at_once = np.linalg.norm(gains, axis=1)
    wrong = np.flatnonzero(
        (at_once > _GAIN * fastest + _PUSHED_OUT)
        | (in_window > _GAIN_IN_WINDOW * fastest + _PUSHED_OUT)
    )
    if len(wrong):
        at = wrong[0]
        raise SimulationError(
            f"the simulation exploded at {rounded(times[at], 4)} s: {name!r} gained "
            f"{rounded(max(at_once[at], in_window[at]), 3)} m/s from contacts that closed at "
            f"{rounded(fastest[at], 3)} m/s: take smaller steps (step=), start bodies apart, or "
            "set restitution="
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
        alone = not np.any(
            (model.body_parentid[1:] == link.frame) & (model.body_weldid[1:] != link.frame)
        )
        mass = mass_properties(model, link)
        if kind == mujoco.mjtJoint.mjJNT_FREE and alone and mass and not model.ntendon:
            masses[number] = mass.mass
    return masses


def overlaps(model: mujoco.MjModel, data: mujoco.MjData, links: Sequence[Link]) -> list[str]:
    """Return notes about bodies that overlap at the start; refuse deep overlaps."""
    owner = owners(model, links)
    deepest: dict[tuple[int, int], float] = {}
    for contact in data.contact[: data.ncon]:
        one, other = sorted(owner[np.maximum(contact.geom, 0)])
        if one != other:
            deepest[one, other] = max(deepest.get((one, other), 0.0), -contact.dist)
    notes = []
    for (one, other), depth in deepest.items():
        if depth < _SHALLOW:
            continue
        names = f"{links[one].name!r} and {links[other].name!r}"
        least = min(_width(model, links[one]), _width(model, links[other]))
        if depth > _DEEP * least:
            raise SimulationError(
                f"{names} start {rounded(depth, 3)} m deep in each other, more than "
                f"{rounded(_DEEP * least, 3)} m: move them apart"
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
    found = [
        (name, rebound((kind[0], kind[1]), kind[2:], model.opt))
        for kind, name in list(kinds.items())[:_MOST_KINDS]
    ]
    notes = []
    dull = [name for name, restitution in found if restitution < _DEAD]
    if dull:
        notes.append(
            f"by the file's solref a ball does not rebound from {dull[0]!r} (restitution below "
            f'{_DEAD}): blows are dead; restitution="materials" lets bodies bounce'
        )
    step = float(model.opt.timestep)
    slow = max(kinds, default=(0.0,))[0]
    if slow > BRIEF_STEPS * step:
        notes.append(
            f"by the file's solref a blow takes about {rounded(1e3 * slow, 3)} ms, or "
            f"{slow / step:.0f} steps, of which more than {BRIEF_STEPS} count as a load that "
            "hardly sounds: set restitution= to the pairs, or take larger steps"
        )
    lively = [(name, value) for name, value in found if value > 1]
    if lively:
        notes.append(
            f"by the file's solref a ball rebounds from {lively[0][0]!r} with {lively[0][1]:.2f} "
            "times its speed, and gains energy: take smaller steps, or set restitution="
        )
    return notes
