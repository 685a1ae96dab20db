"""Offline rendering: from bodies and their excitations to samples at a listener.

The sound of a body at a place is the sum of three parts: plain strikes in closed form, all other
pushes and holds block by block through resonators, and the attack and noise of a recorded model. At
a bare position this is the result. For listeners it is sent, from 1 m or toward each ear, through
`struck.ears` with its delays, heads and room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, TypeGuard, cast

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Listener, Mono, Trajectory, is_listener, position_of
from struck.ears.propagation import Pose
from struck.errors import OptionError, counted, rounded
from struck.excitation.excitation import Burst, Excitation, Hold, Push, Pushing
from struck.excitation.pulses import Samples
from struck.excitation.strike import Strike, after_attack, residual_of
from struck.files.sound import LARGEST, Sound
from struck.model.arrays import Array, Complex, checked, require_number
from struck.model.contact import Contact
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.scene.body import (
    Action,
    Body,
    Scene,
    away_from,
    centre_of,
    default_places,
    doubts,
    long_contacts,
    place_beside,
    unknowns,
    unused_roughness,
    with_fewer_modes,
    without_late_holds,
)
from struck.scene.ending import faded, is_cut_off, level_note, require_fade
from struck.scene.gathered_notes import gather_notes
from struck.scene.strike_energy import note_yielding
from struck.synth.poles import Poles, with_recoil
from struck.synth.ring_down import Pulse, below_nyquist, released, ring_down

if TYPE_CHECKING:
    from struck.ears.hearing import Hearing
    from struck.ears.room import Room
    from struck.scene.contacts import Contacts

LONGEST_SOUND = 3600.0  # the largest `seconds`
_MAX_RATE, _MAX_SAMPLES = 1e6, LONGEST_SOUND * 192_000
LONGEST_UNSAID = 60.0  # s, for which excitations may push if the length is not given
LONGEST_RING = 10.0  # s, the longest decay after that
SHORTEST_RING = 0.1  # and at least, s
# Fraction of the loudest mode: softer modes do not prolong a sound.
_MIN_AUDIBLE_RATIO = 10 ** (-40 / 20)
_DECAY_NEPERS = np.log(1000)  # 60 dB
_SAMPLED_VERTICES = 200  # vertices at most that show how far a body moves
_MAX_SHIFT_RATIO = 1e-3  # contacts moved by less than this fraction of the body are not noted
_MIN_GAIN_RATIO = 1e-9  # of the largest gain: strikes with less do not sound
_BLOCK = 128  # short, since drives of a moving contact are interpolated linearly within a block
_HEARING_BLOCK = 4096


@checked
def render(
    model: ModalModel | Body | Sequence[Body] | Scene,
    excitations: Action | Sequence[Action] | Contacts = (),
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
    listener: Listener | ArrayLike | None = None,
    room: Room | None = None,
    modes: int | None = None,
    fade: float | None = None,
) -> Sound:
    """Render the sound of excited bodies at a listener.

    Parameters
    ----------
    model : ModalModel, Body, sequence of Body, or Scene
        What sounds. A `Body` is a model with a pose in the scene and its own excitations.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, sequence of them, or Contacts
        Forces on a single model or a single `Body` without excitations, or all contacts of a
        `struck.scene.Scene`. A log in which nothing sounds gives silence as long as the log, with
        the reason in the notes of the sound. Default: none.
    seconds : float, optional
        Length of the sound. Default: until the slowest of the loud modes (within 40 dB of the
        loudest) has decayed by 60 dB, at most 10 s after the last excitation.
    sample_rate : int, default 48000
        Hz. Modes at or above half of it are left out, and counted in the notes of the sound.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Listener. A bare position, in body coordinates, m, is a single ear without propagation
        delay. Default: on the x axis of the body through its centre, at 1 m or at two radii of the
        body, whichever is farther; for several bodies `Mono()`.
    room : Room, optional
        Room whose walls reflect the sound. Needs a `Mono`, `Stereo` or `Binaural` listener.
    modes : int, optional
        Use only this many modes of each body, those that are loudest over all contacts. The notes
        of the sound report the audible difference, dB.
    fade : float, optional
        Duration of the fade at the end of a sound that is cut off less than 60 dB below its peak,
        s; 0 for none. Default: 0.01, or half of a sound shorter than 0.02 s.

    Returns
    -------
    Sound
        One channel per ear, left first; in Pa if the models are calibrated.

    Raises
    ------
    OptionError
        If there is nothing to render, the excitations of several bodies are given together, an
        argument is out of range, the fade is longer than the sound, a gain is not finite, or an
        excitation never ends and `seconds` is not given.
    ContactError
        If a contact is not on the body, or the listener is inside it.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> sound = struck.render(model, struck.Strike(striker="steel", speed=0.5), seconds=1.0)
    >>> sound.samples.shape
    (1, 48000)

    Two strikes, 0.25 s apart, heard in stereo:

    >>> strikes = [struck.Strike(time=0.0), struck.Strike(time=0.25)]
    >>> struck.render(model, strikes, seconds=1.0, listener=struck.ears.Stereo()).samples.shape
    (2, 48000)
    """
    # p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] answers a unit impulse. Half-sine strikes at
    # points are convolved with it in closed form (`struck.synth.ring_down`).
    require_length(seconds, sample_rate)
    require_fade(fade, seconds)
    model, mode_notes = with_fewer_modes(model, modes)
    remarks: tuple[str, ...] = ()
    is_log = hasattr(excitations, "body0")
    is_scene = isinstance(model, Scene)
    if isinstance(model, Scene):
        model, remarks = _excite_scene(model, excitations)
        if model.logged is not None and not any(body.pushed for body in model.bodies.values()):
            return _silent_sound(model, listener, mode_notes + remarks, seconds, sample_rate, fade)
        excitations, names, all_bodies = (), list(model.bodies), list(model.bodies.values())
    elif is_log:
        raise OptionError("contacts are those of a scene: give Scene(bodies={name: Body(...)})")
    else:
        all_bodies = _bodies(model, cast("Action | Sequence[Action]", excitations))
        names = [f"body {number}" for number in range(len(all_bodies))]
    _require_excited(all_bodies)
    names = [name for name, body in zip(names, all_bodies, strict=True) if not body.silent]
    names = names if len(all_bodies) > 1 else []
    bodies = [body for body in all_bodies if not body.silent]
    remarks += () if is_log else unused_roughness(bodies)
    remarks += doubts(bodies, seconds)
    if not is_scene:
        remarks += _gather_by_body([long_contacts(body, seconds) for body in bodies], names)
    bodies = [without_late_holds(body, seconds) for body in bodies]
    if isinstance(model, ModalModel) and not (room or is_listener(listener)):
        place = (
            centre_of(model) + place_beside(model) if listener is None else position_of(listener)
        )
        samples, notes = _compute_pressure(
            bodies[0], place, seconds=seconds, sample_rate=sample_rate
        )
    else:
        ears = _listener_of(listener)
        remarks += _note_outrun(ears)
        samples, notes = _mix_bodies(
            bodies, ears, room, names=names, seconds=seconds, sample_rate=sample_rate
        )
    is_calibrated = all(body.sounding.calibrated for body in bodies)
    samples = np.atleast_2d(samples)
    if (peak := float(np.abs(samples).max(initial=0.0))) > LARGEST:
        raise OptionError(
            f"the sound would reach {rounded(peak, 3)}{' Pa' if is_calibrated else ''}, and its "
            f"samples hold at most {rounded(LARGEST, 2)}: give a smaller impulse, speed or force"
        )
    require_fade(fade, samples.shape[1] / sample_rate)
    if fade != 0 and is_cut_off(samples, sample_rate):
        samples = faded(samples, sample_rate, fade)
    remarks = mode_notes + remarks + notes
    places = () if is_log else _gather_by_body([default_places(body) for body in bodies], names)
    if is_calibrated and (samples.any() or not remarks):
        remarks += level_note(samples)
    return Sound(
        samples=samples.astype(np.float32),
        sample_rate=sample_rate,
        calibrated=is_calibrated,
        notes=remarks + places,
    )


def _excite_scene(
    scene: Scene, contacts: Action | Sequence[Action] | Contacts
) -> tuple[Scene, tuple[str, ...]]:
    """Return a scene with the excitations of a contact log, and notes."""
    from struck.scene.contacts import Contacts
    from struck.scene.events import events_of

    if isinstance(contacts, Contacts):
        scene = events_of(scene, contacts).on()
        if early_count := np.count_nonzero(contacts.time < 0):
            note = (
                f"{counted(early_count, 'contact')} before 0 s, heard as at 0 s: add a time to all"
            )
            return scene, (*scene.notes, note)
    elif contacts:
        raise OptionError(
            "a scene takes Contacts; excitations belong to its bodies: give them there"
        )
    return scene, scene.notes


def _silent_sound(
    scene: Scene,
    listener: Listener | ArrayLike | None,
    notes: tuple[str, ...],
    seconds: float | None,
    sample_rate: int,
    fade: float | None,
) -> Sound:
    """Return silence for a scene without a sounding event; by default as long as its log."""
    if seconds is None:
        seconds = min(max(scene.logged or 0.0, SHORTEST_RING), LONGEST_UNSAID)
    require_fade(fade, seconds)
    ears = len(_listener_of(listener).ear_points)
    return Sound(
        samples=np.zeros((ears, max(1, round(seconds * sample_rate))), np.float32),
        sample_rate=sample_rate,
        calibrated=all(
            body.sounding.calibrated for body in scene.bodies.values() if not body.silent
        ),
        notes=notes,
    )


def _bodies(
    model: ModalModel | Body | Sequence[Body], excitations: Action | Sequence[Action]
) -> Sequence[Body]:
    """Return the bodies that are rendered, one of them with the excitations that are given."""
    if isinstance(model, ModalModel):
        return (Body(model=model, excitations=excitations),)
    bodies = (model,) if isinstance(model, Body) else tuple(model)
    if not bodies or not all(isinstance(body, Body) for body in bodies):
        raise OptionError(f"{model!r} are no bodies: give a ModalModel, or Body(...) for each")
    if isinstance(excitations, Sequence) and not excitations:
        return bodies
    single_body, *others = bodies
    if others:
        raise OptionError(
            f"there are {len(bodies)} bodies, and nothing says which of them is excited: give each "
            "its own excitations, as Body(model=..., excitations=...)"
        )
    if single_body.actions:
        raise OptionError(
            f"the Body has its own excitations ({len(single_body.actions)}), and more are given "
            "besides: give all of them in one of the two places"
        )
    return (replace(single_body, excitations=excitations),)


def _require_excited(bodies: Sequence[Body]) -> None:
    """Refuse bodies none of which is excited."""
    if not any(body.pushed for body in bodies):
        holds = sum(len(body.actions) for body in bodies)
        hold_text = f"{counted(holds, 'hold')} and nothing that strikes"
        raise OptionError(
            f"there is {hold_text if holds else 'nothing to render'}: give at least one strike"
        )


def _note_outrun(ears: Listener) -> tuple[str, ...]:
    """Return a note if a listener moves faster than sound between its places."""
    course = Trajectory.of("position", (0, 0, 0) if ears.position is None else ears.position)
    distances = np.linalg.norm(np.diff(course.points, axis=0), axis=1)
    max_speed = np.max(distances / np.diff(course.times), initial=0.0)
    text = (
        f"the listener moves at up to {rounded(max_speed, 4)} m/s, and sound at {AIR.sound_speed:g}"
    )
    note = f"{text}: what it outruns is not heard; places are given in m, times in s"
    return (note,) if max_speed > AIR.sound_speed else ()


def _listener_of(listener: Listener | ArrayLike | None) -> Listener:
    if listener is None or is_listener(listener):
        return listener or Mono()
    return Mono(position=tuple(position_of(listener).tolist()))


def require_length(seconds: float | None, sample_rate: int) -> None:
    """Refuse lengths, s, and sample rates, Hz, that no sound has."""
    if seconds is not None:
        hint = "it must lie above 0 and at most at 3600"
        require_number("seconds", seconds, 0, LONGEST_SOUND, above=True, hint=hint)
    hint = "give a whole number of Hz, such as 48000"
    require_number("sample_rate", sample_rate, 1, _MAX_RATE, whole=True, hint=hint)
    if seconds is not None and seconds * sample_rate > _MAX_SAMPLES:
        raise OptionError(
            f"{seconds} s at {sample_rate} Hz are {rounded(seconds * sample_rate, 3)} samples, "
            f"more than {rounded(_MAX_SAMPLES, 3)}: lower the sample rate, or render parts"
        )


def _compute_pressure(
    body: Body, listener: Array, *, seconds: float | None, sample_rate: int
) -> tuple[Array, tuple[str, ...]]:
    """Return the pressure (n,) at a place (3,) in body coordinates, without travel time."""
    model, actions = body.sounding, _delay_after_attack(body)
    holds = [action for action in actions if isinstance(action, Hold)]
    strikes = [action for action in actions if _is_plain(action) and not holds]
    others = [action for action in actions if holds or not _is_plain(action)]
    pulses, notes = _pulses(model, strikes, listener)
    is_below_nyquist = below_nyquist(model.frequencies, sample_rate)
    frequencies, decays = model.frequencies[is_below_nyquist], model.decays[is_below_nyquist]
    audible_pulses = [replace(pulse, gains=pulse.gains[is_below_nyquist]) for pulse in pulses]
    natural, cut_note = _length(frequencies, decays, audible_pulses)
    residuals, end = _residuals(body, sample_rate)
    natural = max(natural, end)
    driven_samples = np.zeros(0)
    if others:
        expanded_model = model.expanded()
        outputs = _outputs(expanded_model, listener[None], sample_rate)
        driven_body = DrivenBody(
            model=expanded_model, outputs=outputs, actions=others, sample_rate=sample_rate
        )
        driven_samples = driven_body.samples(seconds, min_seconds=natural)[0]
        notes += driven_body.notes
        length = len(driven_samples)
    else:
        length = max(1, round((natural if seconds is None else seconds) * sample_rate))
    samples = ring_down(frequencies, decays, audible_pulses, sample_rate=sample_rate, length=length)
    samples[: len(driven_samples)] += driven_samples
    _add_recoil(samples, model, strikes, listener, sample_rate)
    distances = np.array([np.linalg.norm(listener - centre_of(model))], np.float64)
    _add_residuals(samples[None], residuals, lambda _time: distances)
    remarks = _note_dropped_modes(model, sample_rate) + notes + unknowns(model, map(type, actions))
    return samples, remarks + (cut_note if seconds is None else ())


# Plain strikes: closed form.


def _is_plain(action: Action) -> TypeGuard[Strike]:
    """Return whether an action is a half-sine at a point, which has a closed form."""
    return isinstance(action, Strike) and action.has_closed_form


def _pulses(
    model: ModalModel, strikes: Sequence[Strike], listener: Array
) -> tuple[list[Pulse], tuple[str, ...]]:
    """Return the pulses of strikes, and a note of how far contacts were moved to the surface."""
    if not strikes:
        return [], ()
    contacts = [model.contact(strike.at, strike.direction) for strike in strikes]
    blows = [
        strike.resolved(model, contact) for strike, contact in zip(strikes, contacts, strict=True)
    ]
    drives = model.gains.at(
        np.stack([contact.point for contact in contacts]),
        np.stack([contact.direction for contact in contacts]),
    )
    gains = _require_finite((drives * model.gains.toward(listener[None])).sum(axis=1))
    pulses = [
        Pulse(gains=push.impulse * gain, onset=strike.time, duration=push.duration)
        for strike, push, gain in zip(strikes, blows, gains, strict=True)
    ]
    max_shift = max(contact.distance for contact in contacts)
    extent = 0.0 if model.geometry is None else model.geometry.extent
    shift_note = (
        f"a contact was moved {rounded(max_shift, 2)} m to the surface"
        if max_shift > _MAX_SHIFT_RATIO * extent
        else ""
    )
    rest_note, energy_note = "", ""
    if isinstance(model.gains, ShapeGains):
        energy_note = note_yielding(strikes, blows, contacts, model, drives[:, 0])
        if model.recoil is None:
            rest_note = _note_unmoved(model.gains, contacts, gains, listener)
    return pulses, tuple(filter(None, (shift_note, energy_note, rest_note)))


def _note_unmoved(
    gains: ShapeGains, contacts: Sequence[Contact], contact_gains: Complex, at: Array
) -> str:
    """Return a note of contacts whose gains (K, M) vanish, next to the largest on the body."""
    shapes = gains.shapes[:: 1 + len(gains.shapes) // _SAMPLED_VERTICES]
    max_shapes = np.maximum(shapes.max((0, 1)), -shapes.min((0, 1)))
    max_gain = np.max(max_shapes * np.abs(gains.toward(at[None])[0, 0]), initial=0.0)
    rest_contacts = np.flatnonzero(
        np.abs(contact_gains).max(1, initial=0.0) <= _MIN_GAIN_RATIO * max_gain
    )
    if not (len(rest_contacts) and max_gain):
        return ""
    first = contacts[rest_contacts[0]]
    place, direction = (
        ", ".join(rounded(x, 3) for x in vector) for vector in (first.point, first.direction)
    )
    return (
        f"{len(rest_contacts)} of {len(contacts)} strikes, as that at ({place}) along "
        f"({direction}), move no mode of the body: it is held or at rest there, or moves only "
        "across"
    )


def _outputs(model: ModalModel, listeners: Array, sample_rate: int) -> Complex:
    """Return output gains (K, N) of resonators at places (K, 3), for modes and recoil."""
    outputs = _require_finite(model.gains.toward(listeners))[:, 0]
    return with_recoil(outputs, model.recoil, away_from(model, listeners), sample_rate)


def _require_finite(gains: Complex) -> Complex:
    """Return gains, or raise an OptionError unless all are finite."""
    invalid_count = np.count_nonzero(~np.isfinite(gains).all(axis=tuple(range(gains.ndim - 1))))
    if invalid_count:
        raise OptionError(
            f"{invalid_count} of {gains.shape[-1]} modes have gains that are not finite: analyze "
            "the body again, or look at its model file"
        )
    return gains


def _add_recoil(
    samples: Array, model: ModalModel, strikes: Sequence[Strike], listener: Array, sample_rate: int
) -> None:
    """Add the recoil of strikes at a listener (3,), as resonators compute it from their pulses."""
    if model.recoil is None:
        return
    responses = model.recoil.answers(sample_rate, len(samples)) / away_from(model, listener[None])
    for strike in strikes:
        contact = model.contact(strike.at, strike.direction)
        pulse = strike.pulse(strike.resolved(model, contact), sample_rate)
        part = np.convolve(pulse.force, model.recoil.drives(contact.direction)[0] @ responses)
        start, end = max(pulse.first, 0), min(pulse.first + len(part), len(samples))
        if start < end:
            samples[start:end] += part[start - pulse.first : end - pulse.first]


def _length(
    frequencies: Array, decays: Array, pulses: Sequence[Pulse]
) -> tuple[float, tuple[str, ...]]:
    """Return the length of the sound of strikes, s, and a note if it is cut off."""
    if not pulses:
        return 0.0, ()
    last = max(pulse.release for pulse in pulses)
    poles = -decays + 2j * np.pi * frequencies
    strengths = np.max(
        [np.abs(pulse.gains * released(poles, pulse.duration)) for pulse in pulses], axis=0
    )
    ring_seconds = _ringing_time(decays, strengths)
    return last + ring_seconds, () if ring_seconds < LONGEST_RING else (
        f"the sound ends {LONGEST_RING:g} s after the last strike, before it has fallen by 60 dB",
    )


def _ringing_time(decays: Array, strengths: Array) -> float:
    """Return how long modes ring until the slowest of the loud ones has fallen by 60 dB, s."""
    min_decay = decays[strengths >= _MIN_AUDIBLE_RATIO * strengths.max(initial=0.0)].min(
        initial=np.inf
    )
    if min_decay * LONGEST_RING < _DECAY_NEPERS:
        return LONGEST_RING
    return max(_DECAY_NEPERS / min_decay, SHORTEST_RING)


def _note_dropped_modes(model: ModalModel, sample_rate: int) -> tuple[str, ...]:
    """Return a note of the number of modes left out, or of a model without modes."""
    is_below_nyquist = below_nyquist(model.frequencies, sample_rate)
    if not len(is_below_nyquist):
        lacking = f"no modes up to {_hertz(model.complete_to)}" if model.complete_to else "no modes"
        if model.recoil is not None:
            return (f"{lacking}, so that its recoil alone is heard",)
        return (f"{lacking}, so that it is silent: lower its damping, or widen its band",)
    lost_count = np.count_nonzero(~is_below_nyquist)
    if not lost_count:
        return ()
    note = (
        f"{lost_count} of {len(is_below_nyquist)} modes lie at or above {rounded(sample_rate / 2)} "
        "Hz and were left out"
    )
    return (note,)


def _hertz(frequency: float) -> str:
    """Return a frequency as "20 kHz" or "800 Hz"."""
    return (
        f"{rounded(frequency / 1000, 4)} kHz"
        if frequency >= 1000
        else f"{rounded(frequency, 4)} Hz"
    )


# All other pushes, and holds: block after block through resonators.


@dataclass(kw_only=True)
class DrivenBody:
    """A body that is pushed, and perhaps held, block after block."""

    model: ModalModel
    outputs: Complex  # (points, M), output gains, recoil after the modes
    actions: Sequence[Action]
    sample_rate: int  # Hz
    moving: Callable[[float], Complex] | None = None  # outputs at a time, s, where they change
    # Few of thousands of strikes push in one block, and only these are advanced: waiting ones with
    # first sample and voice, the last first, and pushing ones by voice.
    _waiting: list[tuple[int, int, Pushing]] = field(init=False)
    _pushings: dict[int, Pushing] = field(init=False, default_factory=dict)
    # Start times of scrapes and rolls that have not pushed yet, s, by voice.
    _unheard_times: dict[int, float] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        if self._silent:
            return
        self._holds = [excitation for excitation in self.actions if isinstance(excitation, Hold)]
        excitations: list[Excitation] = [e for e in self.actions if not isinstance(e, Hold)]
        from struck.synth.resonators import Resonators  # strikes alone need none

        self._resonators = Resonators(
            (self.model,),
            points=len(self.outputs),
            voices=max(1, len(excitations)),
            sample_rate=self.sample_rate,
            block=_BLOCK,
        )
        # Band-limited pulses begin some samples before their time; a whole block before it drives
        # reach their places at the same samples as live.
        self._next_sample = -_BLOCK
        pushings = [
            excitation.begin(self.model, self.sample_rate, start=self._next_sample)
            for excitation in excitations
        ]
        self._waiting = [
            (
                excitation.wait(_BLOCK) if isinstance(excitation, Burst) else self._next_sample,
                voice,
                excitation,
            )
            for voice, excitation in enumerate(pushings)
        ]
        self._waiting.sort(key=itemgetter(0), reverse=True)
        self._unheard_times = {
            voice: float(getattr(excitation, "time", 0.0))
            for voice, excitation in enumerate(excitations)
            if hasattr(excitation, "path")
        }
        # An ideal impulse, as many blows of recordings are, has no steady part.
        self._ideal = {n for n, e in enumerate(excitations) if _is_ideal(e, self.model)}
        self._decay_rises = [hold.raised(self.model) for hold in self._holds]
        self._active_holds: tuple[bool, ...] = (False,) * len(self._holds)
        self._decays = self.model.decays
        self._stand()

    @property
    def _silent(self) -> bool:
        return not (len(self.model.frequencies) or self.model.recoil)

    def samples(self, seconds: float | None, *, min_seconds: float) -> Array:
        """Return the pressure at points (points, n); without a length, until it has decayed."""
        blocks: list[Array] = []
        length = None if seconds is None else max(1, round(seconds * self.sample_rate))
        if self._silent:
            return np.zeros((len(self.outputs), length or 1))
        while length is None or self._next_sample < length:
            blocks.append(self._make_block(first=not blocks))
            if length is None:
                length = self._length(min_seconds)
        return np.concatenate(blocks, axis=1)[:, _BLOCK : _BLOCK + length]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the scrapes and rolls that did not push, once all samples are made."""
        silent_count = sum(
            time * self.sample_rate < self._next_sample for time in self._unheard_times.values()
        )
        note = (
            f"scrapes and rolls that are not heard: {silent_count}; they are at rest, without "
            "load, or so fast that all roughness passes within one sample: slow them down, or "
            "give a rougher surface"
        )
        return (note,) if silent_count else ()

    def _make_block(self, *, first: bool) -> Array:
        self._take_holds()
        while self._waiting and self._waiting[-1][0] <= self._next_sample:
            _, voice, pushing = self._waiting.pop()
            self._pushings[voice] = pushing
        pushes = [
            Push(force=push.force, drive=push.drive, voice=voice)
            for voice, pushing in sorted(self._pushings.items())
            if (push := pushing.advance(_BLOCK)) is not None
        ]
        self._pushings = {
            v: pushing for v, pushing in self._pushings.items() if not pushing.finished
        }
        for push in pushes:
            if push.voice in self._unheard_times and push.force.any():
                del self._unheard_times[push.voice]
        self._next_sample += _BLOCK
        if self.moving is not None:
            self.outputs = self.moving(self._next_sample / self.sample_rate)
        has_outputs = first or self.moving is not None
        samples = self._resonators.process(pushes, [self.outputs] if has_outputs else ())[0].copy()
        for push in (push for push in pushes if push.voice in self._ideal):
            gains = (self.outputs * self._steady_states)[:, : len(push.drive)]
            samples += np.outer(np.imag(gains @ push.drive), push.force)
        return samples

    def _take_holds(self) -> None:
        is_active = tuple(
            hold.holds_at(self._next_sample / self.sample_rate) for hold in self._holds
        )
        if is_active != self._active_holds:
            rises = [
                rise for rise, is_on in zip(self._decay_rises, is_active, strict=True) if is_on
            ]
            decays = np.sum([self.model.decays, *rises], axis=0)
            self._decays = np.asarray(decays, np.float64)
            self._resonators.change(0, replace(self.model, decays=self._decays))
            self._stand()
            self._active_holds = is_active

    def _stand(self) -> None:
        poles = Poles.of(replace(self.model, decays=self._decays), self.sample_rate)
        self._steady_states = poles.steady(poles.values / self.sample_rate, self.sample_rate)

    def _length(self, min_seconds: float) -> int | None:
        """Return the sound's length in samples, None while an excitation still pushes."""
        time = self._next_sample / self.sample_rate
        if not (self._waiting or self._pushings):
            amplitudes = np.abs(self._resonators.states(0) * self.outputs)
            strengths = amplitudes[:, : len(self._decays)].max(axis=0)
            passing = any(hold.seconds is not None for hold in self._holds)
            ring_seconds = _ringing_time(self.model.decays if passing else self._decays, strengths)
            return round(max(min_seconds, time + ring_seconds) * self.sample_rate)
        if time > LONGEST_UNSAID:
            raise OptionError(
                f"an excitation has not ended after {LONGEST_UNSAID:g} s: give the length of the "
                "sound with seconds="
            )
        return None


def _is_ideal(excitation: Excitation, model: ModalModel) -> bool:
    """Return whether an excitation is a blow without duration."""
    return isinstance(excitation, Strike) and excitation.is_ideal(model)


# Attack and noise of recorded models.


def _delay_after_attack(body: Body) -> list[Action]:
    """Return actions in which modes set in when the attack has led up to them."""
    return [
        after_attack(action, body.sounding) if isinstance(action, Strike) else action
        for action in body.actions
    ]


def _residuals(body: Body, sample_rate: int) -> tuple[list[tuple[float, Samples]], float]:
    """Return times and residual sounds of strikes at 1 m, and the end of the last, s."""
    strikes = [strike for strike in body.actions if isinstance(strike, Strike)]
    sounds = [(strike.time, residual_of(strike, body.sounding, sample_rate)) for strike in strikes]
    residuals = [(time, part) for time, part in sounds if part is not None]
    end = max((part.first + len(part.force) for _, part in residuals), default=0)
    return residuals, end / sample_rate


def _add_residuals(
    samples: Array, residuals: Sequence[tuple[float, Samples]], distances: Callable[[float], Array]
) -> None:
    """Add residuals to samples (rows, n), at distances (rows,), m, given by a function of time."""
    for time, part in residuals:
        start, end = max(part.first, 0), min(part.first + len(part.force), samples.shape[1])
        if start < end:
            segment = part.force[start - part.first : end - part.first]
            samples[:, start:end] += np.outer(1 / distances(time), segment)


# Bodies in space, heard by a listener.


def _mix_bodies(
    bodies: Sequence[Body],
    listener: Listener,
    room: Room | None,
    *,
    names: Sequence[str],
    seconds: float | None,
    sample_rate: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return the mixed sound of bodies at a listener's ears (ears, n); names for their notes."""
    from struck.ears.hearing import Hearing

    emitters = [body.emitter for body in bodies]
    hearing = Hearing(emitters, listener, sample_rate=sample_rate, room=room)
    pose = Pose.of(listener, emitters)
    options = {"seconds": seconds, "sample_rate": sample_rate}
    place_functions = [
        partial(hearing.propagation.heard_at, number) for number in range(len(bodies))
    ]
    sounds = [
        _send_sound(body, place_function, moves=pose.moves, **options)
        for body, place_function in zip(bodies, place_functions, strict=True)
    ]
    length = None if seconds is None else max(1, round(seconds * sample_rate))
    samples = _hear(hearing, _pad_rows([rows for rows, _ in sounds]), length)
    if room is not None and room.reverberation is not None:
        near_rows = [
            _average_at_metre(
                body, place_function(0.0), rows[: len(rows) // hearing.propagation.images]
            )
            if body.sounding.gains.directional
            else rows
            for body, place_function, (rows, _) in zip(bodies, place_functions, sounds, strict=True)
        ]
        late_sound = _reverberate(room, _pad_rows(near_rows).sum(axis=0), len(samples), sample_rate)
        samples = _add_late_sound(samples, late_sound, length)
    calibrations = [body.sounding.calibrated for body in bodies]
    remarks: tuple[str, ...] = ()
    if listener.position is None and (room is not None or len(pose.ear_points) > 1):
        place = ", ".join(
            rounded(round(coordinate, 6) + 0.0, 3)
            for coordinate in pose.position.at(np.zeros(1))[0]
        )
        remarks = (f"heard at {place} m, beside the body: listener= says otherwise",)
    return samples, remarks + _notes([notes for _, notes in sounds], calibrations, names)


def _send_sound(
    body: Body,
    place_function: Callable[[float], Array],
    *,
    moves: bool,
    seconds: float | None,
    sample_rate: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return a body's sound (rows, n) at 1 m, or at its listeners without travel times.

    `place_function` returns these places in body coordinates at a time of sending, s.
    """
    model = body.sounding
    if not body.actions:
        length = 1 if seconds is None else max(1, round(seconds * sample_rate))
        return np.zeros((len(place_function(0.0)) if model.gains.directional else 1, length)), ()
    if model.gains.directional:
        moves = moves or body.moves
        return _send_around(
            body, place_function, moves=moves, seconds=seconds, sample_rate=sample_rate
        )
    offset = place_beside(model)
    place = centre_of(model) + offset
    samples, notes = _compute_pressure(body, place, seconds=seconds, sample_rate=sample_rate)
    return offset[0] * samples[None], notes


def _send_around(
    body: Body,
    place_function: Callable[[float], Array],
    *,
    moves: bool,
    seconds: float | None,
    sample_rate: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return the sound of a timbre field at each place (rows, n), without travel time."""
    model = body.sounding.expanded()

    def outputs(time: float) -> Complex:
        return _outputs(model, place_function(time), sample_rate)

    driven_body = DrivenBody(
        model=model,
        outputs=outputs(0.0),
        actions=_delay_after_attack(body),
        sample_rate=sample_rate,
        moving=outputs if moves else None,
    )
    residuals, end = _residuals(body, sample_rate)
    samples = driven_body.samples(seconds, min_seconds=end)
    _add_residuals(
        samples,
        residuals,
        lambda time: np.linalg.norm(place_function(time) - centre_of(model), axis=1),
    )
    remarks = _note_dropped_modes(model, sample_rate) + driven_body.notes
    return samples, remarks + unknowns(model, map(type, body.actions))


def _pad_rows(rows: Sequence[Array]) -> Array:
    longest = max(part.shape[1] for part in rows)
    return np.concatenate([np.pad(part, ((0, 0), (0, longest - part.shape[1]))) for part in rows])


def _hear(hearing: Hearing, rows: Array, length: int | None) -> Array:
    """Return the pressure at the ears (ears, n); without a length, until all has arrived."""
    blocks, sample_count = [], 0
    while length is None or sample_count < length + hearing.lead:
        part = rows[:, sample_count : sample_count + _HEARING_BLOCK]
        blocks.append(
            hearing.next_block(np.pad(part, ((0, 0), (0, _HEARING_BLOCK - part.shape[1]))))
        )
        sample_count += _HEARING_BLOCK
        if length is None and sample_count >= rows.shape[1]:
            length = rows.shape[1] + hearing.propagation.longest
    return np.concatenate(blocks, axis=1)[:, hearing.lead : hearing.lead + length]


def _average_at_metre(body: Body, places: Array, rows: Array) -> Array:
    """Return the mean sound at 1 m (1, n) of a timbre field, from the direct sound at places."""
    distances = np.linalg.norm(places[: len(rows)] - centre_of(body.model), axis=1)
    return (rows * distances[:, None]).mean(axis=0)[None]


def _reverberate(room: Room, sound: Array, ears: int, sample_rate: int) -> Array:
    """Return the late sound of a room, after that of its images (ears, n)."""
    from scipy.signal import oaconvolve

    start = round(room.mixing_time() * sample_rate)
    reverberation = room.reverberation
    tail = (
        reverberation.tail(sample_rate, ears, start=start / sample_rate)
        if reverberation
        else np.zeros((ears, 0))
    )
    if not tail.size:
        return np.zeros((ears, 0))
    return np.pad(oaconvolve(sound[None], tail, axes=1), ((0, 0), (start, 0)))


def _add_late_sound(direct_sound: Array, late_sound: Array, length: int | None) -> Array:
    """Return direct and late sound together, the shorter one padded with silence."""
    padded_rows = _pad_rows([direct_sound, late_sound])
    return (padded_rows[: len(direct_sound)] + padded_rows[len(direct_sound) :])[:, :length]


def _notes(
    notes: Sequence[tuple[str, ...]], is_calibrated: Sequence[bool], names: Sequence[str]
) -> tuple[str, ...]:
    """Return the notes of bodies, with their names if there are any."""
    lines = _gather_by_body(notes, names)
    if any(is_calibrated) and not all(is_calibrated):
        note = (
            f"{is_calibrated.count(False)} of {len(is_calibrated)} bodies have relative gains, the "
            "others Pa: their levels cannot be compared"
        )
        return (*lines, note)
    return lines


def _gather_by_body(notes: Sequence[tuple[str, ...]], names: Sequence[str]) -> tuple[str, ...]:
    """Return the notes of bodies in order, gathered by name if there are names."""
    if names:
        pairs = zip(names, notes, strict=True)
        return gather_notes((name, note) for name, body_notes in pairs for note in body_notes)
    return tuple(note for body_notes in notes for note in body_notes)
