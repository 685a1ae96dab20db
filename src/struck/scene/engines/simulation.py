"""Simulation: a scene file, the materials of its bodies, and the engine that moves them."""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from struck.analysis.cached_steps import Stages
from struck.errors import ArgumentError, SimulationError, counted, require_choice, rounded
from struck.files.cache import opened
from struck.model.arrays import checked, refuse_names, require_number
from struck.model.model import ModalModel
from struck.model.provenance import Progress, reported, shown, silent
from struck.scene.body import Body, Scene
from struck.scene.contacts import Contacts
from struck.scene.engines.convex_parts import cut
from struck.scene.engines.explosion import dead, free_masses, overlaps, require_no_blast
from struck.scene.engines.links import Link, links_of, mass_properties
from struck.scene.engines.mujoco import MujocoEngine
from struck.scene.engines.restitution import ContactLaws, PairValues
from struck.scene.engines.scene_file import gathered_warnings, load_scene
from struck.scene.engines.sound_sources import SoundOptions, SoundSources, model_mass
from struck.scene.gathered_notes import QUOTED_FORM, list_names

if TYPE_CHECKING:
    import mujoco

    from struck.scene.engines.mujoco import Control
    from struck.scene.engines.rapier import RapierEngine

ENGINES = ("mujoco", "rapier")
_DENSITY = 1000.0  # kg/m^3, MuJoCo's default
_MAX_SECONDS = 3600.0  # s
_PROGRESS_STEPS = 50  # steps between two reports of progress


def require_seconds(seconds: float, ring: float = 0.0) -> None:
    """Refuse lengths that no simulation has; before bodies are analyzed, which takes longer."""
    hint = "it must lie above 0 and at most at 3600"
    require_number("seconds", seconds, 0, _MAX_SECONDS, above=True, hint=hint)
    require_number("ring", ring, 0, _MAX_SECONDS - seconds, hint="give 0 s or more", unit=" s")


@checked
class Simulation:
    """A scene file that is ready to run: bodies with their sounds, in an engine.

    Parameters
    ----------
    file : path
        A model of MuJoCo (MJCF) or a robot (URDF).
    materials : str, Material or mapping, optional
        Material of all bodies, or by patterns of their names, as in ``{"mug*": "ceramic"}``.
        Default: the material of that name in the file. Bodies without a material are silent.
    models : mapping, optional
        By patterns: the ModalModel, ``.struck`` file, solid, shape or mesh file that sounds instead
        of the shape of the file, in the coordinates of that shape.
    walls : mapping of str to float, optional
        Wall thickness of hollow bodies, m.
    fixed : mapping, optional
        Where bodies are clamped, as for `struck.analyze`.
    roughness : mapping of str to str, optional
        Finish of surfaces for sliding and rolling. Default: that of the material.
    mute : sequence of str, optional
        Patterns of bodies that are silent.
    restitution : float, "materials" or mapping, optional
        Coefficient of restitution of all pairs, by their materials, or by pairs of patterns, as in
        ``{("ball", "floor*"): 0.8}``. It replaces the solver settings of the file for contacts.
        Default: the settings of the file.
    friction : float, "materials" or mapping, optional
        Coefficient of friction, likewise. Default: that of the file.
    engine : {"mujoco", "rapier"}, default "mujoco"
        Engine; "rapier" for scenes of free and fixed bodies.
    step : float, optional
        Time step, s. Default: that of the file.
    keyframe : str, optional
        Name of the state from which the simulation starts.
    folder : path, optional
        Folder that holds all files that the scene names. Default: that of the file.
    convex : {"parts", "hull"}, default "parts"
        Whether concave meshes collide as convex parts into which they are cut, or as their convex
        hulls.
    band : (float, float) or (str, str), optional
        As for `struck.analyze`.
    accuracy : str, optional
        As for `struck.analyze`.
    damping : str, optional
        As for `struck.analyze`.
    cache : bool or path, default True
        As for `struck.analyze`.
    progress : callable, optional
        As for `struck.analyze`. Default: silent.

    Attributes
    ----------
    model : mujoco.MjModel
        What the engine runs, for a loop of one's own with `MujocoRecorder`.
    scene : Scene
        Its bodies where they start.
    notes : tuple of str
        What is silent and why, and what was changed.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or names a file outside the folder.
    SimulationError
        If the engine refuses the scene, with its message, or bodies overlap at the start
        by more than a tenth of the thinner one's width.
    OptionError
        If an argument is out of range, or a pattern matches no body.
    MissingDependencyError
        If MuJoCo, Rapier or CoACD is needed and not installed.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("drop.xml").write_text(
    ...     "<mujoco><worldbody><geom type='plane' size='1 1 0.1'/>"
    ...     "<body name='block' pos='0 0 0.1'><freejoint/>"
    ...     "<geom type='box' size='0.05 0.03 0.01'/></body></worldbody></mujoco>"
    ... )
    >>> simulation = struck.scene.Simulation(
    ...     "drop.xml", materials={"block": "oak"}, accuracy="preview"
    ... )
    >>> scene, contacts = simulation.run(0.3)
    >>> "block" in scene.bodies, len(contacts.time) > 0
    (True, True)
    """

    def __init__(
        self,
        file: str | os.PathLike[str],
        *,
        restitution: PairValues | None = None,
        friction: PairValues | None = None,
        engine: str = "mujoco",
        step: float | None = None,
        keyframe: str | None = None,
        folder: str | os.PathLike[str] | None = None,
        convex: str = "parts",
        cache: bool | str | os.PathLike[str] = True,
        progress: Progress = silent,
        **sounds: Any,  # noqa: ANN401 - of `SoundOptions`
    ) -> None:
        _require_choices(engine, convex, step)
        parameters = ["seconds", "control", *signature(Simulation).parameters][
            :-1
        ]  # as of `simulate`
        names = list(
            dict.fromkeys([*parameters, *(option.name for option in fields(SoundOptions))])
        )
        if not sounds.keys() <= {*names}:
            refuse_names("simulate", 1, names, (), sounds)
        scene_file = load_scene(file, folder)
        spec = _name_all(scene_file.spec())
        if step is not None:
            spec.option.timestep = step
        self._stages = Stages(cache=opened(choice=cache), progress=progress)
        self._sources = SoundSources(SoundOptions(cache=cache, progress=progress, **sounds))
        self._engine, self._keyframe, self._convex = engine, keyframe, convex
        self._prepare(spec, scene_file.notes, restitution, friction)

    def _prepare(
        self,
        spec: mujoco.MjSpec,
        notes: list[str],
        restitution: PairValues | None,
        friction: PairValues | None,
    ) -> None:
        """Check the scene, analyze its bodies, and give the engine masses, hulls and laws."""
        # All checks that need no mode come before the first mode is computed.
        model = _compile(spec, notes)
        links = links_of(model)
        materials = self._sources.prepare(links)
        laws = ContactLaws(materials=materials, restitution=restitution, friction=friction)
        hulls = []
        if self._convex == "parts":
            hulls = cut(spec, model, self._stages)
        elif not model.nmesh:
            hulls = ["convex='hull' changes nothing: no body is a mesh"]
        whole_model = _compile(spec, notes)
        if self._engine == "mujoco" and laws.has_values:
            laws.give(spec, whole_model, links_of(whole_model))
            whole_model = _compile(spec, notes)
        parts = links_of(whole_model)
        self._laws, self.model, self._links = laws, whole_model, parts
        with gathered_warnings(notes):
            overlapping = overlaps(
                whole_model, MujocoEngine(whole_model, parts, self._keyframe).data, parts
            )
            self.started()  # the engine refuses what it cannot move

        bodies = self._sources.bodies(links, [mass_properties(model, link) for link in links])
        masses = _give_masses(spec, model, links, bodies)
        self.model = _compile(spec, notes)
        self._links = links_of(self.model)
        self._masses = free_masses(self.model, self._links)
        with gathered_warnings(notes):
            start = MujocoEngine(self.model, self._links, self._keyframe)
            start.recorder.place(start.data)
        self.notes = (*notes, *self._sources.notes, *masses, *hulls, *laws.notes, *overlapping)
        scene = Scene(bodies=bodies, gravity=self.model.opt.gravity, notes=self.notes)
        self.scene = scene.posed(start.contacts())

    def started(self) -> MujocoEngine | RapierEngine:
        """Return the engine at the start, to be moved by `advance` step by step.

        Returns
        -------
        MujocoEngine or RapierEngine
            The engine.
        """
        if self._engine == "rapier":
            from struck.scene.engines.rapier import RapierEngine

            return RapierEngine(self.model, self._links, self._laws, self._keyframe)
        return MujocoEngine(self.model, self._links, self._keyframe)

    @checked
    def run(
        self, seconds: float, *, control: Control | None = None, progress: Progress = silent
    ) -> tuple[Scene, Contacts]:
        """Simulate from the start.

        Parameters
        ----------
        seconds : float
            Duration, s.
        control : callable, optional
            Called as ``control(model, data)`` before each step, with MuJoCo's objects; not with
            Rapier.
        progress : callable, optional
            Called as ``progress(stage, fraction)``. Default: silent.

        Returns
        -------
        scene : Scene
            Its bodies as they move.
        contacts : Contacts
            The log; its notes tell what was noticed.

        Raises
        ------
        ArgumentError
            If the control is not callable.
        SimulationError
            If the simulation explodes. It names time and body, and what to change.
        """
        require_seconds(seconds)
        if not (control is None or callable(control)):
            raise ArgumentError(f"control is {control!r}: give a function of (model, data)")
        engine = self.started()
        count = max(1, round(seconds / engine.step))
        for number in range(count):
            if number % _PROGRESS_STEPS == 0:
                progress("moving the bodies", number / count)
            engine.advance(control)
        progress("moving the bodies", 1.0)
        contacts = engine.contacts()
        self.require_no_blast(contacts)
        notes = (*contacts.notes, *self._find_warnings(contacts))
        contacts = replace(contacts, notes=notes)
        return replace(self.scene, notes=(*self.notes, *notes)).posed(contacts), contacts

    def require_no_blast(self, contacts: Contacts) -> None:
        """Raise an error if a body gains far more speed in a log than contacts can give.

        Parameters
        ----------
        contacts : Contacts
            The log.
        """
        require_no_blast(contacts, self._masses)

    def _find_warnings(self, contacts: Contacts) -> list[str]:
        """Return warnings about a finished run."""
        if not len(contacts):
            return ["nothing touches anything, so that there is no sound: let it run longer"]
        if self._engine == "rapier" or self._laws.restitution is not None:
            return []
        return dead(self.model)


def _require_choices(engine: str, convex: str, step: float | None) -> None:
    require_choice("engine", engine, ENGINES)
    require_choice("convex", convex, ("parts", "hull"))
    if step is not None:
        require_number("step", step, 1e-6, 0.1, hint="it must lie from 1e-6 to 0.1 s")


def _name_all(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Give each body and geom a different name."""
    for kind, elements in (("body", spec.bodies), ("geom", spec.geoms)):
        used_names = {element.name for element in elements}
        number = 0
        for element in elements:
            while not element.name:
                name = f"{kind} {number}"
                element.name, number = (name if name not in used_names else ""), number + 1
    return spec


def _compile(spec: mujoco.MjSpec, notes: list[str]) -> mujoco.MjModel:
    """Return MuJoCo's model of a scene; its warnings are added to the notes."""
    try:
        with gathered_warnings(notes):
            model = spec.compile()
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise SimulationError(f"MuJoCo refuses the scene: {reason}") from None
    for name in _PLACES:
        values = getattr(model, name)
        is_beyond = ~(np.abs(values) <= _MAX_PLACE)
        if is_beyond.any():
            raise SimulationError(
                f"the scene's {name} holds {values[is_beyond][0]}: give places and sizes within "
                f"{rounded(_MAX_PLACE)} m, and turns that are numbers"
            )
    return model


# MuJoCo takes any number, also NaN; surfaces cannot be made of them.
_PLACES = ("body_pos", "body_quat", "geom_pos", "geom_quat", "geom_size", "qpos0")
_MAX_PLACE = 1e9  # m


def _give_masses(
    spec: mujoco.MjSpec, model: mujoco.MjModel, links: Sequence[Link], bodies: Mapping[str, Body]
) -> list[str]:
    """Give bodies the mass of their finite elements where the file gives none; return a note."""
    masses: dict[str, float] = {}
    for link in links:
        sound = bodies[link.name].model
        mass = model_mass(sound) if isinstance(sound, ModalModel) else None
        if mass is None or link.fixed or not link.frame_is_body:
            continue
        body = spec.body(model.body(link.frame).name)
        weighing = [spec.geom(model.geom(int(geom)).name) for geom in link.geoms]
        if body.explicitinertial or any(
            np.isfinite(geom.mass) or geom.density not in {0.0, _DENSITY} for geom in weighing
        ):
            continue
        if len({model.geom_bodyid[geom] for geom in link.geoms}) > 1:
            continue
        properties = mass.seen_from(link.placement)
        body.explicitinertial, body.mass, body.ipos = True, properties.mass, properties.centre
        body.fullinertia = properties.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        masses[link.name] = properties.mass
    return _masses_in_words(masses)


def _masses_in_words(masses: Mapping[str, float]) -> list[str]:
    """Return a note of the masses that finite elements have given to bodies."""
    if not masses:
        return []
    names = list_names(list(masses), QUOTED_FORM)
    if len(masses) == 1:
        return [
            f"{names} weighs {rounded(mass, 3)} kg, as its elements do" for mass in masses.values()
        ]
    min_mass, max_mass = (
        f"{rounded(min(masses.values()), 3)}",
        f"{rounded(max(masses.values()), 3)}",
    )
    amount = f"{max_mass} kg each" if min_mass == max_mass else f"{min_mass} to {max_mass} kg"
    return [f"{counted(len(masses), 'body')} weigh {amount}, as their elements do: {names}"]


@checked
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
        Called as ``control(model, data)`` before each step, with MuJoCo's objects; an OptionError
        with Rapier.
    progress : callable or None, optional
        As for `analyze`.
    **options
        Materials, restitution, engine and others, as for `struck.scene.Simulation`.

    Returns
    -------
    scene : Scene
        The bodies with the models of their sounds. Its notes list bodies that are silent, and why.
    contacts : Contacts
        One row for each contact that bears a force, and step.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or names a file outside its folder.
    SimulationError
        If the engine refuses the scene, bodies overlap at the start by more than a tenth of the
        thinner one's width, or the simulation explodes.
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
    simulation = Simulation(file, progress=reported(progress), **options)
    return simulation.run(seconds, control=control, progress=reported(progress))
