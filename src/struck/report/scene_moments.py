"""Moments of a scene that are worth a picture: the largest blows, and motion between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.errors import rounded
from struck.model.arrays import Array
from struck.scene.animation import course_of
from struck.scene.body import Body, centre_of, radius_of
from struck.scene.events import Events

MOST = 12  # moments
_BLOWS = 8  # of them that show a blow, at most
_APART = 1 / 40  # of the duration: blows nearer than that share a picture
_LOOKS = 241  # times at which motion is measured
_MOVED = 0.05  # of the way of the body that moves most: less between two pictures shows nothing new
_SEEN = 0.1  # of the smallest body that moves: nor does less than that
_SLIDES = 0.01  # m/s: slower contacts are not mentioned
_LONGEST = 44  # characters of a caption


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A time of a scene, s, with a caption of the event at that time."""

    time: float
    caption: str = ""


def moments_of(events: Events, seconds: float) -> list[Moment]:
    """Return the start, the largest blows, and times between them at which bodies have moved.

    Blows in which a body with a model of its sound takes part come first, those of the largest
    impulse before others. Blows within a fortieth of the duration of a larger one share its moment.
    """
    captions: dict[float, str] = {}
    for time, caption in _blows(events):
        near = min((abs(time - other) for other in captions), default=np.inf)
        if len(captions) < _BLOWS and 0 <= time <= seconds and near >= _APART * seconds:
            captions[time] = caption
    captions.setdefault(0.0, "start")
    times = sorted(captions)
    looks = np.linspace(0.0, seconds, _LOOKS)
    moving = [body for body in events.scene.bodies.values() if body.moves]
    way = _ways(moving, looks)
    smallest = min((radius_of(body.model) for body in moving), default=0.0)
    least = max(_MOVED * way[-1], _SEEN * smallest, 1e-9)
    while len(times) < MOST and (time := _between(times, looks, way, least)) is not None:
        times = sorted([*times, time])
    return [
        Moment(time=time, caption=captions.get(time) or _sliding(events, time)) for time in times
    ]


def _between(times: Sequence[float], looks: Array, way: Array, least: float) -> float | None:
    """Return the time that halves the longest way between times, or the end of the motion.

    None where no way, m, between two of them reaches the `least`, or they are close in time.
    """
    end = float(looks[-1])
    gaps = np.diff(np.interp([*times, end], looks, way))
    for widest in np.argsort(-gaps).tolist():
        if gaps[widest] < least:
            break
        if widest == len(times) - 1:
            time = end
        else:
            middle = np.interp(times[widest], looks, way) + gaps[widest] / 2
            time = float(np.interp(middle, way, looks))
        if min(abs(time - other) for other in times) >= _APART * end:
            return time
    return None


def _blows(events: Events) -> list[tuple[float, str]]:
    """Return times of blows, s, and captions, the most important first."""
    impacts, names = events.impacts, events.contacts.names
    if not len(impacts):
        return []
    blows, rows = np.unique(impacts.blow, return_index=True)
    sizes = np.zeros(len(blows))
    np.add.at(sizes, np.searchsorted(blows, impacts.blow), np.linalg.norm(impacts.impulse, axis=1))
    bodies = [events.scene.bodies[name] for name in names]
    heard = [
        not (bodies[impacts.first[row]].silent and bodies[impacts.second[row]].silent)
        for row in rows
    ]
    order = np.lexsort((-sizes, ~np.array(heard)))
    return [
        (float(impacts.time[row]), _hit(events, bodies, int(row))) for row in rows[order].tolist()
    ]


def _hit(events: Events, bodies: Sequence[Body], row: int) -> str:
    """Return which body hits which, and how fast they come together."""
    impacts, names = events.impacts, events.contacts.names
    pair = [int(impacts.first[row]), int(impacts.second[row])]
    time = float(impacts.time[row])
    # The faster one hits the other.
    if _speed(bodies[pair[1]], time) > _speed(bodies[pair[0]], time):
        pair.reverse()
    approach = float(impacts.approach[row])
    speed = f", {rounded(approach, 2)} m/s" if np.isfinite(approach) and approach > 0 else ""
    return _shortened(f"{names[pair[0]]} hits {names[pair[1]]}{speed}")


def _speed(body: Body, time: float) -> float:
    """Return the speed of a body just before a time, m/s."""
    if not body.moves:
        return 0.0
    before = np.array([max(time - 5e-3, 0.0), max(time - 1e-3, 1e-3)])
    places = body.carried(centre_of(body.model)).at(before)
    return float(np.linalg.norm(places[1] - places[0]) / (before[1] - before[0]))


def _sliding(events: Events, time: float) -> str:
    """Return which bodies slide or roll on each other at a time, the fastest pair."""
    names, fastest, caption = events.contacts.names, _SLIDES, ""
    for contact in events.sustained:
        if not contact.times[0] <= time <= contact.times[-1]:
            continue
        speed = max(float(np.interp(time, contact.times, each)) for each in contact.speeds)
        if speed > fastest:
            fastest = speed
            pair = [contact.first, contact.second]
            if not events.scene.bodies[names[pair[0]]].moves:
                pair.reverse()
            verb = "rolls" if contact.rolls else "slides"
            caption = _shortened(f"{names[pair[0]]} {verb} on {names[pair[1]]}")
    return caption


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def _ways(bodies: Sequence[Body], times: Array) -> Array:
    """Return how far the body that moves most has come at times, turns included, m (T,)."""
    steps = np.zeros(len(times) - 1)
    for body in bodies:
        place, turn = course_of(body, times)
        centre = place + turn @ centre_of(body.model)
        ends = [centre] + [centre + radius_of(body.model) * turn[:, :, axis] for axis in range(2)]
        moved = [np.linalg.norm(np.diff(each, axis=0), axis=1) for each in ends]
        steps = np.maximum(steps, np.max(moved, axis=0))
    return np.concatenate([[0.0], np.cumsum(steps)])
