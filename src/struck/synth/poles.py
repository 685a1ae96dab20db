"""Poles of bodies, and checks of all arguments of resonators before any state changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError, article, rounded
from struck.excitation.excitation import Push
from struck.model.arrays import AnyArray, Array, Complex, numbers, require_number
from struck.model.recoil import Recoil

MIN_RATE, MAX_RATE = 8_000, 192_000  # Hz
MAX_BLOCK = 4096
MAX_FORCE = 1e9  # N, force of a sample


@runtime_checkable
class Ringing(Protocol):
    """The frequencies, decays and recoil of a body that resonators need."""

    @property
    def frequencies(self) -> Array:
        """Ringing frequencies, Hz (M,)."""
        ...

    @property
    def decays(self) -> Array:
        """Decay rates, 1/s (M,)."""
        ...


def with_recoil(
    outputs: Complex, recoil: Recoil | None, distances: Array, sample_rate: float
) -> Complex:
    """Return outputs (K, M) at distances (K,), m, with the outputs of recoil, if any."""
    if recoil is None:
        return outputs
    recoil_outputs = recoil.outputs(sample_rate) / distances[:, None]
    return np.concatenate([outputs, recoil_outputs], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poles:
    """The poles of one body at a sample rate: of its modes, then of its recoil, if any."""

    values: Complex  # (M,), -d + 2 pi i f, 1/s; 0 for modes at or above half the sample rate
    recoils: bool = False  # whether the last three are those of recoil

    @property
    def modes(self) -> int:
        """Number of poles that are of modes, M."""
        return len(self.values) - 3 * self.recoils

    @classmethod
    def of(cls, model: Ringing, sample_rate: float) -> Poles:
        """Return the poles of a model, with its frequencies and decays checked."""
        frequencies, decays = np.asarray(model.frequencies), np.asarray(model.decays)
        recoil: Recoil | None = getattr(model, "recoil", None)
        if not (len(frequencies) or recoil):
            raise OptionError("the model has 0 modes: it needs at least one to sound")
        if len(decays) != len(frequencies):
            raise OptionError(
                f"the model has {len(frequencies)} frequencies and {len(decays)} decays: give as "
                "many of each"
            )
        _require("frequencies", frequencies, above=True)
        _require("decays", decays, above=False)
        is_below_nyquist = frequencies < sample_rate / 2
        values = np.where(is_below_nyquist, -decays + 2j * np.pi * frequencies, 0)
        if recoil is not None:
            values = np.concatenate([values, recoil.poles(sample_rate)])
        return cls(values=values, recoils=recoil is not None)

    def raised(self, rises: Array) -> Complex:
        """Return the poles with the decays of modes raised by `rises`, 1/s (M,)."""
        values = self.values.copy()
        values[: self.modes] -= (values[: self.modes] != 0) * rises
        return values

    @property
    def dropped(self) -> int:
        """Number of modes that were left out."""
        return int(np.count_nonzero(self.values == 0))

    def steady(self, logarithms: Complex, sample_rate: float) -> Complex:
        """Return the states of modes under a constant unit force, 0 for recoil."""
        states = held_states(logarithms, sample_rate)
        states[self.modes :] = 0
        return states

    def require_size(self, values: NDArray[np.generic], what: str) -> None:
        """Check that there is an entry for each mode (..., M), or for each pole."""
        if values.shape[-1] not in {self.modes, len(self.values)}:
            raise OptionError(
                f"{what} has {values.shape[-1]} modes, the body {self.modes}: give one entry for "
                "each"
            )

    def require_same(self, changed_poles: Poles) -> None:
        """Check that a body can continue with other poles: as many modes, and recoil as before."""
        self.require_size(changed_poles.values[: changed_poles.modes], "the changed model")
        if len(changed_poles.values) != len(self.values):
            raise OptionError(
                "of the body and the changed model one has recoil, the other none: analyze both "
                "with recoil=True or False"
            )

    def filled(self, values: AnyArray) -> AnyArray:
        """Return entries for each pole, 0 for recoil where they are of modes alone."""
        missing = len(self.values) - values.shape[-1]
        if not missing:
            return values
        return np.concatenate([values, np.zeros((*values.shape[:-1], missing))], axis=-1)


def held_states(logarithms: Complex, sample_rate: float) -> Complex:
    """Return the states of modes under a constant unit force (M,), by their factors' logarithms."""
    denominators = -np.expm1(logarithms) * sample_rate
    return np.divide(1, denominators, out=np.zeros_like(denominators), where=logarithms != 0)


def _require(name: str, values: Array, *, above: bool) -> None:
    is_invalid = ~(np.isfinite(values) & ((values > 0) if above else (values >= 0)))
    if is_invalid.any():
        value, limit = values[is_invalid][0], "above 0" if above else "at least 0"
        raise OptionError(
            f"{np.count_nonzero(is_invalid)} of {len(values)} {name} are not finite and {limit}, "
            f"the first {value}: mend the model"
        )


def require_session(sample_rate: float, block: int, points: int) -> None:
    """Check sample rate, block and points of a session; OptionError if out of bounds."""
    if not MIN_RATE <= sample_rate <= MAX_RATE:
        raise OptionError(f"sample_rate is {sample_rate}: it must lie from 8000 to 192000 Hz")
    if not 1 <= block <= MAX_BLOCK:
        raise OptionError(f"block is {block}: it must lie from 1 to {MAX_BLOCK} samples")
    hint = "each body needs at least one output"
    require_number("points", points, 1, _MAX_COUNT, whole=True, hint=hint)


_MAX_COUNT = 65_536  # outputs of a body, and pushes in a block

Key = tuple[int, int]  # body and voice


def require_pushes(
    pushes: Sequence[Push],
    poles: Sequence[Poles],
    block: int,
    voices: int,
    last: Mapping[Key, tuple[Array, Array]],
) -> dict[Key, tuple[Array, Array]]:
    """Return force and drive by body and voice; OptionError on bad ones."""
    # A drive that is the very array of the `last` block is not checked again.
    drives: dict[Key, Array] = {}
    new_drives = []
    for push in pushes:
        if not isinstance(push, Push):
            raise OptionError(f"a push is {article(type(push).__name__)}: give a Push")
        key = (push.body, push.voice)
        if not 0 <= push.body < len(poles):
            raise OptionError(f"a push names body {push.body}: there are 0 to {len(poles) - 1}")
        if key in drives:
            raise OptionError(f"body {key[0]} has voice {key[1]} twice: number its pushes apart")
        drive = push.drive
        if key not in last or drive is not last[key][1]:
            drive = _drive(push, poles[push.body])
            new_drives.append(drive)
        drives[key] = drive
    if len(drives) > voices:
        raise OptionError(
            f"there are {len(drives)} pushes in a block, more than {voices}: add up forces on the "
            "same place, or give more voices="
        )
    if (
        new_drives
        and not _add_up(new_drives, np.inf)
        and not all(map(np.all, map(np.isfinite, new_drives)))
    ):
        raise OptionError("a drive is not finite: look at the model's gains")
    forces = _forces(pushes, block)
    return dict(zip(drives, zip(forces, drives.values(), strict=True), strict=True))


def _add_up(arrays: Sequence[Array], limit: float) -> bool:
    """Return whether the sum of all squares lies below a bound, which clears most arguments."""
    values = np.concatenate(arrays)
    return bool(np.vdot(values, values) < limit)


def _forces(pushes: Sequence[Push], block: int) -> list[Array]:
    """Return the forces of pushes, once they are bounded; OptionError on bad ones."""
    forces = [numbers("a force", push.force) for push in pushes]
    for force in forces:
        if force.shape != (block,):
            raise OptionError(f"a force has shape {force.shape}: give {block} samples")
    if forces and not _add_up(forces, MAX_FORCE**2):
        for reach in (float(np.abs(force).max()) for force in forces):
            if not reach <= MAX_FORCE:
                raise OptionError(
                    f"a force reaches {rounded(reach)} N: it must be finite and at most "
                    f"{rounded(MAX_FORCE)} N"
                )
    return forces


def _drive(push: Push, poles: Poles) -> Array:
    """Return the drive of a push, with an entry for each pole."""
    drive = numbers("a drive", push.drive)
    if drive.shape == poles.values.shape:
        return drive
    drive = np.atleast_1d(drive)
    poles.require_size(drive, "a drive")
    return poles.filled(drive)


def require_outputs(
    outputs: Sequence[NDArray[np.generic] | None], poles: Sequence[Poles], points: int
) -> dict[int, Complex]:
    """Return outputs (points, M) by body; OptionError on bad ones."""
    if not len(outputs):
        return {}
    if len(outputs) != len(poles):
        raise OptionError(f"there are outputs for {len(outputs)} of {len(poles)} bodies: give all")
    return {
        body: _output(output, poles[body], points)
        for body, output in enumerate(outputs)
        if output is not None
    }


def _output(output: NDArray[np.generic], poles: Poles, points: int) -> Complex:
    gains = np.atleast_2d(numbers("an output", output, kind=np.complex128))
    if gains.ndim != 2 or len(gains) != points:
        raise OptionError(f"outputs have shape {gains.shape}: give ({points}, modes)")
    poles.require_size(gains, "an output")
    if not np.isfinite(gains).all():
        raise OptionError("an output is not finite: look at the model's gains")
    return poles.filled(gains)


def voices_for(bodies: int, voices: int | None) -> int:
    """Return how many pushes there may be in a block."""
    if voices is not None:
        hint = "there must be room for at least one push"
        require_number("voices", voices, 1, _MAX_COUNT, whole=True, hint=hint)
    return max(16, 4 * bodies) if voices is None else voices
