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

This is c[k] = z c[k-1] + drive F[k], heard as Im[a c[k]], where `states` are z c[-1]: a division by
the sample rate belongs into the drive. Gains that change linearly, by tau[k] from 0 to 1, need
nothing else: the force splits into (1 - tau) F with the old drive and tau F with the new; `ringing`
and `pushed` are taken for old and new outputs apart and added up with 1 - tau and tau.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.synth import nufft_fit as fit
from struck.synth import nufft_kernels as kernels

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

BLOCKS = (16, 4096)
"""Shortest and longest block."""
HEAVIEST = 16.0
"""Nepers a block that a mode may decay: d B / rate."""
_FEWEST, _SHORTEST, _LEAST = 1024, 64, 400_000
_LONGEST_SUM = 1024  # samples; a longer block's convolution is faster by FFT


def wins(modes: int, block: int) -> bool:
    """Tell whether the transform takes less time than resonators stepped sample by sample.

    Measured on a Zen 4 core at 48 kHz against double-precision kernels of the time domain (30 Hz to
    18 kHz, 0.5 to 200 1/s, one output): times as fast ringing, and with one push,

    ======  ==========  ==========  ==========  ==========  ==========
    modes   B = 64      B = 128     B = 256     B = 512     B = 2048
    ======  ==========  ==========  ==========  ==========  ==========
    512     0.4, 0.3    0.6, 0.5    1.0, 0.8    1.3, 0.9    0.8, 0.5
    1024    0.6, 0.5    1.1, 0.9    1.8, 1.5    2.3, 1.7    1.5, 1.1
    2048    1.0, 0.9    1.8, 1.6    3.0, 2.5    4.0, 3.1    2.9, 2.0
    4096    1.5, 1.3    3.4, 2.6    6.7, 4.2    7.3, 5.2    7.1, 5.1
    ======  ==========  ==========  ==========  ==========  ==========

    then 4.7, 3.5 for 16384 modes at B = 128 and 6, 10 for 65536 at B = 512. Below 64 samples, and
    for few modes, the calls of the FFT take longer than all modes. Those are the loops alone; what
    is around them in Python asks for some more modes: 1.2 times at 4096 and B = 128.

    Parameters
    ----------
    modes : int
        Modes that sound into the same outputs.
    block : int
        Samples.
    """
    return modes >= _FEWEST and block >= _SHORTEST and modes * block >= _LEAST


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
        half the sample rate, or decays too much within a block (see `suits`).
    """

    def __init__(self, poles: Complex, sample_rate: float, block: int) -> None:
        _check_poles(poles, sample_rate, block)
        self.block = block
        self.modes = len(poles)
        self._length = fit.length_of(block)
        turns = poles * (block / sample_rate)
        places = poles.imag * (self._length / (2 * np.pi * sample_rate))
        classes = (-turns.real / fit.SPAN).astype(np.int64)
        bins = np.minimum(places.astype(np.int64), self._length // 2 - 1)
        cells = bins + classes * self._cells
        self.order: Index = np.argsort(cells, kind="stable")
        self._steps: Complex = np.exp(turns[self.order])
        middles = 2j * np.pi * (bins + 0.5) * block / self._length
        self._plan((turns + fit.SPAN * (classes + 0.5) - middles)[self.order], cells[self.order])
        self._make_room(int(classes.max()) + 1)

    @staticmethod
    def suits(poles: Complex, sample_rate: float, block: int) -> Mask:
        """Tell which modes decay by no more than `HEAVIEST` nepers in a block (N,)."""
        return -poles.real * block <= HEAVIEST * sample_rate

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
        _check_shape("states", states, (self.modes,))
        _check_shape("outputs", outputs, (len(into), self.modes))
        _check_shape("into", into, (len(into), self.block))
        spectra, samples = self._rooms(len(into))
        kernels.grids_of(
            *(states, outputs, self._weights, self._runs, self._places),
            *(self._values, self._grid, spectra),
        )
        np.fft.irfft(spectra, self._length, norm="forward", out=samples)
        kernels.close(samples, self._openings, into)

    def advance(self, states: Complex) -> None:
        """Step over a block: c becomes c z^B, in double precision."""
        _check_shape("states", states, (self.modes,))
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
        _check_shape("states", states, (self.modes,))
        _check_shape("drive", drive, (self.modes,))
        self._collect(force)
        kernels.absorb(states, drive, self._sums)

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
            _check_shape(name, array, (self.block,))
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
        self._weights = _aligned(2 * fit.WEIGHTS * padded)
        rows = self._weights.reshape(padded, -1)
        fit.fill(rows[: self.modes], turns, self.block)
        self._bins = np.zeros(padded, dtype=np.int64)
        self._bins[: self.modes] = 2 * cells
        starts = _run_starts(cells)
        self._runs, self._places = np.append(starts, self.modes), 2 * cells[starts]
        self._values, self._sums = _aligned(2 * padded), _aligned(2 * padded)

    def _make_room(self, classes: int) -> None:
        self._openings = fit.openings(self.block, classes)
        # A mode on the last cells reads and writes whole vectors.
        size = 2 * (classes * self._cells + fit.WEIGHTS)
        self._grid = np.zeros((2, size))
        self._straight, self._turned = _aligned(size), _aligned(size)
        self._backwards = np.zeros((classes, self._length))
        self._spectrum = np.zeros((classes, self._length // 2 + 1), dtype=complex)
        self._past = np.zeros(self.block + kernels.FORCES_AT_ONCE)
        self._rooms_by_outputs: dict[int, tuple[Complex, Array]] = {}
        self._rooms(1)

    def _rooms(self, outputs: int) -> tuple[Complex, Array]:
        """Return room for spectra and samples; the first call for so many outputs makes it."""
        if outputs not in self._rooms_by_outputs:
            shape = (outputs, len(self._openings))
            spectra = np.zeros((*shape, self._length // 2 + 1), dtype=complex)
            self._rooms_by_outputs[outputs] = spectra, np.zeros((*shape, self._length))
        return self._rooms_by_outputs[outputs]

    def _collect(self, force: Array) -> None:
        """Leave the sums of `collected` in the room for them."""
        _check_shape("force", force, (self.block,))
        kernels.reverse(force, self._openings, self._backwards)
        np.fft.rfft(self._backwards, out=self._spectrum)
        kernels.unfold(self._spectrum, self._straight, self._turned)
        kernels.gather(self._weights, self._bins, self._straight, self._turned, self._sums)


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


def _check_poles(poles: Complex, sample_rate: float, block: int) -> None:
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
    suited = BlockTransform.suits(poles, sample_rate, block)
    if not suited.all():
        raise OptionError(
            f"mode {np.flatnonzero(~suited)[0]} decays by more than {HEAVIEST:g} nepers in a block"
            f" of {block} samples: take a shorter block, or only the modes that suit"
        )


def _check_shape(name: str, array: Array | Complex, shape: tuple[int, ...]) -> None:
    """Refuse what compiled loops would read beyond its end."""
    if array.shape != shape:
        raise OptionError(f"{name} has shape {array.shape}, not {shape}")
