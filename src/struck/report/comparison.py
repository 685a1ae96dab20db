"""How a computed body differs from the real one, or from another: mode by mode."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.files.atomic import write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array, Index
from struck.model.model import ModalModel
from struck.model.provenance import Progress, silent
from struck.recordings.calibration.agreement import FittedModes
from struck.recordings.calibration.pairing import Pairing, explains, paired
from struck.recordings.takes import Take
from struck.report.charts import spectrogram
from struck.report.comparison_page import differences, page, spectra
from struck.report.comparison_sides import RecordedHit, Side

# What a model is compared with: another model, a recording, or modes that somebody fitted.

Other = ModalModel | FittedModes | Sound | Take | str | os.PathLike[str]


def other_side(
    other: Other,
    against: Strike | None,
    strike: Strike,
    listener: ArrayLike | None,
    recording: Sound | None,
    *,
    modes: int,
    progress: Progress,
) -> Side:
    """Return the side that a model is compared with; parameters are those of `compare`.

    Raises
    ------
    OptionError
        On `against` or `recording` without what they belong to.
    ContactError, RecordingError, FileFormatError, MissingDependencyError
        As `compare`.
    """
    if isinstance(other, str | os.PathLike) and Path(other).suffix.lower() in model_file.ENDINGS:
        other = model_file.load_model(other)
    if isinstance(other, ModalModel):
        if recording is not None:
            raise OptionError("recording= belongs to fitted modes: another model is rendered")
        return Side.of_model("other model", other, against or strike, listener)
    if against is not None:
        raise OptionError("against= tells how another model is struck: a recording was struck once")
    if not isinstance(other, Sound | Take | str | os.PathLike):
        return Side.of_recording(other, recording)
    if recording is not None:
        raise OptionError("recording= belongs to fitted modes: a sound is heard as it is")
    heard = RecordedHit.of(other, modes=modes, progress=progress)
    side = Side.of_recording(heard.fitted, heard.sound)
    return replace(side, begins=heard.begins, notes=heard.notes)


_DOUBT = 0.1
"""Nobody strikes a node so well, or tells where, that its modes cannot be heard: a share."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """A model beside a recording of the body, or beside another model.

    Parameters
    ----------
    model, other : Side
        What was compared.
    pairing : Pairing
        Which of the other's modes is which of the model's, and how sure that is.
    cents : array (P,)
        By which the other's modes are higher.
    decay_ratios : array (P,)
        The other's decay rates over the model's; NaN where that does not decay.
    level_differences : array (P,)
        By which the other's modes are louder, `level_offset` apart, dB; NaN where one is silent.
    level_offset : float
        Median of the level differences, dB, taken out of them unless both are calibrated.
    missing : array
        Numbers of the model's modes that the other lacks though they should be heard.
    extra : array
        Numbers of the other's modes that the model lacks though it should have them.
    explained : bool
        Whether the two agree better than by chance.
    """

    model: Side
    other: Side
    pairing: Pairing
    cents: Array
    decay_ratios: Array
    level_differences: Array
    level_offset: float
    missing: Index
    extra: Index
    explained: bool

    @property
    def pairs(self) -> Index:
        """Numbers of the model's modes and the other's that belong together (P, 2)."""
        return np.stack([self.pairing.computed, self.pairing.fitted], axis=1)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of either."""
        return (*self.model.notes, *self.other.notes)

    def summary(self) -> list[str]:
        """Return how they differ, a line each."""
        mine, theirs = len(self.model.partials.frequencies), len(self.other.partials.frequencies)
        name = self.other.name
        lines = [
            f"{len(self.cents)} pairs of {mine} modes of the model and {theirs} of the {name}",
            f"{len(self.missing)} of the model should be in the {name} and are not",
            f"{len(self.extra)} of the {name} should be in the model and are not",
        ]
        if not self.explained:
            lines.append("caution: random modes would agree as well; this may be another body")
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
        """Return a row of text for each pair, under `struck.report.comparison_page.HEADINGS`."""
        mine, theirs = self.model.partials, self.other.partials
        columns = (
            [f"{mode + 1}" for mode in self.pairing.computed],
            _told(mine.frequencies[self.pairing.computed], ".2f"),
            _told(theirs.frequencies[self.pairing.fitted], ".2f"),
            _told(self.cents, "+.2f"),
            _told(_t60(mine.decays[self.pairing.computed]), ".3g"),
            _told(_t60(theirs.decays[self.pairing.fitted]), ".3g"),
            _told(100 * (self.decay_ratios - 1), "+.1f"),
            _told(self.level_differences, "+.1f"),
            _told(100 * self.pairing.confidence, ".0f"),
        )
        return list(zip(*columns, strict=True))

    def page(self) -> str:
        """Return an HTML page of its own: sounds, spectra, differences and the table of modes."""
        sides, alone = (self.model, self.other), (self.missing, self.extra)
        sounds = [side.sound(self.other.seconds) for side in sides]
        lowest = min(float(side.partials.frequencies[side.audible >= 0.5].min()) for side in sides)
        pictures = [("Both spectra", spectra(sides, sounds, alone))]
        if len(self.cents):
            places = self.model.partials.frequencies[self.pairing.computed]
            values = (self.cents, 100 * (self.decay_ratios - 1), self.level_differences)
            picture = differences(sides, places, values, self.pairing.confidence)
            pictures.append(("Differences of paired modes", picture))
        return page(
            names=[side.name for side in sides],
            lines=self.summary(),
            sounds=sounds,
            spectrograms=[spectrogram(sound, max(20.0, lowest / 2)) for sound in sounds],
            pictures=pictures,
            rows=self.rows(),
            alone=[
                side.partials.frequencies[modes] for side, modes in zip(sides, alone, strict=True)
            ],
        )

    def save_page(self, path: str | os.PathLike[str]) -> None:
        """Write the page, whole or not at all.

        Raises
        ------
        FileFormatError
            When the file cannot be written.
        """
        write_bytes(path, self.page().encode())

    def _repr_html_(self) -> str:
        return self.page()


def compare(
    model: ModalModel,
    other: Other,
    *,
    strike: Strike | None = None,
    against: Strike | None = None,
    listener: ArrayLike | None = None,
    recording: Sound | None = None,
    widest: float = 1.25,
    progress: Progress = silent,
) -> Comparison:
    """Compare a model with a recording of the body, or with another model.

    Parameters
    ----------
    model : ModalModel
    other : path, Sound, Take, ModalModel or FittedModes
        A sound file or a sound of one hit or several, whose modes are fitted; a model or its file;
        or anything with `frequencies`, `decays` and `gains`.
    strike : Strike, optional
        Where and with what the model is struck: it tells the levels of its modes. ``Strike()``
        unless given.
    against : Strike, optional
        The same for another model; as `strike` unless given.
    listener : array-like (3,), optional
        In the coordinates of each model, m; beside it unless given.
    recording : Sound, optional
        What was fitted, to be heard on the page; else the fitted modes are.
    widest : float
        Largest factor between the frequencies of the two, either way.
    progress : callable
        Told the stage and the fraction done while a recording is fitted.

    Returns
    -------
    Comparison
        The validation of 2002, section 5, for any body.

    Raises
    ------
    OptionError
        On `against` or `recording` without what they belong to.
    ContactError
        When a contact is none of the body's.
    RecordingError
        When either has no modes, or nothing is struck in a recording.
    FileFormatError, MissingDependencyError
        When a file cannot be read.
    """
    blow = strike or Strike()
    modes = len(model.frequencies)
    theirs = other_side(other, against, blow, listener, recording, modes=modes, progress=progress)
    mine = Side.of_model("model", model, blow, listener, begins=theirs.begins)
    audible = None if theirs.computed else np.maximum(mine.audible, _DOUBT)
    pairing = paired(theirs.partials, model, widest=widest, audible=audible)
    return _compared(mine, theirs, pairing, explained=explains(theirs.partials, model, pairing))


def _compared(mine: Side, theirs: Side, pairing: Pairing, *, explained: bool) -> Comparison:
    one, two = pairing.computed, pairing.fitted
    tones, others = mine.partials, theirs.partials
    levels = theirs.levels[two] - mine.levels[one]
    offset = float(np.nanmedian(levels)) if np.isfinite(levels).any() else 0.0
    absolute = mine.calibrated and theirs.calibrated
    decays = np.where(tones.decays[one] > 0, tones.decays[one], np.nan)
    return Comparison(
        model=mine,
        other=theirs,
        pairing=pairing,
        cents=1200 * np.log2(others.frequencies[two] / tones.frequencies[one]),
        decay_ratios=others.decays[two] / decays,
        level_differences=levels if absolute else levels - offset,
        level_offset=offset,
        missing=mine.lonely(pairing.missing, theirs, pairing.factor),
        extra=theirs.lonely(pairing.extra, mine, 1 / pairing.factor),
        explained=explained,
    )


def _spread(values: Array, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return f"an unknown number of {unit}"
    low, middle, high = np.round(np.quantile(known, [0.1, 0.5, 0.9]), 3) + 0.0
    if not (low or high):
        return f"less than 0.001 {unit}"
    return f"{middle:+.3g} {unit} in the median, most by {low:+.3g} to {high:+.3g} {unit}"


def _t60(decays: Array) -> Array:
    return np.log(1000) / np.where(decays > 0, decays, np.nan)


def _told(values: Array, form: str) -> Sequence[str]:
    return [f"{value:{form}}" if np.isfinite(value) else "-" for value in values]
