"""What one body sends to one place: offline sound of all that happens to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from struck.beside import residual_sound, set_back
from struck.driven import LONGEST_RING, Driven, lasting
from struck.errors import OptionError
from struck.excitation.hold import Hold
from struck.excitation.pushing import Excitation
from struck.excitation.strike import Strike
from struck.model.contact import Contact
from struck.model.model import Array, ModalModel
from struck.scene.body import Action, centre_of
from struck.synth.ring_down import Complex, Pulse, below_nyquist, released, ring_down

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
    """Return what arrives at a place (3,) in body coordinates; see `struck.rendering.render`."""
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
