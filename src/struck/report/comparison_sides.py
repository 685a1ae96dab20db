"""The two sides of a comparison: a model that is struck, and a recording with its modes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import position_of
from struck.errors import ContactError, RecordingError
from struck.excitation.strike import Strike
from struck.files.sound import Sound
from struck.model.arrays import Array, Index
from struck.model.exponentials import samples
from struck.model.model import ModalModel
from struck.model.provenance import Progress, silent
from struck.recordings.calibration.agreement import FittedModes, Partials
from struck.recordings.poles.search import Fitted, fit_poles
from struck.recordings.segments import Row
from struck.recordings.takes import Take, without_force
from struck.scene.body import centre_of, place_beside
from struck.scene.render import render
from struck.synth.ring_down import released

# A recording that a model is compared with: its modes, and the hit that is compared.

FEWEST = 64
"""Modes that are fitted at least, where so many stand out."""
_BEFORE = 0.02
_EARS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedHit:
    """One hit of a recording.

    Parameters
    ----------
    fitted : Fitted
        The modes that all its hits share, with the gains of this one.
    sound : Sound
        From shortly before it to the next one.
    begins : float
        From its onset to the moment of the gains, s.
    notes : tuple of str
        What a person should know of the recording.
    """

    fitted: Fitted
    sound: Sound
    begins: float
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls,
        recording: Sound | Take | str | os.PathLike[str],
        *,
        modes: int = FEWEST,
        progress: Progress = silent,
    ) -> RecordedHit:
        """Fit a recording, and choose its loudest hit.

        Parameters
        ----------
        recording : Sound, Take or path
            Of one body, struck once or several times.
        modes : int
            Not more than these, those that explain most; `FEWEST` where that is more.
        progress : callable
            Told the stage and the fraction done.

        Raises
        ------
        RecordingError
            When nothing is struck in it, or nothing rings.
        FileFormatError, MissingDependencyError
            When its file cannot be read.
        """
        take = _take(recording)
        # Modes under a budget must not be spent on the blow itself.
        fitted = fit_poles(take, budget=max(FEWEST, modes), attack=False, progress=progress)
        if not len(fitted.frequencies):
            reason = fitted.verdict.reason or "all that it holds are tones of the surroundings"
            raise RecordingError(f"{take.name}: {reason}: there is nothing to compare with")
        chosen = _loudest(fitted)
        rows = tuple(fitted.rows[row] for row in chosen)
        gains, errors = fitted.gains[chosen], fitted.gain_errors[chosen]
        return cls(
            fitted=replace(fitted, gains=gains, gain_errors=errors, rows=rows),
            sound=_cut(without_force(take), rows[0].onset, fitted.rows),
            begins=rows[0].time - rows[0].onset,
            notes=_notes(take, fitted),
        )


def _take(recording: Sound | Take | str | os.PathLike[str]) -> Take:
    if isinstance(recording, Take):
        return recording
    return Take.of(recording) if isinstance(recording, Sound) else Take.load(recording)


def _loudest(fitted: Fitted) -> list[int]:
    """Return the rows of gains of the hit that holds most energy."""
    lasting = 1 / np.maximum(fitted.decays, 1e-3 * fitted.frequencies)
    energies = (np.square(np.abs(fitted.gains)) * lasting).sum(axis=1)
    hits = np.array([row.hit for row in fitted.rows])
    best = int(np.argmax(np.bincount(hits, weights=energies)))
    return np.flatnonzero(hits == best).tolist()


def _cut(take: Take, onset: float, rows: Sequence[Row]) -> Sound:
    """Return the sound of one hit, up to the next."""
    begin = max(0, round((onset - _BEFORE) * take.sample_rate))
    later = [row.onset for row in rows if row.onset > onset]
    end = round((min(later) - _BEFORE) * take.sample_rate) if later else take.samples.shape[1]
    samples = take.samples[:_EARS, begin : max(end, begin + 1)]
    return Sound(samples=samples.astype(np.float32), sample_rate=take.sample_rate)


def _notes(take: Take, fitted: Fitted) -> tuple[str, ...]:
    verdict = () if fitted.verdict.modal else (f"{take.name}: {fitted.verdict.reason}",)
    hits = len({row.hit for row in fitted.rows})
    several = (f"{take.name} holds {hits} hits: levels are those of the loudest",) * (hits > 1)
    return (*verdict, *several, *fitted.notes)


# The two sides of a comparison: a model that is struck, or what was fitted to a recording.

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
