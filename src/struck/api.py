"""The verbs: each has its signature, its documentation and one call of the code behind it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from struck.model.arrays import checked
from struck.model.provenance import Progress, reported, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from struck.analysis.analysis import Fixed, Source
    from struck.batch.batch_report import BatchReport
    from struck.ears import Listener, Room
    from struck.excitation.strike import Strike
    from struck.explorer.server import Explorer
    from struck.files.sofa_fields import Places
    from struck.files.sound import Sound
    from struck.live.player import Player
    from struck.model import Material, Mesh, ModalModel
    from struck.model.contact import Place
    from struck.model.damping import Band
    from struck.perception.sound_map import SoundMap
    from struck.recordings.takes import Recording
    from struck.report.comparison import Comparison, Other
    from struck.scene import Body, Contacts, Scene, Simulation
    from struck.scene.body import Action
    from struck.scene.engines.mujoco import Control


def analyze(
    body: Source,
    material: Material | str,
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
    wall: float | None = None,
    holes: str | None = None,
    repair: bool | None = None,
    fixed: Fixed | None = None,
    accuracy: str | None = None,
    band: Band | None = None,
    damping: str = "own",
    radiation: str = "power",
    recoil: bool = True,
    modes: int | None = None,
    method: str | None = None,
    backend: str | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress | None = shown,
) -> ModalModel:
    """Compute the modal model of a body.

    Parameters
    ----------
    body : path, Mesh, object of trimesh, Open3D or PyVista, (vertices, faces), VolumeMesh or solid
        A surface (OBJ, STL, PLY, OFF, GLB, glTF; gz, bz2, xz or zip too), or elements of another
        program (VTK, VTU, MSH, INP). Or a body of struck.solids or struck.shapes.
    material : Material or str
    units, size : str or float, optional
        Of a file's or object's numbers: "m", "cm", "mm", "in" or "ft"; its own `.units` or metres
        unless given. Or the longest edge of the body's bounding box, m.
    part, up : str, optional
        Which of several bodies in a file (see `struck info`), and which axis points up.
    wall : float, optional
        Thickness of a hollow body's wall or of an open sheet, half on either side, m.
    holes : str, optional
        Of a surface with a wall: "keep" or "fill"; round and straight-edged ones stay otherwise.
    repair : bool, optional
        False refuses holes, crossings, flipped faces and the like; else they are mended, and told.
    fixed : box (2, 3) or callable, optional
        Where the body is held: between two corners, m, or where ``fixed(points)`` is true.
    accuracy : str, optional
        "preview", "standard" (unless given) or "fine": most errors are below 3, 0.5 or 0.1 %.
    band : pair of float or str, optional
        All modes within it are computed, Hz or notes: from 20 to 20,000 unless given, if not long.
    damping, radiation : str
        "own" or "heard", see `Material.named` (a Material keeps its own); and "power" (Pa), the
        same with a timbre field, "field", which takes minutes (see `ModalModel.radiating`), or
        "obrien2002" or "heuristic1998" (relative).
    recoil : bool
        The click of a free body as a whole; never by the papers' own ways, named by a year.
    modes : int, optional
        At most so many, the loudest over contacts; `provenance` tells how far that is heard, in dB.
    method, backend : str, optional
        For a body of struck.shapes "formula" unless given, or "fem" for the solid it stands for.
        For all others "quadratic" elements ("fem") unless given, "obrien2002" for linear
        tetrahedra with lumped mass as in the paper, "obrien2002-consistent" for consistent mass.
        And the sparse factorisation: "auto" (unless given), "rslab" or "superlu".
    cache : bool or path
        Where finished stages are kept: the user's cache (or $STRUCK_CACHE), not at all, a folder.
    progress : callable or None
        Told the stage and fraction done; else lines on stderr or a notebook's bar. None: silent.

    Returns
    -------
    ModalModel
        Complete over the band, by Sturm count, with the error of each frequency.

    Raises
    ------
    MeshError, MaterialError, OptionError, FileFormatError, SolverError
        With the value, the bound and the way out.
    """
    given = {**locals(), "progress": reported(progress)}  # all goes on under its own name

    from struck.analysis import analysis

    work = analysis.analyze_with_field if given["radiation"] == "field" else analysis.analyze
    if given.pop("modes") is not None:
        from struck.perception import audibility

        return audibility.within_budget(modes, work, **given)
    return work(**given)


def analyze_many(
    files: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    material: Material | str | None = None,
    *,
    out: str | os.PathLike[str],
    **options: Any,  # noqa: ANN401 - of `struck.batch.analyze_many`
) -> BatchReport:
    """Analyze many mesh files into a folder of models, with a report.

    Parameters
    ----------
    files, material, out : str or path or several, Material or str, path
        Patterns as ``meshes/**/*.obj``, folders, names; what they are made of; where models go.
    **options
        Those of `analyze`, and more: see `struck.batch.analyze_many`, also for what it returns.
    """
    from struck.batch import batch

    return batch.analyze_many(files, material, out=out, **options)


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
    pitch: ArrayLike | None = None,
    geometry: Mesh | str | os.PathLike[str] | None = None,
    blow: Strike | None = None,
    residual: bool | None = None,
    force: bool = False,
    report: str | os.PathLike[str] | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress | None = shown,
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
        nearly as fast are told as perhaps its own; with modes=None few but the clear ones stay.
    pitch, geometry : optional
        Where contacts lie, in m, as of `ModalModel.charted`, for what scrapes or rolls along them;
        the surface may be a mesh file in m.
    blow : Strike, optional
        With which it was struck, by impulse and duration or by striker and speed. It is divided
        out, so that forces in N drive the model; without it gains hold the blow.
    residual : bool or None
        Keep the loudest hit's attack and noise, less its modes: they sound with each strike. None:
        where a band of the ear within 50 dB of the loudest would be over 6 dB short without them.
    force : bool
        Make a model even of what is not the ringing of a struck object.
    report : path, optional
        Where to write an HTML page of how recordings and model sound and differ.
    cache, progress : bool or path, callable
        As for `analyze`: a fit that was stopped goes on from there.

    Returns
    -------
    ModalModel
        With relative gains, `errors` of its frequencies, and what was left out in `provenance`.

    Raises
    ------
    RecordingError, FileFormatError, OptionError
        With the value, the bound and the way out.
    """
    given = {**locals(), "progress": reported(progress)}  # all under its own name but the page
    told = {name: given[name] for name in given if name not in {"recordings", "report"}}

    from struck.files.atomic import writable
    from struck.model.html import PAGES
    from struck.recordings.fit import files_read, fit_recordings

    if report is not None:
        used = files_read(recordings, manifest)
        writable(report, unlike=used, endings=PAGES, kind="pages")
    fitting = fit_recordings(recordings, **told)
    if report is not None:
        from struck.report.fit_page import save_report

        save_report(fitting, report)
    return fitting.model


def load(path: str | os.PathLike[str]) -> ModalModel:
    """Read the model at `path`: a ``.struck`` file, or a ``.sofa`` file of gains of modes.

    Raises
    ------
    FileFormatError
        When the file is missing, damaged, no model, or of a newer version.
    """
    from struck.files import model_file

    return model_file.load_model(path)


def save(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Places | None = None,
    listeners: ArrayLike | None = None,
) -> None:
    """Write a model to a ``.struck`` file, its gains to ``.sofa``, or its shapes to ``.vtu``.

    Parameters
    ----------
    model : ModalModel
    path : path
        Its ending tells the kind. VTU files hold the surface and a field of vectors a mode.
    contacts, listeners : array-like, optional
        For ``.sofa`` files, where the model is struck and heard: (K, 3), m, or names; those
        that were recorded unless given.

    Raises
    ------
    FileFormatError, OptionError
        When the folder is missing or cannot be written; on another ending, on contacts or listeners
        for another file, or none for a computed model's SOFA file; on no mode shapes.

    Warns
    -----
    LossWarning
        When the model has what a ``.sofa`` file cannot hold: a residual, a shape, a material.
    """
    from struck.files import model_file

    model_file.save_model(model, path, contacts=contacts, listeners=listeners)


def render(
    model: ModalModel | Body | Sequence[Body] | Scene,
    excitations: Action | Sequence[Action] | Contacts = (),
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
    listener: Listener | ArrayLike | None = None,
    room: Room | None = None,
    modes: int | None = None,
    fade: float | None = None,
) -> Sound:
    """Return the sound, at a listener, of bodies struck, scraped, rolled on, plucked or held.

    Parameters
    ----------
    model : ModalModel, Body, several bodies, or Scene
        What sounds; a `Body` is a model with its place in the scene and what happens to it.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, several of them, or Contacts
        What pushes a single model, or a single `Body` without excitations, and what holds it; or
        all contacts of a `struck.scene.Scene`. A log of contacts in which nothing sounds renders to
        silence as long as the log, and the sound's notes give the reason.
    seconds : float or None
        Length of the sound. None: until 60 dB of decay of the slowest among the loud modes (within
        40 dB of the loudest), at most 10 s after the last push.
    sample_rate : int
        Hz. Modes at or above half of it are left out, and the sound's notes say how many.
    listener : Mono, Stereo, Binaural, array-like (3,) or None
        Who hears it. A bare position in body coordinates, m, is one ear without travel time: what a
        contact sends at t is heard at t. None: on the body's x axis through its centre, 1 m or two
        of its radii away, whichever is farther; several bodies are heard by `Mono()`.
    room, modes : Room, int, optional
        Whose walls reflect, for listeners other than a bare position. And at most so many modes a
        body, the loudest over contacts; the sound's notes tell how far that is heard, in dB.
    fade : float or None
        Length of the fade at the end of a sound that is cut off less than 60 dB below its peak, s.
        0: none, for parts that are joined or added. Default: 0.01, of sounds shorter than 0.02 s
        the last half.

    Returns
    -------
    Sound
        A channel for each ear, left first, in Pa when the models are calibrated.

    Raises
    ------
    OptionError, ContactError
        On nothing to render, excitations of which nothing says whose they are, arguments outside
        their bounds, a fade longer than the sound, gains that are not finite, pushes that never end
        where no length is said; on a contact off the body, or a listener inside one.
    """
    given = locals()  # all goes on under its own name

    from struck.scene import render as offline

    return offline.render(**given)


def simulate(
    file: str | os.PathLike[str],
    seconds: float = 5.0,
    *,
    control: Control | None = None,
    progress: Progress | None = shown,
    **options: Any,  # noqa: ANN401 - of `Simulation`
) -> tuple[Scene, Contacts]:
    """Simulate a scene file: bodies that move, and all their contacts, ready for `render`.

    Parameters
    ----------
    file, seconds : path, float
        A model of MuJoCo (MJCF) or a robot (URDF); and how long it moves, s.
    control, progress : callable, optional
        ``control(model, data)`` before each step, and as for `analyze`.
    **options
        What bodies are made of, restitution, engine and all else: see `struck.scene.Simulation`.

    Returns
    -------
    scene : Scene
        Bodies with the models of their sounds; its notes tell what is silent and why.
    contacts : Contacts

    Raises
    ------
    FileFormatError, OptionError, MissingDependencyError, SimulationError
        As `struck.scene.Simulation` does.
    """
    from struck.scene.engines.simulation import Simulation

    simulation = Simulation(file, progress=reported(progress), **options)
    return simulation.run(seconds, control=control, progress=reported(progress))


def play(
    model: ModalModel | Sequence[ModalModel] | Scene | Simulation,
    *,
    listener: Listener | ArrayLike | None = None,
    device: int | str | None = None,
    sample_rate: float | None = None,
    block: int = 128,
    volume: float = 0.0,
    voices: int | None = None,
    ahead: int | None = None,
    modes: int | None = None,
    control: Control | None = None,
) -> Player:
    """Play models, a scene or a simulation on an audio device until the player is stopped.

    Parameters
    ----------
    model : ModalModel or sequence of them, Scene or Simulation
        The bodies, in one system of coordinates; or those of a scene, which `player.move` and
        `player.follow` move, or a simulation that runs beside the sound.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Who hears them, as for `render`, with a position and a direction that stay until
        `player.listener` is set anew.
    device, sample_rate : int or str, float, optional
        Number or part of the name (`struck play --list-devices`), and Hz; the system's own choice
        and the device's own rate unless given.
    block, volume : int, float
        Samples for each call of the device: fewer are heard sooner and cost more. And dB: at 0 the
        default strike of the loudest body at its default contact peaks at -12 dB of full scale; a
        limiter keeps all below -1 dB.
    voices, ahead : int, optional
        Excitations at once, 16 or of a scene 128; strikes at one place share one. And blocks of
        forces kept ready, 2 or of a scene 8: more bear a busier machine, and are heard later.
    modes, control : int, callable, optional
        As for `render`, told in the player's `notes`. And of a simulation, as for `simulate`: what
        it pushes is heard some 200 ms later.

    Returns
    -------
    Player
        Running; use it in a `with`, or call its `stop()`.

    Raises
    ------
    MissingDependencyError, DeviceError, OptionError, ContactError
        With the value, the bound and the way out.
    """
    given = locals()  # all goes on under its own name

    from struck.live import player

    return player.play(**given)


def explore(
    model: ModalModel | Sequence[ModalModel] | None = None,
    *,
    names: Sequence[str] | None = None,
    objects: Sequence[str] | None = None,
    port: int = 0,
    browser: bool = True,
    wait: bool = True,
) -> Explorer:
    """Open bodies in the browser, where a click strikes them.

    Parameters
    ----------
    model : ModalModel or sequence of them, optional
        Bodies to show. Default: the eighteen objects of the room, which are computed while it is
        open.
    names : sequence of str, optional
        Title of each model. Default: "Body 1" and so on.
    objects : sequence of str, optional
        Names of the objects of the room to compute, such as "string" or "bell". Default: all.
    port : int
        Port of 127.0.0.1, from 1 to 65535. Default: 0, a free one.
    browser : bool
        Whether to open a browser where there is a display. Default: True.
    wait : bool
        Whether to serve until Ctrl-C, else until `stop` is called. Default: True.

    Returns
    -------
    Explorer
        With its `url` and `stop()`; it may be used in a `with`.

    Raises
    ------
    MissingDependencyError, OptionError, FileFormatError
        Without starlette or uvicorn, on a taken port, and on gains that no file keeps.
    """
    from struck.explorer import server

    return server.explore(
        model, names=names, objects=objects, port=port, browser=browser, wait=wait
    )


def show(
    model: ModalModel,
    path: str | os.PathLike[str] | None = None,
    *,
    field: int | str | None = None,
    strike: Strike | None = None,
    modes: int | None = None,
    nodal_lines: int | None = None,
) -> Figure:
    """Draw a model: its shape, first modes and the spectrum of a strike; or one thing of it.

    Parameters
    ----------
    model : ModalModel
    path : path, optional
        Where to save the picture too; the ending tells its format.
    field : int or "brightness", optional
        Index of a mode, from 0, for its directivity; or the brightness of a strike all around.
    strike : Strike, optional
        A blow, for the surface as it moves after it (2002, figure 4).
    modes : int, optional
        Number of mode shapes, drawn alone.
    nodal_lines : int, optional
        Number of modes that are drawn from the broad side of a flat body, from above of others,
        with their nodal lines, as Chladni's figures show them. Pictures count modes from 1.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    FileFormatError, OptionError, ContactError
        When the folder is missing or the ending is no picture's; without a field, such a mode, or
        mode shapes; where the strike meets no body.
    """
    from struck.report.model_pictures import picture_of

    return picture_of(model, path, field=field, strike=strike, modes=modes, nodal_lines=nodal_lines)


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

    Parameters
    ----------
    model : ModalModel
    other : path, Sound, Take, ModalModel or FittedModes
        A sound file or a sound of one hit or several, whose modes are fitted; a model or its file;
        or anything with `frequencies`, `decays` and `gains`.
    at, strike, against : place, Strike, Strike, optional
        Where and with what both are struck: the model's playing place, and ``Strike()``, unless
        given. And another model, where it is struck otherwise.
    listener : array-like (3,), optional
        In the coordinates of each model, m; beside it unless given.
    recording : Sound, optional
        What was fitted, to be heard on the page; else the fitted modes are.
    widest, progress : float, callable
        Largest factor between the frequencies of the two, either way; and as for `analyze`.

    Returns
    -------
    Comparison
        The validation of 2002, section 5, for any body. Its summary tells where both were struck.

    Raises
    ------
    OptionError, ContactError, RecordingError, FileFormatError, MissingDependencyError
        With the value, the bound and the way out.
    """
    given = {**locals(), "progress": reported(progress)}  # all goes on under its own name

    from struck.report import comparison

    return comparison.compare(**given)


def tune(
    body: Source,
    material: Material | str,
    *,
    vary: str,
    lowest: float | str | None = None,
    **options: Any,  # noqa: ANN401 - of `struck.analysis.tuning`
) -> Any:  # noqa: ANN401 - as the body
    """Return the body with the dimension that makes its lowest mode, or another, ring in tune.

    Parameters
    ----------
    body : a body of struck.solids or struck.shapes, or ``functools.partial(bowl, radius=0.1)``
        A file has no dimensions to vary.
    material : Material or str
    vary : str
        Name of the dimension, such as "length".
    lowest : float
        Hz, or a note as "A5" or "A5+12c".
    **options
        Of other modes ``frequency=, mode="bending 2"``, and more, as of `struck.analysis.tune`.

    Raises
    ------
    OptionError
        When the body has no such dimension, or it does not reach the frequency.
    """
    from struck.analysis import tuning

    return tuning.tune(body, material, vary=vary, lowest=lowest, **options).body


def audible(
    model: ModalModel,
    contacts: Sequence[Place] | None = None,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
) -> ModalModel:
    """Return a model of the modes that are heard anywhere, their gains solved for anew.

    Those that add least are left out first, as long as behind no filter of the ear all of them
    together exceed the threshold that the others leave, at any contact and any listener. Those
    that stay get factors, such that what passes the filters changes least.

    Parameters
    ----------
    model : ModalModel
        With a surface.
    contacts : sequence of str or array-like, optional
        As for `ModalModel.contact`; 256 spread over the surface unless given.
    listener, level : array-like (3,) or (L, 3), float, optional
        m, beside the model unless given; of the loudest contact, dB re 20 micropascal, else 85.

    Returns
    -------
    ModalModel
        Its provenance counts what was left out.

    Raises
    ------
    ContactError, OptionError
        With the value, the bound and the way out.
    """
    from struck.perception import audibility

    return audibility.audible(model, contacts, listener=listener, level=level)


def sonic_distance(
    a: ModalModel,
    b: ModalModel,
    *,
    at: Place = None,
    against: Place = None,
    listener: ArrayLike | None = None,
    level: float | None = None,
    method: str = "erb",
) -> float:
    """Return how different two impacts sound, dB.

    Parameters
    ----------
    a, b : ModalModel
        What is struck; one model twice to compare two of its contacts.
    at, against : place, optional
        Where `a` is struck, as for `ModalModel.contact`, its playing place unless given; and `b`.
    listener, level : array-like (3,), float, optional
        In the coordinates of each model, m; beside it unless given. And what the loudest contact of
        each reaches, dB re 20 micropascal; 85 unless given: bodies are compared by their timbre.
    method : str
        "erb": levels behind the ear's filters, above the threshold in quiet; root mean square over
        those filters where either is heard: masked modes count for little.
        "doel1998": the sum of section 5 over modes; its root grows with their number.
        "doel1998-mean": the same with the sum of S(f) divided out, a weighted root mean square.

    Returns
    -------
    float
        0 for sounds that cannot be told apart.

    Raises
    ------
    OptionError, ContactError
        On an unknown method, models without a common set of modes by one of 1998; off the body.
    """
    from struck.perception.sonic_distance import sonic_distance as distance

    return distance(a, b, at=at, against=against, listener=listener, level=level, method=method)


def sound_map(
    model: ModalModel,
    threshold_db: float = 3.0,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
    progress: Progress | None = shown,
) -> SoundMap:
    """Choose how few contacts are enough, and which sounds where.

    Parameters
    ----------
    model : ModalModel
        With a surface.
    threshold_db : float
        Largest `sonic_distance` of what is stored from a push straight into the surface anywhere.
    listener, level, progress : array-like (3,), float, callable, optional
        m; beside the model unless given. And the level of the loudest contact, dB re 20
        micropascal; 85 unless given. Softer needs fewer. And as for `analyze`.

    Returns
    -------
    SoundMap
        Its `bound` holds at all contacts, not at samples: see `docs/explanation/perception.md`.

    Raises
    ------
    OptionError, ContactError
        With the value, the bound and the way out.
    """
    from struck.perception.sound_map import sound_map as chosen

    return chosen(model, threshold_db, listener=listener, level=level, progress=reported(progress))


def materials() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of materials by name: group, aliases, constants, damping sets, source."""
    from struck.model import material

    return material.materials()


for _name, _verb in list(vars().items()):
    if getattr(_verb, "__module__", "") == __name__:  # all verbs check what they are given
        vars()[_name] = checked(_verb)
