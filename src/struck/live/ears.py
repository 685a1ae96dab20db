"""A listener's ears while bodies are played: the feeder finds the delays, the callback hears.

What the callback needs lies in three pieces of memory, laid out once; `struck.ears.delay_lines`
says what it does with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from struck.ears.delay_kernels import hear
from struck.ears.delay_lines import between
from struck.ears.listeners import Listener, Trajectory
from struck.ears.propagation import STRETCH, Emitter, Pose, Propagation
from struck.errors import ContactError, OptionError
from struck.live.ring import NEW_WAYS, SINCE, Record, jitted_within
from struck.model.arrays import Array, Index, Single
from struck.model.model import ModalModel
from struck.scene.body import centre_of, emitter_at
from struck.synth.memory import part

FARTHEST = 340.0  # m from a body to a listener while it is played: a second of travel
_GROUP = 8  # taps in a vector
_STANDING = 1 << 32  # times as long, a stretch does not move within a block

# At the front of the whole numbers.
_LINES, _LENGTH, _PATHS, _TAPS, _EARS, _BLOCK, _STRETCH, _NOW, _ROWS, _HEADER = range(10)


class Ears(NamedTuple):
    """The arrays that the callback hears with, all float32 unless stated."""

    lines: Single  # these six as `struck.ears.delay_kernels.hear` takes them
    between: Single
    before: Single
    after: Single
    history: Single
    heard: Single
    ways: Array  # (2, paths, 3): delays and gains of the stretch
    sizes: Index  # numbers at the front of the whole ones
    line_of: Index  # (paths,)
    ear_of: Index  # (paths,)


def _seen(singles: Single, reals: Array, wholes: Index) -> Ears:
    """Return the arrays that lie in the three pieces of memory."""
    lines, length, paths, taps = wholes[_LINES], wholes[_LENGTH], wholes[_PATHS], wholes[_TAPS]
    ears, block, rows = wholes[_EARS], wholes[_BLOCK], wholes[_ROWS]
    a = lines * length
    b = a + rows * 32
    c = b + paths * taps
    d = c + paths * taps
    e = d + paths * (taps - 1 + block)
    return Ears(
        part(singles, 0, (lines, length)),
        part(singles, a, (rows, 32)),
        part(singles, b, (paths, taps)),
        part(singles, c, (paths, taps)),
        part(singles, d, (paths, taps - 1 + block)),
        part(singles, e, (ears, block)),
        part(reals, 0, (2, paths, 3)),
        part(wholes, 0, (_HEADER,)),
        part(wholes, _HEADER, (paths,)),
        part(wholes, _HEADER + paths, (paths,)),
    )


seen = jitted_within(_seen)  # for compiled code


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

    @property
    def memory(self) -> tuple[Single, Array, Index]:
        """Float32, float64 and int64 memory of the callback, which must outlive it."""
        return self._singles, self._reals, self._wholes

    def _lay_out(self) -> None:
        paths, taps, block, found = self.paths, self.taps, self._block, self.propagation
        table, ears, lines = between(), found.ears, found.lines
        longest = FARTHEST / 340.0 * self._rate + found.lead + block + 64
        length = 2 << int(np.ceil(np.log2(longest)))
        sizes = (lines, length, paths, taps, ears, block, self._stretch, 0, len(table))
        self._wholes = np.array([*sizes, *found.paths.lines, *found.paths.ears], np.int64)
        held = paths * (3 * taps - 1 + block)
        self._singles = np.zeros(lines * length + table.size + held + ears * block, np.float32)
        self._reals = np.zeros(6 * paths)
        parts = _seen(self._singles, self._reals, self._wholes)
        parts.between[:] = table
        parts.after[:, : found.paths.after.shape[1]] = found.paths.after

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
            if distance < emitter.radius:
                raise ContactError(
                    f"the listener is {distance:.3g} m from the centre of body {number}, inside "
                    f"its radius of {emitter.radius:.3g} m: move it away"
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
    return emitter_at(model, Trajectory.of("position", centre_of(model)))


@jitted_within
def take(ears: Ears, record: Record) -> None:
    """Take over new delays, gains and responses from a record."""
    if record.stretch[NEW_WAYS]:  # number by number: whole arrays take seconds to compile
        for path in range(ears.after.shape[0]):
            for place in range(3):
                ears.ways[0, path, place] = record.ways[0, path, place]
                ears.ways[1, path, place] = record.ways[1, path, place]
            for tap in range(ears.after.shape[1]):
                ears.before[path, tap] = ears.after[path, tap]
                ears.after[path, tap] = np.float32(record.responses[path, tap])


@jitted_within
def listen(ears: Ears, sounds: Array, since: int, held: int) -> None:
    """Write what bodies sound like (bodies, rows, block) to the lines and hear it.

    Where nothing new is known, `held`, all stays as it was at the end of the block before.
    """
    now, half, stretch = ears.sizes[_NOW], ears.lines.shape[1] // 2, ears.sizes[_STRETCH]
    if held:
        since, stretch = (since + sounds.shape[2]) * _STANDING, stretch * _STANDING
    for line in range(ears.lines.shape[0]):
        for k in range(sounds.shape[2]):
            place = (now + k) % half
            sample = np.float32(sounds[line, 0, k])
            ears.lines[line, place] = ears.lines[line, place + half] = sample
    ears.heard[:] = np.float32(0)
    hear(
        ears.lines,
        now,
        ears.between,
        ears.line_of,
        ears.ear_of,
        ears.ways[0],
        ears.ways[1],
        ears.before,
        ears.after,
        since,
        stretch,
        ears.history,
        ears.heard,
    )
    ears.sizes[_NOW] = now + sounds.shape[2]
