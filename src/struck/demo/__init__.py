"""The demo: a gallery of bodies, computed, struck, drawn and put on pages that play."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from struck.demo import recordings, solids
from struck.errors import FileFormatError
from struck.files.atomic import write_bytes
from struck.progress import Progress, silent
from struck.report import gallery as shapes
from struck.report.model_page import page

_TITLE = "struck: a gallery"


def gallery(folder: Path, progress: Progress = silent) -> Path:
    """Compute the gallery: models, sounds, pictures and the pages that play them.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    progress : callable
        Told the stage and the fraction of it that is done.

    Returns
    -------
    Path
        The first page. Each body in closed form, and a recording, has one of its own beside it.

    Raises
    ------
    FileFormatError
        When the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{folder} cannot be made ({error.strerror}): name another") from None
    links = _pages_of_shapes(folder, progress)
    _written(folder / f"{recordings.NAME}.html", recordings.recording(folder, progress))
    links = {**links, f"{recordings.NAME}.html": recordings.TITLE}
    exhibits = [piece.exhibit(folder, progress) for piece in solids.PIECES]
    return _written(folder / "index.html", page(_TITLE, solids.INTRODUCTION, exhibits, links))


def _pages_of_shapes(folder: Path, progress: Progress) -> Mapping[str, str]:
    """Write a page for each closed form; return titles by the pages' names."""
    back = {"index.html": _TITLE}
    for piece in shapes.PIECES:
        exhibit = piece.exhibit(folder, progress)
        text = page(f"struck: {piece.title}", shapes.INTRODUCTION, [exhibit], back)
        _written(folder / f"{piece.name}.html", text)
    return {f"{piece.name}.html": piece.title for piece in shapes.PIECES}


def _written(path: Path, text: str) -> Path:
    write_bytes(path, text.encode())
    return path
