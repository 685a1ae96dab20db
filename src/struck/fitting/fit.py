"""The verb: recordings of one object in, its model out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from struck.files.atomic import writable
from struck.model.model import ModalModel
from struck.progress import Progress, silent
from struck.recordings.fit import fit_recordings
from struck.recordings.gain_table import Recording
from struck.recordings.manifest import KINDS, NAME, read_manifest
from struck.report.fit_page import save_report


def fit(
    recordings: Recording | Sequence[Recording],
    *,
    contacts: ArrayLike | None = None,
    listeners: ArrayLike | Sequence[ArrayLike] | None = None,
    manifest: str | os.PathLike[str] | None = None,
    symmetry: str | None = None,
    centre: ArrayLike | None = None,
    radius: float = 0.0,
    way: str = "field",
    method: str = "shared",
    modes: int | None = 64,
    onsets: Sequence[Sequence[float]] | None = None,
    room: float | Recording | None = None,
    residual: bool = False,
    force: bool = False,
    report: str | os.PathLike[str] | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress = silent,
) -> ModalModel:
    """Fit a model to recordings of one object: all takes share its modes.

    Parameters
    ----------
    recordings : path, Sound, or several of them
        WAV, FLAC or AIFF files with any number of channels and hits, at one sample rate; or a
        manifest (TOML or CSV), or the folder of one that `struck record` wrote.
    contacts : array-like (recordings,), (recordings, 1) or (recordings, 2), optional
        Coordinates of what was struck in each recording. Without contacts, listeners and manifest
        the model is of a single point.
    listeners : array-like (3,), or for each recording (3,) or (channels, 3), optional
        Where its microphones were, body coordinates, m.
    manifest : path, optional
        The same for files, by name: TOML or CSV.
    symmetry : str, optional
        "none", or "axial" of a body round about the z axis.
    centre : array-like (3,), optional
        Where the sound seems to come from, m; the origin unless given.
    radius : float
        Of a ball about the centre that holds the body, m: listeners within it are inside.
    way : str
        "field": each mode a contact part times a listener part; "table": all gains, quinti-linear
        in between, for contacts and listeners on grids (2007).
    method : str
        "shared", or "corbett2007" for the paper's own.
    modes : int or None
        Not more than these, those that explain most of the sound, the blow included; None for all
        of what rings freely after it that are clear of the noise, by 19 dB of energy.
    onsets : sequence of sequences of float, optional
        Times of the hits in each recording, s; found unless given.
    room : float, path or Sound, optional
        Reverberation time T60 of the room, s, or a recording of a clap in it: modes that die away
        nearly as fast, or faster, are told in the report and in `provenance` as perhaps its own.
    residual : bool
        Keep what the modes do not explain of the loudest hit, its attack and noise: `render` then
        plays it with each strike.
    force : bool
        Make a model even of what is not the ringing of a struck object.
    report : path, optional
        Where to write an HTML page of how recordings and model sound and differ.
    cache : bool or path
        Where finished stages are kept: a fit that was stopped goes on from there. As in `analyze`.
    progress : callable
        Told the stage and the fraction of it that is done.

    Returns
    -------
    ModalModel
        With relative gains, `errors` of its frequencies, and what was left out in `provenance`.

    Raises
    ------
    RecordingError
        When recordings are silent, too short, unlike, hold no hit or nothing that rings.
    FileFormatError
        When a file cannot be read or written, or the report is a recording.
    OptionError
        On places that do not fit the recordings, or arguments outside their bounds.

    Notes
    -----
    `struck.recordings.fit.fit_recordings` returns errors of decays and gains, verdict and
    residual too.
    """
    page = None if report is None else writable(report, unlike=files_read(recordings, manifest))
    fitting = fit_recordings(
        recordings,
        contacts=contacts,
        listeners=listeners,
        manifest=manifest,
        symmetry=symmetry,
        centre=centre,
        radius=radius,
        way=way,
        method=method,
        modes=modes,
        onsets=onsets,
        room=room,
        residual=residual,
        force=force,
        cache=cache,
        progress=progress,
    )
    if page is not None:
        save_report(fitting, page)
    return fitting.model


def files_read(
    recordings: Recording | Sequence[Recording], manifest: str | os.PathLike[str] | None
) -> list[str | os.PathLike[str]]:
    """Return the names of all files that a fit reads, those in a manifest or a folder of one too.

    Raises
    ------
    FileFormatError
        When a manifest cannot be read.
    """
    several = [recordings]
    if isinstance(recordings, Sequence) and not isinstance(recordings, str):
        several = recordings
    named = [each for each in (*several, manifest) if isinstance(each, str | os.PathLike)]
    paths = [Path(each) / NAME if Path(each).is_dir() else Path(each) for each in named]
    lists = [path for path in paths if path.suffix.lower() in KINDS and path.is_file()]
    return [*named, *lists, *(file for path in lists for file in read_manifest(path).files)]
