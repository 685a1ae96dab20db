"""Live sound of contacts, from a running simulation or from a log that arrives in pieces.

Whether a contact is a load or a blow depends on the rows that follow: a long contact is a load, a
short one is a blow. So the log runs ahead of the sound. Each new piece is analyzed together with
the rows before it, by `struck.scene.events` as offline, and events that are long enough before its
end are planned: each blow at its own sample, each part of a sustained contact so that it fades in
while the part before fades out.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from struck.errors import OptionError, SimulationError, StruckError
from struck.excitation.scraping_force import FADE_SECONDS, SlidingContact
from struck.excitation.strike import Strike
from struck.live.commands import Host
from struck.model.arrays import Array
from struck.scene.body import Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.events import Events, Impacts, events_of
from struck.scene.sustained_contact import SustainedContact

if TYPE_CHECKING:
    from struck.scene.engines.mujoco import Control
    from struck.scene.engines.simulation import Simulation

FORESIGHT = 0.06  # s of a log beyond what is planned
HINDSIGHT = 0.08  # s of it before that
_PIECE_SECONDS, _MAX_PIECE_SECONDS = 0.05, 0.2  # s of a simulation that are analyzed together
_FIRST_PIECES, _MAX_BUSY_RATIO = 2, 0.7
_LEAD_SECONDS = 0.04  # s, from planning to sound
_MAX_SHIFT_STEPS = 2.5  # steps by which a blow may shift when more rows are known
_MAX_SHIFT_SECONDS = 5e-3  # s, by which at most
_MIN_SECONDS = 2e-3  # s, of a part of a sustained contact
_NAP_SECONDS = 2e-3  # s
_COLUMNS = ("time", "dt", "body0", "body1", "position", "normal", "impulse", "velocity", "id")
_POSE = ("time", "body", "position", "rotation")


class _Rubbing(NamedTuple):
    """A sustained contact that has not ended."""

    end: float  # s, of what is planned
    surfaces: Sequence[SlidingContact]
    positions: Sequence[Array] | None  # on the roughness of each body at that time, m (3,)
    seed: int


@dataclass(kw_only=True, eq=False)
class ContactStream:
    """Planner of the blows and lasting contacts of a scene, from pieces of its contact log."""

    scene: Scene
    host: Host
    sample_rate: float
    slipped: float = 0.0  # s by which pieces came too late, and the sound had to wait
    missed: int = 0  # rows of times that were planned before
    zero: int | None = None  # sample at which the log's time is 0
    _window: Contacts | None = None
    _planned_end: float = -np.inf  # s: contacts before this moment are planned
    # Times of the last blow of each pair, s.
    _last_blow_times: dict[tuple[int, int], float] = field(default_factory=dict)
    _contact_count: int = 0  # sustained contacts
    _rubbing: dict[tuple[int, int], _Rubbing] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def take(
        self,
        piece: Contacts,
        *,
        until: float | None = None,
        ended: bool = False,
        check: Callable[[Contacts], None] | None = None,
    ) -> None:
        """Plan the next piece of a contact log, complete up to a time, s (its last row by default).

        If it has `ended`, all of it is planned. `check` may refuse the rows known so far; names
        that do not fit raise an OptionError.
        """
        with self._lock:
            poses = np.zeros(0) if piece.poses is None else piece.poses.time
            times = np.concatenate([piece.time, poses])
            if not len(times):
                return
            previous = self._window
            window = (
                piece
                if previous is None
                else _join_logs(previous, piece, self._planned_end - HINDSIGHT)
            )
            events = events_of(self.scene, window)  # refuses what does not fit
            if check is not None:
                check(window)
            self._window = window
            self.missed += int(np.count_nonzero(piece.time < self._planned_end))
            if previous is None:
                self._planned_end = float(times.min())
            end = float(times.max()) if until is None else until
            end = max(end + 1.0 if ended else end - FORESIGHT, self._planned_end)
            self._plan(events, piece, end)
            self._planned_end = end

    def _plan(self, events: Events, piece: Contacts, end: float) -> None:
        """Plan the events from the end of the last piece to an end, s."""
        blows = self._blows(events, end)
        struck_bodies = (
            replace(events, impacts=blows, sustained=()).on().bodies if len(blows) else {}
        )
        plans = [
            self.host.blow(name, action)
            for name, body in struck_bodies.items()
            for action in body.actions
            if isinstance(action, Strike)
        ]
        for contact, seed in self._rubs(events, end):
            for number in (contact.first, contact.second):
                name, first = events.contacts.names[number], number == contact.first
                body = self.scene.bodies[name]
                if not body.silent:
                    rub = contact.on(body.sounding, first=first, seed=seed)
                    plans.append(self.host.rub(name, rub))
        zero = self._schedule()  # now that all is computed
        self.host.follow(_poses_of(piece), zero)
        for plan in plans:
            plan(zero)

    def _schedule(self) -> int:
        """Return the sample at which the log's time is 0, put off where it is too late for that."""
        min_sample = self.host.now + round(_LEAD_SECONDS * self.sample_rate)
        log_start = round(self._planned_end * self.sample_rate)
        if self.zero is None:
            self.zero = min_sample - log_start
        if self.zero + log_start < self.host.now:
            self.slipped += (min_sample - self.zero - log_start) / self.sample_rate
            self.zero = min_sample - log_start
        return self.zero

    def _blows(self, events: Events, end: float) -> Impacts:
        """Return the blows that are new, and before an end, s."""
        impacts, steps = events.impacts, events.contacts.dt
        slack = (
            min(_MAX_SHIFT_STEPS * float(np.median(steps)), _MAX_SHIFT_SECONDS)
            if len(steps)
            else 0.0
        )
        last_blows, new = dict(self._last_blow_times), []
        for k in np.flatnonzero((impacts.time < end) & (impacts.time >= self._planned_end - slack)):
            pair, moment = (int(impacts.first[k]), int(impacts.second[k])), float(impacts.time[k])
            if moment > last_blows.get(pair, -np.inf) + slack:
                self._last_blow_times[pair] = max(moment, self._last_blow_times.get(pair, -np.inf))
                new.append(k)
        return impacts.chosen(np.array(new, np.int64))

    def _rubs(self, events: Events, end: float) -> Iterator[tuple[SustainedContact, int]]:
        """Yield the parts of sustained contacts up to an end, s, with the seed of each."""
        for contact in events.sustained:
            low = max(self._planned_end, float(contact.times[0]))
            high = min(end + FADE_SECONDS, float(contact.times[-1]))
            if high - low < _MIN_SECONDS:
                continue
            pair, part = (contact.first, contact.second), contact.cut(low, high)
            last = self._rubbing.get(pair)
            if last is None or last.end < low:  # it begins
                self._contact_count += 1
                last = _Rubbing(
                    end=low,
                    surfaces=contact.surfaces,
                    positions=part.begins,
                    seed=self._contact_count,
                )
            part = replace(part, surfaces=last.surfaces, begins=last.positions)
            places = [
                [np.interp(end, part.times, axis) for axis in path.T] for path in part.surface_paths
            ]
            self._rubbing[pair] = last._replace(end=end, positions=[np.array(at) for at in places])
            yield part, last.seed


class SimulationRun:
    """A simulation that runs in a thread, a little ahead of the sound of its contacts."""

    def __init__(
        self, simulation: Simulation, stream: ContactStream, control: Control | None
    ) -> None:
        self._simulation, self._stream, self._control = simulation, stream, control
        self.load = 0.0  # fraction of time that the thread computes, 0 to 1
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="struck simulation", daemon=True)
        self.start = self._thread.start
        self._engine = simulation.started()
        for _ in range(_FIRST_PIECES):  # the first takes longest, as nothing is cached
            self._go_on(_PIECE_SECONDS)

    def stop(self) -> None:
        """End the simulation's thread, if it ever began."""
        self._stopping = True
        if self._thread.ident is not None:
            self._thread.join()

    @property
    def running(self) -> bool:
        """Whether the simulation still runs: not once it exploded."""
        return self._thread.is_alive()

    def _run(self) -> None:
        error = self._stream.host.error
        try:
            # As it holds the interpreter's lock at times, whatever stops it stops the feeder too.
            hurry(1)
            self._keep_up()
        except StruckError as failure:
            error.keep(failure)
        except Exception as failure:  # noqa: BLE001 - of `control`; raised in the user's thread
            simulation_error = SimulationError(
                f"the simulation ended: it, or control=, raised {failure!r}"
            )
            simulation_error.__cause__ = failure
            error.keep(simulation_error)

    def _keep_up(self) -> None:
        stream, start_time, start_cpu_time = self._stream, time.perf_counter(), time.thread_time()
        plan_seconds, length = 0.0, _PIECE_SECONDS
        while not self._stopping:
            loop_time = time.perf_counter()
            self.load = (time.thread_time() - start_cpu_time) / max(loop_time - start_time, 1e-9)
            played_time = (stream.host.now - (stream.zero or 0)) / stream.sample_rate
            if self._engine.time > played_time + FORESIGHT + _LEAD_SECONDS + 2 * plan_seconds:
                time.sleep(_NAP_SECONDS)
                continue
            self._go_on(length)
            plan_seconds = max(0.9 * plan_seconds, time.perf_counter() - loop_time)
            if plan_seconds > _MAX_BUSY_RATIO * length:  # longer pieces need less work in all
                length = min(2 * length, _MAX_PIECE_SECONDS)

    def _go_on(self, length: float) -> None:
        """Advance the simulation by some time, s, and plan the sound of its contacts."""
        end = self._engine.time + length
        while self._engine.time < end and not self._stopping:
            self._engine.advance(self._control)
        piece = self._engine.contacts(forget=True)
        check = self._simulation.require_no_blast
        self._stream.take(piece, until=self._engine.time, check=check)


def hurry(priority: int) -> None:
    """Give this thread real-time priority, where the system allows that."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            thread = threading.get_native_id()
            os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))


def _join_logs(old: Contacts, new: Contacts, start_time: float) -> Contacts:
    """Return one log of two pieces: rows of the older one since a time, s, then the newer one."""
    if old.names != new.names:
        raise OptionError(f"names are {new.names}, and were {old.names}: give the same each time")
    is_recent = old.time >= start_time
    column_pairs = {n: (getattr(old, n), getattr(new, n)) for n in _COLUMNS}
    known_pairs = {
        n: pair for n, pair in column_pairs.items() if pair[0] is not None and pair[1] is not None
    }
    columns: dict[str, Any] = {
        n: np.concatenate([a[is_recent], b]) for n, (a, b) in known_pairs.items()
    }
    poses = [log.poses for log in (old, new) if log.poses is not None]
    if len(poses) == 2:
        poses[0] = _select_poses(poses[0], start_time)
    rows: dict[str, Any] = {
        n: np.concatenate([getattr(log, n) for log in poses]) for n in _POSE if poses
    }
    return Contacts(names=new.names, poses=Poses(**rows) if rows else None, **columns)


def _select_poses(poses: Poses, start_time: float) -> Poses:
    """Return poses from a time on, s, and the last one before it of each body."""
    is_selected = ~np.append((np.diff(poses.body) == 0) & (poses.time[1:] <= start_time), False)
    return Poses(**{name: getattr(poses, name)[is_selected] for name in _POSE})


def _poses_of(piece: Contacts) -> Mapping[str, tuple[Array, Array, Array]]:
    """Return the poses of a piece by the names of bodies."""
    if piece.poses is None:
        return {}
    return {name: piece.poses.of(number) for number, name in enumerate(piece.names)}
