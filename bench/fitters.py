"""Those who fit modes to a recording: struck, the method of 2007, and peers where they are here.

sdypy-EMA is made for transfer functions measured in a laboratory: it gets the spectrum of the take
band by band, each moved down to 0 Hz, without which close pairs are lost, and of its poles those
that stay put over orders. lim-sample 2.2 calls a function of NumPy by an argument that NumPy 2.4
no longer has: it is given back while it runs. genny takes the spectrum's peaks as they stand on the
grid of a transform, and is told how many modes there are. For sdypy-EMA and genny, which leave
levels open, gains are the least squares of all samples.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import best_gains
from struck.recordings.corbett2007 import fit_corbett2007
from struck.recordings.poles.search import fit_poles
from struck.recordings.takes import Take

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Modes = tuple[Complex, Complex]
"""Poles (M,), -d + 2 pi i f, 1/s, and gains (channels, M) at the time of the hit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """A take (channels, n) with its lead-in, and how many modes are in it, for who must be told."""

    samples: Array
    lead: int
    sample_rate: int
    modes: int

    @property
    def ringing(self) -> Array:
        """From the hit on."""
        return self.samples[:, self.lead :]

    @property
    def seconds(self) -> float:
        """How long all channels ring, together."""
        return self.ringing.size / self.sample_rate

    @property
    def noise(self) -> float:
        """Rms of the lead-in."""
        return float(self.samples[:, : self.lead].std())


Fitter = Callable[[Job], Modes]
OURS, WRITTEN, GATED = "struck", "corbett2007 as written", "corbett2007, gated"
SDYPY, SAMPLE, GENNY = "sdypy-EMA", "lim-sample", "genny"
MODULES = {SDYPY: "sdypy.EMA", SAMPLE: "sample.sample", GENNY: "genny.identify"}


def ours(job: Job) -> Modes:
    """Fit with poles shared by all channels, nothing told."""
    fit = fit_poles(Take(samples=job.samples, sample_rate=job.sample_rate), budget=None)
    poles = -fit.decays + 2j * np.pi * fit.frequencies
    late = np.array([row.time for row in fit.rows]) - job.lead / job.sample_rate
    return poles, fit.gains * np.exp(np.outer(-late, poles))


def written(job: Job) -> Modes:
    """Fit every bin of every channel, drop what nobody hears, merge."""
    modes = fit_corbett2007([job.ringing], job.sample_rate)
    return -modes.decays + 2j * np.pi * modes.frequencies, modes.gains


def gated(job: Job) -> Modes:
    """Fit only the bins that rise over the lead-in."""
    lead_ins = [job.samples[:, : job.lead]]
    modes = fit_corbett2007([job.ringing], job.sample_rate, lead_ins=lead_ins)
    return -modes.decays + 2j * np.pi * modes.frequencies, modes.gains


_WIDTH, _NARROWEST, _BESIDE = 0.15, 100.0, 10.0
"""Bands of sdypy-EMA: their breadth over their frequency, at least so many Hz, and a margin."""
_ORDER, _ORDERS, _STEADY = 40, 8, 5


def by_sdypy(job: Job) -> Modes:
    """Fit common denominators (LSCF) band by band to the spectrum of the first second."""
    model = importlib.import_module(MODULES[SDYPY]).Model
    length = min(job.ringing.shape[1], job.sample_rate)
    spectrum = np.fft.rfft(job.ringing[:, :length], axis=1)
    frequencies = np.fft.rfftfreq(length, 1 / job.sample_rate)
    found = [np.zeros(0, complex)]
    for low, high in _bands(0.45 * job.sample_rate):
        near = (frequencies > low - _BESIDE) & (frequencies < high + _BESIDE)
        own = frequencies[near]
        down = own[0] - _BESIDE / 2
        band = model(
            frf=spectrum[:, near],
            freq=own - down,
            lower=own[1] - down,
            upper=own[-2] - down,
            pol_order_high=_ORDER,
        )
        band.get_poles(show_progress=False)
        poles = _steady([np.asarray(each) + 2j * np.pi * down for each in band.all_poles])
        within = (poles.imag > 2 * np.pi * low) & (poles.imag <= 2 * np.pi * high)
        found.append(poles[within & (poles.real < 0)])
    return _audible(np.concatenate(found), job)


def _bands(highest: float) -> Iterator[tuple[float, float]]:
    low = 30.0
    while low < highest:
        high = min(low + max(_NARROWEST, _WIDTH * low), highest)
        yield low, high
        low = high


def _steady(orders: list[Complex]) -> Complex:
    """Return poles of the highest order that most of the orders before it have too."""
    *before, last = orders[-_ORDERS:]
    votes = np.zeros(len(last))
    for other in before:
        nearest = other[np.abs(last.imag[:, None] - other.imag).argmin(axis=1)]
        off = np.abs(nearest - last)
        votes += off < 0.1 * np.abs(last.real)
    return last[votes >= _STEADY]


def _audible(poles: Complex, job: Job) -> Modes:
    """Solve for gains, and keep what rises 16 dB over the noise by its energy."""
    poles = poles[np.argsort(poles.imag)]
    if not poles.size:
        return poles, np.zeros((len(job.samples), 0), complex)
    gains = best_gains(poles, job.ringing, job.sample_rate)
    energy = (np.abs(gains) ** 2).sum(axis=0) / (-4 * poles.real) * job.sample_rate
    kept = energy > 40 * job.noise**2
    return poles[kept], gains[:, kept]


def by_sample(job: Job) -> Modes:
    """Track sinusoids, fit their levels with a bent line."""
    with _older_reshape():
        model = importlib.import_module(MODULES[SAMPLE]).SAMPLE(
            sinusoidal__n=8192,
            sinusoidal__w=np.blackman(8192),
            sinusoidal__t=-100,
            sinusoidal__padded=True,
            sinusoidal__tracker__fs=job.sample_rate,
            sinusoidal__tracker__h=512,
            sinusoidal__tracker__max_n_sines=100,
            sinusoidal__tracker__reverse=True,
            sinusoidal__tracker__peak_threshold=-60,
            sinusoidal__tracker__min_sine_dur=0.1,
            sinusoidal__tracker__freq_dev_offset=10,
        )
        model.fit(job.ringing[0])
    poles = -2 / model.decays_ + 2j * np.pi * model.freqs_
    return poles, model.amps_[None].astype(complex)


@contextmanager
def _older_reshape() -> Iterator[None]:
    """Let np.reshape have its argument newshape, which went out in NumPy 2.4."""
    module: Any = np
    newer = module.reshape

    def reshape(array: Any, shape: Any = None, order: Any = "C", newshape: Any = None) -> Any:  # noqa: ANN401 - as of NumPy
        return newer(array, shape if newshape is None else newshape, order=order)

    if "newshape" not in inspect.signature(newer).parameters:
        module.reshape = reshape
    try:
        yield
    finally:
        module.reshape = newer


def by_genny(job: Job) -> Modes:
    """Take the strongest peaks of a spectrum, and the slopes of their levels."""
    fit = importlib.import_module(MODULES[GENNY]).modal_fit
    modes = fit(job.ringing[0], sr=job.sample_rate, n_modes=job.modes)
    order = np.argsort(modes.freqs)
    poles = -modes.decays[order] + 2j * np.pi * modes.freqs[order]
    return poles, best_gains(poles, job.ringing, job.sample_rate)


PEERS: dict[str, Fitter] = {SDYPY: by_sdypy, SAMPLE: by_sample, GENNY: by_genny}


def missing() -> dict[str, str]:
    """Return which peers are not here, and why."""
    reasons = {}
    for name, module in MODULES.items():
        try:
            with _older_reshape(), warnings.catch_warnings(action="ignore"):
                importlib.import_module(module)
        except ImportError as error:
            reasons[name] = f"pip install {name} ({error})"
    return reasons


def timed(fitter: Fitter, job: Job) -> tuple[float, Modes]:
    """Return the processor time of the thread, s, and the modes."""
    begun = time.thread_time()
    with warnings.catch_warnings(action="ignore"):
        modes = fitter(job)
    return time.thread_time() - begun, modes
