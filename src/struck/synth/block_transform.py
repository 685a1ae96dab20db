"""A block of sound in a few operations a mode, by a non-uniform Fourier transform.

Within a block each damped wave is a sum of eight waves on a grid of frequencies, times a window. So
all modes are summed on the grid with eight complex weights each, one inverse FFT makes the samples,
and the states step over the whole block at once. The same weights read the spectrum of a force
back: what it leaves in each state. What a force does within its own block is its convolution with
one impulse response.

Decays within a block tilt the waves; the eight weights follow 1 neper either way. Modes are
therefore kept in classes 2 nepers a block wide, each with a grid of its own and its mean decay put
into the window: at small blocks all modes are in the first.

States are double precision and step exactly, so errors do not grow with time: -132 dB of its own
peak for any one mode. The steps of a block, in this order, all arrays contiguous and in the order
of the transform (``mine[transform.order]``):

    transform.ringing(states, outputs, into)     # states as they are at its first sample,
    transform.pushed(force, answer, into[0])     # answer = transform.answer(outputs[0] * drive)
    transform.advance(states)
    transform.absorb(states, force, drive)       # once for each push

With one push or none `step` does the last two, and the first of the next block, in one pass.

This is c[k] = z c[k-1] + drive F[k], heard as Im[a c[k]], where `states` are z c[-1]: a division by
the sample rate belongs into the drive. Gains that change linearly, by tau[k] from 0 to 1, need
nothing else: the force splits into (1 - tau) F with the old drive and tau F with the new; `ringing`
and `pushed` are taken for old and new outputs apart and added up with 1 - tau and tau.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, Complex, Index, Mask, Single
from struck.synth import transform_kernels as kernels
from struck.synth.memory import aligned
from struck.synth.poles import Poles
from struck.synth.reference import KEPT, Outputs, WholeBlocks

BLOCKS = (16, 4096)  # shortest and longest block
HEAVIEST = 16.0  # nepers a block that a mode may decay: d B / rate
_FEWEST, _SHORTEST, _LEAST = 1024, 64, 400_000


def wins(modes: int, block: int) -> bool:
    """Tell whether the transform is faster than stepping the modes sample by sample."""
    # Zen 4, 48 kHz, one output: times as fast ringing, and under one push, 0.7 and 0.3 for 1024
    # modes in blocks of 64, 1.1 and 0.5 in blocks of 128; for 4096 modes 2.9 and 1.2 in blocks of
    # 128; for 16384 modes 5.2 and 2.3 in blocks of 128, 22.1 and 9.3 in blocks of 2048. For few
    # modes the calls of the FFT take longer than all modes.
    return modes >= _FEWEST and block >= _SHORTEST and modes * block >= _LEAST


def suits(poles: Complex, sample_rate: float, block: int) -> Mask:
    """Tell which modes decay by no more than `HEAVIEST` nepers in a block (N,)."""
    return -poles.real * block <= HEAVIEST * sample_rate


def check_poles(poles: Complex, sample_rate: float, block: int) -> None:
    """Raise an OptionError on poles or a block that the transform cannot take."""
    if not BLOCKS[0] <= block <= BLOCKS[1]:
        raise OptionError(f"block is {block} samples: {BLOCKS[0]} to {BLOCKS[1]} can be used")
    if poles.ndim != 1 or not len(poles):
        raise OptionError(f"poles have shape {poles.shape}, not (N,) with N of at least 1")
    frequencies = poles.imag / (2 * np.pi)
    known = np.isfinite(poles) & (poles.real <= 0.0)
    bad = ~(known & (frequencies >= 0.0) & (frequencies < sample_rate / 2))
    if bad.any():
        raise OptionError(
            f"pole {poles[bad][0]} 1/s of mode {np.flatnonzero(bad)[0]} must be finite, decay, and"
            f" turn at 0 to {sample_rate / 2:g} Hz: leave out modes above half the sample rate"
        )
    suited = suits(poles, sample_rate, block)
    if not suited.all():
        raise OptionError(
            f"mode {np.flatnonzero(~suited)[0]} decays by more than {HEAVIEST:g} nepers in a block"
            f" of {block} samples: take a shorter block, or only the modes that suit"
        )


def check_shape(name: str, array: Array | Complex, shape: tuple[int, ...]) -> None:
    """Raise an OptionError on an array that compiled loops would read beyond its end."""
    if array.shape != shape:
        raise OptionError(f"{name} has shape {array.shape}, not {shape}")


# The weights of the block transform: a damped wave as eight waves on a grid of frequencies.
#
# Over a block the time runs from x = -1 to 1. A mode that turns by the phase Im zeta relative to
# the middle of its eight neighbours, and decays by Re zeta, is fitted by least squares as
#
# window(x) exp(zeta x) ~ sum over j of V_j(zeta) exp(i pi (j - 7/2) x B / M),
#
# so each V_j is a linear functional of exp(zeta x), a power series in zeta with coefficients that
# depend on the block alone: the cost of a mode's weights does not depend on the length of the
# block. Fitted interpolators: Fessler and Sutton, "Nonuniform fast Fourier transforms using min-max
# interpolation", IEEE Trans. Signal Process. 51 (2003), here for complex frequencies.

WEIGHTS = 8  # frequencies of the grid that a mode touches
OVERSAMPLING = 2.25  # length of the transform over that of the block
SPAN = 2.0  # nepers a block within a class of decays: wider classes need more weights
# Of the steepness that suits undamped waves: the worst error at a class's edge is least here.
_SHARPNESS = 0.97
# |zeta| <= 0.86 in every class, so that the first power left out is below 1e-25.
_POWERS = 22
_MODES_AT_ONCE = 4096


def length_of(block: int) -> int:
    """Return the even length M of the transform for a block."""
    return 2 * math.ceil(OVERSAMPLING * block / 2)


def window(block: int) -> Array:
    """Return the window (B + 1,), largest in the middle: the transform of a Kaiser-Bessel bell."""
    steepness = _SHARPNESS * np.pi * WEIGHTS * (1 - 1 / (2 * OVERSAMPLING))
    phase = np.pi * WEIGHTS * np.linspace(-0.5, 0.5, block + 1) * block / length_of(block)
    root = np.sqrt(steepness**2 - phase**2)
    bell = np.sinh(root) / root
    return bell / bell.max()


def openings(block: int, classes: int) -> Array:
    """Return what undoes the window and restores the mean decay of each class (C, B + 1)."""
    decays = SPAN * (np.arange(classes) + 0.5)
    return np.exp(-np.outer(decays, np.arange(block + 1) / block)) / window(block)


def fill(rows: Single, turns: Complex, block: int) -> None:
    """Write weights (N, 16), real and imaginary parts alternating, from 2 zeta (N,)."""
    series = _series(block)
    for first in range(0, len(turns), _MODES_AT_ONCE):
        some = turns[first : first + _MODES_AT_ONCE] / 2
        weights = np.zeros((len(some), WEIGHTS), dtype=np.complex128)
        for coefficients in series:
            weights *= some[:, None]
            weights += coefficients
        weights *= np.exp(some)[:, None]
        rows[first : first + len(some), 0::2] = weights.real
        rows[first : first + len(some), 1::2] = weights.imag


def _series(block: int) -> Complex:
    """Return the coefficients of the powers of zeta, highest first (P, 8)."""
    middles = np.arange(WEIGHTS) - (WEIGHTS - 1) / 2
    turn = np.pi * block / length_of(block)
    times = np.linspace(-1.0, 1.0, block + 1)
    waves = np.exp(1j * turn * np.outer(times, middles)) / window(block)[:, None]
    exponents = np.arange(_POWERS)
    factorials = np.array([float(math.factorial(m)) for m in exponents])
    powers = times[:, None] ** exponents / factorials
    fitted = np.linalg.pinv(waves, rcond=1e-15) @ powers
    # From the middle of the block, where the fit counts time, to its start.
    return np.asarray(fitted * np.exp(-1j * turn * middles)[:, None], dtype=np.complex128).T[::-1]


_LONGEST_SUM = 1024  # samples; a longer block's convolution is faster by FFT


class BlockTransform:
    """The plan of a block: weights, grid places and steps of all modes, and work space."""

    def __init__(self, poles: Complex, sample_rate: float, block: int) -> None:
        check_poles(poles, sample_rate, block)
        self.block = block
        self.modes = len(poles)
        self._length = length_of(block)
        turns = poles * (block / sample_rate)
        places = poles.imag * (self._length / (2 * np.pi * sample_rate))
        classes = (-turns.real / SPAN).astype(np.int64)
        bins = np.minimum(places.astype(np.int64), self._length // 2 - 1)
        cells = bins + classes * self._cells
        self.order: Index = np.argsort(cells, kind="stable")
        self._steps: Complex = np.exp(turns[self.order])
        middles = 2j * np.pi * (bins + 0.5) * block / self._length
        self._plan((turns + SPAN * (classes + 0.5) - middles)[self.order], cells[self.order])
        self._make_room(int(classes.max()) + 1)

    def ringing(self, states: Complex, outputs: Array | Complex, into: Array) -> None:
        """Add the modes' free sound, Im[sum over n of a_n c_n z_n^k], to `into` (L, B)."""
        check_shape("states", states, (self.modes,))
        check_shape("outputs", outputs, (len(into), self.modes))
        check_shape("into", into, (len(into), self.block))
        grids = self._rooms(len(into))[0]
        grids[:] = 0.0
        kernels.sum_up(
            states, outputs, self._weights, self._runs, self._places, self._values, grids
        )
        self.summed(into)

    def summed(self, into: Array) -> None:
        """Add the sound of what `ringing` or `step` last summed on the grid, for each output."""
        grids, spectra, samples = self._rooms(len(into))
        for grid, spectrum in zip(grids, spectra, strict=True):
            kernels.fold(grid[0], grid[1], spectrum)
        np.fft.irfft(spectra, self._length, norm="forward", out=samples)
        kernels.close(samples, self._openings, into)

    def advance(self, states: Complex) -> None:
        """Step over a block: c becomes c z^B, in double precision."""
        check_shape("states", states, (self.modes,))
        kernels.advance(states, self._steps)

    def absorb(self, states: Complex, force: Array, drive: Array | Complex) -> None:
        """Add drive times `collected`, what a force leaves, to states already advanced."""
        check_shape("states", states, (self.modes,))
        check_shape("drive", drive, (self.modes,))
        self._collect(force)
        kernels.absorb(states, drive, self._sums)

    def step(
        self,
        states: Complex,
        push: tuple[Array, Array | Complex] | None,
        outputs: Array | Complex,
    ) -> None:
        """Do `advance`, `absorb` and the next block's `ringing`, up to `summed`, in one pass."""
        force, drive = push or (None, np.zeros(0))
        check_shape("states", states, (self.modes,))
        check_shape("outputs", outputs, (len(outputs), self.modes))
        if force is not None:
            check_shape("drive", drive, (self.modes,))
            self._transform_backwards(force)
        kernels.step(
            *(states, self._steps, drive, outputs, self._weights, self._bins),
            *(self._runs, self._places, self._grids, self._sums, self._values),
            self._rooms(len(outputs))[0],
        )

    def collected(self, force: Array) -> Complex:
        """Return sum over k of F[k] z^(B - k) for each mode (N,): a new array."""
        self._collect(force)
        return self._sums[: 2 * self.modes].astype(np.float64).view(np.complex128)

    def answer(self, weights: Complex) -> Array:
        """Return the impulse response within a block, Im[sum over n of w_n z_n^k] (B,)."""
        into = np.zeros((1, self.block))
        self.ringing(weights, np.ones((1, self.modes)), into)
        return into[0]

    def pushed(self, force: Array, answer: Array, into: Array) -> None:
        """Add the convolution of a force with the impulse response `answer` to `into` (B,)."""
        for name, array in (("force", force), ("answer", answer), ("into", into)):
            check_shape(name, array, (self.block,))
        if self.block <= _LONGEST_SUM:
            kernels.convolve(force, answer, self._past, into)
        else:
            spectrum = np.fft.rfft(force, 2 * self.block) * np.fft.rfft(answer, 2 * self.block)
            into += np.fft.irfft(spectrum, 2 * self.block)[: self.block]

    @property
    def _cells(self) -> int:
        """Frequencies of a class: 0 to M/2, and three more on either side."""
        return self._length // 2 + 1 + 2 * kernels.REACH

    def _plan(self, turns: Complex, cells: Index) -> None:
        padded = -(-self.modes // kernels.MODES_AT_ONCE) * kernels.MODES_AT_ONCE
        self._weights = aligned(2 * WEIGHTS * padded, np.float32)
        rows = self._weights.reshape(padded, -1)
        fill(rows[: self.modes], turns, self.block)
        self._bins = np.zeros(padded, dtype=np.int32)
        self._bins[: self.modes] = 2 * cells
        starts = _run_starts(cells)
        self._runs, self._places = np.append(starts, self.modes), 2 * cells[starts]
        self._values, self._sums = (aligned(2 * padded, np.float32) for _ in range(2))

    def _make_room(self, classes: int) -> None:
        self._openings = openings(self.block, classes)
        # A mode on the last cells reads and writes whole vectors.
        size = 2 * (classes * self._cells + WEIGHTS)
        self._size = size
        self._grids = aligned(size, np.float32), aligned(size, np.float32)
        self._backwards = np.zeros((classes, self._length))
        self._spectrum = np.zeros((classes, self._length // 2 + 1), dtype=complex)
        self._past = np.zeros(self.block + kernels.FORCES_AT_ONCE)
        self._rooms_by_outputs: dict[int, tuple[Array, Complex, Array]] = {}
        self._rooms(1)

    def _rooms(self, outputs: int) -> tuple[Array, Complex, Array]:
        """Return grids, spectra and samples to work in, made once for a number of outputs."""
        if outputs not in self._rooms_by_outputs:
            shape = (outputs, len(self._openings))
            self._rooms_by_outputs[outputs] = (
                np.zeros((outputs, 2, self._size)),
                np.zeros((*shape, self._length // 2 + 1), dtype=complex),
                np.zeros((*shape, self._length)),
            )
        return self._rooms_by_outputs[outputs]

    def _collect(self, force: Array) -> None:
        """Leave the sums of `collected` in `_sums`."""
        self._transform_backwards(force)
        kernels.gather(self._weights, self._bins, *self._grids, self._sums)

    def _transform_backwards(self, force: Array) -> None:
        """Leave the spectrum of a force on the grid."""
        check_shape("force", force, (self.block,))
        kernels.reverse(force, self._openings, self._backwards)
        np.fft.rfft(self._backwards, out=self._spectrum)
        kernels.unfold(self._spectrum, *self._grids)


def _run_starts(cells: Index) -> Index:
    """Return where runs of modes of one cell begin, none longer than sums may be."""
    places = np.arange(len(cells))
    fresh = np.append(True, cells[1:] != cells[:-1])
    since = places - np.maximum.accumulate(np.where(fresh, places, 0))
    return np.flatnonzero(since % kernels.LONGEST_RUN == 0)


def fits_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether the transform can make a body's blocks: none of its modes dies within one."""
    suited = suits(poles.values, sample_rate, block)
    return BLOCKS[0] <= block <= BLOCKS[1] and bool(suited.all())


def gains_by_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether it can, and faster than sample by sample."""
    return wins(len(poles.values), block) and fits_transform(poles, sample_rate, block)


class Transformed(WholeBlocks):
    """The modes of one body by one `BlockTransform`."""

    def planned(self, poles: Complex) -> Index:
        """Plan the transform."""
        self._transform = BlockTransform(poles, self.rate, self.size)
        # The outputs for which the next block's ringing is summed up already.
        self._summed: Outputs | None = None
        # Impulse responses, as `_levels`.
        self._answers: dict[tuple[int, int], tuple[Outputs, Array, Array]] = {}
        return self._transform.order

    def rung(self, outputs: Outputs) -> Array:
        """Return the sound of the states alone in the next block."""
        into = np.zeros((len(outputs), self.size))
        if outputs is self._summed:
            self._transform.summed(into)
        else:
            self._transform.ringing(self.ahead, outputs, into)
        self._summed = None
        return into

    def wake(self) -> None:
        """Advance states that slept to the present."""
        if self.asleep:
            self._summed = None
        super().wake()

    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return the sound of a force within its own block."""
        into = np.zeros((len(outputs), self.size))
        for answer, samples in zip(self._answer(outputs, drive), into, strict=True):
            self._transform.pushed(force, answer, samples)
        return into

    def _answer(self, outputs: Outputs, drive: Array) -> Array:
        """Return impulse responses within a block, cached for the last gains."""
        pair = id(outputs), id(drive)
        if pair not in self._answers:
            while len(self._answers) >= KEPT:
                self._answers.pop(next(iter(self._answers)))
            weights = outputs * (drive / self.rate)
            answers = np.array([self._transform.answer(each) for each in weights])
            self._answers[pair] = outputs, drive, answers
        return self._answers[pair][2]

    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Advance the states by a block."""
        scaled = [(force / self.rate, drive) for force, drive in pushes]
        if len(scaled) <= 1:
            self._transform.step(self.ahead, next(iter(scaled), None), self.outputs)
            self._summed = self.outputs
            return
        self._transform.advance(self.ahead)
        for force, drive in scaled:
            self._transform.absorb(self.ahead, force, drive)
