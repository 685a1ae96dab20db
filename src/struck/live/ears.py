"""A listener's ears while bodies are played: the feeder finds the delays, the callback hears.

What the callback needs lies in arrays that are laid out once; `struck.ears.delay_lines` says what
it does with them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from struck.ears.delay_lines import between
from struck.ears.listeners import Listener
from struck.ears.propagation import STRETCH, Emitter, Pose, Propagation
from struck.errors import ContactError, OptionError
from struck.live.ring import NEW_WAYS, SINCE, Record
from struck.model.arrays import Array
from struck.model.model import ModalModel
from struck.scene.body import Body

FARTHEST = 340.0  # m from a body to a listener while it is played: a second of travel
_GROUP = 8  # taps in a vector


class EarsMemory(ctypes.Structure):
    """What the callback hears with; `callback.h` in the core has the same fields."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("lines", "length", "fine", "paths", "taps")),
        *((name, ctypes.c_int64) for name in ("ears", "block", "stretch", "now")),
        *((name, ctypes.c_void_p) for name in ("line", "between", "before", "after", "history")),
        *((name, ctypes.c_void_p) for name in ("heard", "ways", "line_of", "ear_of")),
    )


class Following:
    """Pose of a listener who moves to where the player says, one stretch of time after another."""

    moves = True

    def __init__(self, pose: Pose) -> None:
        self.ear_points = pose.ear_points
        self.wanted = self._end = self._begin = _at_rest(pose)

    def go_on(self) -> None:
        """Begin the next stretch."""
        self._begin, self._end = self._end, self.wanted

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return places and axes as `Pose.at`, at even shares of the stretch up to its end."""
        shares = np.arange(1, len(times) + 1) / len(times)
        (here, turned), (there, wanted) = self._begin, self._end
        centres = here + shares[:, None] * (there - here)
        turns = Slerp([0, 1], Rotation.from_matrix(np.array([turned, wanted])))(shares).as_matrix()
        ears = centres[:, None] + self.ear_points @ turns
        return np.concatenate([centres[:, None], ears], axis=1), turns


def _at_rest(pose: Pose) -> tuple[Array, Array]:
    if pose.moves:
        raise OptionError(
            "while it is played a listener goes where `player.listener` says: give a position and "
            "a direction that stay"
        )
    places, turned = pose.at(np.zeros(1))
    return places[0, 0].copy(), turned[0].copy()


class LiveEars:
    """The ears of a listener, and the memory of the sound that travels to them."""

    def __init__(
        self, models: Sequence[ModalModel], listener: Listener, *, sample_rate: float, block: int
    ) -> None:
        self._emitters = [_emitter(model) for model in models]
        self._pose = Following(Pose.of(listener, self._emitters))
        self._rate, self._block = sample_rate, block
        self._stretch = block * max(1, round(STRETCH / block))
        self.propagation = Propagation(
            self._emitters,
            self._pose,
            listener.filters(sample_rate, brief=True),
            sample_rate=sample_rate,
            stretch=self._stretch,
        )
        self._since = self._stretch
        self._require_possible(self.position)
        self._lay_out()

    @property
    def position(self) -> Array:
        """Centre of the head, m (3,)."""
        return self._pose.wanted[0]

    @property
    def paths(self) -> int:
        """Number of paths from bodies to ears."""
        return len(self.propagation.paths.lines)

    @property
    def taps(self) -> int:
        """Length of the ears' responses, padded to whole vectors."""
        return -(-self.propagation.paths.after.shape[1] // _GROUP) * _GROUP

    def _lay_out(self) -> None:
        paths, taps, block, found = self.paths, self.taps, self._block, self.propagation
        longest = FARTHEST / 340.0 * self._rate + found.lead + block + 64
        length = 2 << int(np.ceil(np.log2(longest)))
        after = np.zeros((paths, taps), np.float32)
        after[:, : found.paths.after.shape[1]] = found.paths.after
        table = between()
        # Kept, as the callback has but their addresses.
        self._arrays = {
            "line": np.zeros((found.lines, length), np.float32),
            "between": table,
            "before": np.zeros_like(after),
            "after": after,
            "history": np.zeros((paths, taps - 1 + block), np.float32),
            "heard": np.zeros((found.ears, block), np.float32),
            "ways": np.zeros((2, paths, 3)),
            "line_of": np.array(found.paths.lines, np.int64),
            "ear_of": np.array(found.paths.ears, np.int64),
        }
        self.memory = EarsMemory(
            lines=found.lines,
            length=length,
            fine=len(table) - 1,
            paths=paths,
            taps=taps,
            ears=found.ears,
            block=block,
            stretch=self._stretch,
            now=0,
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )

    def listen(self, listener: Listener) -> None:
        """Move the listener, from the next stretch on."""
        pose = Pose.of(listener, self._emitters)
        if pose.ear_points.shape != self._pose.ear_points.shape:
            raise OptionError(
                f"the player has {self.propagation.ears} ears, the new listener "
                f"{len(pose.ear_points)}: start another player for it"
            )
        wanted = _at_rest(pose)
        self._require_possible(wanted[0])
        self._pose.wanted = wanted

    def _require_possible(self, place: Array) -> None:
        for number, emitter in enumerate(self._emitters):
            distance = float(np.linalg.norm(emitter.centre.at(np.zeros(1))[0] - place))
            if emitter.holds(place, 0.0):
                raise ContactError(
                    f"the listener is {distance:.3g} m from the centre of body {number}, inside "
                    "its surface: move it away"
                )
            if distance > FARTHEST:
                raise OptionError(
                    f"the listener is {distance:.4g} m from body {number}: at most {FARTHEST:g} m "
                    "while it is played"
                )

    def write(self, record: Record) -> None:
        """Write delays, gains and responses of the next block into its record."""
        record.stretch[NEW_WAYS] = self._since == self._stretch
        if self._since == self._stretch:
            self._pose.go_on()
            paths, self._since = self.propagation.go_on(), 0
            record.ways[0], record.ways[1] = paths.delays, paths.gains
            record.responses[:, : paths.after.shape[1]] = paths.after
        record.stretch[SINCE] = self._since
        self._since += self._block


def _emitter(model: ModalModel) -> Emitter:
    if model.gains.directional:
        raise OptionError(
            "a body with a timbre field is played for a bare position, or rendered for two ears"
        )
    return Body(model=model).emitter
