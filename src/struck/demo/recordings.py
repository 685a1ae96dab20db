"""A recording of the gallery: a drum that somebody struck, and the model of it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from struck.excitation.strike import Strike
from struck.files import model_file
from struck.progress import Progress
from struck.recordings.fit import fit_recordings
from struck.rendering import render
from struck.report.fit_page import report

NAME, TITLE = "tabla", "A recorded tabla"


def recording(folder: Path, progress: Progress) -> str:
    """Fit the recording, save model and sounds into a folder, and return the page that plays them.

    The sound is as recorded, and that of a drum half and twice as large.
    """

    def staged(stage: str, fraction: float) -> None:
        progress(f"{TITLE}: {stage}", fraction)

    with resources.as_file(resources.files("struck.demo").joinpath(f"{NAME}.wav")) as path:
        made = fit_recordings(path, residual=True, progress=staged)
    model_file.save(made.model, folder / f"{NAME}.struck")
    for name, size in (("half", 0.5), ("recorded", 1.0), ("twice", 2.0)):
        model = made.model if size == 1 else made.model.scaled(size)
        render(model, Strike(impulse=1.0, duration=0.0)).save(folder / f"{NAME}_{name}.wav")
    return report(made)
