"""What one body sends to one place: offline sound of all that happens to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.excitation import Excitation, Pushing
from struck.excitation.hold import Hold
from struck.excitation.pulses import LEAD, sampled
from struck.excitation.strike import Strike
from struck.model.arrays import Array, Complex
from struck.model.contact import Contact
from struck.model.model import ModalModel
from struck.model.residual import Residual
from struck.scene.body import Action, centre_of
from struck.synth.ring_down import Pulse, below_nyquist, released, ring_down

# What strikes of a recorded object sound like beside its modes: offline.


def set_back(model: ModalModel, actions: Sequence[Action]) -> list[Action]:
    """Return actions in which modes set in when the attack has led up to them."""
    if model.residual is None:
        return list(actions)
    lead = model.residual.lead
    return [
        replace(each, time=each.time + lead) if isinstance(each, Strike) else each
        for each in actions
    ]


def residual_sound(
    model: ModalModel,
    actions: Sequence[Action],
    distances: Callable[[float], Array],
    *,
    sample_rate: int,
    length: int,
) -> Array:
    """Return attacks and noise of all strikes, as strong as those (rows, length).

    Parameters
    ----------
    model : ModalModel
    actions : sequence of Action
        As they were before `set_back`; only strikes count.
    distances : callable
        Returns how far away each row is at a time (rows,), m.
    sample_rate : int
        Hz.
    length : int
        Samples.
    """
    strikes = [each for each in actions if isinstance(each, Strike)]
    rows = len(distances(0.0))
    heard = np.zeros((rows, length))
    if model.residual is None:
        return heard
    for strike in strikes:
        first, part = _sounding(model, model.residual, strike, sample_rate)
        begin, end = max(first, 0), min(first + len(part), length)
        if begin < end:
            heard[:, begin:end] += np.outer(
                1 / distances(strike.time), part[begin - first : end - first]
            )
    return heard


def _sounding(
    model: ModalModel, residual: Residual, strike: Strike, sample_rate: int
) -> tuple[int, Array]:
    """Return the sample at which a strike's attack begins, and what sounds from there on at 1 m.

    A longer push than the recorded one takes its treble off, as it does with the modes.
    """
    blow = strike.resolved(model, model.contact(strike.at, strike.direction))
    samples = residual.samples(sample_rate, strike.seed)
    if not blow.duration:
        return round(strike.time * sample_rate), blow.impulse * samples
    pulse = sampled(
        strike.shape,
        impulse=blow.impulse,
        onset=strike.time,
        duration=blow.duration,
        sample_rate=sample_rate,
    )
    from scipy.signal import oaconvolve

    return pulse.first, np.asarray(oaconvolve(samples, pulse.force), np.float64) / sample_rate


# Offline sound of whatever goes on pushing a body: block after block through its resonators.

LONGEST_UNSAID = 60.0
"""How long a sound of unsaid length waits for what pushes to end, s."""
LONGEST_RING = 10.0
"""How long it goes on after that at most, s."""
SHORTEST_RING = 0.1
"""How long it goes on at least, s."""
_QUIETEST = 10 ** (-40 / 20)
_SILENT = np.log(1000)
# Short, since drives go straight from block to block where a contact moves.
_BLOCK = 128


def resonators_for(*models: ModalModel, engine: str = "auto", **options: Any) -> Any:  # noqa: ANN401 - either kind
    """Return resonators for some bodies: compiled ones, or plain NumPy's where numba is missing."""
    try:
        from struck.synth.resonators import Resonators
    except ImportError:  # numba comes late to new versions of Python
        from struck.synth.reference import ReferenceResonators

        return ReferenceResonators(models, **options)
    return Resonators(models, engine=engine, **options)


@dataclass(kw_only=True)
class Driven:
    """A body that is pushed, and perhaps held.

    Parameters
    ----------
    model : ModalModel
    outputs : array (points, M), complex
        What is heard.
    excitations : sequence of Excitation
    holds : sequence of Hold
    sample_rate : int
        Hz.
    moving : callable or None
        Outputs at a time, s, where they change.
    """

    model: ModalModel
    outputs: Complex
    excitations: Sequence[Excitation]
    holds: Sequence[Hold]
    sample_rate: int
    moving: Callable[[float], Complex] | None = None
    _pushings: list[Pushing] = field(init=False)

    def __post_init__(self) -> None:
        # A hand may damp modes more than the block transform bears.
        engine = "stepped" if self.holds else "auto"
        options = {"sample_rate": self.sample_rate, "block": _BLOCK, "engine": engine}
        voices = max(1, len(self.excitations))
        points = len(self.outputs)
        self._resonators = resonators_for(self.model, points=points, voices=voices, **options)
        # Band-limited pulses begin some samples before their time.
        self._now = -LEAD
        self._pushings = [
            each.begin(self.model, self.sample_rate, start=self._now) for each in self.excitations
        ]
        self._raised = [hold.raised(self.model) for hold in self.holds]
        self._held: tuple[bool, ...] = (False,) * len(self.holds)
        self._decays = self.model.decays

    def samples(self, seconds: float | None, *, at_least: float) -> Array:
        """Return what is heard (points, samples).

        Parameters
        ----------
        seconds : float or None
            None: until all pushes have ended and what rings then has died away.
        at_least : float
            s, where seconds is None.

        Raises
        ------
        OptionError
            Where seconds is None and the pushes do not end within a minute.
        """
        blocks: list[Array] = []
        length = None if seconds is None else max(1, round(seconds * self.sample_rate))
        while length is None or self._now < length:
            blocks.append(self._next(first=not blocks))
            if length is None:
                length = self._length(at_least)
        return np.concatenate(blocks, axis=1)[:, LEAD : LEAD + length]

    def _next(self, *, first: bool) -> Array:
        self._take_holds()
        pushes = [
            replace(push, voice=voice)
            for voice, push in enumerate(each.advance(_BLOCK) for each in self._pushings)
            if push is not None
        ]
        self._now += _BLOCK
        if self.moving is not None:
            self.outputs = self.moving(self._now / self.sample_rate)
        given = first or self.moving is not None
        samples = self._resonators.process(pushes, [self.outputs] if given else ())
        return samples[0].copy()

    def _take_holds(self) -> None:
        held = tuple(hold.holds_at(self._now / self.sample_rate) for hold in self.holds)
        if held != self._held:
            raised = [more for more, now in zip(self._raised, held, strict=True) if now]
            decays = np.sum([self.model.decays, *raised], axis=0)
            self._decays = np.asarray(decays, np.float64)
            self._resonators.change(0, replace(self.model, decays=self._decays))
            self._held = held

    def _length(self, at_least: float) -> int | None:
        """Return how many samples the sound has, None as long as something still pushes."""
        now = self._now / self.sample_rate
        if all(each.finished for each in self._pushings):
            strengths = np.abs(self._resonators.states(0) * self.outputs).max(axis=0)
            passing = any(hold.seconds is not None for hold in self.holds)
            more = lasting(self.model.decays if passing else self._decays, strengths)
            return round(max(at_least, now + more) * self.sample_rate)
        if now > LONGEST_UNSAID:
            raise OptionError(
                f"what pushes has not ended after {LONGEST_UNSAID:g} s: say how long the sound "
                "shall be with seconds="
            )
        return None


def lasting(decays: Array, strengths: Array) -> float:
    """Return how long modes ring until the slowest of the loud ones has fallen by 60 dB, s.

    Loud is what is within 40 dB of the loudest. At most `LONGEST_RING`.
    """
    loud = decays[strengths >= _QUIETEST * strengths.max(initial=0.0)]
    slowest = loud.min(initial=np.inf)
    if slowest * LONGEST_RING < _SILENT:
        return LONGEST_RING
    return max(_SILENT / slowest, SHORTEST_RING)


# Contacts moved by less than this share of the body are not worth a note.
_MOVED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dry:
    """What arrives, the travel time left out.

    Parameters
    ----------
    samples : array (n,)
        Pa, or relative.
    notes : tuple of str
        What a listener should know.
    """

    samples: Array
    notes: tuple[str, ...]


def dry_sound(
    model: ModalModel,
    actions: Sequence[Action],
    listener: Array,
    *,
    seconds: float | None,
    sample_rate: int,
) -> Dry:
    """Return what arrives at a place (3,) in body coordinates; see `struck.scene.render.render`."""
    asked, actions = actions, set_back(model, actions)
    holds = [each for each in actions if isinstance(each, Hold)]
    strikes = [each for each in actions if _is_plain(each) and not holds]
    others = [each for each in actions if not (isinstance(each, Hold) or each in strikes)]
    pulses, notes = _pulses(model, strikes, listener)
    kept = below_nyquist(model.frequencies, sample_rate)
    frequencies, decays = model.frequencies[kept], model.decays[kept]
    heard = [replace(pulse, gains=pulse.gains[kept]) for pulse in pulses]
    natural, cut = _length(frequencies, decays, heard)
    driven = np.zeros(0)
    if others or holds:
        driven = _driven(model, others, holds, listener, sample_rate, seconds, natural)
        length = len(driven)
    else:
        length = max(1, round((natural if seconds is None else seconds) * sample_rate))
    samples = ring_down(frequencies, decays, heard, sample_rate=sample_rate, length=length)
    samples[: len(driven)] += driven
    away = np.array([np.linalg.norm(listener - centre_of(model))], np.float64)
    samples += residual_sound(
        model, asked, lambda _time: away, sample_rate=sample_rate, length=length
    )[0]
    notes = left_out(kept, sample_rate) + notes + (cut if seconds is None else ())
    return Dry(samples=samples, notes=notes)


def _is_plain(action: Action) -> TypeGuard[Strike]:
    """Tell whether an action is a half-sine at a point, which has a closed form."""
    return (
        isinstance(action, Strike)
        and action.shape == "half-sine"
        and not action.patch
        and not action.transient
    )


def _driven(
    model: ModalModel,
    excitations: Sequence[Excitation],
    holds: Sequence[Hold],
    listener: Array,
    sample_rate: int,
    seconds: float | None,
    at_least: float,
) -> Array:
    outputs = finite(model.gains.toward(listener[None]))[:, 0]
    driven = Driven(
        model=model,
        outputs=outputs,
        excitations=excitations,
        holds=holds,
        sample_rate=sample_rate,
    )
    return driven.samples(seconds, at_least=at_least)[0]


def _pulses(
    model: ModalModel, strikes: Sequence[Strike], listener: Array
) -> tuple[list[Pulse], tuple[str, ...]]:
    """Return what the modes feel, and how far contacts were moved to reach the surface."""
    if not strikes:
        return [], ()
    contacts = [model.contact(strike.at, strike.direction) for strike in strikes]
    pushes = [
        strike.resolved(model, contact) for strike, contact in zip(strikes, contacts, strict=True)
    ]
    gains = _gains(model, contacts, listener)
    pulses = [
        Pulse(gains=push.impulse * gain, onset=strike.time, duration=push.duration)
        for strike, push, gain in zip(strikes, pushes, gains, strict=True)
    ]
    moved = max(contact.distance for contact in contacts)
    extent = 0.0 if model.geometry is None else model.geometry.extent
    notable = moved > _MOVED * extent
    return pulses, (f"a contact was moved {moved:.2g} m to the surface",) if notable else ()


def _gains(model: ModalModel, contacts: Sequence[Contact], listener: Array) -> Complex:
    """Return the gain of each mode for each contact, Pa/(N s) or relative (K, M)."""
    drives = model.gains.at(
        np.stack([contact.point for contact in contacts]),
        np.stack([contact.direction for contact in contacts]),
    )
    return finite((drives * model.gains.toward(listener[None])).sum(axis=1))


def finite(gains: Complex) -> Complex:
    """Return gains, or raise an OptionError unless all are finite."""
    wrong = np.count_nonzero(~np.isfinite(gains).reshape(-1, gains.shape[-1]).all(axis=0))
    if wrong:
        raise OptionError(
            f"{wrong} of {gains.shape[-1]} modes have gains that are not finite: analyze the body "
            "again, or look at its model file"
        )
    return gains


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
    more = lasting(decays, strengths)
    return last + more, () if more < LONGEST_RING else (
        f"the sound ends {LONGEST_RING:g} s after the last strike, before it has fallen by 60 dB",
    )


def left_out(kept: NDArray[np.bool_], sample_rate: int) -> tuple[str, ...]:
    """Say how many modes are not heard."""
    lost = np.count_nonzero(~kept)
    if not lost:
        return ()
    return (
        f"{lost} of {len(kept)} modes lie at or above {sample_rate / 2:g} Hz and were left out",
    )
