"""What a model is compared with: another model, a recording, or modes that somebody fitted."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from struck.comparison.heard import Heard
from struck.comparison.sides import Side
from struck.errors import OptionError
from struck.excitation.strike import Strike
from struck.files import any_model
from struck.files.sound import Sound
from struck.model.model import ModalModel
from struck.progress import Progress
from struck.recordings.calibration.partials import FittedModes
from struck.recordings.takes.take import Take

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
    if isinstance(other, str | os.PathLike) and Path(other).suffix.lower() in any_model.ENDINGS:
        other = any_model.load(other)
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
    heard = Heard.of(other, modes=modes, progress=progress)
    side = Side.of_recording(heard.fitted, heard.sound)
    return replace(side, begins=heard.begins, notes=heard.notes)
