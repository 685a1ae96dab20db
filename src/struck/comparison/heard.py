"""A recording that a model is compared with: its modes, and the hit that is compared."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from struck.errors import RecordingError
from struck.files.sound import Sound
from struck.progress import Progress, silent
from struck.recordings.poles.fit import fit_poles
from struck.recordings.poles.fitted import Fitted
from struck.recordings.segments import Row
from struck.recordings.takes.force import without_force
from struck.recordings.takes.take import Take

FEWEST = 64
"""Modes that are fitted at least, where so many stand out."""
_BEFORE = 0.02
_EARS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Heard:
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
    ) -> Heard:
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
