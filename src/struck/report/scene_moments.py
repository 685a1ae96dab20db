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
MIN_SEPARATION = 1 / 40  # of the duration: blows nearer than that share a picture
_SAMPLE_COUNT = 241  # times at which motion is measured
# Fraction of the path of the body that moves most: less between two pictures shows nothing new.
_MIN_PATH_FRACTION = 0.05
_MIN_RADIUS_FRACTION = 0.1  # of the smallest body that moves: nor does less than that
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
        gap = min((abs(time - other) for other in captions), default=np.inf)
        if len(captions) < _BLOWS and 0 <= time <= seconds and gap >= MIN_SEPARATION * seconds:
            captions[time] = caption
    captions.setdefault(0.0, "start")
    times = sorted(captions)
    sample_times = np.linspace(0.0, seconds, _SAMPLE_COUNT)
    moving = [body for body in events.scene.bodies.values() if body.moves]
    path_lengths = _ways(moving, sample_times)
    min_radius = min((radius_of(body.model) for body in moving), default=0.0)
    min_length = max(_MIN_PATH_FRACTION * path_lengths[-1], _MIN_RADIUS_FRACTION * min_radius, 1e-9)
    while (
        len(times) < MOST
        and (time := _between(times, sample_times, path_lengths, min_length)) is not None
    ):
        times = sorted([*times, time])
    return [
        Moment(time=time, caption=captions.get(time) or _sliding(events, time)) for time in times
    ]


def _between(
    times: Sequence[float], sample_times: Array, path_lengths: Array, min_length: float
) -> float | None:
    """Return the time that halves the longest way between times, or the end of the motion.

    None where no way, m, between two of them reaches the `least`, or they are close in time.
    """
    end = float(sample_times[-1])
    gaps = np.diff(np.interp([*times, end], sample_times, path_lengths))
    for number in np.argsort(-gaps).tolist():
        if gaps[number] < min_length:
            break
        if number == len(times) - 1:
            time = end
        else:
            middle = np.interp(times[number], sample_times, path_lengths) + gaps[number] / 2
            time = float(np.interp(middle, path_lengths, sample_times))
        if min(abs(time - other) for other in times) >= MIN_SEPARATION * end:
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
    is_audible = [
        not (bodies[impacts.first[row]].silent and bodies[impacts.second[row]].silent)
        for row in rows
    ]
    order = np.lexsort((-sizes, ~np.array(is_audible)))
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
        speed = max(float(np.interp(time, contact.times, speeds)) for speeds in contact.speeds)
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
        place, rotation = course_of(body, times)
        centre = place + rotation @ centre_of(body.model)
        ends = [centre] + [
            centre + radius_of(body.model) * rotation[:, :, axis] for axis in range(2)
        ]
        moved = [np.linalg.norm(np.diff(end, axis=0), axis=1) for end in ends]
        steps = np.maximum(steps, np.max(moved, axis=0))
    return np.concatenate([[0.0], np.cumsum(steps)])
