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

import numpy as np
from numpy.typing import NDArray

from struck.synth import nufft_fit as fit
from struck.synth import nufft_samples as sampled
from struck.synth import transform_kernels as kernels
from struck.synth.nufft_bounds import check_poles, check_shape

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

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
        self._weights = _aligned(2 * fit.WEIGHTS * padded)
        rows = self._weights.reshape(padded, -1)
        fit.fill(rows[: self.modes], turns, self.block)
        self._bins = np.zeros(padded, dtype=np.int32)
        self._bins[: self.modes] = 2 * cells
        starts = _run_starts(cells)
        self._runs, self._places = np.append(starts, self.modes), 2 * cells[starts]
        self._values, self._sums = _aligned(2 * padded), _aligned(2 * padded)

    def _make_room(self, classes: int) -> None:
        self._openings = fit.openings(self.block, classes)
        # A mode on the last cells reads and writes whole vectors.
        size = 2 * (classes * self._cells + fit.WEIGHTS)
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
