"""The fit of 2007, section 3: exponentials bin by bin, what is heard of them, merged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError
from struck.model.arrays import Array, Complex, Index
from struck.model.exponentials import Exponentials
from struck.recordings.segments import Segment

# Modes that nobody hears: below the threshold in quiet, or drowned by a stronger neighbour.

LOUDEST = 90.0
"""Level given to the strongest amplitude, dB SPL."""
HEARD = 0.2
"""Time over which hearing collects energy, s."""
_DEPTH = 10.0  # of the masked level under the masker, dB
_DOWNWARD, _UPWARD = 27.0, 15.0  # slopes below and above a masker, dB per Bark


def audible(frequencies: Array, decays: Array, amplitudes: Array) -> NDArray[np.bool_]:
    """Tell which modes (M,) are heard beside the others.

    A mode's level is that of its mean power over 200 ms. It is heard where it exceeds the threshold
    in quiet, and the masked level of each stronger one that is heard: 10 dB under that one's level,
    less 27 dB per Bark downwards and 15 dB per Bark upwards.

    Parameters
    ----------
    frequencies, decays, amplitudes : array (M,)
        Hz, 1/s, and any unit: the largest amplitude counts as 90 dB SPL.

    Notes
    -----
    The form is that of mode pruning by masking in additive synthesis (triangular spread over the
    Bark scale); the constants are common ones, since the paper gives none.
    """
    heard = np.zeros(len(frequencies), np.bool_)
    levels = _levels(decays, amplitudes)
    places = bark(frequencies)
    loud = levels > quiet(frequencies)
    for mode in np.argsort(-levels, kind="stable"):
        above = places[mode] - places[heard]
        slopes = np.where(above > 0, _UPWARD * above, -_DOWNWARD * above)
        masked = np.max(levels[heard] - _DEPTH - slopes, initial=-np.inf)
        heard[mode] = loud[mode] and levels[mode] >= masked
    return heard


def bark(frequencies: Array) -> Array:
    """Return critical-band rates, Bark (Zwicker & Terhardt 1980)."""
    return 13 * np.arctan(7.6e-4 * frequencies) + 3.5 * np.arctan((frequencies / 7500) ** 2)


def quiet(frequencies: Array) -> Array:
    """Return the threshold in quiet, dB SPL (Terhardt 1979); below 20 Hz that of 20 Hz."""
    kilo = np.maximum(frequencies, 20.0) / 1000
    return 3.64 * kilo**-0.8 - 6.5 * np.exp(-0.6 * (kilo - 3.3) ** 2) + 1e-3 * kilo**4


def _levels(decays: Array, amplitudes: Array) -> Array:
    """Return levels of the mean power over 200 ms, dB SPL."""
    if not len(amplitudes):
        return np.zeros(0)
    exponents = 2 * np.maximum(decays, 1e-3) * HEARD
    tiny = np.finfo(np.float64).tiny
    powers = np.square(amplitudes) * -np.expm1(-exponents) / exponents
    relative = np.maximum(powers, tiny) / max(float(np.square(amplitudes).max()), tiny)
    return LOUDEST + 10 * np.log10(relative)


# One set of modes for many recordings, as in 2007 (section 3.2): merge what sounds the same.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedModes:
    """Modes of one or several recordings.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing, ascending, Hz.
    decays : array (M,)
        1/s.
    gains : array (recordings, M), complex
        g of Im[g exp((-d + 2 pi i f) t)]; 0 where a recording does not have the mode. The paper's
        own gain is the absolute value: its eq. 1 has no phase.
    """

    frequencies: Array
    decays: Array
    gains: Complex


def inaudible_difference(frequencies: ArrayLike) -> Array:
    """Return how far apart frequencies may be and still sound the same, Hz.

    4 Hz below 2 kHz, (f - 2 kHz) / 250 + 4 Hz above (2007, section 3.2; a fit to Shower & Biddulph
    1931).
    """
    return 4 + np.maximum(np.asarray(frequencies, float) - 2000, 0) / 250


def merged(recordings: Sequence[SharedModes]) -> SharedModes:
    """Give the modes of separate recordings common frequencies and decays.

    From the strongest mode on, each takes from every other recording the nearest one left that
    sounds the same, if there is any. They share their mean frequency and the decay of the
    strongest; modes of one recording are never merged.

    Parameters
    ----------
    recordings : sequence of SharedModes
        Each with any number of rows of gains.

    Returns
    -------
    SharedModes
        With the rows of all recordings, in order.
    """
    rows = np.cumsum([0, *(len(each.gains) for each in recordings)])
    owners = np.repeat(np.arange(len(recordings)), [len(each.decays) for each in recordings])
    frequencies = np.concatenate([each.frequencies for each in recordings])
    decays = np.concatenate([each.decays for each in recordings])
    gains = np.zeros((rows[-1], len(owners)), np.complex128)
    for number, each in enumerate(recordings):
        gains[rows[number] : rows[number + 1], owners == number] = each.gains
    groups = _groups(frequencies, owners, np.abs(gains).max(axis=0, initial=0.0))
    means = np.array([frequencies[group].mean() for group in groups])
    order = np.argsort(means, kind="stable")
    leaders = np.array([groups[place][0] for place in order], np.int64)
    common = [gains[:, groups[place]].sum(axis=1) for place in order]
    return SharedModes(
        frequencies=means[order],
        decays=decays[leaders],
        gains=np.array(common, np.complex128).reshape(len(order), len(gains)).T,
    )


def _groups(frequencies: Array, owners: Index, strengths: Array) -> list[Index]:
    """Return which modes belong together, the strongest of each group first."""
    left = np.ones(len(frequencies), np.bool_)
    groups: list[Index] = []
    for leader in np.argsort(-strengths, kind="stable"):
        if left[leader]:
            group = _group(int(leader), frequencies, owners, left)
            left[group] = False
            groups.append(group)
    return groups


def _group(leader: int, frequencies: Array, owners: Index, left: NDArray[np.bool_]) -> Index:
    """Return the leader and the nearest mode of each other recording that sounds the same."""
    distances = np.abs(frequencies - frequencies[leader])
    close = left & (distances < inaudible_difference(frequencies[leader]))
    others = np.flatnonzero(close & (owners != owners[leader]))
    others = others[np.argsort(distances[others], kind="stable")]
    _, first = np.unique(owners[others], return_index=True)
    return np.concatenate([[leader], others[first]]).astype(np.int64)


# Damped exponentials from a few of their samples (Steiglitz & McBride 1965).

ITERATIONS = 5
"""Rounds of prefiltering; more do not change poles of clean signals."""


def steiglitz_mcbride(signal: Complex, terms: int, iterations: int = ITERATIONS) -> Complex:
    """Return the poles of the rational filter whose impulse response is nearest to a signal.

    Each round filters signal and impulse by the last denominator, after which numerator and
    denominator follow from a linear least-squares problem; Prony's method gives the first one.
    Unstable poles are mirrored into the unit circle between rounds.

    Parameters
    ----------
    signal : array (n,), complex
        n at least twice `terms`.
    terms : int
        Poles; the numerator has as many coefficients.
    iterations : int
        Rounds.

    Returns
    -------
    array (at most terms,), complex
        Poles z of sum c z^n; none where the signal has no such model.

    Notes
    -----
    K. Steiglitz and L. E. McBride, "A technique for the identification of linear systems", IEEE
    Transactions on Automatic Control 10(4), 461-464, 1965.
    """
    from scipy.signal import lfilter

    impulse = np.zeros_like(signal)
    impulse[0] = 1
    denominator = _prony(signal, terms)
    for _ in range(iterations):
        if not np.isfinite(denominator).all():
            return np.zeros(0, np.complex128)
        denominator = _stable(denominator)
        filtered = lfilter([1], denominator, signal)
        answer = lfilter([1], denominator, impulse)
        columns = _delayed(-filtered, range(1, terms + 1)), _delayed(answer, range(terms))
        solution = np.linalg.lstsq(np.hstack(columns), filtered, rcond=None)[0]
        denominator = np.concatenate([[1], solution[:terms]])
    finite = np.isfinite(denominator).all()
    return np.asarray(np.roots(denominator) if finite else [], np.complex128)


def residues(signal: Complex, poles: Complex) -> Complex:
    """Return the factors c of sum c z^n that fit a signal (n,) best, for given poles (P,)."""
    powers = poles ** np.arange(len(signal))[:, None]
    return np.asarray(np.linalg.lstsq(powers, signal, rcond=None)[0], np.complex128)


def _prony(signal: Complex, terms: int) -> Complex:
    """Return 1, a_1 ... of the recursion that predicts a signal best from its last samples."""
    stretches = np.lib.stride_tricks.sliding_window_view(signal, terms + 1)[:, ::-1]
    prediction = np.linalg.lstsq(stretches[:, 1:], stretches[:, 0], rcond=None)[0]
    return np.concatenate([[1], -prediction])


def _stable(denominator: Complex) -> Complex:
    """Return the polynomial with the roots outside of the unit circle mirrored into it."""
    roots = np.roots(denominator)
    outside = np.abs(roots) > 1
    roots[outside] = 1 / roots[outside].conj()
    return np.asarray(np.poly(roots), np.complex128)


def _delayed(signal: Complex, delays: Iterable[int]) -> Complex:
    """Return a signal (n,) delayed by several numbers of samples, one a column."""
    count = len(signal)
    return np.stack([np.pad(signal, (delay, 0))[:count] for delay in delays], axis=1)


# The windowed Fourier transform of 2007 (eq. 3 and 4): each bin as a signal of its own.

WINDOW = 0.046
"""Length of a window, s."""
OVERLAP = 4
"""Windows that cover a sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowedTransform:
    """Blackman-Harris windows that look forward from their start.

    Parameters
    ----------
    length : int
        Samples of a window, a power of 2.
    sample_rate : float
        Hz.
    """

    length: int
    sample_rate: float

    @classmethod
    def at(cls, sample_rate: float) -> WindowedTransform:
        """Take the power of 2 next to 46 ms: 2048 samples at 44.1 kHz."""
        return cls(length=2 ** round(np.log2(WINDOW * sample_rate)), sample_rate=sample_rate)

    @property
    def hop(self) -> int:
        """Samples from a window to the next."""
        return self.length // OVERLAP

    @property
    def bin_width(self) -> float:
        """Spacing of bins, Hz (eq. 5)."""
        return self.sample_rate / self.length

    @property
    def step(self) -> float:
        """Time from a window to the next, s."""
        return self.hop / self.sample_rate

    @cached_property
    def window(self) -> Array:
        """Weights (length,)."""
        from scipy.signal.windows import blackmanharris

        return blackmanharris(self.length, sym=False)

    def of(self, samples: Array) -> Complex:
        """Transform samples (n,), n at least one window: (windows, bins below half the rate).

        The exponent counts time from the first sample on, not from each window's start: only so
        does a mode in bin k turn at its distance from that bin, f - F_k.
        """
        starts = np.lib.stride_tricks.sliding_window_view(samples, self.length)[:: self.hop]
        spectra = np.fft.fft(starts * self.window, axis=1)[:, : self.length // 2]
        turns = np.outer(np.arange(len(starts)) * self.hop, np.arange(self.length // 2))
        return spectra * np.exp(-2j * np.pi * (turns % self.length) / self.length)

    def answers(self, exponents: Complex) -> Complex:
        """Return B of eq. 6, what a window makes of exp(exponent t): (..., ) as the exponents."""
        times = np.arange(self.length) / self.sample_rate
        return np.asarray(np.exp(exponents[..., None] * times) @ self.window, np.complex128)


TERMS = 4
"""Modes looked for in each bin; one term more takes up the rest (the paper: 2 or 4)."""
GATE = 12.0
"""What a bin must rise above the lead-in to be fitted, dB."""
LONGEST = 60.0
"""The longest take, s."""
_FIRST = 4  # windows in which a bin must rise
_SMALLEST = 1e-3  # poles nearer to 0 are gone within a window


def fit_corbett2007(
    takes: Sequence[Array],
    sample_rate: float,
    *,
    lead_ins: Sequence[Array] | None = None,
    terms: int = TERMS,
    gate: float = GATE,
    masking: bool = True,
) -> SharedModes:
    """Fit modes to recordings by the method of 2007.

    Parameters
    ----------
    takes : sequence of array (channels, n)
        Hits, from the impact on. Each channel is a recording of its own, as in the paper.
    sample_rate : float
        Hz.
    lead_ins : sequence of array (channels, n), optional
        The ambient sound before each take, at least a window of 46 ms long. A bin is fitted only
        where its first windows exceed it by `gate`; without it, all bins are fitted.
    terms : int
        Modes looked for in each bin.
    gate : float
        dB.
    masking : bool
        Whether modes that nobody hears are dropped from each recording.

    Returns
    -------
    SharedModes
        A row of complex gains for each channel, take after take.

    Raises
    ------
    OptionError
        On takes that are too short or too long, not finite, or that do not fit their lead-ins.

    Notes
    -----
    R. Corbett, K. van den Doel, J. E. Lloyd and W. Heidrich, "TimbreFields: 3D interactive sound
    models for real-time audio", Presence 16(6), 643-654, 2007. The paper says that a lead-in was
    recorded to tell spurious modes but not how: the gate is the least that does it.
    """
    transform = WindowedTransform.at(sample_rate)
    if terms < 1:
        raise OptionError(f"terms is {terms}: look for at least 1 mode in each bin")
    recordings = _recordings(takes, lead_ins, transform, terms)
    fitted = [
        fit_recording(channel, transform, lead_in=lead_in, terms=terms, gate=gate)
        for channel, lead_in in recordings
    ]
    return merged([_heard(each) for each in fitted] if masking else fitted)


def fit_recording(
    samples: Array,
    transform: WindowedTransform,
    *,
    lead_in: Array | None = None,
    terms: int = TERMS,
    gate: float = GATE,
) -> SharedModes:
    """Fit each bin of one recording (n,) with exponentials, and keep those that lie in the bin.

    Returns
    -------
    SharedModes
        With one row of gains; frequencies ascend bin by bin only.
    """
    spectra = transform.of(samples)
    bins = np.arange(1, spectra.shape[1])  # bin 0 has no modes: a pair of poles is one there
    if lead_in is not None:
        risen = np.abs(spectra[:_FIRST]).max(axis=0)
        ambient = np.sqrt(np.square(np.abs(transform.of(lead_in))).mean(axis=0))
        bins = bins[(risen > ambient * 10 ** (gate / 20))[1:]]
    found = [_modes_in(spectra[:, each], int(each), transform, terms) for each in bins]
    frequencies, decays, gains = np.concatenate([np.zeros((3, 0)), *found], axis=1)
    return SharedModes(
        frequencies=frequencies.real, decays=decays.real, gains=gains[None].astype(np.complex128)
    )


def _modes_in(
    trajectory: Complex, number: int, transform: WindowedTransform, terms: int
) -> Complex:
    """Return frequencies, decays and complex gains (3, modes) of one bin (eq. 6 and 7)."""
    if not trajectory.any():
        return np.zeros((3, 0), np.complex128)
    poles = steiglitz_mcbride(trajectory, terms + 1)
    poles = poles[(np.abs(poles) > _SMALLEST) & (np.abs(poles) < 1)]
    factors = residues(trajectory, poles)
    exponents = np.asarray(np.log(poles) / transform.step, np.complex128)
    offsets = exponents.imag / (2 * np.pi)
    # C / B is half of the mode's exponential: Im[g z^n] = (g z^n - its conjugate) / 2i.
    gains = 2j * factors / transform.answers(exponents)
    mine = np.abs(offsets) <= transform.bin_width / 2
    modes = np.stack([number * transform.bin_width + offsets, -exponents.real, gains])
    return np.asarray(modes[:, mine], np.complex128)


def _heard(modes: SharedModes) -> SharedModes:
    """Keep the modes of one recording that are heard."""
    kept = audible(modes.frequencies, modes.decays, np.abs(modes.gains[0]))
    return SharedModes(
        frequencies=modes.frequencies[kept],
        decays=modes.decays[kept],
        gains=modes.gains[:, kept],
    )


def _recordings(
    takes: Sequence[Array],
    lead_ins: Sequence[Array] | None,
    transform: WindowedTransform,
    terms: int,
) -> list[tuple[Array, Array | None]]:
    """Return each channel with its lead-in, checked."""
    if not takes:
        raise OptionError("there are 0 takes: give at least one")
    if lead_ins is not None and len(lead_ins) != len(takes):
        raise OptionError(f"there are {len(takes)} takes and {len(lead_ins)} lead-ins: give all")
    # Prony's start needs as many equations as unknowns.
    windows = 2 * (terms + 1)
    shortest = transform.length + (windows - 1) * transform.hop
    recordings: list[tuple[Array, Array | None]] = []
    for number, take in enumerate(takes):
        channels = _channels(take, f"take {number}", shortest, transform.sample_rate)
        if lead_ins is None:
            recordings += [(channel, None) for channel in channels]
            continue
        name = f"the lead-in of take {number}"
        before = _channels(lead_ins[number], name, transform.length, transform.sample_rate)
        if len(before) != len(channels):
            raise OptionError(f"{name} has {len(before)} channels, the take {len(channels)}")
        recordings += zip(channels, before, strict=True)
    return recordings


def _channels(samples: Array, name: str, shortest: int, sample_rate: float) -> Array:
    channels = np.atleast_2d(np.asarray(samples, np.float64))
    if channels.ndim != 2 or not np.isfinite(channels).all():
        raise OptionError(f"{name} has shape {channels.shape}: give finite samples (channels, n)")
    count = channels.shape[1]
    if not shortest <= count <= LONGEST * sample_rate:
        raise OptionError(
            f"{name} has {count} samples: give {shortest} to {LONGEST * sample_rate:.0f}, "
            f"{shortest / sample_rate:.2g} to {LONGEST:g} s"
        )
    return channels


# The fit of 2007 for the same segments as the modern one.


def by_corbett2007(segments: Sequence[Segment], budget: int | None) -> Exponentials:
    """Fit each channel of each hit by itself and merge what sounds alike.

    Parameters
    ----------
    segments : sequence of Segment
        The gate is used where all have a lead-in of a window, 46 ms.
    budget : int or None
        Not more modes than these, those of most energy; the paper has no such bound.

    Returns
    -------
    Ringing
        In ascending order of frequency.
    """
    rate = segments[0].sample_rate
    window = WindowedTransform.at(rate).length
    gated = all(each.before.shape[1] >= window for each in segments)
    found = fit_corbett2007(
        [each.samples for each in segments],
        rate,
        lead_ins=[each.before for each in segments] if gated else None,
    )
    poles = -found.decays + 2j * np.pi * found.frequencies
    ringing = Exponentials(poles=poles, gains=found.gains)
    energies = (np.abs(found.gains) ** 2).sum(axis=0) / np.maximum(found.decays, 1e-6)
    return ringing.of(np.sort(np.argsort(-energies, kind="stable")[:budget]))
