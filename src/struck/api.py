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
    body : path, Mesh, VolumeMesh, mesh object, (vertices, faces), solid or shape
        The body to analyze:

        - path of a surface mesh (OBJ, STL, PLY, OFF, GLB, glTF; also compressed by gz, bz2, xz or
          zip) or of a volume mesh (VTK, VTU, MSH, INP);
        - mesh object of trimesh, Open3D or PyVista, or arrays of vertices (V, 3), m, and faces
          (F, 3);
        - body of `struck.solids` or `struck.shapes`.
    material : Material or str
        A material, or its name as listed by `struck.materials`.
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: the unit stored in the file or object, otherwise metres.
    size : float, optional
        Scale the body so that the longest edge of its bounding box has this length, m.
    part : str, optional
        Name of the part to analyze if the file contains several (see ``struck info``).
    up : {"x", "y", "z"}, optional
        Axis that points up. Default: as the file format defines it.
    wall : float, optional
        Wall thickness, m. A closed surface becomes a hollow body with its wall inside the surface;
        an open one becomes a sheet, with half of the thickness on either side.
    holes : {"keep", "fill"}, optional
        What to do with holes in a surface that has a wall. Default: keep round and straight-edged
        holes, fill the others.
    repair : bool, optional
        If False, raise MeshError for holes, self-intersections or flipped faces. By default they
        are repaired, and a RepairWarning lists the repairs.
    fixed : array-like (2, 3) or callable, optional
        Where the body is clamped: a box given by two corners, m, or a function of points (N, 3)
        that returns a mask (N,).
    accuracy : {"preview", "standard", "fine"}, optional
        Most frequencies have errors below 3, 0.5 or 0.1 %. Default: "standard".
    band : (float, float) or (str, str), optional
        Lowest and highest frequency, Hz or note names. All modes in the band are computed.
        Default: 20 to 20,000 Hz, unless that would take too long.
    damping : {"own", "heard"}, default "own"
        Damping constants of a material that is given by name: internal friction only, or tuned by
        ear to include mounting and radiation (see `Material.named`).
    radiation : {"power", "field", "obrien2002", "heuristic1998"}, default "power"
        How gains are computed. "power": radiated power of each mode, gains in Pa/(N s). "field":
        the same with directivity, by boundary elements, which takes minutes (see
        `ModalModel.radiating`). The other two are those of the papers; their gains are relative.
    recoil : bool, default True
        Include the sound of a free body that is accelerated as a whole. The methods of the papers
        never include it.
    modes : int, optional
        Keep only this many modes, those that are loudest over all contacts. `provenance` reports
        the audible difference, dB.
    method : str, optional
        For bodies of `struck.shapes`: "formula" (default) or "fem". For all others: "quadratic"
        elements (default, also called "fem"), or linear tetrahedra as in the 2002 paper with
        lumped ("obrien2002") or consistent mass ("obrien2002-consistent").
    backend : {"auto", "rslab", "superlu"}, optional
        Sparse factorisation. Default: "auto".
    cache : bool or path, default True
        True: cache intermediate results in the user's cache directory or in ``$STRUCK_CACHE``.
        False: no cache. A path: that directory.
    progress : callable or None, optional
        Called as ``progress(stage, fraction)``. Default: a line on stderr, or a bar in a notebook.
        None: silent.

    Returns
    -------
    ModalModel
        All modes in the band, verified by a Sturm count, with an estimated error of each frequency.

    Raises
    ------
    MeshError
        If the surface cannot be repaired or meshed.
    MaterialError
        If the material is unknown or its constants are out of range.
    OptionError
        If an option is unknown, out of range or does not apply to this body.
    FileFormatError
        If the file is missing, damaged or of an unknown format.
    SolverError
        If the eigenvalue solver does not converge.

    Examples
    --------
    A steel bar, 10 cm long:

    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> model.frequencies[:3].round()
    array([ 5028.,  9203., 11878.])

    A triangle mesh of a hollow sphere with a wall of 4 mm:

    >>> import trimesh
    >>> mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    >>> model = struck.analyze(
    ...     mesh, "glass", wall=0.004, units="m", accuracy="preview", progress=None
    ... )
    >>> len(model.frequencies) > 10
    True
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

    Each body is analyzed by a process of one thread. A failure of one file does not stop the
    others. `struck.batch.analyze_many` documents all options.

    Parameters
    ----------
    files : str, path or sequence of them, optional
        Patterns such as ``meshes/**/*.obj``, folders, and names of files. Default: the files of
        the option `table`.
    material : Material or str, optional
        Material of every file for which the table has none.
    out : path
        Folder for the models and the report. It is created if it does not exist.
    **options
        Options of `analyze`, and those of `struck.batch.analyze_many`.

    Returns
    -------
    BatchReport
        One row for each body; also written to `out` as CSV, JSON and HTML.

    Raises
    ------
    OptionError
        If there are no files, two models would have one name, or an option is unknown.
    FileFormatError
        If a table is damaged, or the folder cannot be written.
    MissingDependencyError
        If an option needs a package that is not installed.

    Examples
    --------
    >>> import trimesh
    >>> for name, radius in (("small", 0.02), ("large", 0.03)):
    ...     _ = trimesh.creation.icosphere(subdivisions=2, radius=radius).export(f"{name}.stl")
    >>> report = struck.analyze_many(
    ...     "*.stl", "steel", out="models", accuracy="preview", units="m", progress=None
    ... )
    >>> [row.model for row in report.rows]
    ['large.struck', 'small.struck']
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
    way : {"field", "table"}, default "field"
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
    """Save a model to a file.

    Parameters
    ----------
    model : ModalModel
        The model.
    path : path
        The ending selects the format: ``.struck`` holds the whole model, ``.sofa`` its gains,
        ``.vtu`` its surface with one vector field for each mode shape.
    contacts : array-like (K, 3) or sequence of str, optional
        Contacts of a ``.sofa`` file, m, or names of contacts. Default: those of the recordings.
    listeners : array-like (L, 3), optional
        Listeners of a ``.sofa`` file, m. Default: those of the recordings.

    Raises
    ------
    FileFormatError
        If the folder does not exist or cannot be written, or the ending is unknown.
    OptionError
        If contacts or listeners are given for another format, or are missing for the ``.sofa`` file
        of a computed model, or the model has no mode shapes for a ``.vtu`` file.

    Warns
    -----
    LossWarning
        If the model has parts that a ``.sofa`` file cannot hold: a residual, a shape, a material.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> struck.save(struck.analyze(bar, "steel", progress=None), "bar.struck")
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
    """Render the sound of excited bodies at a listener.

    Parameters
    ----------
    model : ModalModel, Body, sequence of Body, or Scene
        What sounds. A `Body` is a model with a pose in the scene and its own excitations.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, sequence of them, or Contacts
        Forces on a single model or a single `Body` without excitations, or all contacts of a
        `struck.scene.Scene`. A log in which nothing sounds gives silence as long as the log, with
        the reason in the notes of the sound.
    seconds : float, optional
        Length of the sound. Default: until the slowest of the loud modes (within 40 dB of the
        loudest) has decayed by 60 dB, at most 10 s after the last excitation.
    sample_rate : int, default 48000
        Hz. Modes at or above half of it are left out, and counted in the notes of the sound.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Listener. A bare position, in body coordinates, m, is a single ear without propagation
        delay. Default: on the x axis of the body through its centre, at 1 m or at two radii of the
        body, whichever is farther; for several bodies `Mono()`.
    room : Room, optional
        Room whose walls reflect the sound. Needs a `Mono`, `Stereo` or `Binaural` listener.
    modes : int, optional
        Use only this many modes of each body, those that are loudest over all contacts. The notes
        of the sound report the audible difference, dB.
    fade : float, optional
        Duration of the fade at the end of a sound that is cut off less than 60 dB below its peak,
        s; 0 for none. Default: 0.01, or half of a sound shorter than 0.02 s.

    Returns
    -------
    Sound
        One channel per ear, left first; in Pa if the models are calibrated.

    Raises
    ------
    OptionError
        If there is nothing to render, the excitations of several bodies are given together, an
        argument is out of range, the fade is longer than the sound, a gain is not finite, or an
        excitation never ends and `seconds` is not given.
    ContactError
        If a contact is not on the body, or the listener is inside it.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> sound = struck.render(model, struck.Strike(striker="steel", speed=0.5), seconds=1.0)
    >>> sound.samples.shape
    (1, 48000)

    Two strikes, 0.25 s apart, heard in stereo:

    >>> strikes = [struck.Strike(time=0.0), struck.Strike(time=0.25)]
    >>> struck.render(model, strikes, seconds=1.0, listener=struck.ears.Stereo()).samples.shape
    (2, 48000)
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
    """Simulate the rigid bodies of a scene file, and log all contacts for `render`.

    Parameters
    ----------
    file : path
        A model of MuJoCo (MJCF), or a robot (URDF).
    seconds : float, default 5.0
        Duration, s.
    control : callable, optional
        Called as ``control(model, data)`` before each step, with the engine's objects.
    progress : callable or None, optional
        As for `analyze`.
    **options
        Materials, restitution, engine and others, as for `struck.scene.Simulation`.

    Returns
    -------
    scene : Scene
        The bodies with the models of their sounds. Its notes list bodies that are silent, and why.
    contacts : Contacts
        One row for each contact and step.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or names a file outside its folder.
    SimulationError
        If the engine refuses the scene, or bodies overlap at the start.
    OptionError
        If an option is out of range, or a pattern matches no body.
    MissingDependencyError
        If MuJoCo, Rapier or CoACD is needed and not installed.

    Examples
    --------
    A wooden block that falls on a floor:

    >>> from pathlib import Path
    >>> _ = Path("fall.xml").write_text(
    ...     "<mujoco><worldbody><geom type='plane' size='1 1 0.1'/>"
    ...     "<body name='block' pos='0 0 0.1'><freejoint/>"
    ...     "<geom type='box' size='0.05 0.03 0.01'/></body></worldbody></mujoco>"
    ... )
    >>> scene, contacts = struck.simulate(
    ...     "fall.xml", 0.5, materials={"block": "oak"}, accuracy="preview", progress=None
    ... )
    >>> sound = struck.render(scene, contacts, seconds=0.5)
    >>> sound.peak > 0
    True
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
    """Play models, a scene or a simulation on an audio device.

    Parameters
    ----------
    model : ModalModel, sequence of ModalModel, Scene or Simulation
        The bodies, all in one coordinate system; or those of a scene, which `Player.move` and
        `Player.follow` move; or a simulation, which runs while it sounds.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Listener as for `render`, at a constant position and orientation, until `Player.listener`
        is set.
    device : int or str, optional
        Number of the output device, or a part of its name (``struck play --list-devices``).
        Default: the default device of the system.
    sample_rate : float, optional
        Hz. Default: that of the device.
    block : int, default 128
        Samples per call of the device. Fewer give a lower latency and a higher processor load.
    volume : float, default 0.0
        dB. At 0 dB the default strike of the loudest body at its default contact peaks at -12 dB of
        full scale. A limiter keeps the output below -1 dB.
    voices : int, optional
        Maximum number of simultaneous excitations. Default: 16, or 128 for a scene. Strikes at one
        contact share a voice.
    ahead : int, optional
        Number of blocks of forces that are computed ahead. More tolerate a busier machine and
        increase the latency. Default: 2, or 8 for a scene.
    modes : int, optional
        Maximum number of modes of each body, as for `render`. `Player.notes` report the audible
        difference.
    control : callable, optional
        As for `simulate`. Its effect is audible after about 200 ms.

    Returns
    -------
    Player
        A running player. Use it in a ``with`` statement, or call its `stop`.

    Raises
    ------
    MissingDependencyError
        If PortAudio is not installed.
    DeviceError
        If there is no such device, or it refuses the sample rate or the block size.
    OptionError
        If an option is out of range.
    ContactError
        If the listener is inside a body.

    Examples
    --------
    .. code-block:: python

        bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
        model = struck.analyze(bar, "steel", accuracy="preview")
        with struck.play(model) as player:
            player.strike(at="top", striker="wood")
            time.sleep(2)
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
    """Show bodies in a browser, where a click strikes them.

    Parameters
    ----------
    model : ModalModel or sequence of ModalModel, optional
        Default: eighteen demonstration objects, which are computed in the background.
    names : sequence of str, optional
        Titles of the models. Default: "Body 1" and so on.
    objects : sequence of str, optional
        Names of the demonstration objects to compute, such as "string" or "bell". Default: all.
    port : int, default 0
        Port on 127.0.0.1; 0 selects a free one.
    browser : bool, default True
        Open a browser, if there is a display.
    wait : bool, default True
        Serve until Ctrl-C. Otherwise return, and serve until `Explorer.stop` is called.

    Returns
    -------
    Explorer
        The server, with its `url` and `stop`. It may be used in a ``with`` statement.

    Raises
    ------
    MissingDependencyError
        If starlette or uvicorn is not installed.
    OptionError
        If the port is in use or out of range, or the names do not match the models.
    FileFormatError
        If the gains of a model cannot be saved.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> with struck.explore(model, names=["bar"], browser=False, wait=False) as room:
    ...     room.url.startswith("http://127.0.0.1:")
    True
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
    """Draw a model: its shape, its first modes and the spectrum of a strike.

    At most one of `field`, `strike`, `modes` and `nodal_lines` selects another picture.

    Parameters
    ----------
    model : ModalModel
        The model.
    path : path, optional
        File to save the picture to; the ending selects the format.
    field : int or "brightness", optional
        Directivity of the mode of this index, or brightness of a strike in slices around the body.
    strike : Strike, optional
        Motion of the surface after this strike (O'Brien, Shen and Gatchalian 2002, figure 4).
    modes : int, optional
        Number of mode shapes to draw.
    nodal_lines : int, optional
        Number of modes to draw with their nodal lines (Chladni figures), from the broad side of a
        flat body, from above for others. Pictures count modes from 1.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.

    Raises
    ------
    FileFormatError
        If the folder does not exist, or the ending is not that of a picture.
    OptionError
        If the model has no field, no such mode or no mode shapes.
    ContactError
        If the contact of the strike is not on the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> figure = struck.show(model, "bar.png")
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
    """Reduce a model to the modes that are audible.

    Modes are removed, quietest first, while in every auditory filter their summed level stays below
    the masking threshold of the remaining modes, at every contact and listener. The gains of the
    remaining modes are scaled so that the output of the filters changes least.

    Parameters
    ----------
    model : ModalModel
        A model with a surface.
    contacts : sequence of str or array-like (3,), optional
        Contacts, as for `ModalModel.contact`. Default: 256 spread over the surface.
    listener : array-like (3,) or (L, 3), optional
        Listeners, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact, dB re 20 micropascal. Default: 85.

    Returns
    -------
    ModalModel
        The reduced model. Its provenance counts the modes that were removed.

    Raises
    ------
    ContactError
        If a contact is not on the body.
    OptionError
        If the model has no surface, or no mode is audible at this level.

    Examples
    --------
    >>> plate = struck.solids.Block(size=(0.3, 0.2, 0.004))
    >>> model = struck.analyze(plate, "steel", accuracy="preview", progress=None)
    >>> len(struck.audible(model).frequencies) < len(model.frequencies)
    True
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
    """Return how different the sounds of two strikes are, dB.

    Parameters
    ----------
    a : ModalModel
        First model.
    b : ModalModel
        Second model. Give one model twice to compare two of its contacts.
    at : str or array-like, optional
        Contact on `a`, as for `ModalModel.contact`. Default: its playing place.
    against : str or array-like, optional
        Contact on `b`. Default: its playing place.
    listener : array-like (3,), optional
        Position in the coordinates of each model, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact of each model, dB re 20 micropascal, so that bodies are
        compared by timbre. Default: 85.
    method : {"erb", "doel1998", "doel1998-mean"}, default "erb"
        "erb": root mean square difference of the levels in those auditory filters in which either
        sound is above the threshold in quiet. "doel1998": the sum over modes of van den Doel and
        Pai (1998), section 5, whose root grows with the number of modes. "doel1998-mean": the same
        divided by the sum of weights, a weighted root mean square.

    Returns
    -------
    float
        Distance, dB; 0 for indistinguishable sounds.

    Raises
    ------
    OptionError
        If the method is unknown, or a method of 1998 is used on models with different modes.
    ContactError
        If a contact is not on the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.2, 0.03, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> struck.sonic_distance(model, model)
    0.0
    >>> struck.sonic_distance(model, model, at="end", against="middle") > 3
    True
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
    """Choose the contacts whose sounds represent the whole surface of a body.

    Parameters
    ----------
    model : ModalModel
        A model with a surface.
    threshold_db : float, default 3.0
        Largest `sonic_distance` between a stored sound and that of a push straight into the surface
        at any contact that it represents.
    listener : array-like (3,), optional
        Position, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact, dB re 20 micropascal. A lower one needs fewer contacts.
        Default: 85.
    progress : callable or None, optional
        As for `analyze`.

    Returns
    -------
    SoundMap
        Contacts, and the triangles of the surface that each represents. Its `bound` holds for all
        contacts, not for a sample of them (see `docs/explanation/perception.md`).

    Raises
    ------
    OptionError
        If the model has no surface, or a value is out of range.
    ContactError
        If the listener is inside the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> chart = struck.sound_map(model, threshold_db=6.0, progress=None)
    >>> chart.gains.shape == (len(chart.contacts), len(chart.frequencies))
    True
    """
    from struck.perception.sound_map import sound_map as chosen

    return chosen(model, threshold_db, listener=listener, level=level, progress=reported(progress))


def materials() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of materials.

    Returns
    -------
    mapping
        By name: group, aliases, constants in SI units, sets of damping constants, and sources.

    Examples
    --------
    >>> struck.materials()["steel"]["density"]
    7850.0
    """
    from struck.model import material

    return material.materials()


for _name, _verb in list(vars().items()):
    if getattr(_verb, "__module__", "") == __name__:  # all verbs check what they are given
        vars()[_name] = checked(_verb)
