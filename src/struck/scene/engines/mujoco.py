"""MuJoCo: contacts and motion of its bodies, noted step by step as `Contacts`.

After `mj_step` MuJoCo's data still hold contacts, forces and velocities as they were when the step
began, so that a row's time is that. Forces come from `mj_contactForce`, which knows both cones and
all dimensions of friction; over one step they are impulses.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError, SimulationError
from struck.model.arrays import Array, Index
from struck.model.provenance import Progress, silent
from struck.scene.body import Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.engines.explosion import dead, free_masses, require_no_blast
from struck.scene.engines.links import Link, links_of, mass_properties, owners
from struck.scene.engines.sound_sources import SoundOptions, SoundSources

if TYPE_CHECKING:
    import mujoco

    from struck.analysis.analysis import Fixed
    from struck.scene.engines.sound_sources import Materials, Sounding

POSES = 240.0  # Hz, at which bodies are placed that touch nothing
_FASTEST = 1000.0  # m/s and rad/s: beyond it a simulation has exploded
_FARTHEST = 1e5  # m
_WARNED = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")

_NO_ROWS = np.zeros((0, 16))
_IMPULSE = slice(13, 16)

Control = Callable[["mujoco.MjModel", "mujoco.MjData"], None]


class MujocoRecorder:
    """A log of contacts and motion of a MuJoCo simulation that you step yourself.

    Parameters
    ----------
    model : mujoco.MjModel

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

        self._mujoco, self._model = mujoco, model
        self.links = tuple(links) or tuple(links_of(model))
        self._owners = owners(model, self.links)
        self._carried = [n for n, link in enumerate(self.links) if link.frame_is_body]
        self._frames = np.array([self.links[n].frame for n in self._carried], np.int64)
        self._alone = [n for n, link in enumerate(self.links) if not link.frame_is_body]
        self._rows: list[Array] = []
        self._poses: list[tuple[float, Array, Array]] = []
        self._still: tuple[Array, Array] | None = None
        self._time = self._last = -np.inf
        self._flexible = 0
        self._warnings = [int(getattr(mujoco.mjtWarning, name)) for name in _WARNED]
        self._force = np.zeros(6)

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is simulated."""
        return self._model

    def step(self, data: mujoco.MjData) -> None:
        """Note what touches and where bodies are; call it after each `mujoco.mj_step`.

        Raises
        ------
        SimulationError
            When the simulation has exploded.
        OptionError
            When time does not go on, as after a reset: use a new recorder.
        """
        time = data.time - self._model.opt.timestep
        self._require_sane(data, time)
        if time <= self._time:
            raise OptionError(
                f"time went from {self._time:.6g} to {time:.6g} s: call step() once after each "
                "mj_step, and begin a new recorder after a reset"
            )
        self._time = time
        if self._still is None:
            self._keep_still(data)
        touched = data.ncon > 0 and self._note_contacts(data, time)
        if touched or time - self._last >= 1 / POSES - 1e-9:
            self._last = time
            frames = self._frames
            self._poses.append((time, data.xpos[frames], data.xquat[frames]))

    def place(self, data: mujoco.MjData) -> None:
        """Note where bodies are before the first step."""
        if self._still is None:
            self._keep_still(data)
        self._last = data.time
        frames = self._frames
        self._poses.append((data.time, data.xpos[frames], data.xquat[frames]))

    def contacts(self) -> Contacts:
        """Return the log so far."""
        if not self._poses:
            raise OptionError("nothing was noted: call step(data) after each mj_step")
        rows = np.concatenate([_NO_ROWS, *self._rows])
        time, step, body0, body1 = rows[:, :4].T
        position, normal, velocity, impulse = np.split(rows[:, 4:], (3, 6, 9), axis=1)
        return Contacts(
            names=[link.name for link in self.links],
            time=time,
            dt=step,
            body0=body0,
            body1=body1,
            position=position,
            normal=normal,
            impulse=impulse,
            velocity=velocity,
            poses=self._placed(),
            notes=self._notes(),
        )

    def scene(
        self,
        *,
        materials: Materials | None = None,
        models: Mapping[str, Sounding] | None = None,
        walls: Mapping[str, float] | None = None,
        fixed: Mapping[str, Fixed] | None = None,
        roughness: Mapping[str, str] | None = None,
        mute: Sequence[str] = (),
        band: tuple[float, float] | None = None,
        accuracy: str = "standard",
        damping: str = "own",
        cache: bool | str | os.PathLike[str] = True,
        progress: Progress = silent,
    ) -> tuple[Scene, Contacts]:
        """Return the scene, whose bodies sound and move, and the log of its contacts so far.

        Parameters
        ----------
        materials, models, walls, fixed, roughness, mute
            As for `struck.simulate`.
        band, accuracy, damping, cache, progress
            As for `struck.analyze`.

        Raises
        ------
        OptionError
            When nothing was noted, or on patterns that fit no body.
        SimulationError
            When the log is that of a simulation that exploded.
        """
        contacts = self.contacts()
        require_no_blast(contacts, self.links, free_masses(self._model, self.links))
        sources = SoundSources(
            SoundOptions(
                materials=materials,
                models=models or {},
                walls=walls or {},
                fixed=fixed or {},
                roughness=roughness or {},
                mute=mute,
                band=band,
                accuracy=accuracy,
                damping=damping,
                cache=cache,
                progress=progress,
            )
        )
        masses = [mass_properties(self._model, link) for link in self.links]
        bodies = sources.bodies(self.links, masses)
        notes = (*sources.notes, *contacts.notes, *dead(self._model))
        scene = Scene(bodies=bodies, gravity=self._model.opt.gravity, notes=notes)
        return scene.posed(contacts), contacts

    def _notes(self) -> tuple[str, ...]:
        if not self._flexible:
            return ()
        return (f"{self._flexible} contacts of flexible bodies were left out: they are not rigid",)

    # One step.

    def _note_contacts(self, data: mujoco.MjData, time: float) -> bool:
        """Keep the rows of one step; return whether there are any."""
        contact, count = data.contact, data.ncon
        forces = np.zeros((count, 6))
        for number in range(count):
            self._mujoco.mj_contactForce(self._model, data, number, self._force)
            forces[number] = self._force
        geoms = np.asarray(contact.geom)
        loaded = forces[:, :3].any(axis=1)
        rigid = (geoms >= 0).all(axis=1)
        self._flexible += int(np.count_nonzero(loaded & ~rigid))
        # What is welded together, or the world with itself, is no pair.
        pair = self._owners[np.maximum(geoms, 0)]
        kept = np.flatnonzero(loaded & rigid & (pair[:, 0] != pair[:, 1]))
        if not len(kept):
            return False
        frames = np.asarray(contact.frame)[kept].reshape(-1, 3, 3)
        step = self._model.opt.timestep
        impulse = np.einsum("kij,ki->kj", frames, forces[kept, :3]) * step
        place = np.asarray(contact.pos)[kept]
        bodies = self._model.geom_bodyid[geoms[kept]]
        velocity = _speed(self._model, data, bodies[:, 1], place) - _speed(
            self._model, data, bodies[:, 0], place
        )
        times = np.full((len(kept), 1), time)
        rows = (times, times * 0 + step, pair[kept], place, frames[:, 0], velocity, impulse)
        self._rows.append(_together(np.hstack(rows)))
        return True

    def _require_sane(self, data: mujoco.MjData, time: float) -> None:
        """Refuse a state that MuJoCo warned of, or faster than anything is."""
        warned = data.warning.number[self._warnings].any()
        fast = float(np.abs(data.qvel).max(initial=0.0))
        far = float(np.abs(data.xpos).max(initial=0.0))
        if not warned and fast < _FASTEST and far < _FARTHEST:
            return
        why = f"a velocity is {fast:.3g}, a position {far:.3g} m"
        raise SimulationError(
            f"the simulation exploded at {time:.4g} s ({why}): take smaller steps, start bodies "
            "apart, or soften contacts and actuators"
        )

    # Poses.

    def _keep_still(self, data: mujoco.MjData) -> None:
        """Keep the places of geoms of the world, which never move."""
        geoms = [self.links[n].frame for n in self._alone]
        quaternions = np.zeros((len(geoms), 4))
        for row, geom in zip(quaternions, geoms, strict=True):
            self._mujoco.mju_mat2Quat(row, data.geom_xmat[geom])
        self._still = data.geom_xpos[geoms], quaternions

    def _placed(self) -> Poses:
        """Return where the coordinates of all shapes are."""
        if self._still is None:
            raise OptionError("nothing was noted: call step(data) after each mj_step")
        times = np.array([time for time, _, _ in self._poses])
        places = np.stack([place for _, place, _ in self._poses])
        turns = np.stack([turn for _, _, turn in self._poses])
        parts = []
        for number, link in enumerate(self.links):
            here = slice(0, 1 if link.fixed else None)  # what stands needs one row
            if link.frame_is_body:
                column = self._carried.index(number)
                course = places[here, column], turns[here, column]
            else:
                row = self._alone.index(number)
                course = self._still[0][row][None], self._still[1][row][None]
            moved = link.placement.carried(*course)
            parts.append((times[here], np.full(len(times[here]), number), *moved))
        time, body, position, rotation = (np.concatenate(each) for each in zip(*parts, strict=True))
        return Poses(time=time, body=body, position=position, rotation=rotation)


class MujocoEngine:
    """A simulation in MuJoCo from its beginning, with its log."""

    def __init__(self, model: mujoco.MjModel, links: Sequence[Link], keyframe: str | None) -> None:
        import mujoco

        self._mujoco, self._model = mujoco, model
        self.data = mujoco.MjData(model)
        if keyframe is not None:
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
            if number < 0:
                known = [model.key(each).name for each in range(model.nkey)]
                raise OptionError(f"keyframe is {keyframe!r}: the file has {known or 'none'}")
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

    def contacts(self) -> Contacts:
        """Return the log so far."""
        return self.recorder.contacts()


def _together(rows: Array) -> Array:
    """Return the rows of a step, those of one pair and place in one: edges meet at such twice."""
    same = (rows[1:, : _IMPULSE.start] == rows[:-1, : _IMPULSE.start]).all(axis=1)
    if not same.any():
        return rows
    first = np.flatnonzero(np.append(True, ~same))
    summed = rows[first]
    summed[:, _IMPULSE] = np.add.reduceat(rows[:, _IMPULSE], first, axis=0)
    return summed


def _speed(model: mujoco.MjModel, data: mujoco.MjData, bodies: Index, places: Array) -> Array:
    """Return the velocities of points of bodies, m/s (K, 3)."""
    # MuJoCo keeps a body's velocity as if it moved with the centre of its tree.
    spatial = data.cvel[bodies]
    arms = places - data.subtree_com[model.body_rootid[bodies]]
    return spatial[:, 3:] + np.cross(spatial[:, :3], arms)
