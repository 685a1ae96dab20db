"""Comparison of a computed body with a recording, or with another model, mode by mode."""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import position_of
from struck.errors import ContactError, OptionError, RecordingError, counted, rounded
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.files.atomic import require_ending, write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array, Index, Mask, brief, checked
from struck.model.contact import Place
from struck.model.exponentials import samples
from struck.model.gains import ShapeGains
from struck.model.html import PAGES, document, picture, table
from struck.model.model import LOUDEST, ModalModel
from struck.model.picture_style import in_default_style
from struck.model.provenance import Progress, reported, shown, silent
from struck.recordings.calibration.agreement import FittedModes, Partials
from struck.recordings.calibration.pairing import Pairing, explains, paired, pairs_by_chance
from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.segments import Row
from struck.recordings.takes import Take, without_force
from struck.report.charts import (
    BLUE,
    INK,
    ORANGE,
    RANGE,
    chart,
    decibels,
    frequency_axis,
    plain,
    spectrogram,
    strongest,
)
from struck.scene.body import centre_of, place_beside
from struck.scene.render import render
from struck.synth.ring_down import released

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What a model is compared with: another model, a recording, or fitted modes.
Other = ModalModel | FittedModes | Sound | Take | str | os.PathLike[str]

FEWEST = 64  # modes that are fitted at least, where that many stand out
# Headings of the table of paired modes.
HEADINGS = ("mode", "model (Hz)", "other (Hz)", "cents", "T60 model (s)", "T60 other (s)",
            "decay (%)", "level (dB)", "sure (%)")  # fmt: skip
_COLOURS = (BLUE, ORANGE)  # of the first side and of the second
_DOUBT = 0.1  # least audibility of a mode: no real strike is exactly on a node
_BEFORE = 0.02  # of a recording before its hit, s
_EARS = 2
_MIN_PAIRED_FRACTION = 0.5  # share of two models' modes in pairs below which these say little
_SILENT = 1e-6
_SHARED = 1e-3  # relative distance of modes that ring as one
_QUIETEST = -60.0  # modes that far below the loudest one's energy, dB, are as often heard as not
_SECONDS, _LONGEST = 3.0, 10.0
_SAMPLE_RATE = 48000  # of fitted modes without a recording, Hz
_BAND = 0.45  # share of its sample rate up to which a recording is complete


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Comparison of a model with a recording of the body, or with another model.

    Parameters
    ----------
    model : Side
        The model.
    other : Side
        The recording or the other model.
    pairing : Pairing
        Pairs of modes, and their confidence.
    cents : array (P,)
        Frequencies of the other's modes relative to the model's, cents.
    decay_ratios : array (P,)
        Ratio of the other's decay rates to the model's; NaN if the latter is 0.
    level_differences : array (P,)
        Levels of the other's modes relative to the model's, without `level_offset`, dB; NaN if one
        is silent.
    level_offset : float
        Median of the level differences, dB, which is removed from them unless both are calibrated.
    missing : array
        Numbers of the model's modes that the other lacks though they should be heard; a fit's modes
        that stand for the blow are not missed, nor extra.
    twins : array
        Numbers of the model's unpaired modes that share their frequency with a paired one, as those
        of a round body do: they are heard as one.
    extra : array
        Numbers of the other's modes that the model lacks though it should have them.
    explained : bool
        Whether the two agree better than by chance.
    by_chance : float, default 0.0
        Number of pairs that random modes would give; 0 if the two certainly agree better.
    """

    __repr__ = brief
    model: Side
    other: Side
    pairing: Pairing
    cents: Array
    decay_ratios: Array
    level_differences: Array
    level_offset: float
    missing: Index
    twins: Index
    extra: Index
    explained: bool
    by_chance: float = 0.0

    @property
    def pairs(self) -> Index:
        """Numbers of the model's modes and the other's that belong together (P, 2)."""
        return np.stack([self.pairing.computed, self.pairing.fitted], axis=1)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about either side."""
        return (*self.model.notes, *self.other.notes)

    def summary(self) -> list[str]:
        """Summarise the differences.

        Returns
        -------
        list of str
            One line per result.
        """
        model_count, other_count = (
            len(item.partials.frequencies) for item in (self.model, self.other)
        )
        name, pairs = self.other.name, counted(len(self.cents), "pair")
        modes = counted(model_count, "mode")
        lines = [
            f"{pairs} of {modes} of the model and {other_count} of the {name}",
            f"{len(self.missing)} of the model should be in the {name} and are not",
            f"{len(self.extra)} of the {name} should be in the model and are not",
        ]
        if len(self.twins):
            twins = f"{len(self.twins)} of the model share a frequency with a paired one"
            lines.insert(1, f"{twins}, and are heard with it")
        lines += [f"the {side.name} is {side.struck}" for side in (self.model, self.other)]
        if not self.explained:
            percentage = 100 * min(1.0, self.by_chance / max(len(self.cents), 1))
            lines.append("caution: random modes would agree as well; this may be another body")
            lines.append(f"about {percentage:.0f} % of the pairs would be found by chance")
        if name == "other model" and len(self.cents) < _MIN_PAIRED_FRACTION * min(
            model_count, other_count
        ):
            caveat = "which says little of two designs: see their sonic distance"
            lines.append(f"caution: {pairs} by frequency alone, {caveat}")
        lines += [f"note: {note}" for note in self.notes]
        if not len(self.cents):
            return lines
        offset = (
            f", besides {self.level_offset:+.1f} dB for all" if self._relative else ", absolute"
        )
        return [
            *lines,
            f"frequencies differ by {_spread(self.cents, 'cents')}",
            f"decay rates differ by {_spread(100 * (self.decay_ratios - 1), '%')}",
            f"levels differ by {_spread(self.level_differences, 'dB')}{offset}",
        ]

    @property
    def _relative(self) -> bool:
        return not (self.model.calibrated and self.other.calibrated)

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row of text for each pair of modes.

        Returns
        -------
        list of tuple of str
            Texts under `struck.report.comparison.HEADINGS`.
        """
        mine, theirs = self.model.partials, self.other.partials
        columns = (
            [f"{mode + 1}" for mode in self.pairing.computed],
            _texts(mine.frequencies[self.pairing.computed], ".2f"),
            _texts(theirs.frequencies[self.pairing.fitted], ".2f"),
            _texts(self.cents, "+.2f"),
            _t60_texts(mine.decays[self.pairing.computed]),
            _t60_texts(theirs.decays[self.pairing.fitted]),
            _texts(100 * (self.decay_ratios - 1), "+.1f"),
            _texts(self.level_differences, "+.1f"),
            _texts(100 * self.pairing.confidence, ".0f"),
        )
        return list(zip(*columns, strict=True))

    def page(self) -> str:
        """Make an HTML page of the comparison.

        Returns
        -------
        str
            HTML with sounds, spectra, differences and the table of modes, without other files.
        """
        return _page(self)

    def save_page(self, path: str | os.PathLike[str]) -> None:
        """Write the HTML page, completely or not at all.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        FileFormatError
            If the file cannot be written, or its name does not end as that of a page.
        """
        require_ending(path, PAGES, "pages")
        write_bytes(path, self.page().encode())

    def _repr_html_(self) -> str:
        return self.page()


@checked
def compare(
    model: ModalModel,
    other: Other,
    *,
    at: Place = None,
    strike: Strike | None = None,
    against: Strike | None = None,
    listener: ArrayLike | None = None,
    recording: Sound | None = None,
    widest: float = 1.25,
    progress: Progress | None = shown,
) -> Comparison:
    """Compare a model with a recording of the body, or with another model.

    Modes are paired by frequency, after O'Brien, Shen and Gatchalian (2002), section 5.

    Parameters
    ----------
    model : ModalModel
        The model.
    other : path, Sound, Take, ModalModel or FittedModes
        A recording of one or several hits, whose modes are fitted; a model or its file; or any
        object with `frequencies`, `decays` and `gains`.
    at : str or array-like, optional
        Contact at which both are struck, as for `ModalModel.contact`. Default: the playing
        place of the model.
    strike : Strike, optional
        Strike of both. Default: ``Strike()``.
    against : Strike, optional
        Strike of the other model, if it differs.
    listener : array-like (3,), optional
        Position in the coordinates of each model, m. Default: next to each model.
    recording : Sound, optional
        Recording of fitted modes, for the report. Default: the fitted modes are rendered.
    widest : float, default 1.25
        Largest ratio of the two frequencies of a pair.
    progress : callable or None, optional
        As for `analyze`.

    Returns
    -------
    Comparison
        Pairs of modes with differences of frequency, decay and level. Its summary states where both
        were struck.

    Raises
    ------
    OptionError
        If an option is out of range or does not apply.
    ContactError
        If the contact is not on the body.
    RecordingError
        If the recording is not of a struck object.
    FileFormatError
        If the file is missing or damaged.
    MissingDependencyError
        If the format of the recording needs a package that is not installed.

    Examples
    --------
    >>> from struck.shapes import Bar
    >>> bar = Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> longer = Bar(length=0.303, width=0.03, thickness=0.005, ends="free")
    >>> models = [struck.analyze(each, "steel", progress=None) for each in (bar, longer)]
    >>> comparison = struck.compare(*models, progress=None)
    >>> comparison.cents[:3].round()
    array([-34., -34., -34.])
    """
    blow = _blow(at, strike)
    _require_place("model", model, blow)
    if isinstance(other, str | os.PathLike) and Path(other).suffix.lower() in model_file.ENDINGS:
        other = model_file.load(other)
    if isinstance(other, ModalModel):
        if recording is not None:
            raise OptionError("recording= belongs to fitted modes: another model is rendered")
        theirs = Side.of_model(
            "other model", other, against or _same_place(blow, model, other), listener
        )
    else:
        theirs = _recorded_side(other, against, recording, model, reported(progress))
        hint = (
            "" if strike or at is not None else "; give the place or the blow where you know them"
        )
        theirs = replace(
            theirs, struck=f"taken to be of that strike, of which it tells nothing{hint}"
        )
    mine = Side.of_model("model", model, blow, listener, begins=theirs.begins)
    audible = None if theirs.computed else np.maximum(mine.audible, _DOUBT)
    pairing = paired(theirs.partials, model, widest=widest, audible=audible)
    is_explained, by_chance = pairing.support > 0, 0.0
    if not is_explained:
        by_chance = pairs_by_chance(theirs.partials, model, widest=widest)
        is_explained = explains(theirs.partials, model, pairing) and by_chance < len(pairing) / 2
    return replace(_compared(mine, theirs, pairing), explained=is_explained, by_chance=by_chance)


def _require_place(name: str, model: ModalModel, strike: Strike) -> None:
    """Refuse a strike at a place that the side of that name lacks."""
    try:
        model.contact(strike.at, strike.direction)
    except (ContactError, OptionError) as error:
        raise type(error)(f"on the {name}, {error}") from error


def _blow(at: Place, strike: Strike | None) -> Strike:
    """Return the strike on the model, at the place in one of the two arguments."""
    if strike is None or at is None:
        return strike or Strike(at=at)
    if strike.at is not None:
        raise OptionError(f"at is {at!r} and strike.at is {strike.at!r}: give the place once")
    return replace(strike, at=at)


def _same_place(strike: Strike, model: ModalModel, other: ModalModel) -> Strike:
    """Return the strike at the same place of another model, by name or by fractions of its box.

    If no place is given and that one moves no mode of the other, as the side of a bar that moves
    up and down alone, the other is struck at its own default place.
    """
    surface, named = other.gains, isinstance(strike.at, str) and ":" not in strike.at
    if model.geometry is None or other.geometry is None or not isinstance(surface, ShapeGains):
        return strike  # recorded coordinates, or each its own place
    if named and strike.at != LOUDEST:
        return strike
    contact = model.contact(strike.at, strike.direction)
    (low, high), (least, most) = model.geometry.bounds, other.geometry.bounds
    shares = (contact.point - low) / np.maximum(high - low, np.finfo(float).tiny)
    _, _, nearest = surface.locator.closest((least + shares * (most - least))[None])
    if strike.at is None and not surface.at(nearest[:1], contact.direction[None]).any():
        return strike
    return replace(strike, at=nearest[0], direction=contact.direction)


def _compared(mine: Side, theirs: Side, pairing: Pairing) -> Comparison:
    one, two = pairing.computed, pairing.fitted
    tones, others = mine.partials, theirs.partials
    levels = theirs.levels[two] - mine.levels[one]
    offset = float(np.nanmedian(levels)) if np.isfinite(levels).any() else 0.0
    is_absolute = mine.calibrated and theirs.calibrated
    decays = np.where(tones.decays[one] > 0, tones.decays[one], np.nan)
    missing = mine.missing_from(pairing.missing, theirs, pairing.factor)
    deviations = np.abs(tones.frequencies[missing, None] / tones.frequencies[one] - 1)
    is_twin = deviations.min(axis=1, initial=np.inf) < _SHARED
    return Comparison(
        model=mine,
        other=theirs,
        pairing=pairing,
        cents=1200 * np.log2(others.frequencies[two] / tones.frequencies[one]),
        decay_ratios=others.decays[two] / decays,
        level_differences=levels if is_absolute else levels - offset,
        level_offset=offset,
        missing=missing[~is_twin],
        twins=missing[is_twin],
        extra=theirs.missing_from(pairing.extra, mine, 1 / pairing.factor),
        explained=True,
    )


def _spread(values: Array, unit: str) -> str:
    finite_values = values[np.isfinite(values)]
    if not finite_values.size:
        return f"an unknown number of {unit}"
    low, middle, high = np.round(np.quantile(finite_values, [0.1, 0.5, 0.9]), 3) + 0.0
    if not (low or high):
        return f"less than 0.001 {unit}"
    median, lowest, highest = (rounded(value, 3, sign=True) for value in (middle, low, high))
    return f"{median} {unit} in the median, most by {lowest} to {highest} {unit}"


def _t60(decays: Array) -> Array:
    return np.log(1000) / np.where(decays > 0, decays, np.nan)


def _t60_texts(decays: Array) -> Sequence[str]:
    return [rounded(time, 3) if np.isfinite(time) else "-" for time in _t60(decays)]


def _texts(values: Array, form: str) -> Sequence[str]:
    return [f"{value:{form}}" if np.isfinite(value) else "-" for value in values]


# The two sides: a model that is struck, or a recording with its modes.


def _recorded_side(
    other: FittedModes | Sound | Take | str | os.PathLike[str],
    against: Strike | None,
    recording: Sound | None,
    model: ModalModel,
    progress: Progress,
) -> Side:
    """Return the side of a recording or fitted modes; parameters as in `compare`."""
    if against is not None:
        raise OptionError("against= is the strike of another model: a recording was struck once")
    if not isinstance(other, Sound | Take | str | os.PathLike):
        return Side.of_recording(other, recording)
    if recording is not None:
        raise OptionError("recording= belongs to fitted modes: a sound needs none")
    # Modes under a budget must not be spent on the blow itself, unless the model's were.
    has_all_modes = model.provenance.details.get("modes_sought") == "all"
    budget = None if has_all_modes else max(FEWEST, len(model.frequencies))
    return Side.of_take(_take(other), budget, progress, attack=model.recorded and not has_all_modes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """One of two bodies that are compared, as it sounds."""

    name: str
    partials: Partials  # its modes as heard
    complete_to: float  # no mode below it is missing, Hz
    computed: bool  # whether modes that are not heard are known too
    calibrated: bool  # whether amplitudes are Pa
    seconds: float  # for how long it is worth hearing
    sound: Callable[[float], Sound]  # makes its sound, of a length in s at most
    begins: float = 0.0  # when amplitudes count, s after the strike began; 0: when it is over
    struck: str = ""  # where and how it was struck, in words
    notes: tuple[str, ...] = ()  # remarks for the reader
    blow: Mask | bool = False  # modes of the blow, which are never missing

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
        """Make a side of a struck model, heard at 1 m unless a listener (3,) is given."""
        # A model of recordings is as complete as a recording, no more.
        _require_place(name, model, strike)
        beside = centre_of(model) + place_beside(model)
        place = beside if listener is None else position_of(listener)
        recorded = model.geometry is None
        errors = 0.0 if model.errors is None or not recorded else np.nan_to_num(model.errors)
        return cls(
            name=name,
            partials=Partials(
                frequencies=model.frequencies,
                decays=model.decays,
                amplitudes=_amplitudes(model, strike, place, begins),
                frequency_errors=errors * model.frequencies,
                decay_errors=np.zeros_like(model.frequencies),
            ),
            complete_to=np.inf if recorded else model.complete_to,
            computed=not recorded,
            calibrated=model.calibrated,
            seconds=_SECONDS,
            sound=lambda seconds: render(model, strike, seconds=seconds, listener=place),
            begins=begins,
            struck=_struck_at(model, strike),
            blow=~model.of_object,
        )

    @classmethod
    def of_recording(cls, fitted: FittedModes, recording: Sound | None = None) -> Side:
        """Make a side of fitted modes, with the recording, or with the sound of the modes."""
        if recording is None:
            complete_to, longest = np.inf, _SECONDS
            sound = partial(_resynthesised, fitted)
        else:
            complete_to = _BAND * recording.sample_rate
            longest = min(recording.duration, _LONGEST)
            sound = partial(_shortened, recording)
        return cls(
            name="recording",
            partials=Partials.of(fitted),
            complete_to=complete_to,
            computed=False,
            calibrated=False,
            seconds=longest,
            sound=sound,
        )

    @classmethod
    def of_take(
        cls,
        take: Take,
        budget: int | None = FEWEST,
        progress: Progress = silent,
        *,
        attack: bool = False,
    ) -> Side:
        """Fit at most a budget of modes to a recording of one body, and take its loudest hit."""
        fitted = fit_poles(take, budget=budget, attack=attack, progress=progress)
        if not len(fitted.frequencies):
            reason = fitted.verdict.reason or "all that it holds are tones of the surroundings"
            raise RecordingError(f"{take.name}: {reason}: there is nothing to compare with")
        chosen = _loudest(fitted)
        rows = tuple(fitted.rows[row] for row in chosen)
        gains, errors = fitted.gains[chosen], fitted.gain_errors[chosen]
        hit = replace(fitted, gains=gains, gain_errors=errors, rows=rows)
        sound = _cut(without_force(take), rows[0].onset, fitted.rows)
        return replace(
            cls.of_recording(hit, sound),
            begins=rows[0].time - rows[0].onset,
            notes=_notes(take, fitted),
            blow=fitted.blow,
        )

    @property
    def audible(self) -> Array:
        """How audible each mode is next to the loudest, by energy, 0 to 1 (M,)."""
        slowest = np.maximum(self.partials.decays, 1e-3 * self.partials.frequencies)
        energies = np.square(self.partials.amplitudes) / slowest
        quietest = 10 ** (_QUIETEST / 10) * energies.max()
        return energies / (energies + quietest)

    @property
    def levels(self) -> Array:
        """Amplitudes in dB; NaN for modes that are silent next to the loudest (M,)."""
        amplitudes = self.partials.amplitudes
        is_loud = amplitudes > _SILENT * amplitudes.max()
        return 20 * np.log10(np.where(is_loud, amplitudes, np.nan))

    # `factor`: by which frequencies of `beside` exceed those here.
    def missing_from(self, modes: Index, beside: Side, factor: float) -> Index:
        """Return the unpaired modes of the object within the other side's complete band."""
        in_band = self.partials.frequencies[modes] <= beside.complete_to / factor
        is_audible = beside.computed or self.audible[modes] >= 0.5
        is_blow = np.broadcast_to(self.blow, self.partials.frequencies.shape)[modes]
        return modes[in_band & is_audible & ~is_blow]


def _amplitudes(model: ModalModel, strike: Strike, listener: Array, begins: float) -> Array:
    """Return amplitudes of modes `begins` s after the strike began, Pa or relative (M,)."""
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


def _struck_at(model: ModalModel, strike: Strike) -> str:
    """Return the place, the impulse and the duration of a strike in words."""
    contact = model.contact(strike.at, strike.direction)
    blow = strike.resolved(model, contact)
    units = "" if model.recorded else " m"
    place = ", ".join(f"{rounded(value, 4)}" for value in np.round(contact.point, 9) + 0.0)
    place_text = f"{contact.name} ({place}){units}" if place else "its one place"
    force = f"{rounded(blow.impulse, 3)} {'N s' if model.calibrated else 'of the recorded blow'}"
    during = f" in {rounded(1000 * blow.duration, 3)} ms" if blow.duration else ""
    return f"struck at {place_text.strip()} by {force}{during}"


def _shortened(sound: Sound, seconds: float) -> Sound:
    return replace(sound, samples=sound.samples[:, : max(1, round(seconds * sound.sample_rate))])


def _resynthesised(fitted: FittedModes, seconds: float) -> Sound:
    """Return the sound of fitted modes in the first channel or two."""
    poles = -np.asarray(fitted.decays) + 2j * np.pi * np.asarray(fitted.frequencies)
    gains = np.atleast_2d(np.asarray(fitted.gains, np.complex128))[:2]
    indices = np.flatnonzero(poles.imag < np.pi * _SAMPLE_RATE)
    sound = samples(poles[indices], gains[:, indices], round(seconds * _SAMPLE_RATE), _SAMPLE_RATE)
    return Sound(samples=sound.astype(np.float32), sample_rate=_SAMPLE_RATE)


def _take(recording: Sound | Take | str | os.PathLike[str]) -> Take:
    if isinstance(recording, Take):
        return recording
    return Take.of(recording) if isinstance(recording, Sound) else Take.load(recording)


def _loudest(fitted: PoleFit) -> list[int]:
    """Return the rows of gains of the hit that holds most energy."""
    lasting = 1 / np.maximum(fitted.decays, 1e-3 * fitted.frequencies)
    energies = (np.square(np.abs(fitted.gains)) * lasting).sum(axis=1)
    hits = np.array([row.hit for row in fitted.rows])
    return np.flatnonzero(hits == int(np.argmax(np.bincount(hits, weights=energies)))).tolist()


def _cut(take: Take, onset: float, rows: Sequence[Row]) -> Sound:
    """Return the sound of one hit, up to the next."""
    begin = max(0, round((onset - _BEFORE) * take.sample_rate))
    later_onsets = [row.onset for row in rows if row.onset > onset]
    end = (
        round((min(later_onsets) - _BEFORE) * take.sample_rate)
        if later_onsets
        else take.samples.shape[1]
    )
    samples = take.samples[:_EARS, begin : max(end, begin + 1)]
    return Sound(samples=samples.astype(np.float32), sample_rate=take.sample_rate)


def _notes(take: Take, fitted: PoleFit) -> tuple[str, ...]:
    verdict = () if fitted.verdict.modal else (f"{take.name}: {fitted.verdict.reason}",)
    hits = len({row.hit for row in fitted.rows})
    hit_note = (f"{take.name} holds {hits} hits: levels are those of the loudest",) * (hits > 1)
    return (*verdict, *hit_note, *fitted.notes)


# The page: both sides heard, their spectra, and how paired modes differ.


def _page(comparison: Comparison) -> str:
    """Return a page that needs no other file."""
    sides = (comparison.model, comparison.other)
    unpaired_modes = (comparison.missing, comparison.extra)
    names = [side.name for side in sides]
    sounds = [side.sound(comparison.other.seconds) for side in sides]
    lowest = min(float(side.partials.frequencies[side.audible >= 0.5].min()) for side in sides)
    figures = [spectrogram(sound, max(20.0, lowest / 2)) for sound in sounds]
    pictures = picture("Both spectra", _spectra(sides, sounds, unpaired_modes))
    if len(comparison.cents):
        pictures += picture("Differences of paired modes", _differences(comparison))
    body = _BODY.format(
        lines="".join(f"<li>{html.escape(line)}</li>" for line in comparison.summary()),
        sounds="".join(map(_sound_figure, names, sounds, figures, _COLOURS)),
        pictures=pictures,
        table=table(HEADINGS, comparison.rows()),
        alone="".join(map(_unpaired, sides, unpaired_modes)),
        script=(resources.files("struck.report") / "comparison.js").read_text(encoding="utf-8"),
    )
    return document(f"struck: {' and '.join(names)}", body, style=_STYLE)


def _sound_figure(name: str, sound: Sound, figure: Figure, colour: str) -> str:
    return (
        f'<figure><figcaption><b style="color:{colour}">{html.escape(name)}</b></figcaption>'
        f"{sound._repr_html_()}{picture(f'Spectrogram of the {name}', figure)}</figure>"
    )


def _unpaired(side: Side, modes: Index) -> str:
    frequencies_text = (
        ", ".join(f"{value:.1f}" for value in side.partials.frequencies[modes]) or "none"
    )
    return f"<p><b>In the {html.escape(side.name)} alone</b> (Hz): {frequencies_text}</p>"


@in_default_style
def _spectra(
    sides: Sequence[Side], sounds: Sequence[Sound], unpaired_modes: Sequence[Index]
) -> Figure:
    """Draw both spectra in one, with ticks at the modes that only one side has."""
    figure = chart(11.0, 4.6)
    axes = figure.subplots()
    for side, sound, colour in zip(sides, sounds, _COLOURS, strict=True):
        frequencies, powers = strongest(sound)
        axes.plot(
            frequencies,
            decibels(powers),
            color=colour,
            linewidth=0.9,
            alpha=0.75,
            label=plain(side.name),
        )
    for side, modes, colour, height in zip(
        sides, unpaired_modes, _COLOURS, (5.0, 10.0), strict=True
    ):
        if len(modes):
            missing_from = side.partials.frequencies[modes]
            label = plain(f"in the {side.name} alone")
            axes.plot(
                missing_from, np.full(len(missing_from), height), "|", color=colour, label=label
            )
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", ylim=(-RANGE, 14))
    _frequency_axis(axes, sides)
    axes.legend(loc="lower left", fontsize=8, framealpha=0.85, edgecolor="none")
    return figure


@in_default_style
def _differences(comparison: Comparison) -> Figure:
    """Draw how the other's modes differ from the model's, the fainter the less sure the pair."""
    sides = (comparison.model, comparison.other)
    confidences = np.clip(comparison.pairing.confidence, 0.2, 1.0)
    frequencies = comparison.model.partials.frequencies[comparison.pairing.computed]
    values = {
        "frequency (cents)": comparison.cents,
        "decay rate (%)": 100 * (comparison.decay_ratios - 1),
        "level (dB)": comparison.level_differences,
    }
    figure = chart(11.0, 6.4)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, (label, values_of_pairs) in zip(panels, values.items(), strict=True):
        axes.axhline(0, color=INK, linewidth=0.7)
        axes.vlines(frequencies, 0, values_of_pairs, color=ORANGE, alpha=0.35, linewidth=1)
        axes.scatter(frequencies, values_of_pairs, s=16, color=ORANGE, alpha=confidences)
        axes.set_ylabel(label)
        _frequency_axis(axes, sides)
    figure.supxlabel("frequency (Hz)", fontsize=10)
    figure.suptitle(plain(f"{sides[1].name} less {sides[0].name}"), fontsize=11)
    return figure


def _frequency_axis(axes: Axes, sides: Sequence[Side]) -> None:
    all_frequencies = np.concatenate([side.partials.frequencies for side in sides])
    frequency_axis(axes, 0.7 * float(all_frequencies.min()), 1.2 * float(all_frequencies.max()))


_STYLE = """\
button { font: inherit; padding: .3rem 1rem; margin-bottom: 1rem; }
.modes { max-height: 32rem; overflow: auto; }
"""
_BODY = """\
<section><ul>{lines}</ul></section>
<section><h2>Sounds</h2><button id="switch">play, then switch between the two</button>
<div class="sounds">{sounds}</div></section>
<section><h2>Modes</h2>{pictures}<div class="modes">{table}</div>{alone}</section>
<script>
{script}</script>
"""
