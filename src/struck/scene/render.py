"""Offline rendering: from bodies and their excitations to samples at a listener.

What a body sends to a place is the sum of three parts: plain strikes in closed form, whatever else
pushes or holds it block by block through resonators, and the attack and noise of a recorded model.
A bare position hears that as it is. For listeners it is sent, from 1 m or toward each ear, through
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
from struck.excitation.strike import Strike, after_attack, residual_of, unyielding
from struck.files.sound import LARGEST, Sound
from struck.model.arrays import Array, Complex, require_number
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
from struck.scene.gathered_notes import gathered
from struck.synth.poles import Poles, with_recoil
from struck.synth.ring_down import Pulse, below_nyquist, released, ring_down

if TYPE_CHECKING:
    from struck.ears.hearing import Hearing
    from struck.ears.room import Room
    from struck.scene.contacts import Contacts

LONGEST_SOUND = 3600.0  # the largest `seconds`
_HIGHEST_RATE, _MOST_SAMPLES = 1e6, LONGEST_SOUND * 192_000
LONGEST_UNSAID = 60.0  # how long a sound of unsaid length waits for what pushes to end, s
LONGEST_RING = 10.0  # how long it goes on after that at most, s
SHORTEST_RING = 0.1  # and at least, s
_QUIETEST = 10 ** (-40 / 20)  # softer modes than this share of the loudest do not prolong a sound
_SILENT = np.log(1000)
_SAMPLED = 200  # vertices at most that show how far a body moves
_MOVED = 1e-3  # contacts moved by less than this share of the body are not worth a note
_UNMOVED = 1e-9  # of the largest gain: what strikes with less are not heard
_BLOCK = 128  # short, since drives go straight from block to block where a contact moves
_HEARING_BLOCK = 4096


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
    """Return the sound of bodies at a listener (see `struck.render`)."""
    # p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] answers a unit impulse. Half-sine strikes at
    # points are convolved with it in closed form (`struck.synth.ring_down`).
    require_length(seconds, sample_rate)
    require_fade(fade, seconds)
    model, lost = with_fewer_modes(model, modes)
    told: tuple[str, ...] = ()
    logged = hasattr(excitations, "body0")
    staged = isinstance(model, Scene)
    if isinstance(model, Scene):
        model, told = _excited(model, excitations)
        if model.logged is not None and not any(body.pushed for body in model.bodies.values()):
            return _silent_sound(model, listener, lost + told, seconds, sample_rate)
        excitations, names, every = (), list(model.bodies), list(model.bodies.values())
    elif logged:
        raise OptionError("contacts are those of a scene: give Scene(bodies={name: Body(...)})")
    else:
        every = _bodies(model, cast("Action | Sequence[Action]", excitations))
        names = [f"body {number}" for number in range(len(every))]
    _require_excited(every)
    names = [name for name, body in zip(names, every, strict=True) if not body.silent]
    names = names if len(every) > 1 else []
    bodies = [body for body in every if not body.silent]
    told += () if logged else unused_roughness(bodies)
    told += doubts(bodies, seconds)
    told += () if staged else long_contacts(bodies, seconds)
    bodies = [without_late_holds(body, seconds) for body in bodies]
    if isinstance(model, ModalModel) and not (room or is_listener(listener)):
        place = (
            centre_of(model) + place_beside(model) if listener is None else position_of(listener)
        )
        samples, notes = _arriving(bodies[0], place, seconds=seconds, sample_rate=sample_rate)
    else:
        ears = _listener_of(listener)
        told += _outrun(ears)
        samples, notes = _mixed(
            bodies, ears, room, names=names, seconds=seconds, sample_rate=sample_rate
        )
    calibrated = all(body.sounding.calibrated for body in bodies)
    samples = np.atleast_2d(samples)
    if (peak := float(np.abs(samples).max(initial=0.0))) > LARGEST:
        raise OptionError(
            f"the sound would reach {rounded(peak, 3)}{' Pa' if calibrated else ''}, and its "
            f"samples hold at most {rounded(LARGEST, 2)}: give a smaller impulse, speed or force"
        )
    require_fade(fade, samples.shape[1] / sample_rate)
    if fade != 0 and is_cut_off(samples, sample_rate):
        samples = faded(samples, sample_rate, fade)
    told = lost + told + notes
    places = () if logged else _by_body([default_places(body) for body in bodies], names)
    if calibrated and (samples.any() or not told):
        told += level_note(samples)
    return Sound(
        samples=samples.astype(np.float32),
        sample_rate=sample_rate,
        calibrated=calibrated,
        notes=told + places,
    )


def _excited(
    scene: Scene, contacts: Action | Sequence[Action] | Contacts
) -> tuple[Scene, tuple[str, ...]]:
    """Return a scene with the excitations of a contact log, and notes."""
    from struck.scene.contacts import Contacts
    from struck.scene.events import events_of

    if isinstance(contacts, Contacts):
        scene = events_of(scene, contacts).on()
        if early := np.count_nonzero(contacts.time < 0):
            note = f"{counted(early, 'contact')} before 0 s, heard as at 0 s: add a time to all"
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
) -> Sound:
    """Return silence for a scene without a sounding event; by default as long as its log."""
    if seconds is None:
        seconds = min(max(scene.logged or 0.0, SHORTEST_RING), LONGEST_UNSAID)
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
    if not bodies or not all(isinstance(each, Body) for each in bodies):
        raise OptionError(f"{model!r} are no bodies: give a ModalModel, or Body(...) for each")
    if isinstance(excitations, Sequence) and not excitations:
        return bodies
    only, *others = bodies
    if others:
        raise OptionError(
            f"there are {len(bodies)} bodies, and nothing says which of them is excited: give each "
            "its own excitations, as Body(model=..., excitations=...)"
        )
    if only.actions:
        raise OptionError(
            f"the Body has its own excitations ({len(only.actions)}), and more are given "
            "beside it: give all of them in one of the two places"
        )
    return (replace(only, excitations=excitations),)


def _require_excited(bodies: Sequence[Body]) -> None:
    """Refuse bodies none of which is excited."""
    if not any(body.pushed for body in bodies):
        holds = sum(len(body.actions) for body in bodies)
        held = f"{counted(holds, 'hold')} and nothing that strikes"
        raise OptionError(
            f"there is {held if holds else 'nothing to render'}: give at least one strike"
        )


def _outrun(ears: Listener) -> tuple[str, ...]:
    """Return a note of a table of places between which a listener outruns the sound."""
    course = Trajectory.of("position", (0, 0, 0) if ears.position is None else ears.position)
    ways = np.linalg.norm(np.diff(course.points, axis=0), axis=1)
    fastest = np.max(ways / np.diff(course.times), initial=0.0)
    told = (
        f"the listener moves at up to {rounded(fastest, 4)} m/s, and sound at {AIR.sound_speed:g}"
    )
    note = f"{told}: what it outruns is not heard; places are given in m, times in s"
    return (note,) if fastest > AIR.sound_speed else ()


def _listener_of(listener: Listener | ArrayLike | None) -> Listener:
    if listener is None or is_listener(listener):
        return listener or Mono()
    return Mono(position=tuple(position_of(listener).tolist()))


def require_length(seconds: float | None, sample_rate: int) -> None:
    """Refuse lengths, s, and sample rates, Hz, that no sound has."""
    if seconds is not None:
        wanted = "it must lie above 0 and at most at 3600"
        require_number("seconds", seconds, 0, LONGEST_SOUND, above=True, hint=wanted)
    wanted = "give a whole number of Hz, such as 48000"
    require_number("sample_rate", sample_rate, 1, _HIGHEST_RATE, whole=True, hint=wanted)
    if seconds is not None and seconds * sample_rate > _MOST_SAMPLES:
        raise OptionError(
            f"{seconds} s at {sample_rate} Hz are {rounded(seconds * sample_rate, 3)} samples, "
            f"more than {rounded(_MOST_SAMPLES, 3)}: lower the sample rate, or render parts"
        )


def _arriving(
    body: Body, listener: Array, *, seconds: float | None, sample_rate: int
) -> tuple[Array, tuple[str, ...]]:
    """Return the pressure (n,) at a place (3,) in body coordinates, without travel time."""
    model, actions = body.sounding, _after_attack(body)
    holds = [each for each in actions if isinstance(each, Hold)]
    strikes = [each for each in actions if _is_plain(each) and not holds]
    others = [each for each in actions if holds or not _is_plain(each)]
    pulses, notes = _pulses(model, strikes, listener)
    kept = below_nyquist(model.frequencies, sample_rate)
    frequencies, decays = model.frequencies[kept], model.decays[kept]
    heard = [replace(pulse, gains=pulse.gains[kept]) for pulse in pulses]
    natural, cut = _length(frequencies, decays, heard)
    residuals, end = _residuals(body, sample_rate)
    natural = max(natural, end)
    driven = np.zeros(0)
    if others:
        whole = model.expanded()
        outputs = _outputs(whole, listener[None], sample_rate)
        pushed = DrivenBody(model=whole, outputs=outputs, actions=others, sample_rate=sample_rate)
        driven = pushed.samples(seconds, at_least=natural)[0]
        notes += pushed.notes
        length = len(driven)
    else:
        length = max(1, round((natural if seconds is None else seconds) * sample_rate))
    samples = ring_down(frequencies, decays, heard, sample_rate=sample_rate, length=length)
    samples[: len(driven)] += driven
    _add_recoil(samples, model, strikes, listener, sample_rate)
    away = np.array([np.linalg.norm(listener - centre_of(model))], np.float64)
    _add_residuals(samples[None], residuals, lambda _time: away)
    told = _left_out(model, sample_rate) + notes + unknowns(model, map(type, actions))
    return samples, told + (cut if seconds is None else ())


# Plain strikes: closed form.


def _is_plain(action: Action) -> TypeGuard[Strike]:
    """Return whether an action is a half-sine at a point, which has a closed form."""
    return (
        isinstance(action, Strike)
        and action.shape == "half-sine"
        and not action.patch
        and not action.transient
    )


def _pulses(
    model: ModalModel, strikes: Sequence[Strike], listener: Array
) -> tuple[list[Pulse], tuple[str, ...]]:
    """Return the pulses of strikes, and a note of how far contacts were moved to the surface."""
    if not strikes:
        return [], ()
    contacts = [model.contact(strike.at, strike.direction) for strike in strikes]
    pushes = [
        strike.resolved(model, contact) for strike, contact in zip(strikes, contacts, strict=True)
    ]
    drives = model.gains.at(
        np.stack([contact.point for contact in contacts]),
        np.stack([contact.direction for contact in contacts]),
    )
    gains = _finite((drives * model.gains.toward(listener[None])).sum(axis=1))
    pulses = [
        Pulse(gains=push.impulse * gain, onset=strike.time, duration=push.duration)
        for strike, push, gain in zip(strikes, pushes, gains, strict=True)
    ]
    moved = max(contact.distance for contact in contacts)
    extent = 0.0 if model.geometry is None else model.geometry.extent
    told = (
        f"a contact was moved {rounded(moved, 2)} m to the surface"
        if moved > _MOVED * extent
        else ""
    )
    still, rich = "", ""
    if isinstance(model.gains, ShapeGains):
        rich = unyielding(strikes, pushes, contacts, model, drives[:, 0])
        if model.recoil is None:
            still = _unmoved(model.gains, contacts, gains, listener)
    return pulses, tuple(filter(None, (told, rich, still)))


def _unmoved(gains: ShapeGains, contacts: Sequence[Contact], heard: Complex, at: Array) -> str:
    """Return a note of contacts whose gains (K, M) vanish, next to the largest on the body."""
    shapes = gains.shapes[:: 1 + len(gains.shapes) // _SAMPLED]
    largest = np.maximum(shapes.max((0, 1)), -shapes.min((0, 1)))
    loudest = np.max(largest * np.abs(gains.toward(at[None])[0, 0]), initial=0.0)
    still = np.flatnonzero(np.abs(heard).max(1, initial=0.0) <= _UNMOVED * loudest)
    if not (len(still) and loudest):
        return ""
    first = contacts[still[0]]
    place, way = (", ".join(rounded(x, 3) for x in each) for each in (first.point, first.direction))
    told = f"{len(still)} of {len(contacts)} strikes, as that at ({place}) along ({way}), move"
    return f"{told} no mode of the body: it is held or at rest there, or moves only across"


def _outputs(model: ModalModel, listeners: Array, sample_rate: int) -> Complex:
    """Return output gains (K, N) of resonators at places (K, 3), for modes and recoil."""
    outputs = _finite(model.gains.toward(listeners))[:, 0]
    return with_recoil(outputs, model.recoil, away_from(model, listeners), sample_rate)


def _finite(gains: Complex) -> Complex:
    """Return gains, or raise an OptionError unless all are finite."""
    wrong = np.count_nonzero(~np.isfinite(gains).all(axis=tuple(range(gains.ndim - 1))))
    if wrong:
        raise OptionError(
            f"{wrong} of {gains.shape[-1]} modes have gains that are not finite: analyze the body "
            "again, or look at its model file"
        )
    return gains


def _add_recoil(
    samples: Array, model: ModalModel, strikes: Sequence[Strike], listener: Array, sample_rate: int
) -> None:
    """Add the recoil of strikes, heard at a place (3,), as resonators make it of their pulses."""
    if model.recoil is None:
        return
    answers = model.recoil.answers(sample_rate, len(samples)) / away_from(model, listener[None])
    for strike in strikes:
        contact = model.contact(strike.at, strike.direction)
        pulse = strike.pulse(strike.resolved(model, contact), sample_rate)
        part = np.convolve(pulse.force, model.recoil.drives(contact.direction)[0] @ answers)
        begin, end = max(pulse.first, 0), min(pulse.first + len(part), len(samples))
        if begin < end:
            samples[begin:end] += part[begin - pulse.first : end - pulse.first]


def _length(
    frequencies: Array, decays: Array, pulses: Sequence[Pulse]
) -> tuple[float, tuple[str, ...]]:
    """Return for how long strikes are to be heard, s, and a note when that was cut short."""
    if not pulses:
        return 0.0, ()
    last = max(pulse.release for pulse in pulses)
    poles = -decays + 2j * np.pi * frequencies
    strengths = np.max(
        [np.abs(pulse.gains * released(poles, pulse.duration)) for pulse in pulses], axis=0
    )
    more = _ringing_time(decays, strengths)
    return last + more, () if more < LONGEST_RING else (
        f"the sound ends {LONGEST_RING:g} s after the last strike, before it has fallen by 60 dB",
    )


def _ringing_time(decays: Array, strengths: Array) -> float:
    """Return how long modes ring until the slowest of the loud ones has fallen by 60 dB, s."""
    slowest = decays[strengths >= _QUIETEST * strengths.max(initial=0.0)].min(initial=np.inf)
    if slowest * LONGEST_RING < _SILENT:
        return LONGEST_RING
    return max(_SILENT / slowest, SHORTEST_RING)


def _left_out(model: ModalModel, sample_rate: int) -> tuple[str, ...]:
    """Return a note of how many modes are not heard, where any is not or none is there."""
    kept = below_nyquist(model.frequencies, sample_rate)
    if not len(kept):
        lacking = f"no modes up to {_hertz(model.complete_to)}" if model.complete_to else "no modes"
        if model.recoil is not None:
            return (f"{lacking}, so that its recoil alone is heard",)
        return (f"{lacking}, so that it is silent: lower its damping, or widen its band",)
    lost = np.count_nonzero(~kept)
    if not lost:
        return ()
    return (
        f"{lost} of {len(kept)} modes lie at or above {sample_rate / 2:g} Hz and were left out",
    )


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
    outputs: Complex  # (points, M), recoil after the modes: what is heard
    actions: Sequence[Action]
    sample_rate: int  # Hz
    moving: Callable[[float], Complex] | None = None  # outputs at a time, s, where they change
    # Of thousands of strikes few push in one block, and these alone are asked: what waits with its
    # first sample and its voice, the last first, and what pushes by its voice.
    _waiting: list[tuple[int, int, Pushing]] = field(init=False)
    _pushings: dict[int, Pushing] = field(init=False, default_factory=dict)
    _unfelt: dict[int, float] = field(init=False, default_factory=dict)  # begins, s, by voice

    def __post_init__(self) -> None:
        if self._silent:
            return
        self._holds = [each for each in self.actions if isinstance(each, Hold)]
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
        self._now = -_BLOCK
        begun = [each.begin(self.model, self.sample_rate, start=self._now) for each in excitations]
        self._waiting = [
            (each.wait(_BLOCK) if isinstance(each, Burst) else self._now, voice, each)
            for voice, each in enumerate(begun)
        ]
        self._waiting.sort(key=itemgetter(0), reverse=True)
        self._unfelt = {
            voice: float(getattr(each, "time", 0.0))
            for voice, each in enumerate(excitations)
            if hasattr(each, "path")
        }
        # Of an ideal impulse, which many blows of recordings are, nothing is steady.
        self._ideal = {n for n, e in enumerate(excitations) if _is_ideal(e, self.model)}
        self._raised = [hold.raised(self.model) for hold in self._holds]
        self._held: tuple[bool, ...] = (False,) * len(self._holds)
        self._decays = self.model.decays
        self._stand()

    @property
    def _silent(self) -> bool:
        return not (len(self.model.frequencies) or self.model.recoil)

    def samples(self, seconds: float | None, *, at_least: float) -> Array:
        """Return the pressure at points (points, n); without a length, until it has decayed."""
        blocks: list[Array] = []
        length = None if seconds is None else max(1, round(seconds * self.sample_rate))
        if self._silent:
            return np.zeros((len(self.outputs), length or 1))
        while length is None or self._now < length:
            blocks.append(self._next(first=not blocks))
            if length is None:
                length = self._length(at_least)
        return np.concatenate(blocks, axis=1)[:, _BLOCK : _BLOCK + length]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the scrapes and rolls that did not push, once all samples are made."""
        still = sum(time * self.sample_rate < self._now for time in self._unfelt.values())
        told = (
            f"scrapes and rolls that are not heard: {still}; they are at rest, without load, or so "
            "fast that all roughness passes within one sample: slow them down, or give a rougher "
            "surface"
        )
        return (told,) if still else ()

    def _next(self, *, first: bool) -> Array:
        self._take_holds()
        while self._waiting and self._waiting[-1][0] <= self._now:
            _, voice, begun = self._waiting.pop()
            self._pushings[voice] = begun
        pushes = [
            Push(force=push.force, drive=push.drive, voice=voice)
            for voice, each in sorted(self._pushings.items())
            if (push := each.advance(_BLOCK)) is not None
        ]
        self._pushings = {v: each for v, each in self._pushings.items() if not each.finished}
        for push in pushes:
            if push.voice in self._unfelt and push.force.any():
                del self._unfelt[push.voice]
        self._now += _BLOCK
        if self.moving is not None:
            self.outputs = self.moving(self._now / self.sample_rate)
        given = first or self.moving is not None
        samples = self._resonators.process(pushes, [self.outputs] if given else ())[0].copy()
        for push in (push for push in pushes if push.voice in self._ideal):
            answers = (self.outputs * self._steady)[:, : len(push.drive)]
            samples += np.outer(np.imag(answers @ push.drive), push.force)
        return samples

    def _take_holds(self) -> None:
        held = tuple(hold.holds_at(self._now / self.sample_rate) for hold in self._holds)
        if held != self._held:
            raised = [more for more, now in zip(self._raised, held, strict=True) if now]
            decays = np.sum([self.model.decays, *raised], axis=0)
            self._decays = np.asarray(decays, np.float64)
            self._resonators.change(0, replace(self.model, decays=self._decays))
            self._stand()
            self._held = held

    def _stand(self) -> None:
        poles = Poles.of(replace(self.model, decays=self._decays), self.sample_rate)
        self._steady = poles.steady(poles.values / self.sample_rate, self.sample_rate)

    def _length(self, at_least: float) -> int | None:
        """Return the sound's length in samples, None while an excitation still pushes."""
        now = self._now / self.sample_rate
        if not (self._waiting or self._pushings):
            heard = np.abs(self._resonators.states(0) * self.outputs)
            strengths = heard[:, : len(self._decays)].max(axis=0)
            passing = any(hold.seconds is not None for hold in self._holds)
            more = _ringing_time(self.model.decays if passing else self._decays, strengths)
            return round(max(at_least, now + more) * self.sample_rate)
        if now > LONGEST_UNSAID:
            raise OptionError(
                f"what pushes has not ended after {LONGEST_UNSAID:g} s: say how long the sound "
                "shall be with seconds="
            )
        return None


def _is_ideal(excitation: Excitation, model: ModalModel) -> bool:
    """Return whether an excitation is a blow without duration."""
    if not isinstance(excitation, Strike):
        return False
    contact = model.contact(excitation.at, excitation.direction)
    return not excitation.resolved(model, contact).duration


# Attack and noise of recorded models.


def _after_attack(body: Body) -> list[Action]:
    """Return actions in which modes set in when the attack has led up to them."""
    return [
        after_attack(each, body.sounding) if isinstance(each, Strike) else each
        for each in body.actions
    ]


def _residuals(body: Body, sample_rate: int) -> tuple[list[tuple[float, Samples]], float]:
    """Return times and residual sounds of strikes at 1 m, and the end of the last, s."""
    strikes = [each for each in body.actions if isinstance(each, Strike)]
    every = [(each.time, residual_of(each, body.sounding, sample_rate)) for each in strikes]
    heard = [(time, part) for time, part in every if part is not None]
    end = max((part.first + len(part.force) for _, part in heard), default=0)
    return heard, end / sample_rate


def _add_residuals(
    samples: Array, residuals: Sequence[tuple[float, Samples]], distances: Callable[[float], Array]
) -> None:
    """Add residuals to samples (rows, n), at distances (rows,), m, given by a function of time."""
    for time, part in residuals:
        begin, end = max(part.first, 0), min(part.first + len(part.force), samples.shape[1])
        if begin < end:
            heard = part.force[begin - part.first : end - part.first]
            samples[:, begin:end] += np.outer(1 / distances(time), heard)


# Bodies in space, heard by a listener.


def _mixed(
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
    given = {"seconds": seconds, "sample_rate": sample_rate}
    ways = [partial(hearing.propagation.heard_at, number) for number in range(len(bodies))]
    sent = [
        _sent(body, seen, moves=pose.moves, **given)
        for body, seen in zip(bodies, ways, strict=True)
    ]
    length = None if seconds is None else max(1, round(seconds * sample_rate))
    samples = _heard(hearing, _of_one_length([rows for rows, _ in sent]), length)
    if room is not None and room.reverberation is not None:
        near = [
            _at_a_metre(body, seen(0.0), rows[: len(rows) // hearing.propagation.images])
            if body.sounding.gains.directional
            else rows
            for body, seen, (rows, _) in zip(bodies, ways, sent, strict=True)
        ]
        late = _reverberated(room, _of_one_length(near).sum(axis=0), len(samples), sample_rate)
        samples = _of_one_duration(samples, late, length)
    known = [body.sounding.calibrated for body in bodies]
    told: tuple[str, ...] = ()
    if listener.position is None and (room is not None or len(pose.ear_points) > 1):
        place = ", ".join(
            rounded(round(each, 6) + 0.0, 3) for each in pose.position.at(np.zeros(1))[0]
        )
        told = (f"heard at {place} m, beside the body: listener= says otherwise",)
    return samples, told + _notes([notes for _, notes in sent], known, names)


def _sent(
    body: Body,
    seen: Callable[[float], Array],
    *,
    moves: bool,
    seconds: float | None,
    sample_rate: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return a body's sound (rows, n) at 1 m, or at its listeners without travel times.

    `seen` tells these places in its own coordinates at a time of sending, s.
    """
    model = body.sounding
    if not body.actions:
        length = 1 if seconds is None else max(1, round(seconds * sample_rate))
        return np.zeros((len(seen(0.0)) if model.gains.directional else 1, length)), ()
    if model.gains.directional:
        moves = moves or body.moves
        return _sent_around(body, seen, moves=moves, seconds=seconds, sample_rate=sample_rate)
    far = place_beside(model)
    place = centre_of(model) + far
    samples, notes = _arriving(body, place, seconds=seconds, sample_rate=sample_rate)
    return far[0] * samples[None], notes


def _sent_around(
    body: Body,
    seen: Callable[[float], Array],
    *,
    moves: bool,
    seconds: float | None,
    sample_rate: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return the sound of a timbre field at each place (rows, n), without travel time."""
    model = body.sounding.expanded()

    def outputs(time: float) -> Complex:
        return _outputs(model, seen(time), sample_rate)

    driven = DrivenBody(
        model=model,
        outputs=outputs(0.0),
        actions=_after_attack(body),
        sample_rate=sample_rate,
        moving=outputs if moves else None,
    )
    residuals, end = _residuals(body, sample_rate)
    samples = driven.samples(seconds, at_least=end)
    _add_residuals(
        samples, residuals, lambda time: np.linalg.norm(seen(time) - centre_of(model), axis=1)
    )
    told = _left_out(model, sample_rate) + driven.notes
    return samples, told + unknowns(model, map(type, body.actions))


def _of_one_length(rows: Sequence[Array]) -> Array:
    longest = max(each.shape[1] for each in rows)
    return np.concatenate([np.pad(each, ((0, 0), (0, longest - each.shape[1]))) for each in rows])


def _heard(hearing: Hearing, rows: Array, length: int | None) -> Array:
    """Return the pressure at the ears (ears, n); without a length, until all has arrived."""
    blocks, done = [], 0
    while length is None or done < length + hearing.lead:
        part = rows[:, done : done + _HEARING_BLOCK]
        blocks.append(
            hearing.next_block(np.pad(part, ((0, 0), (0, _HEARING_BLOCK - part.shape[1]))))
        )
        done += _HEARING_BLOCK
        if length is None and done >= rows.shape[1]:
            length = rows.shape[1] + hearing.propagation.longest
    return np.concatenate(blocks, axis=1)[:, hearing.lead : hearing.lead + length]


def _at_a_metre(body: Body, places: Array, rows: Array) -> Array:
    """Return the mean sound at 1 m (1, n) of a timbre field, from the direct sound at places."""
    distances = np.linalg.norm(places[: len(rows)] - centre_of(body.model), axis=1)
    return (rows * distances[:, None]).mean(axis=0)[None]


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
    """Return direct and late sound together, the shorter one padded with silence."""
    both = _of_one_length([heard, late])
    return (both[: len(heard)] + both[len(heard) :])[:, :length]


def _notes(
    notes: Sequence[tuple[str, ...]], calibrated: Sequence[bool], names: Sequence[str]
) -> tuple[str, ...]:
    """Return the notes of bodies, with their names if there are any."""
    lines = _by_body(notes, names)
    if any(calibrated) and not all(calibrated):
        relative = (
            f"{calibrated.count(False)} of {len(calibrated)} bodies have relative gains, the "
            "others Pa: their levels cannot be compared"
        )
        return (*lines, relative)
    return lines


def _by_body(notes: Sequence[tuple[str, ...]], names: Sequence[str]) -> tuple[str, ...]:
    """Return the notes of bodies one after the other, gathered by name if there are names."""
    if names:
        named = zip(names, notes, strict=True)
        return gathered((name, note) for name, some in named for note in some)
    return tuple(note for some in notes for note in some)
