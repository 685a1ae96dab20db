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
from struck.synth import transform_kernels as sampled
from struck.synth.poles import Poles
from struck.synth.reference import KEPT, Outputs, WholeBlocks

# Which blocks and modes the block transform is for, and what it refuses.

BLOCKS = (16, 4096)
"""Shortest and longest block."""
HEAVIEST = 16.0
"""Nepers a block that a mode may decay: d B / rate."""
_FEWEST, _SHORTEST, _LEAST = 1024, 64, 400_000


def wins(modes: int, block: int) -> bool:
    """Tell whether the transform takes less time than resonators stepped sample by sample.

    Measured on a Zen 4 core at 48 kHz (30 Hz to 18 kHz, 0.5 to 200 1/s, one output), Python and
    all: times as fast ringing, and under one push,

    ======  ==========  ==========  ==========  ==========  ==========
    modes   B = 64      B = 128     B = 256     B = 512     B = 2048
    ======  ==========  ==========  ==========  ==========  ==========
    512     0.5, 0.3    0.6, 0.3    1.0, 0.5    1.2, 0.6    1.0, 0.4
    1024    0.7, 0.3    1.1, 0.5    1.6, 0.8    2.2, 1.0    1.9, 0.8
    2048    1.1, 0.4    1.3, 0.7    1.8, 1.4    3.9, 1.7    4.1, 1.5
    4096    1.7, 0.7    2.9, 1.2    4.6, 2.1    6.6, 2.9    6.7, 2.8
    16384   3.2, 1.2    5.2, 2.3    8.8, 4.2    15.8, 7.0   22.1, 9.3
    ======  ==========  ==========  ==========  ==========  ==========

    For few modes the calls of the FFT take longer than all modes.

    Parameters
    ----------
    modes : int
        Modes that sound into the same outputs.
    block : int
        Samples.
    """
    return modes >= _FEWEST and block >= _SHORTEST and modes * block >= _LEAST


def suits(poles: Complex, sample_rate: float, block: int) -> Mask:
    """Tell which modes decay by no more than `HEAVIEST` nepers in a block (N,)."""
    return -poles.real * block <= HEAVIEST * sample_rate


def check_poles(poles: Complex, sample_rate: float, block: int) -> None:
    """Refuse what cannot be planned with an OptionError."""
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
    """Refuse what compiled loops would read beyond its end."""
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

WEIGHTS = 8
"""Frequencies of the grid that a mode touches."""
OVERSAMPLING = 2.25
"""Length of the transform over that of the block."""
SPAN = 2.0
"""Nepers a block within a class of decays: wider classes need more weights."""
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
    """Write the weights of modes, real and imaginary parts alternating.

    Parameters
    ----------
    rows : array (N, 16)
        The result, for times counted from the start of the block.
    turns : array (N,)
        2 zeta: decay and phase over the block relative to the mean decay of the class and to the
        middle of the eight frequencies.
    block : int
    """
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
    """The plan of a block: weights, places on the grid and steps of all modes, and room to work in.

    It allocates nothing afterwards but what NumPy's FFT does, keeps no state that sounds, and
    serves one thread at a time.

    Parameters
    ----------
    poles : array (N,), complex
        -d + 2 pi i f, 1/s.
    sample_rate : float
        Hz.
    block : int
        Samples B, 16 to 4096.

    Attributes
    ----------
    order : array (N,)
        The caller's index of each mode of the transform: modes are sorted by frequency in classes
        of decay.
    block, modes : int

    Raises
    ------
    OptionError
        On no modes, a block out of range, or a pole that is not finite, grows, lies outside 0 to
        half the sample rate, or decays too much within a block (`nufft_bounds.suits`).
    """

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
        """Add what the modes sound like by themselves: Im[sum over n of a_n c_n z_n^k].

        Parameters
        ----------
        states : array (N,), complex
            c, at the first sample of the block.
        outputs : array (L, N), real or complex
            a, the gains of each output.
        into : array (L, B)
            Added to, k = 0 to B - 1.
        """
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
        """Add what was summed up on the grid last, by `ringing` or by `step`, for each output."""
        grids, spectra, samples = self._rooms(len(into))
        for grid, spectrum in zip(grids, spectra, strict=True):
            sampled.fold(grid[0], grid[1], spectrum)
        np.fft.irfft(spectra, self._length, norm="forward", out=samples)
        sampled.close(samples, self._openings, into)

    def advance(self, states: Complex) -> None:
        """Step over a block: c becomes c z^B, in double precision."""
        check_shape("states", states, (self.modes,))
        kernels.advance(states, self._steps)

    def absorb(self, states: Complex, force: Array, drive: Array | Complex) -> None:
        """Add what a force of this block leaves in the states of the next: drive times `collected`.

        Parameters
        ----------
        states : array (N,), complex
            Already advanced.
        force : array (B,)
        drive : array (N,), real or complex
        """
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
        """Do `advance`, `absorb` of a force and drive, and `ringing` of the next block at once.

        What it sounds like is for `summed`, before the next `ringing` or `step`.
        """
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
        """Add the answer to a force within its own block: sum over j <= k of F[j] h[k - j].

        Parameters
        ----------
        force, answer : array (B,)
        into : array (B,)
            Added to.
        """
        for name, array in (("force", force), ("answer", answer), ("into", into)):
            check_shape(name, array, (self.block,))
        if self.block <= _LONGEST_SUM:
            sampled.convolve(force, answer, self._past, into)
        else:
            spectrum = np.fft.rfft(force, 2 * self.block) * np.fft.rfft(answer, 2 * self.block)
            into += np.fft.irfft(spectrum, 2 * self.block)[: self.block]

    @property
    def _cells(self) -> int:
        """Frequencies of a class: 0 to M/2, and three more on either side."""
        return self._length // 2 + 1 + 2 * sampled.REACH

    def _plan(self, turns: Complex, cells: Index) -> None:
        padded = -(-self.modes // kernels.MODES_AT_ONCE) * kernels.MODES_AT_ONCE
        self._weights = _aligned(2 * WEIGHTS * padded)
        rows = self._weights.reshape(padded, -1)
        fill(rows[: self.modes], turns, self.block)
        self._bins = np.zeros(padded, dtype=np.int32)
        self._bins[: self.modes] = 2 * cells
        starts = _run_starts(cells)
        self._runs, self._places = np.append(starts, self.modes), 2 * cells[starts]
        self._values, self._sums = _aligned(2 * padded), _aligned(2 * padded)

    def _make_room(self, classes: int) -> None:
        self._openings = openings(self.block, classes)
        # A mode on the last cells reads and writes whole vectors.
        size = 2 * (classes * self._cells + WEIGHTS)
        self._size = size
        self._grids = _aligned(size), _aligned(size)
        self._backwards = np.zeros((classes, self._length))
        self._spectrum = np.zeros((classes, self._length // 2 + 1), dtype=complex)
        self._past = np.zeros(self.block + sampled.FORCES_AT_ONCE)
        self._rooms_by_outputs: dict[int, tuple[Array, Complex, Array]] = {}
        self._rooms(1)

    def _rooms(self, outputs: int) -> tuple[Array, Complex, Array]:
        """Return room for grids, spectra and samples; the first call for so many makes it."""
        if outputs not in self._rooms_by_outputs:
            shape = (outputs, len(self._openings))
            self._rooms_by_outputs[outputs] = (
                np.zeros((outputs, 2, self._size)),
                np.zeros((*shape, self._length // 2 + 1), dtype=complex),
                np.zeros((*shape, self._length)),
            )
        return self._rooms_by_outputs[outputs]

    def _collect(self, force: Array) -> None:
        """Leave the sums of `collected` in the room for them."""
        self._transform_backwards(force)
        kernels.gather(self._weights, self._bins, *self._grids, self._sums)

    def _transform_backwards(self, force: Array) -> None:
        """Leave the spectrum of a force on the grid."""
        check_shape("force", force, (self.block,))
        sampled.reverse(force, self._openings, self._backwards)
        np.fft.rfft(self._backwards, out=self._spectrum)
        sampled.unfold(self._spectrum, *self._grids)


def _run_starts(cells: Index) -> Index:
    """Return where runs of modes of one cell begin, none longer than sums may be."""
    places = np.arange(len(cells))
    fresh = np.append(True, cells[1:] != cells[:-1])
    since = places - np.maximum.accumulate(np.where(fresh, places, 0))
    return np.flatnonzero(since % kernels.LONGEST_RUN == 0)


def _aligned(count: int) -> Single:
    """Return zeros that begin on a cache line."""
    room = np.zeros(count + 16, dtype=np.float32)
    skipped = -(room.ctypes.data // 4) % 16
    return room[skipped : skipped + count]


# A body of thousands of modes, by the block transform.


def fits_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether the transform can make a body's blocks: none of its modes dies within one."""
    suited = suits(poles.values, sample_rate, block)
    return BLOCKS[0] <= block <= BLOCKS[1] and bool(suited.all())


def gains_by_transform(poles: Poles, sample_rate: float, block: int) -> bool:
    """Tell whether it can, and faster than sample by sample."""
    return wins(len(poles.values), block) and fits_transform(poles, sample_rate, block)


class Transformed(WholeBlocks):
    """One body, by one `BlockTransform`."""

    def planned(self, poles: Complex) -> Index:
        """Plan the transform."""
        self._transform = BlockTransform(poles, self.rate, self.size)
        # The outputs for which the next block's ringing is summed up already.
        self._summed: Outputs | None = None
        # Impulse responses, as `_levels`.
        self._answers: dict[tuple[int, int], tuple[Outputs, Array, Array]] = {}
        return self._transform.order

    def rung(self, outputs: Outputs) -> Array:
        """Return what the states sound like by themselves in the next block (points, block)."""
        into = np.zeros((len(outputs), self.size))
        if outputs is self._summed:
            self._transform.summed(into)
        else:
            self._transform.ringing(self.ahead, outputs, into)
        self._summed = None
        return into

    def wake(self) -> None:
        """Bring the states to where they would be by now."""
        if self.asleep:
            self._summed = None
        super().wake()

    def answered(self, outputs: Outputs, force: Array, drive: Array) -> Array:
        """Return what a force sounds like in its own block (points, block)."""
        into = np.zeros((len(outputs), self.size))
        for answer, samples in zip(self._answer(outputs, drive), into, strict=True):
            self._transform.pushed(force, answer, samples)
        return into

    def _answer(self, outputs: Outputs, drive: Array) -> Array:
        """Return impulse responses within a block; those of the last gains are kept."""
        pair = id(outputs), id(drive)
        if pair not in self._answers:
            while len(self._answers) >= KEPT:
                self._answers.pop(next(iter(self._answers)))
            weights = outputs * (drive / self.rate)
            answers = np.array([self._transform.answer(each) for each in weights])
            self._answers[pair] = outputs, drive, answers
        return self._answers[pair][2]

    def advance(self, pushes: Sequence[tuple[Array, Array]]) -> None:
        """Move the states on by a block under forces with constant drives."""
        scaled = [(force / self.rate, drive) for force, drive in pushes]
        if len(scaled) <= 1:
            self._transform.step(self.ahead, next(iter(scaled), None), self.outputs)
            self._summed = self.outputs
            return
        self._transform.advance(self.ahead)
        for force, drive in scaled:
            self._transform.absorb(self.ahead, force, drive)
