"""The verbs: thin functions over what does the work."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from struck.errors import OptionError
from struck.model.provenance import Progress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from struck.analysis.discretisation import Solid
    from struck.ears.listeners import Listener
    from struck.files.sofa_fields import Contacts
    from struck.live.player import Player
    from struck.model.material import Material
    from struck.model.model import ModalModel
    from struck.recordings.gain_table import Recording


def save(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
) -> None:
    """Write a model to a ``.struck`` file, or its gains to a ``.sofa`` file, atomically.

    Parameters
    ----------
    model : ModalModel
    path : path
        Its ending tells the kind.
    contacts, listeners : array-like, optional
        For ``.sofa`` files, where the model is struck and heard: coordinates, m, or names; those
        that were recorded unless given.

    Raises
    ------
    FileFormatError
        When the folder is missing or cannot be written.
    OptionError
        On another ending, on contacts or listeners for a ``.struck`` file, or none for a computed
        model's SOFA file.

    Warns
    -----
    LossWarning
        When the model has what a ``.sofa`` file cannot hold: a residual, a shape, a material.
    """
    from struck.files import model_file

    model_file.save_model(model, path, contacts=contacts, listeners=listeners)


def load(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model from a ``.struck`` file, or from a ``.sofa`` file of gains of modes.

    Raises
    ------
    FileFormatError
        When the file is missing, damaged, no model, or of a newer version.
    """
    from struck.files import model_file

    return model_file.load_model(path)


def show(model: ModalModel, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw a model: its shape, its first mode shapes and the spectrum of a strike.

    Parameters
    ----------
    model : ModalModel
    path : path, optional
        Where to save the picture too; the ending tells its format.

    Raises
    ------
    FileFormatError
        When the folder is missing or the ending is no picture's.
    """
    from struck.excitation.strike import Strike
    from struck.report.charts import overview
    from struck.report.charts import save as save_picture
    from struck.scene.render import render

    figure = overview(model, render(model, Strike()))
    if path is not None:
        save_picture(figure, path)
    return figure


def play(
    model: ModalModel | Sequence[ModalModel],
    *,
    listener: Listener | ArrayLike | None = None,
    device: int | str | None = None,
    sample_rate: float | None = None,
    block: int = 128,
    volume: float = 0.0,
    voices: int = 16,
    ahead: int = 2,
) -> Player:
    """Play a model, or several, on an audio device until the player is stopped.

    Parameters
    ----------
    model : ModalModel or sequence of them
        The bodies, in one system of coordinates.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Who hears them, as for `render`, with a position and a direction that stay until
        `player.listener` is set anew.
    device : int or str, optional
        Its number or part of its name (`struck play --list-devices`); the system's own choice
        unless given.
    sample_rate : float, optional
        Hz; the device's own unless given.
    block : int
        Samples for each call of the device: fewer are heard sooner and cost more.
    volume : float
        dB. At 0 the default strike of the loudest body at its default contact peaks at -12 dB of
        full scale; a limiter keeps all below -1 dB.
    voices : int
        Excitations at once; strikes at one place share one.
    ahead : int
        Blocks of forces kept ready: more of them bear a busier machine, and are heard later.

    Returns
    -------
    Player
        Running; use it in a `with`, or call its `stop()`. The first call takes seconds, as all
        that runs on the device is compiled before it opens.

    Raises
    ------
    MissingDependencyError
        Where PortAudio is not installed.
    DeviceError
        Where there is no such device, or it refuses.
    OptionError
        On numbers outside their bounds, or a model that is not fit to ring.
    ContactError
        Where the listener is inside a body.
    """
    from struck.live.player import play as play_live
    from struck.model.model import ModalModel

    return play_live(
        [model] if isinstance(model, ModalModel) else list(model),
        listener=listener,
        device=device,
        sample_rate=sample_rate,
        block=block,
        volume=volume,
        voices=voices,
        ahead=ahead,
    )


def tune(
    body: Solid | str,
    material: Material | str,
    *,
    vary: str,
    lowest: float,
    accuracy: str = "standard",
    progress: Progress = silent,
) -> Solid:
    """Return the body with the dimension that makes its lowest mode ring at `lowest`.

    Parameters
    ----------
    body : a solid of struck.solids
        A file has no dimensions to vary.
    material : Material or str
    vary : str
        Name of the dimension, such as "length".
    lowest : float
        Hz.
    accuracy : str
        "preview", "standard" or "fine".
    progress : callable
        Told the stage and the fraction of it that is done.

    Raises
    ------
    OptionError
        When the body has no such dimension, or it does not reach the frequency.

    Examples
    --------
    >>> from struck.solids import Tube
    >>> tube = Tube(length=0.5, radius=0.0125, wall=0.001)
    >>> round(tune(tube, "aluminium", vary="length", lowest=587.33, accuracy="preview").length, 3)
    0.511
    """
    from struck.analysis.discretisation import Solid
    from struck.analysis.tuning import tuned
    from struck.model.material import Material

    if not isinstance(body, Solid):
        raise OptionError(f"{type(body).__name__} has no dimensions to vary: give a solid")
    chosen = Material.named(material) if isinstance(material, str) else material
    return tuned(body, chosen, vary=vary, lowest=lowest, accuracy=accuracy, progress=progress)


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
    from struck.files.atomic import writable
    from struck.recordings.fit import files_read, fit_recordings
    from struck.report.fit_page import save_report

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
