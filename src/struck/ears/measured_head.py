"""Heads that were measured: their own responses in all directions, near and far."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from struck.ears.aligning import BRIEF, EARS, LASTING, Aligned, aligned, spline_weights
from struck.ears.head import Array, Filters, Single, require_rate
from struck.ears.heads import CATMULL_ROM, HEIGHTS, KNOT_STEP, NEAR, POWERS
from struck.ears.hrtf import HrtfSet, bundled, directions_of
from struck.ears.sofa import read_sofa
from struck.ears.sphere import HEAD_RADIUS, arrival_delay, distance_gain
from struck.model.air import AIR

STEP = 5.0  # degrees between the nodes of the grid, over azimuth and elevation
AZIMUTHS = np.arange(-STEP, 361 + 2 * STEP, STEP)  # one more at the start and two at the end
ELEVATIONS = np.arange(-90 - STEP, 91 + 2 * STEP, STEP)  # beyond a pole is the other side
NEAR_STEPS = 72  # between angles 0 and pi of the near field
NEAR_LASTING = 48 / 48000  # s, of the near field's responses
_SPECTRUM = 512  # bins, from which those are cut
_KUHN = 1.5 * HEAD_RADIUS / AIR.sound_speed  # s
_COLUMNS, _NEAR_COLUMNS = len(AZIMUTHS), NEAR_STEPS + 4
_NEAREST, _FARTHEST = NEAR * HEAD_RADIUS, (1 + HEIGHTS[-3]) * HEAD_RADIUS
_PER_STEP = np.array([180 / math.pi / STEP] * 2 + [1 / KNOT_STEP, NEAR_STEPS / math.pi])
_FIRST = np.array([90 / STEP, 180 / STEP, -math.log(NEAR - 1) / KNOT_STEP, 0]) + 1


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredHead:
    """A head with the responses that were measured on it.

    Parameters
    ----------
    measured : HrtfSet
        Its responses.
    """

    measured: HrtfSet

    @classmethod
    def named(cls, name: str) -> MeasuredHead:
        """Return a head whose responses come with struck: "kemar".

        Raises
        ------
        OptionError
            When none is called that.
        """
        return cls(bundled(name))

    @classmethod
    def read(cls, path: str | Path) -> MeasuredHead:
        """Return the head of a SOFA file.

        Raises
        ------
        FileFormatError
            When it is none that can be read.
        MissingDependencyError
            When h5py is not installed.
        """
        return cls(read_sofa(path))

    @property
    def name(self) -> str:
        """What it is called."""
        return self.measured.name

    @property
    def references(self) -> tuple[str, ...]:
        """Keys of the papers behind it."""
        return self.measured.references

    def prepared(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Return its filters (kept, once made), brief ones for playing live.

        Raises
        ------
        OptionError
            If the sample rate is not between 4 and 768 kHz.
        """
        require_rate(sample_rate, 768000)
        how = (BRIEF,) if brief else ()
        return prepare(self.measured, sample_rate, *how)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFilters:
    """Delays and spectra on a grid of directions, with cubics between its nodes.

    Spectra are those of responses with zeros behind, so that a product is a convolution.

    Parameters
    ----------
    grid : array (elevations * azimuths, 2 + 4 bins), float32
        Delays (s) and spectra of both ears at the distance that was measured.
    near : array (KNOTS * (NEAR_STEPS + 4), 2 + 4 bins), float32
        What other distances add to the delays (s), and multiply the spectra by.
    taps : int
        Length of the responses.
    length : int
        Of the transforms.
    gain : float
        By which the set's own level was multiplied, to be relative to the free field.
    """

    grid: Single
    near: Single
    taps: int
    length: int
    gain: float

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return delays (n, 2) and responses (n, 2, taps); see `struck.ears.head.Filters`."""
        places = _places(directions, distances)
        cells = places.astype(np.intp)
        weights = ((places - cells)[..., None] ** POWERS @ CATMULL_ROM).astype(np.float32)
        far = _mixed(self.grid, cells[:, :2], weights[:, :2], _COLUMNS)
        near = _mixed(self.near, cells[:, 2:], weights[:, 2:], _NEAR_COLUMNS)
        delays = far[:, :2].astype(np.float64) + near[:, :2]
        spectra = far[:, 2:].view(np.complex64) * near[:, 2:].view(np.complex64)
        responses = np.fft.irfft(spectra.reshape(len(places), 2, -1), self.length)
        return delays, responses[..., : self.taps].astype(np.float32)


def _places(directions: Array, distances: Array) -> Array:
    """Return elevation, azimuth, height and angle to the left ear in steps of the tables."""
    x, y, z = directions.T
    places = np.empty((len(distances), 4))
    places[:, 0] = np.arctan2(z, np.hypot(x, y))
    places[:, 1] = np.arctan2(-y, -x)
    nearby = np.minimum(np.maximum(distances, _NEAREST), _FARTHEST)
    places[:, 2] = np.log(nearby / HEAD_RADIUS - 1)
    places[:, 3] = np.arctan2(np.hypot(x, z), y)
    places *= _PER_STEP
    places += _FIRST
    return places


def _mixed(table: Single, cells: NDArray[np.intp], weights: Single, columns: int) -> Single:
    """Return the cubics (n, ..) over the 16 nodes around each place."""
    both = (weights[:, 0, :, None] * weights[:, 1, None, :]).reshape(-1, 1, 16)
    rows = (cells[:, 0] * columns + cells[:, 1])[:, None] + _NEIGHBOURS[columns]
    return np.matmul(both, table.take(rows, axis=0), dtype=np.float32)[:, 0]


_NEIGHBOURS = {
    columns: (np.arange(-1, 3)[:, None] * columns + np.arange(-1, 3)).reshape(-1)
    for columns in (_COLUMNS, _NEAR_COLUMNS)
}


@lru_cache(maxsize=8)
def prepare(measured: HrtfSet, sample_rate: float, lasting: float = LASTING) -> MeasuredFilters:
    """Return the filters of a set at a sample rate, of so many seconds each."""
    ready = aligned(measured, sample_rate, _nodes(), lasting)
    taps, short = ready.responses.shape[-1], round(NEAR_LASTING * sample_rate)
    length = next_fast_len(taps + short - 1, real=True)
    return MeasuredFilters(
        grid=_grid(ready, length),
        near=_near_field(measured.distance, sample_rate, short, length),
        taps=taps,
        length=length,
        gain=ready.gain,
    )


def _nodes() -> Array:
    azimuths, elevations = np.meshgrid(AZIMUTHS, ELEVATIONS)
    return directions_of(azimuths.ravel(), elevations.ravel())


def _grid(ready: Aligned, length: int) -> Single:
    """Return delays and spectra on the grid: a spline over what is measured."""
    nodes = _nodes()
    weights = spline_weights(ready.directions, nodes)
    # Far from all that was measured, delays tend to Kuhn's for low frequencies, which are smooth.
    excess = ready.delays + _KUHN * (ready.directions @ EARS.T)
    delays = weights @ excess - _KUHN * (nodes @ EARS.T)
    responses = weights @ ready.responses.reshape(len(ready.responses), -1)
    return _table(delays, responses.reshape(len(nodes), 2, -1), length)


def _table(delays: Array, responses: Array, length: int) -> Single:
    """Return rows of delays (n, 2) and of the spectra of responses (n, 2, taps)."""
    spectra = np.fft.rfft(responses, length).reshape(len(responses), -1)
    return np.concatenate([delays, spectra.view(np.float64)], axis=1).astype(np.float32)


@lru_cache(maxsize=8)
def _near_field(reference: float, sample_rate: float, short: int, length: int) -> Single:
    """Return what the distance changes, over heights and angles, mirrored beyond 0 and pi."""
    angles = np.linspace(0, np.pi, NEAR_STEPS + 1)
    frequencies = np.linspace(0, sample_rate / 2, _SPECTRUM + 1)
    tables: list[Single] = []
    for distance in (1 + HEIGHTS) * HEAD_RADIUS:
        gains = distance_gain(frequencies, angles, distance, reference).T
        later = arrival_delay(angles, distance) - arrival_delay(angles, reference)
        table = _table(_both(later), _both(_minimum_phase(gains)[:, :short]), length)
        tables.append(np.pad(table, ((1, 2), (0, 0)), mode="reflect"))
    return np.concatenate(tables)


def _both(left: Array) -> Array:
    """Return values (A, ..) over the angle to the left ear for both ears, (A, 2, ..)."""
    return np.stack([left, left[::-1]], axis=1)


def _minimum_phase(gains: Array) -> Array:
    """Return the responses (A, 2 bins) of minimum phase that have these gains (A, bins + 1).

    References
    ----------
    Oppenheim & Schafer, Discrete-Time Signal Processing, 3rd ed., section 13.5.
    """
    cepstra = np.fft.irfft(np.log(gains), axis=-1)
    half = cepstra.shape[-1] // 2
    cepstra[:, 1:half] *= 2
    cepstra[:, half + 1 :] = 0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstra, axis=-1)), axis=-1)
