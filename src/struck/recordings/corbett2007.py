"""The fit of 2007 (section 3): exponentials in each bin, without inaudible ones, merged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Complex, Index
from struck.model.exponentials import Exponentials
from struck.perception.auditory_scale import bark, threshold_in_quiet
from struck.recordings.noise import blackman_harris
from struck.recordings.segments import Segment

MAX_LEVEL = 90.0  # level of the strongest amplitude, dB SPL
INTEGRATION_TIME = 0.2  # time over which hearing collects energy, s
_MIN_FREQUENCY = 20.0  # threshold in quiet of lower ones, Hz
_DEPTH = 10.0  # of the masked level under the masker, dB
_LOWER_SLOPE, _UPPER_SLOPE = 27.0, 15.0  # slopes below and above a masker, dB per Bark


def audible(frequencies: Array, decays: Array, amplitudes: Array) -> NDArray[np.bool_]:
    """Return which modes (M,) are audible: over the threshold in quiet and not masked.

    A mode's level is that of its mean power over 200 ms, the largest amplitude counting as 90 dB
    SPL. A stronger audible mode masks levels 10 dB below its own, less 27 dB per Bark
    downwards and 15 dB per Bark upwards: triangular spreading as in additive synthesis, with common
    constants, since the paper gives none.
    """
    is_audible = np.zeros(len(frequencies), np.bool_)
    levels = _levels(decays, amplitudes)
    places = bark(frequencies)
    is_loud = levels > threshold_in_quiet(np.maximum(frequencies, _MIN_FREQUENCY))
    for mode in np.argsort(-levels, kind="stable"):
        bark_differences = places[mode] - places[is_audible]
        slopes = np.where(
            bark_differences > 0, _UPPER_SLOPE * bark_differences, -_LOWER_SLOPE * bark_differences
        )
        masked_level = np.max(levels[is_audible] - _DEPTH - slopes, initial=-np.inf)
        is_audible[mode] = is_loud[mode] and levels[mode] >= masked_level
    return is_audible


def _levels(decays: Array, amplitudes: Array) -> Array:
    """Return levels of the mean power over 200 ms, dB SPL."""
    if not len(amplitudes):
        return np.zeros(0)
    exponents = 2 * np.maximum(decays, 1e-3) * INTEGRATION_TIME
    tiny = np.finfo(np.float64).tiny
    powers = np.square(amplitudes) * -np.expm1(-exponents) / exponents
    relative_powers = np.maximum(powers, tiny) / max(float(np.square(amplitudes).max()), tiny)
    return MAX_LEVEL + 10 * np.log10(relative_powers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedModes:
    """Modes of one or several recordings."""

    frequencies: Array  # (M,), ringing, ascending, Hz
    decays: Array  # (M,), 1/s
    # (recordings, M), g of Im[g exp((-d + 2 pi i f) t)]; 0: a recording lacks the mode
    gains: Complex


def inaudible_difference(frequencies: ArrayLike) -> Array:
    """Return how far apart frequencies may be and still sound the same, Hz.

    4 Hz below 2 kHz, (f - 2 kHz) / 250 + 4 Hz above (2007, section 3.2; a fit to Shower & Biddulph
    1931).
    """
    return 4 + np.maximum(np.asarray(frequencies, float) - 2000, 0) / 250


def merge_modes(recordings: Sequence[SharedModes]) -> SharedModes:
    """Give the modes of separate recordings common frequencies and decays (2007, section 3.2).

    From the strongest mode on, each takes from every other recording the nearest one left that
    sounds the same. They share their mean frequency and the decay of the strongest; modes of one
    recording are never merged.
    """
    rows = np.cumsum([0, *(len(recording.gains) for recording in recordings)])
    owners = np.repeat(
        np.arange(len(recordings)), [len(recording.decays) for recording in recordings]
    )
    frequencies = np.concatenate([recording.frequencies for recording in recordings])
    decays = np.concatenate([recording.decays for recording in recordings])
    gains = np.zeros((rows[-1], len(owners)), np.complex128)
    for number, recording in enumerate(recordings):
        gains[rows[number] : rows[number + 1], owners == number] = recording.gains
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


# K. Steiglitz and L. E. McBride, "A technique for the identification of linear systems", IEEE
# Transactions on Automatic Control 10(4), 461-464, 1965.

ITERATIONS = 5  # rounds of prefiltering; more do not change poles of clean signals


def steiglitz_mcbride(signal: Complex, terms: int, iterations: int = ITERATIONS) -> Complex:
    """Return the poles z of the rational filter whose impulse response is nearest to a signal.

    Each round filters signal and impulse by the last denominator, after which numerator and
    denominator follow from linear least squares; Prony's method gives the first one. Unstable poles
    are mirrored into the unit circle between rounds.
    """
    from scipy.signal import lfilter

    impulse = np.zeros_like(signal)
    impulse[0] = 1
    denominator = _prony(signal, terms)
    for _ in range(iterations):
        if not np.isfinite(denominator).all():
            return np.zeros(0, np.complex128)
        denominator = _mirror_unstable_roots(denominator)
        filtered_signal = lfilter([1], denominator, signal)
        impulse_response = lfilter([1], denominator, impulse)
        columns = (
            _delay_signal(-filtered_signal, range(1, terms + 1)),
            _delay_signal(impulse_response, range(terms)),
        )
        solution = np.linalg.lstsq(np.hstack(columns), filtered_signal, rcond=None)[0]
        denominator = np.concatenate([[1], solution[:terms]])
    is_finite = np.isfinite(denominator).all()
    return np.asarray(np.roots(denominator) if is_finite else [], np.complex128)


def residues(signal: Complex, poles: Complex) -> Complex:
    """Return the factors c of sum c z^n that fit a signal (n,) best, for given poles (P,)."""
    powers = poles ** np.arange(len(signal))[:, None]
    return np.asarray(np.linalg.lstsq(powers, signal, rcond=None)[0], np.complex128)


def _prony(signal: Complex, terms: int) -> Complex:
    """Return 1, a_1 ... of the recursion that predicts a signal best from its last samples."""
    stretches = np.lib.stride_tricks.sliding_window_view(signal, terms + 1)[:, ::-1]
    prediction = np.linalg.lstsq(stretches[:, 1:], stretches[:, 0], rcond=None)[0]
    return np.concatenate([[1], -prediction])


def _mirror_unstable_roots(denominator: Complex) -> Complex:
    """Return the polynomial with the roots outside of the unit circle mirrored into it."""
    roots = np.roots(denominator)
    is_outside = np.abs(roots) > 1
    roots[is_outside] = 1 / roots[is_outside].conj()
    return np.asarray(np.poly(roots), np.complex128)


def _delay_signal(signal: Complex, delays: Iterable[int]) -> Complex:
    """Return a signal (n,) delayed by several numbers of samples, one a column."""
    count = len(signal)
    return np.stack([np.pad(signal, (delay, 0))[:count] for delay in delays], axis=1)


WINDOW = 0.046  # s
OVERLAP = 4  # windows that cover a sample


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowedTransform:
    """Spectra of Blackman-Harris windows that look forward from their start (eq. 3 and 4)."""

    length: int  # samples of a window, a power of 2
    sample_rate: float  # Hz

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
        """Weights of the window's samples (length,)."""
        return blackman_harris(self.length)

    def of(self, samples: Array) -> Complex:
        """Transform samples (n,), n at least one window: (windows, bins below half the rate).

        The exponent counts time from the first sample on, not from each window's start: only so
        does a mode in bin k turn at its distance from that bin, f - F_k.
        """
        starts = np.lib.stride_tricks.sliding_window_view(samples, self.length)[:: self.hop]
        spectra = np.fft.fft(starts * self.window, axis=1)[:, : self.length // 2]
        phase_steps = np.outer(np.arange(len(starts)) * self.hop, np.arange(self.length // 2))
        return spectra * np.exp(-2j * np.pi * (phase_steps % self.length) / self.length)

    def answers(self, exponents: Complex) -> Complex:
        """Return B of eq. 6, a window's transform of exp(exponent t), shaped as the exponents."""
        times = np.arange(self.length) / self.sample_rate
        return np.asarray(np.exp(exponents[..., None] * times) @ self.window, np.complex128)


TERMS = 4  # modes sought in each bin (the paper: 2 or 4); one term more takes up the rest
GATE = 12.0  # least rise of a fitted bin over the lead-in, dB
LONGEST = 60.0  # take, s
_FIRST = 4  # windows in which a bin must rise
_MIN_POLE = 1e-3  # poles nearer to 0 are gone within a window


def fit_corbett2007(
    takes: Sequence[Array],
    sample_rate: float,
    *,
    lead_ins: Sequence[Array] | None = None,
    terms: int = TERMS,
    gate: float = GATE,
    masking: bool = True,
) -> SharedModes:
    """Fit modes to takes of (channels, n) as Corbett et al. 2007 do; gains for each channel.

    Takes begin at the impact. A bin is fitted only where its first windows exceed the lead-in,
    ambient sound of at least 46 ms, by `gate` dB; without lead-ins, all bins are. The paper says
    that a lead-in was recorded to tell spurious modes but not how. `terms` modes are looked for in
    each bin; `masking` drops the inaudible modes of each recording.

    R. Corbett, K. van den Doel, J. E. Lloyd and W. Heidrich, "TimbreFields: 3D interactive sound
    models for real-time audio", Presence 16(6), 643-654, 2007.
    """
    transform = WindowedTransform.at(sample_rate)
    if terms < 1:
        raise OptionError(f"terms is {terms}: look for at least 1 mode in each bin")
    recordings = _recordings(takes, lead_ins, transform, terms)
    channel_modes = [
        fit_recording(channel, transform, lead_in=lead_in, terms=terms, gate=gate)
        for channel, lead_in in recordings
    ]
    return merge_modes(
        [_keep_audible(modes) for modes in channel_modes] if masking else channel_modes
    )


def fit_recording(
    samples: Array,
    transform: WindowedTransform,
    *,
    lead_in: Array | None = None,
    terms: int = TERMS,
    gate: float = GATE,
) -> SharedModes:
    """Fit each bin of one recording (n,), and keep the modes that lie in their bin, bin by bin."""
    spectra = transform.of(samples)
    bins = np.arange(1, spectra.shape[1])  # bin 0 has no modes: a pair of poles is one there
    if lead_in is not None:
        peak_magnitudes = np.abs(spectra[:_FIRST]).max(axis=0)
        ambient = np.sqrt(np.square(np.abs(transform.of(lead_in))).mean(axis=0))
        bins = bins[(peak_magnitudes > ambient * 10 ** (gate / 20))[1:]]
    bin_modes = [_modes_in(spectra[:, index], int(index), transform, terms) for index in bins]
    frequencies, decays, gains = np.concatenate([np.zeros((3, 0)), *bin_modes], axis=1)
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
    poles = poles[(np.abs(poles) > _MIN_POLE) & (np.abs(poles) < 1)]
    factors = residues(trajectory, poles)
    exponents = np.asarray(np.log(poles) / transform.step, np.complex128)
    offsets = exponents.imag / (2 * np.pi)
    # C / B is half of the mode's exponential: Im[g z^n] = (g z^n - its conjugate) / 2i.
    gains = 2j * factors / transform.answers(exponents)
    is_in_bin = np.abs(offsets) <= transform.bin_width / 2
    modes = np.stack([number * transform.bin_width + offsets, -exponents.real, gains])
    return np.asarray(modes[:, is_in_bin], np.complex128)


def _keep_audible(modes: SharedModes) -> SharedModes:
    """Drop the inaudible modes of one recording."""
    is_audible = audible(modes.frequencies, modes.decays, np.abs(modes.gains[0]))
    return SharedModes(
        frequencies=modes.frequencies[is_audible],
        decays=modes.decays[is_audible],
        gains=modes.gains[:, is_audible],
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
    min_length = transform.length + (windows - 1) * transform.hop
    recordings: list[tuple[Array, Array | None]] = []
    for number, take in enumerate(takes):
        channels = _channels(take, f"take {number}", min_length, transform.sample_rate)
        if lead_ins is None:
            recordings += [(channel, None) for channel in channels]
            continue
        name = f"the lead-in of take {number}"
        lead_in_channels = _channels(
            lead_ins[number], name, transform.length, transform.sample_rate
        )
        if len(lead_in_channels) != len(channels):
            raise OptionError(
                f"{name} has {len(lead_in_channels)} channels, the take {len(channels)}"
            )
        recordings += zip(channels, lead_in_channels, strict=True)
    return recordings


def _channels(samples: Array, name: str, min_length: int, sample_rate: float) -> Array:
    channels = np.atleast_2d(np.asarray(samples, np.float64))
    if channels.ndim != 2 or not np.isfinite(channels).all():
        raise OptionError(f"{name} has shape {channels.shape}: give finite samples (channels, n)")
    count = channels.shape[1]
    if not min_length <= count <= LONGEST * sample_rate:
        raise OptionError(
            f"{name} has {count} samples: give {min_length} to {LONGEST * sample_rate:.0f}, "
            f"{rounded(min_length / sample_rate, 2)} to {LONGEST:g} s"
        )
    return channels


def by_corbett2007(segments: Sequence[Segment], budget: int | None) -> Exponentials:
    """Fit segments by the method of 2007; keep at most `budget` modes, the strongest by energy.

    The gate is used where all have a lead-in of a window, 46 ms; the budget is not the paper's.
    """
    rate = segments[0].sample_rate
    window = WindowedTransform.at(rate).length
    is_gated = all(segment.before.shape[1] >= window for segment in segments)
    modes = fit_corbett2007(
        [segment.samples for segment in segments],
        rate,
        lead_ins=[segment.before for segment in segments] if is_gated else None,
    )
    poles = -modes.decays + 2j * np.pi * modes.frequencies
    ringing = Exponentials(poles=poles, gains=modes.gains)
    energies = (np.abs(modes.gains) ** 2).sum(axis=0) / np.maximum(modes.decays, 1e-6)
    return ringing.of(np.sort(np.argsort(-energies, kind="stable")[:budget]))
