"""Offline sound: a model and what strikes it, in; samples, out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.contact import Contact
from struck.driven import LONGEST_RING, SHORTEST_RING, Driven, lasting
from struck.errors import OptionError
from struck.excitation.hold import Hold
from struck.excitation.pushing import Excitation
from struck.excitation.strike import Strike
from struck.model import Array, ModalModel
from struck.sound import Sound
from struck.synth.ring_down import Complex, Pulse, below_nyquist, released, ring_down

__all__ = ["LONGEST_RING", "LONGEST_SOUND", "SHORTEST_RING", "Action", "render"]

Action = Excitation | Hold
"""What may happen to a body."""
LONGEST_SOUND = 3600.0
"""The largest `seconds`."""

# Contacts moved by less than this share of the body are not worth a note.
_MOVED = 1e-3


def render(
    model: ModalModel,
    excitations: Action | Sequence[Action],
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
    listener: ArrayLike | None = None,
) -> Sound:
    """Return what a listener hears of a body that is struck, scraped, rolled on, plucked or held.

    Parameters
    ----------
    model : ModalModel
        The body.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, or several of them
        What pushes it and what holds it.
    seconds : float or None
        Length of the sound. None: until 60 dB of decay of the slowest among the loud modes (within
        40 dB of the loudest), at most 10 s after the last push.
    sample_rate : int
        Hz. Modes at or above half of it are left out, and the sound's notes say how many.
    listener : array-like (3,) or None
        Position in body coordinates, m. None: on the body's x axis through its centre, 1 m or two
        of its radii away, whichever is farther.

    Returns
    -------
    Sound
        One channel, in Pa when the model is calibrated. The travel time is left out: what a
        contact sends at t is heard at t.

    Raises
    ------
    OptionError
        On nothing to render, arguments outside their bounds, gains that are not finite, or pushes
        that never end where no length is said.
    ContactError
        On a contact off the body, or a listener inside it.

    Notes
    -----
    p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] is the answer to a unit impulse. Half-sine
    strikes at points are convolved with it in closed form (`struck.synth.ring_down`); all else goes
    through `struck.synth.resonators`, strikes too where a hand holds the body.
    """
    actions = _actions(excitations)
    _require_bounds(seconds, sample_rate)
    position = _default_listener(model) if listener is None else _position(listener)
    holds = [each for each in actions if isinstance(each, Hold)]
    strikes = [each for each in actions if _is_plain(each) and not holds]
    others = [each for each in actions if not (isinstance(each, Hold) or each in strikes)]
    pulses, notes = _pulses(model, strikes, position)
    kept = below_nyquist(model.frequencies, sample_rate)
    frequencies, decays = model.frequencies[kept], model.decays[kept]
    heard = [replace(pulse, gains=pulse.gains[kept]) for pulse in pulses]
    natural, cut = _length(frequencies, decays, heard)
    driven = np.zeros(0)
    if others or holds:
        driven = _driven(model, others, holds, position, sample_rate, seconds, natural)
        length = len(driven)
    else:
        length = max(1, round((natural if seconds is None else seconds) * sample_rate))
    samples = ring_down(frequencies, decays, heard, sample_rate=sample_rate, length=length)
    samples[: len(driven)] += driven
    return Sound(
        samples=samples.astype(np.float32),
        sample_rate=sample_rate,
        calibrated=model.calibrated,
        notes=_left_out(kept, sample_rate) + notes + (cut if seconds is None else ()),
    )


def _actions(excitations: Action | Sequence[Action]) -> Sequence[Action]:
    actions = list(excitations) if isinstance(excitations, Sequence) else [excitations]
    if not actions:
        raise OptionError("there is nothing to render: give at least one Strike")
    for each in actions:
        if not (isinstance(each, Hold) or callable(getattr(each, "begin", None))):
            raise OptionError(f"{each!r} is no excitation: give Strike(...) or several of them")
    return actions


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
    outputs = _finite(model.gains.toward(listener[None]))[:, 0]
    driven = Driven(
        model=model,
        outputs=outputs,
        excitations=excitations,
        holds=holds,
        sample_rate=sample_rate,
    )
    return driven.samples(seconds, at_least=at_least)[0]


def _require_bounds(seconds: float | None, sample_rate: int) -> None:
    if seconds is not None and not 0 < seconds <= LONGEST_SOUND:
        raise OptionError(f"seconds is {seconds}: it must lie above 0 and at most at 3600")
    if not (sample_rate >= 1 and float(sample_rate).is_integer()):
        raise OptionError(f"sample_rate is {sample_rate}: give a whole number of Hz, such as 48000")


def _position(listener: ArrayLike) -> Array:
    position = np.asarray(listener, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise OptionError(f"listener is {listener!r}: give one position (x, y, z) in m")
    return position


def _default_listener(model: ModalModel) -> Array:
    centre = np.zeros(3) if model.centre is None else np.asarray(model.centre)
    radius = 0.0
    if model.geometry is not None:
        radius = float(np.linalg.norm(model.geometry.points - centre, axis=1).max())
    return centre + np.array([max(1.0, 2 * radius), 0.0, 0.0])


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
    return _finite((drives * model.gains.toward(listener[None])).sum(axis=1))


def _finite(gains: Complex) -> Complex:
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


def _left_out(kept: NDArray[np.bool_], sample_rate: int) -> tuple[str, ...]:
    lost = np.count_nonzero(~kept)
    if not lost:
        return ()
    return (
        f"{lost} of {len(kept)} modes lie at or above {sample_rate / 2:g} Hz and were left out",
    )
