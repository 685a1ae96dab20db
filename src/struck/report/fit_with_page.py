"""The verb `fit`: `recordings.fit_recordings`, the page about the fit, and the model alone.

It is here, as `recordings` is below `report`, and imports the code of the page if one is written.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from struck.files.atomic import writable
from struck.model.arrays import checked
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Progress, reported, shown
from struck.recordings.fit import files_read, fit_recordings
from struck.recordings.takes import Recording

if TYPE_CHECKING:
    from struck.excitation.strike import Strike


@checked
def fit(
    recordings: Recording | Sequence[Recording],
    *,
    contacts: ArrayLike | None = None,
    listeners: ArrayLike | Sequence[ArrayLike] | None = None,
    manifest: str | os.PathLike[str] | None = None,
    symmetry: str | None = None,
    centre: ArrayLike | None = None,
    radius: float = 0.0,
    interpolation: str = "field",
    method: str = "shared",
    modes: int | None = 64,
    onsets: Sequence[Sequence[float]] | None = None,
    room: float | Recording | None = None,
    pitch: ArrayLike | None = None,
    geometry: Mesh | str | os.PathLike[str] | None = None,
    blow: Strike | None = None,
    residual: bool | None = None,
    force: bool = False,
    report: str | os.PathLike[str] | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress | None = shown,
) -> ModalModel:
    """Fit a modal model to recordings of one object.

    All recordings share the frequencies and decay rates of the modes; each has gains of its own.

    Parameters
    ----------
    recordings : path, Sound, or sequence of them
        WAV, FLAC or AIFF files with any number of channels and hits, all at one sample rate; or a
        manifest (TOML or CSV); or a folder written by ``struck record``.
    contacts : array-like (R,), (R, 1) or (R, 2), optional
        Contact coordinates of each recording. Without contacts, listeners and manifest the model
        has a single contact and listener.
    listeners : array-like (3,), (R, 3) or (R, C, 3), optional
        Microphone positions in body coordinates, m.
    manifest : path, optional
        TOML or CSV file that lists contacts and listeners by file name.
    symmetry : {"none", "axial"}, optional
        "axial" for a body of revolution about the z axis.
    centre : array-like (3,), optional
        Acoustic centre of the body, m. Default: the origin.
    radius : float, default 0.0
        Radius of a sphere about the centre that encloses the body, m. Listeners within it are
        treated as inside the body.
    interpolation : {"field", "table"}, default "field"
        Form of the gains. "field": the product of a function of the contact and a function of the
        listener, for each mode. "table": all measured gains on a grid of contacts and listeners,
        with linear interpolation in five dimensions (Corbett et al. 2007).
    method : {"shared", "corbett2007"}, default "shared"
        Estimator of the modes; "corbett2007" is that of the paper.
    modes : int or None, default 64
        Maximum number of modes, chosen by explained energy, attack included. None: all modes of
        the free decay with an energy at least 19 dB above the noise.
    onsets : sequence of sequences of float, optional
        Times of the hits in each recording, s. Default: detected.
    room : float, path or Sound, optional
        Reverberation time T60 of the room, s, or a recording of a clap in it. Modes with a similar
        decay time are reported as possible modes of the room; with ``modes=None`` most of them are
        removed.
    pitch : float or array-like (D,), optional
        Metres per unit of each contact coordinate; for an azimuth in rad, the radius of the body
        (see `ModalModel.charted`). Needed for scraping and rolling.
    geometry : Mesh or path, optional
        Surface of a body of revolution, m, about the z axis. Needed for the same, instead of
        `pitch`.
    blow : Strike, optional
        Strike of the recordings, by impulse and duration or by striker and speed. It is
        deconvolved, so that the model responds to a force in N. Default: gains include the strike.
    residual : bool, optional
        Add the attack and the noise of the loudest hit, without its modes, to each strike.
        Default: if any auditory band within 50 dB of the loudest would otherwise lose more than
        6 dB.
    force : bool, default False
        Return a model even if the recordings do not sound like a struck object.
    report : path, optional
        Where to write an HTML page that compares the recordings with the model.
    cache : bool or path, default True
        As for `analyze`. An interrupted fit continues from the cache.
    progress : callable or None, optional
        As for `analyze`.

    Returns
    -------
    ModalModel
        With relative gains. Its `errors` are those of the frequencies; `provenance` lists what was
        left out.

    Raises
    ------
    RecordingError
        If the recordings have no hits, differ in sample rate, or are not of a struck object.
    FileFormatError
        If a file is missing, damaged or of an unknown format.
    OptionError
        If an option is unknown or out of range.

    Examples
    --------
    Two decaying tones in noise, after half a second of silence:

    >>> time = np.arange(48_000) / 48_000
    >>> hit = np.exp(-8 * time) * np.sin(2 * np.pi * 440 * time)
    >>> hit += 0.5 * np.exp(-20 * time) * np.sin(2 * np.pi * 1234 * time)
    >>> noise = 1e-4 * np.random.default_rng(0).standard_normal(72_000)
    >>> samples = noise + np.concatenate([np.zeros(24_000), 0.5 * hit])
    >>> recording = struck.Sound(samples=samples[None], sample_rate=48_000)
    >>> model = struck.fit(recording, modes=None, residual=False, progress=None)
    >>> model.frequencies.round(1)
    array([ 440., 1234.])
    >>> model.decays.round(1)
    array([ 8., 20.])
    """
    options = {**locals(), "progress": reported(progress)}
    del options["recordings"], options["report"]
    if report is not None:
        from struck.model.html import PAGES

        used = files_read(recordings, manifest)
        writable(report, unlike=used, endings=PAGES, kind="pages")
    fitting = fit_recordings(recordings, **options)
    if report is not None:
        from struck.report.fit_page import save_report

        save_report(fitting, report)
    return fitting.model
