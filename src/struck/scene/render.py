"""Offline sound of bodies in space, as a listener hears them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.hearing import Hearing
from struck.ears.listeners import Listener, Mono, is_listener, position_of
from struck.ears.propagation import Pose
from struck.ears.room import Room
from struck.errors import OptionError
from struck.excitation.hold import Hold
from struck.files.sound import Sound
from struck.model.arrays import Array, Complex
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.scene.body import Action, Body, centre_of, place_beside
from struck.scene.one_body import (
    Driven,
    dry_sound,
    finite,
    left_out,
    residual_sound,
    set_back,
)
from struck.synth.ring_down import below_nyquist

_BLOCK = 4096


def mixed(
    bodies: Sequence[Body],
    listener: Listener,
    *,
    seconds: float | None,
    sample_rate: int,
    room: Room | None = None,
) -> Sound:
    """Return what a listener hears; see `struck.scene.render.render`."""
    emitters = [body.emitter for body in bodies]
    pose = Pose.of(listener, emitters)
    sent = [_sent(body, pose, seconds=seconds, sample_rate=sample_rate) for body in bodies]
    hearing = Hearing(emitters, listener, sample_rate=sample_rate, room=room)
    length = None if seconds is None else max(1, round(seconds * sample_rate))
    samples = _heard(hearing, _of_one_length([rows for rows, _ in sent]), length)
    if room is not None and room.reverberation is not None:
        near = [_at_a_metre(body, pose, rows) for body, (rows, _) in zip(bodies, sent, strict=True)]
        late = _reverberated(room, _of_one_length(near).sum(axis=0), len(samples), sample_rate)
        samples = _of_one_duration(samples, late, length)
    calibrated = [body.model.calibrated for body in bodies]
    return Sound(
        samples=samples.astype(np.float32),
        sample_rate=sample_rate,
        calibrated=all(calibrated),
        notes=_notes([notes for _, notes in sent], calibrated),
    )


def _sent(
    body: Body, pose: Pose, *, seconds: float | None, sample_rate: int
) -> tuple[Array, tuple[str, ...]]:
    """Return what a body sounds like at 1 m, or at each ear but for the travel time (rows, n)."""
    if body.model.gains.directional:
        return _sent_to_ears(body, pose, seconds=seconds, sample_rate=sample_rate)
    far = place_beside(body.model)
    place = centre_of(body.model) + far
    arrived = dry_sound(body.model, body.actions, place, seconds=seconds, sample_rate=sample_rate)
    return far[0] * arrived.samples[None], arrived.notes


def _sent_to_ears(
    body: Body, pose: Pose, *, seconds: float | None, sample_rate: int
) -> tuple[Array, tuple[str, ...]]:
    model = body.model.expanded()
    actions = set_back(body.model, body.actions)
    outputs = _toward_ears(body, pose)
    driven = Driven(
        model=model,
        outputs=outputs(0.0),
        excitations=[each for each in actions if not isinstance(each, Hold)],
        holds=[each for each in actions if isinstance(each, Hold)],
        sample_rate=sample_rate,
        moving=outputs if pose.moves or body.emitter.centre.moves else None,
    )
    kept = below_nyquist(model.frequencies, sample_rate)
    samples = driven.samples(seconds, at_least=0.0)
    samples += residual_sound(
        body.model,
        body.actions,
        lambda time: np.linalg.norm(_ears_from(body, pose, time), axis=1),
        sample_rate=sample_rate,
        length=samples.shape[1],
    )
    return samples, left_out(kept, sample_rate)


def _ears_from(body: Body, pose: Pose, time: float) -> Array:
    """Return the ears as seen from a body when they hear what it sends at a time, m (ears, 3)."""
    place = body.emitter.centre.at(np.array([time]))
    way = float(np.linalg.norm(pose.at(np.array([time]))[0][0, 0] - place))
    return pose.at(np.array([time + way / AIR.sound_speed]))[0][0, 1:] - place


def _toward_ears(body: Body, pose: Pose) -> Callable[[float], Complex]:
    """Return a function of the time of sending: gains toward the ears when that arrives."""
    gains, back = body.model.gains.expanded(), np.asarray(body.rotation).T

    def outputs(time: float) -> Complex:
        ears = _ears_from(body, pose, time) @ back.T + centre_of(body.model)
        return finite(gains.toward(ears)[:, 0])

    return outputs


def _of_one_length(rows: Sequence[Array]) -> Array:
    longest = max(each.shape[1] for each in rows)
    return np.concatenate([np.pad(each, ((0, 0), (0, longest - each.shape[1]))) for each in rows])


def _heard(hearing: Hearing, rows: Array, length: int | None) -> Array:
    """Return what the ears hear (ears, n); of unsaid length, until all has arrived."""
    blocks, done = [], 0
    while length is None or done < length + hearing.lead:
        part = rows[:, done : done + _BLOCK]
        blocks.append(hearing.next_block(np.pad(part, ((0, 0), (0, _BLOCK - part.shape[1])))))
        done += _BLOCK
        if length is None and done >= rows.shape[1]:
            length = rows.shape[1] + hearing.propagation.longest
    return np.concatenate(blocks, axis=1)[:, hearing.lead : hearing.lead + length]


def _at_a_metre(body: Body, pose: Pose, rows: Array) -> Array:
    """Return what a body sounds like at 1 m (1, n); of a timbre field what the ears get there."""
    if not body.model.gains.directional:
        return rows
    start = np.zeros(1)
    apart = body.emitter.centre.at(start)[0] - pose.at(start)[0][0, 1:]
    return (rows * np.linalg.norm(apart, axis=1)[:, None]).mean(axis=0)[None]


def _reverberated(room: Room, sent: Array, ears: int, sample_rate: int) -> Array:
    """Return the late sound of a room, after that of its images (ears, n)."""
    from scipy.signal import oaconvolve

    start = round(room.mixing_time() * sample_rate)
    late = room.reverberation
    tail = late.tail(sample_rate, ears, start=start / sample_rate) if late else np.zeros((ears, 0))
    if not tail.size:
        return np.zeros((ears, 0))
    return np.pad(oaconvolve(sent[None], tail, axes=1), ((0, 0), (start, 0)))


def _of_one_duration(heard: Array, late: Array, length: int | None) -> Array:
    """Return both together; of unsaid length, until the later one ends."""
    longest = max(heard.shape[1], late.shape[1])
    both = [np.pad(each, ((0, 0), (0, longest - each.shape[1]))) for each in (heard, late)]
    return (both[0] + both[1])[:, :length]


def _notes(notes: Sequence[tuple[str, ...]], calibrated: Sequence[bool]) -> tuple[str, ...]:
    many = len(notes) > 1
    told = [
        f"body {number}: {note}" if many else note
        for number, some in enumerate(notes)
        for note in some
    ]
    if any(calibrated) and not all(calibrated):
        told.append(
            f"{calibrated.count(False)} of {len(calibrated)} bodies have relative gains, the "
            "others Pa: their levels cannot be compared"
        )
    return tuple(told)


# Offline sound: bodies and what happens to them, in; samples, out.

LONGEST_SOUND = 3600.0
"""The largest `seconds`."""


def render(
    model: ModalModel | Body | Sequence[Body],
    excitations: Action | Sequence[Action] = (),
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
    listener: Listener | ArrayLike | None = None,
    room: Room | None = None,
) -> Sound:
    """Return what a listener hears of bodies that are struck, scraped, rolled on, plucked or held.

    Parameters
    ----------
    model : ModalModel, Body, or several bodies
        What sounds; a `Body` is a model with its place in the scene and what happens to it.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, or several of them
        What pushes a single model and what holds it.
    seconds : float or None
        Length of the sound. None: until 60 dB of decay of the slowest among the loud modes (within
        40 dB of the loudest), at most 10 s after the last push.
    sample_rate : int
        Hz. Modes at or above half of it are left out, and the sound's notes say how many.
    listener : Mono, Stereo, Binaural, array-like (3,) or None
        Who hears it. A bare position in body coordinates, m, is one ear for which the travel time
        is left out: what a contact sends at t is heard at t. None: on the body's x axis through its
        centre, 1 m or two of its radii away, whichever is farther; several bodies are heard by
        `Mono()`.
    room : Room or None
        Whose walls reflect, for listeners other than a bare position.

    Returns
    -------
    Sound
        A channel for each ear, left first, in Pa when the models are calibrated.

    Raises
    ------
    OptionError
        On nothing to render, arguments outside their bounds, gains that are not finite, or pushes
        that never end where no length is said.
    ContactError
        On a contact off the body, or a listener inside one.

    Notes
    -----
    p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] is the answer to a unit impulse. Half-sine
    strikes at points are convolved with it in closed form (`struck.synth.ring_down`); all else goes
    through `struck.synth.resonators`, strikes too where a hand holds the body.
    """
    _require_bounds(seconds, sample_rate)
    if isinstance(model, ModalModel) and not (room or is_listener(listener)):
        body = Body(model=model, excitations=excitations)
        place = (
            centre_of(model) + place_beside(model) if listener is None else position_of(listener)
        )
        arrived = dry_sound(model, body.actions, place, seconds=seconds, sample_rate=sample_rate)
        return Sound(
            samples=arrived.samples.astype(np.float32),
            sample_rate=sample_rate,
            calibrated=model.calibrated,
            notes=arrived.notes,
        )
    return mixed(
        _bodies(model, excitations),
        _someone(listener),
        seconds=seconds,
        sample_rate=sample_rate,
        room=room,
    )


def _bodies(
    model: ModalModel | Body | Sequence[Body], excitations: Action | Sequence[Action]
) -> Sequence[Body]:
    if isinstance(model, ModalModel):
        return (Body(model=model, excitations=excitations),)
    bodies = (model,) if isinstance(model, Body) else tuple(model)
    if not bodies or not all(isinstance(each, Body) for each in bodies):
        raise OptionError(f"{model!r} are no bodies: give a ModalModel, or Body(...) for each")
    if excitations:
        raise OptionError("a Body brings its own excitations: give them there")
    return bodies


def _someone(listener: Listener | ArrayLike | None) -> Listener:
    if listener is None or is_listener(listener):
        return listener or Mono()
    return Mono(position=tuple(position_of(listener).tolist()))


def _require_bounds(seconds: float | None, sample_rate: int) -> None:
    if seconds is not None and not 0 < seconds <= LONGEST_SOUND:
        raise OptionError(f"seconds is {seconds}: it must lie above 0 and at most at 3600")
    if not (sample_rate >= 1 and float(sample_rate).is_integer()):
        raise OptionError(f"sample_rate is {sample_rate}: give a whole number of Hz, such as 48000")
