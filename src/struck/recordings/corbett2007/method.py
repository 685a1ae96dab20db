"""The fit of 2007, section 3: exponentials bin by bin, what is heard of them, merged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.recordings.corbett2007.masking import audible
from struck.recordings.corbett2007.merging import SharedModes, merged
from struck.recordings.corbett2007.steiglitz_mcbride import residues, steiglitz_mcbride
from struck.recordings.corbett2007.windowed_transform import WindowedTransform

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

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
