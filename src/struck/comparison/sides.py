"""The two sides of a comparison: a model that is struck, or what was fitted to a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.ears.listeners import position_of
from struck.errors import ContactError
from struck.excitation.strike import Strike
from struck.files.sound import Sound
from struck.model.exponentials import samples
from struck.model.model import ModalModel
from struck.recordings.calibration.partials import FittedModes, Partials
from struck.rendering import render
from struck.scene.body import centre_of, place_beside
from struck.synth.ring_down import released

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SILENT = 1e-6
_QUIETEST = -60.0
"""A mode whose energy is that far below the loudest one's, dB, is as often heard as not."""
_SECONDS, _LONGEST = 3.0, 10.0
_SAMPLE_RATE = 48000
_BAND = 0.45
"""Share of its sample rate up to which a recording tells all that rings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """One of two bodies that are compared, as it sounds.

    Parameters
    ----------
    name : str
        What people call it.
    partials : Partials
        Its modes as heard.
    complete_to : float
        No mode below it is missing, Hz.
    computed : bool
        Whether modes that are not heard are known too.
    calibrated : bool
        Whether amplitudes are Pa.
    seconds : float
        For how long it is worth hearing.
    sound : callable
        Makes its sound, so many seconds long at most.
    begins : float
        How long after the beginning of the strike amplitudes count, s; 0: as soon as it is over.
    notes : tuple of str
        What a person should know of it.
    """

    name: str
    partials: Partials
    complete_to: float
    computed: bool
    calibrated: bool
    seconds: float
    sound: Callable[[float], Sound]
    begins: float = 0.0
    notes: tuple[str, ...] = ()

    @classmethod
    def of_model(
        cls,
        name: str,
        model: ModalModel,
        strike: Strike,
        listener: ArrayLike | None,
        *,
        begins: float = 0.0,
    ) -> Side:
        """Take a model that is struck, heard from beside it unless a listener (3,) is given.

        What a model of recordings holds is what was heard: as complete as a recording, no more.

        Raises
        ------
        ContactError
            When the contact is off the body, or the strike wakes no mode.
        """
        beside = centre_of(model) + place_beside(model)
        place = beside if listener is None else position_of(listener)
        recorded = model.geometry is None
        return cls(
            name=name,
            partials=Partials(
                frequencies=model.frequencies,
                decays=model.decays,
                amplitudes=_amplitudes(model, strike, place, begins),
                frequency_errors=_errors(model) if recorded else np.zeros_like(model.frequencies),
                decay_errors=np.zeros_like(model.frequencies),
            ),
            complete_to=np.inf if recorded else model.complete_to,
            computed=not recorded,
            calibrated=model.calibrated,
            seconds=_SECONDS,
            sound=lambda seconds: render(model, strike, seconds=seconds, listener=place),
            begins=begins,
        )

    @classmethod
    def of_recording(cls, fitted: FittedModes, recording: Sound | None = None) -> Side:
        """Take fitted modes, with the recording or what they sound like themselves."""
        if recording is None:
            return cls._heard(fitted, lambda seconds: _resynthesised(fitted, seconds))
        return replace(
            cls._heard(fitted, lambda seconds: _shortened(recording, seconds)),
            complete_to=_BAND * recording.sample_rate,
            seconds=min(recording.duration, _LONGEST),
        )

    @classmethod
    def _heard(cls, fitted: FittedModes, sound: Callable[[float], Sound]) -> Side:
        return cls(
            name="recording",
            partials=Partials.of(fitted),
            complete_to=np.inf,
            computed=False,
            calibrated=False,
            seconds=_SECONDS,
            sound=sound,
        )

    @property
    def audible(self) -> Array:
        """How far each mode can be expected to be heard beside the loudest, 0 to 1 (M,)."""
        slowest = np.maximum(self.partials.decays, 1e-3 * self.partials.frequencies)
        energies = np.square(self.partials.amplitudes) / slowest
        quietest = 10 ** (_QUIETEST / 10) * energies.max()
        return energies / (energies + quietest)

    @property
    def levels(self) -> Array:
        """Amplitudes in dB; NaN for modes that are silent beside the loudest (M,)."""
        amplitudes = self.partials.amplitudes
        loud = amplitudes > _SILENT * amplitudes.max()
        return 20 * np.log10(np.where(loud, amplitudes, np.nan))

    def lonely(self, modes: Index, beside: Side, factor: float) -> Index:
        """Return which modes without a partner are told by `beside` to be none of its body's.

        Parameters
        ----------
        modes : array
            Numbers of modes without a partner.
        beside : Side
            What they have no partner in.
        factor : float
            By which frequencies of `beside` exceed those here.
        """
        known = self.partials.frequencies[modes] <= beside.complete_to / factor
        heard = beside.computed or self.audible[modes] >= 0.5
        return modes[known & heard]


def _amplitudes(model: ModalModel, strike: Strike, listener: Array, begins: float) -> Array:
    """Return how strong modes are so long after the strike began, Pa or relative (M,)."""
    contact = model.contact(strike.at, strike.direction)
    blow = strike.resolved(model, contact)
    drives = model.gains.at(contact.point[None], contact.direction[None])[0]
    gains = (drives * model.gains.toward(listener[None])[0]).sum(axis=0)
    poles = -model.decays + 2j * np.pi * model.frequencies
    left = np.exp(-model.decays * max(begins - blow.duration, 0.0))
    amplitudes = blow.impulse * np.abs(gains * released(poles, blow.duration)) * left
    if not amplitudes.any():
        place = np.round(contact.point, 4).tolist()
        raise ContactError(
            f"a strike at {place} m wakes none of {len(poles)} modes: strike another place"
        )
    return amplitudes


def _errors(model: ModalModel) -> Array:
    """Return standard errors of frequencies that were fitted, Hz (M,); 0 where unknown."""
    shares = np.zeros_like(model.frequencies) if model.errors is None else model.errors
    return np.nan_to_num(shares) * model.frequencies


def _shortened(sound: Sound, seconds: float) -> Sound:
    length = max(1, round(seconds * sound.sample_rate))
    return replace(sound, samples=sound.samples[:, :length])


def _resynthesised(fitted: FittedModes, seconds: float) -> Sound:
    """Return what fitted modes sound like in the first channel or two."""
    poles = -np.asarray(fitted.decays) + 2j * np.pi * np.asarray(fitted.frequencies)
    gains = np.atleast_2d(np.asarray(fitted.gains, np.complex128))[:2]
    heard = np.flatnonzero(poles.imag < np.pi * _SAMPLE_RATE)
    length = round(seconds * _SAMPLE_RATE)
    sound = samples(poles[heard], gains[:, heard], length, _SAMPLE_RATE)
    return Sound(samples=sound.astype(np.float32), sample_rate=_SAMPLE_RATE)
