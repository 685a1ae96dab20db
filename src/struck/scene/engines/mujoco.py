"""MuJoCo: contacts and motion of its bodies, noted step by step as `Contacts`.

After `mj_step` MuJoCo's data still hold contacts, forces and velocities as they were when the step
began, so that a row's time is that. Forces come from `mj_contactForce`, which knows both cones and
all dimensions of friction; over one step they are impulses.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from struck.errors import ArgumentError, OptionError, counted, require_choice, rounded
from struck.model.arrays import Array, Index
from struck.scene.body import Scene
from struck.scene.contacts import Contacts
from struck.scene.engines.explosion import dead, free_masses, require_no_blast, require_slow
from struck.scene.engines.links import Link, links_of, mass_properties, owners
from struck.scene.engines.sound_sources import SoundOptions, SoundSources
from struck.scene.engines.step_log import StepLog

if TYPE_CHECKING:
    import mujoco

_WARNING_NAMES = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")

Control = Callable[["mujoco.MjModel", "mujoco.MjData"], None]


class MujocoRecorder:
    """A log of contacts and motion of a MuJoCo simulation that you step yourself.

    Parameters
    ----------
    model : mujoco.MjModel
        The model of the engine.
    links : sequence of Link, optional
        Bodies that are logged. Default: all that can touch.

    Examples
    --------
    ::

        log = struck.scene.MujocoRecorder(model)
        while data.time < 5:
            mujoco.mj_step(model, data)
            log.step(data)
        scene, contacts = log.scene(materials={"mug*": "ceramic"})
        struck.render(scene, contacts).save("scene.wav")
    """

    def __init__(self, model: mujoco.MjModel, *, links: Sequence[Link] = ()) -> None:
        import mujoco

        if not isinstance(model, mujoco.MjModel):
            expected_type = "a mujoco.MjModel, as of mujoco.MjModel.from_xml_path(path)"
            raise ArgumentError(f"model is {model!r}: MujocoRecorder takes {expected_type}")
        self._mujoco, self._model = mujoco, model
        self.links = tuple(links) or tuple(links_of(model))
        self._owners = owners(model, self.links)
        self._body_links = [n for n, link in enumerate(self.links) if link.frame_is_body]
        self._frames = np.array([self.links[n].frame for n in self._body_links], np.int64)
        self._log = StepLog(self.links)
        self._fixed_poses: tuple[Array, Array] | None = None
        self._time = -model.opt.timestep  # that of the first step is 0
        self._flexible_count = self._skipped_count = 0
        self._warnings = [int(getattr(mujoco.mjtWarning, name)) for name in _WARNING_NAMES]
        self._force = np.zeros(6)

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is simulated."""
        return self._model

    def step(self, data: mujoco.MjData) -> None:
        """Record contacts and poses; call it after each `mujoco.mj_step`.

        Parameters
        ----------
        data : mujoco.MjData
            State of the engine.

        Raises
        ------
        SimulationError
            If the simulation has exploded.
        OptionError
            If time does not increase, as after a reset: use a new recorder.
        """
        time = data.time - self._model.opt.timestep
        self._require_sane(data, time)
        if time <= self._time:
            raise OptionError(
                f"time went from {self._time:.6g} to {time:.6g} s: call step() once after each "
                "mj_step, and begin a new recorder after a reset"
            )
        if self._time >= 0:
            self._skipped_count += round((time - self._time) / self._model.opt.timestep) - 1
        self._time = time
        has_contacts = data.ncon > 0 and self._note_contacts(data, time)
        if has_contacts or self._log.is_due(time):
            self._place(data, time)

    def place(self, data: mujoco.MjData) -> None:
        """Record the poses of the bodies before the first step.

        Parameters
        ----------
        data : mujoco.MjData
            State of the engine.
        """
        self._place(data, data.time)

    def _place(self, data: mujoco.MjData, time: float) -> None:
        if self._fixed_poses is None:
            self._fixed_poses = self._standing(data)
        positions, rotations = (values.copy() for values in self._fixed_poses)
        positions[self._body_links] = data.xpos[self._frames]
        rotations[self._body_links] = data.xquat[self._frames]
        self._log.pose(time, positions, rotations)

    def contacts(self, *, forget: bool = False) -> Contacts:
        """Return the log.

        Parameters
        ----------
        forget : bool, default False
            Remove the returned rows, so that the next call returns only later ones.

        Returns
        -------
        Contacts
            The log since the start, or since the last call with `forget`.
        """
        return self._log.contacts(self._notes(), forget=forget)

    def scene(self, **sounds: Any) -> tuple[Scene, Contacts]:  # noqa: ANN401 - of `SoundOptions`
        """Return the scene, whose bodies sound and move, and the log of its contacts so far.

        Parameters
        ----------
        **sounds
            materials, models, walls, fixed, roughness and mute as for `struck.simulate`; band,
            accuracy, damping, cache and progress as for `struck.analyze`.

        Returns
        -------
        tuple of Scene, Contacts
            The scene, whose bodies sound and move, and the log.

        Raises
        ------
        OptionError
            When nothing was noted, or on patterns that fit no body.
        SimulationError
            When the log is that of a simulation that exploded.
        """
        contacts = self.contacts()
        require_no_blast(contacts, free_masses(self._model, self.links))
        sources = SoundSources(SoundOptions(**sounds))
        masses = [mass_properties(self._model, link) for link in self.links]
        bodies = sources.bodies(self.links, masses)
        mass_notes = [
            f"{link.name!r} moves as {rounded(mass.mass, 3)} kg, MuJoCo's own, and sounds as "
            f"{rounded(sound_mass, 3)} kg"
            for link, mass in zip(self.links, masses, strict=True)
            if mass and (sound_mass := getattr(bodies[link.name].model, "mass", None))
            if not 0.9 < sound_mass / mass.mass < 1.1
        ]
        notes = (*sources.notes, *mass_notes, *contacts.notes, *dead(self._model))
        scene = Scene(bodies=bodies, gravity=self._model.opt.gravity, notes=notes)
        return scene.posed(contacts), contacts

    def _notes(self) -> tuple[str, ...]:
        notes = []
        if self._skipped_count:
            notes.append(
                f"{counted(self._skipped_count, 'step')} not logged, whose contacts are missing: "
                "call step(data) after each mj_step"
            )
        if self._flexible_count:
            notes.append(f"{counted(self._flexible_count, 'contact')} of flexible bodies left out")
        if self._model.opt.integrator == self._mujoco.mjtIntegrator.mjINT_RK4:
            notes.append(
                "contacts are those of the last of RK4's four stages, so that their impulses may "
                "differ from those of the motion: set integrator to Euler or implicitfast"
            )
        return tuple(notes)

    # One step.

    def _note_contacts(self, data: mujoco.MjData, time: float) -> bool:
        """Append the contacts of one time step to the log; return whether there are any."""
        contact, count = data.contact, data.ncon
        forces = np.zeros((count, 6))
        for number in range(count):
            self._mujoco.mj_contactForce(self._model, data, number, self._force)
            forces[number] = self._force
        geoms = np.asarray(contact.geom)
        is_loaded = forces[:, :3].any(axis=1)
        is_rigid = (geoms >= 0).all(axis=1)
        self._flexible_count += int(np.count_nonzero(is_loaded & ~is_rigid))
        # Geoms that are welded together, or both of the world, are no pair.
        pair = self._owners[np.maximum(geoms, 0)]
        rows = np.flatnonzero(is_loaded & is_rigid & (pair[:, 0] != pair[:, 1]))
        if not len(rows):
            return False
        frames = np.asarray(contact.frame)[rows].reshape(-1, 3, 3)
        step = self._model.opt.timestep
        impulse = np.einsum("kij,ki->kj", frames, forces[rows, :3]) * step
        place = np.asarray(contact.pos)[rows]
        bodies = self._model.geom_bodyid[geoms[rows]]
        velocity = _speed(self._model, data, bodies[:, 1], place) - _speed(
            self._model, data, bodies[:, 0], place
        )
        self._log.touch(time, step, pair[rows], place, frames[:, 0], velocity, impulse)
        return True

    def _require_sane(self, data: mujoco.MjData, time: float) -> None:
        """Refuse a state that MuJoCo warned of, or an impossibly fast one."""
        has_warning = data.warning.number[self._warnings].any()
        require_slow(time, data.qvel, data.xpos, has_warning=bool(has_warning))

    def _standing(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Return positions and rotations of all links, filled in for fixed geoms."""
        positions, rotations = np.zeros((len(self.links), 3)), np.zeros((len(self.links), 4))
        for number, link in enumerate(self.links):
            if not link.frame_is_body:
                positions[number] = data.geom_xpos[link.frame]
                self._mujoco.mju_mat2Quat(rotations[number], data.geom_xmat[link.frame])
        return positions, rotations


class MujocoEngine:
    """A simulation in MuJoCo from its beginning, with its log."""

    def __init__(self, model: mujoco.MjModel, links: Sequence[Link], keyframe: str | None) -> None:
        import mujoco

        self._mujoco, self._model = mujoco, model
        self.data = mujoco.MjData(model)
        if keyframe is not None:
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
            if number < 0 and not model.nkey:
                problem = "the scene has no keyframes: leave keyframe= out"
                raise OptionError(f"keyframe is {keyframe!r}: {problem}")
            if number < 0:
                names = [model.key(key).name for key in range(model.nkey)]
                require_choice("keyframe", keyframe, names, more=", or leave keyframe= out")
            mujoco.mj_resetDataKeyframe(model, self.data, number)
        mujoco.mj_forward(model, self.data)
        self.recorder = MujocoRecorder(model, links=links)

    @property
    def step(self) -> float:
        """Duration of a step, s."""
        return float(self._model.opt.timestep)

    def advance(self, control: Control | None = None) -> None:
        """Take one step and note it."""
        if control is not None:
            control(self._model, self.data)
        self._mujoco.mj_step(self._model, self.data)
        self.recorder.step(self.data)

    @property
    def time(self) -> float:
        """Time of the simulation, s."""
        return float(self.data.time)

    def contacts(self, *, forget: bool = False) -> Contacts:
        """Return the log so far, or since the last call with `forget`."""
        return self.recorder.contacts(forget=forget)


def _speed(model: mujoco.MjModel, data: mujoco.MjData, bodies: Index, points: Array) -> Array:
    """Return the velocities of points of bodies, m/s (K, 3)."""
    # MuJoCo gives a body's velocity at the centre of mass of its tree.
    velocities = data.cvel[bodies]
    arms = points - data.subtree_com[model.body_rootid[bodies]]
    return velocities[:, 3:] + np.cross(velocities[:, :3], arms)
