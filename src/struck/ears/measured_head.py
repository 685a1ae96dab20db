"""Measured heads: their own responses in all directions, near and far."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import BSpline
from scipy.spatial import KDTree

from struck.ears.heads import (
    CATMULL_ROM,
    HEIGHTS,
    KNOT_STEP,
    NEAR,
    POWERS,
    Filters,
    fading,
    minimum_phase,
    require_rate,
)
from struck.ears.sphere import HEAD_RADIUS, arrival_delay, distance_gain, pressure
from struck.errors import FileFormatError, require_choice, rounded
from struck.files.atomic import is_file, unread
from struck.files.sofa import Container, opened
from struck.model.arrays import Array, Complex, Single, checked
from struck.model.material import AIR

BUNDLED = ("kemar",)
_FULL_SCALE = 32768.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HrtfSet:
    """Measured responses of two ears to M sources around a head, all at one distance."""

    name: str
    directions: Array  # (M, 3): unit vectors from the head's centre, in the head's frame
    distance: float  # m, of the sources from the head's centre
    responses: Array  # (M, 2, N): left ear first, at any level that all share
    delays: Array  # (M, 2), s, of the responses, less a time that all share
    sample_rate: float  # Hz
    references: tuple[str, ...] = ()  # keys in references.toml
    source: str = ""  # origin and terms, as the file says
    licence: str = ""


def require_set(name: str) -> None:
    """Raise an error unless a name is a set that comes with struck or an existing file."""
    if not is_file(name) and Path(name).suffix.lower() == ".sofa":
        raise FileFormatError(f"{name} {unread(name, FileNotFoundError())}")
    if not is_file(name):
        require_choice("hrtf", name, BUNDLED, more=", or the path of a .sofa file")


@cache
def read_bundled(name: str) -> HrtfSet:
    """Return a set that comes with struck; OptionError on another name."""
    require_choice("hrtf", name, BUNDLED)
    with (
        resources.files("struck.ears").joinpath(f"{name}.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as archive,
    ):
        left = archive["left"] / _FULL_SCALE
        return HrtfSet(
            name=name,
            directions=directions_of(archive["azimuths"], archive["elevations"]),
            distance=float(archive["distance"]),
            responses=np.stack([left, left[archive["mirrored"]]], axis=1),
            delays=np.full((len(left), 2), float(archive["start"])),
            sample_rate=float(archive["sample_rate"]),
            references=("gardner1994",),
            source=str(archive["source"]),
            licence=str(archive["licence"]),
        )


def directions_of(azimuths: Array, elevations: Array) -> Array:
    """Return the unit vectors (M, 3) of angles in degrees: forward, left, up."""
    azimuth, elevation = np.radians(azimuths), np.radians(elevations)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


# Alignment of measured responses: onsets, delays, level and directions between.

LEAD = 8 / 48000  # s, before an onset: the ringing of a limited band precedes it
LASTING = 448 / 48000  # s, length of a response with its lead: all that KEMAR has
BRIEF = 256 / 48000  # s, length of a response for live use; deep notches at 8 kHz need all of it
ONSET = 0.1  # share of a response's peak: the first sample above it is the onset
EARS = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
_OVERSAMPLING = 8  # onsets are found between samples
_MAX_VALUES = 2**21  # values, to bound the memory that long responses take
_FADE_IN, _FADE_OUT = 0.5, 0.0625  # of the lead, of the whole
_PASS = 0.9  # of the band that both sample rates hold: above, responses fade out
_LEVEL_BAND = np.linspace(200, 500, 7)  # Hz, where heads are spheres and loudspeakers work
_LEVELS, _PHASES = (150.0, 300.0), (300.0, 1500.0)  # Hz, from the sphere's to the set's own
_LOW_FREQUENCIES = np.linspace(0, 1500, 121)  # Hz, where responses are completed
_UNCHANGED_FREQUENCIES = np.linspace(1525, 5000, 140)  # Hz, where they are not changed
_MIN_LOSS = 0.35  # logarithm of a factor: losses of 3 dB count
_MAX_LOSS = 3.5  # the same: up to 30 dB are compensated
_KNOTS = 0.25e-3  # s, between those of the splines that are added
_DEGREES, _SMOOTHNESS = 80, 2.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aligned:
    """Responses of one set at one sample rate, all with their onset at the same sample."""

    directions: Array  # (M, 3), none twice
    delays: Array  # (M, 2), s: from the free arrival at the head's centre to the first sample
    responses: Array  # (M, 2, taps), relative to the free field at the head's centre
    gain: float  # factor on the set's own level that makes them so


def align(hrtf_set: HrtfSet, sample_rate: float, nodes: Array, lasting: float = LASTING) -> Aligned:
    """Align the responses of a set, bring them to a sample rate and to the free field's level.

    If a set has more directions than there are nodes (W, 3), those nearest to nodes are used.

    The time that both ears share is arbitrary in most sets, and in some from one elevation to the
    next (by 0.2 ms in KEMAR's): it is set such that sound comes to the nearer ear as on a rigid
    sphere. The time between the ears stays as it was measured. The level that all responses share
    is set such that the mean power from 200 to 500 Hz is that on the sphere. Low
    sound that all lose, the loudspeaker's, is made up for.
    """
    chosen = _chosen(hrtf_set.directions, nodes)
    directions, responses = hrtf_set.directions[chosen], hrtf_set.responses[chosen]
    parts = np.array_split(responses, math.ceil(responses.size / _MAX_VALUES))
    onsets = np.concatenate([_onsets(part) for part in parts]) / hrtf_set.sample_rate
    gain = _gain(directions, responses, hrtf_set)
    arrival_times = onsets + hrtf_set.delays[chosen]
    excess_times = arrival_times - arrival_delay(_angles(directions), hrtf_set.distance)
    ear_weights = (1 + directions @ EARS.T) / 2  # both add up to one, so no ear takes over at once
    shared = np.sum(excess_times * ear_weights, axis=1, keepdims=True)
    starts = np.array_split(onsets - LEAD, len(parts))
    settings = hrtf_set.sample_rate, sample_rate, lasting
    resampled_parts = [
        _resample(part, start, *settings) for part, start in zip(parts, starts, strict=True)
    ]
    delays, resampled_responses = (
        arrival_times - shared - LEAD,
        gain * np.concatenate(resampled_parts),
    )
    return Aligned(
        directions=directions,
        delays=delays,
        responses=resampled_responses
        + _low_sound(resampled_responses, delays, directions, hrtf_set.distance, sample_rate),
        gain=gain,
    )


def _spectra(responses: Array, sample_rate: float, frequencies: Array) -> Complex:
    times = np.arange(responses.shape[-1]) / sample_rate
    phases = np.exp(-2j * np.pi * np.outer(times, frequencies))
    return np.asarray(responses @ phases, np.complex128)


def _low_sound(
    responses: Array, delays: Array, directions: Array, distance: float, sample_rate: float
) -> Array:
    """Return the low sound (M, 2, taps) that a loudspeaker lost, to be added to responses.

    A head is a sphere there (Xie 2009, J. Audio Eng. Soc. 57(5), 328): one factor for all makes
    mean levels over directions and ears the sphere's, and mean phases, which a loudspeaker changes
    farther up. Added are cubic splines by least squares, which hold nothing above. A set that
    loses less than 3 dB keeps its own.
    """
    angles, taps = _angles(directions), responses.shape[-1]
    sphere_spectra = pressure(_LOW_FREQUENCIES, angles.ravel(), distance).T.reshape(
        *angles.shape, -1
    )
    sphere_spectra *= np.exp(2j * np.pi * delays[..., np.newaxis] * _LOW_FREQUENCIES)
    set_spectra = _spectra(responses, sample_rate, _LOW_FREQUENCIES)
    powers = (
        np.square(np.abs(spectra)).mean(axis=(0, 1)) for spectra in (sphere_spectra, set_spectra)
    )
    sphere_powers, set_powers = (np.maximum(power, np.finfo(float).tiny) for power in powers)
    levels = np.clip(0.5 * np.log(sphere_powers / set_powers), -_MAX_LOSS, _MAX_LOSS)
    if levels.max() < _MIN_LOSS:
        return np.zeros(responses.shape)
    phases = np.angle(np.sum(sphere_spectra * set_spectra.conj(), axis=(0, 1)))
    factors = np.expm1(
        fading(_LOW_FREQUENCIES, *_LEVELS) * levels
        + 1j * fading(_LOW_FREQUENCIES, *_PHASES) * phases
    )
    knots = np.arange(-3, taps / sample_rate / _KNOTS + 1) * _KNOTS
    times = np.clip(np.arange(taps) / sample_rate, knots[3], knots[-4])
    splines = BSpline.design_matrix(times, knots, 3).toarray().T
    basis = _spectra(
        splines, sample_rate, np.concatenate([_LOW_FREQUENCIES, _UNCHANGED_FREQUENCIES])
    ).T
    targets = np.zeros((len(basis), set_spectra[..., 0].size), np.complex128)
    targets[: len(_LOW_FREQUENCIES)] = (set_spectra * factors).reshape(-1, len(_LOW_FREQUENCIES)).T
    rows = np.concatenate([basis.real, basis.imag]), np.concatenate([targets.real, targets.imag])
    return (np.linalg.lstsq(*rows, rcond=1e-6)[0].T @ splines).reshape(responses.shape)


def _angles(directions: Array) -> Array:
    """Return the angles (M, 2) between sources and the ears, rad."""
    return np.arccos(np.clip(directions @ EARS.T, -1, 1))


def _chosen(directions: Array, nodes: Array) -> NDArray[np.intp]:
    """Return the numbers of directions kept: none twice, as poles often are, and not too many."""
    rounded_directions = np.round(directions, 3) + 0.0  # no negative zeros
    indices = np.sort(np.unique(rounded_directions, axis=0, return_index=True)[1])
    if len(indices) <= len(nodes):
        return indices
    return indices[np.unique(KDTree(directions[indices]).query(nodes)[1])]


def _onsets(responses: Array) -> Array:
    """Return where responses (M, 2, N) first exceed a share of their peak, in samples.

    Cross-correlation with the minimum-phase response, which was tried, jumps by samples between
    neighbours where a zero leaves the unit circle; this does not.
    """
    taps = responses.shape[-1]
    margin = 16  # a limited band rings before its onset, also before the first sample
    length = (taps + 2 * margin) * _OVERSAMPLING
    spectra = np.fft.rfft(np.pad(responses, ((0, 0), (0, 0), (margin, margin))), axis=-1)
    magnitudes = np.abs(np.fft.irfft(spectra, length, axis=-1))
    level = ONSET * magnitudes.max(axis=-1, keepdims=True)
    magnitudes[..., 0] = 0
    first = np.maximum(np.argmax(magnitudes > level, axis=-1), 1)[..., np.newaxis]
    values_below = np.take_along_axis(magnitudes, first - 1, axis=-1)
    values_above = np.take_along_axis(magnitudes, first, axis=-1)
    return (
        (first - (values_above - level) / (values_above - values_below)) / _OVERSAMPLING - margin
    )[..., 0]


def _gain(directions: Array, responses: Array, hrtf_set: HrtfSet) -> float:
    """Return the factor that makes responses relative to the free field."""
    mean_power = np.mean(np.abs(_spectra(responses, hrtf_set.sample_rate, _LEVEL_BAND)) ** 2)
    angles, counts = np.unique(np.round(_angles(directions), 3), return_counts=True)
    sphere_powers = np.mean(np.abs(pressure(_LEVEL_BAND, angles, hrtf_set.distance)) ** 2, axis=0)
    return math.sqrt(np.average(sphere_powers, weights=counts) / mean_power)


def _resample(
    responses: Array, starts: Array, old_rate: float, new_rate: float, lasting: float
) -> Array:
    """Return the responses (M, 2, taps) from their starts (s) on, at a new sample rate.

    Each is a sum of cosines between its samples; taking them at other times shifts by parts of a
    sample and changes the rate in one step.
    """
    length = 2 * responses.shape[-1] + 2 * math.ceil(lasting * old_rate)
    frequencies = np.arange(length // 2 + 1) * (old_rate / length)
    max_frequency = min(old_rate, new_rate) / 2
    spectra = np.fft.rfft(responses, length, axis=-1) * fading(
        frequencies / max_frequency, _PASS, 1.0
    )
    spectra *= np.exp(2j * np.pi * frequencies * starts[..., np.newaxis])
    times = np.arange(round(lasting * new_rate)) / new_rate
    phases = 2 * np.pi * np.outer(frequencies, times)
    cosines, sines = np.cos(phases), np.sin(phases)
    # The sum over the spectrum is 1 / length; a response is a density over time, 1 / rate each.
    spectra[..., 1:] *= 2
    sums = spectra.real @ cosines - spectra.imag @ sines
    return sums * (old_rate / new_rate / length) * _window(round(lasting * new_rate), new_rate)


def _window(taps: int, sample_rate: float) -> Array:
    """Return ones with eased ends, for responses cut at a lead and a length."""
    start = np.arange(taps) / (_FADE_IN * LEAD * sample_rate)
    end = np.arange(taps)[::-1] / (_FADE_OUT * taps)
    return np.sin(0.5 * np.pi * np.clip(np.minimum(start, end) + 0.05, 0, 1)) ** 2


def splined(measured_directions: Array, values: Array, target_directions: Array) -> Array:
    """Return values (M, K) in measured directions interpolated to target directions (W, K).

    A spline on the sphere: exact where measured, and of the least mean square of a derivative of
    order 2.5 (of Laplace and Beltrami) between, so that it stays bounded where none is near (Wahba
    1981, SIAM J. Sci. Stat. Comput. 2(1), 5, with a series for its kernel).
    """
    count = len(measured_directions)
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = _kernel(measured_directions @ measured_directions.T)
    system[count, count] = 0
    weights = np.linalg.solve(system, np.pad(values, ((0, 1), (0, 0))))
    return np.asarray(
        _kernel(target_directions @ measured_directions.T) @ weights[:-1] + weights[-1], np.float64
    )


def _kernel(cosines: Array) -> Array:
    return np.interp(np.sqrt(np.clip(1 - cosines, 0, 2)), *_kernel_table())


@cache
def _kernel_table() -> tuple[Array, Array]:
    """Return chords between directions, over sqrt(2), and the kernel there: true to 1e-9."""
    degrees = np.arange(1.0, _DEGREES + 1)
    series = np.zeros(_DEGREES + 1)
    series[1:] = (2 * degrees + 1) / (degrees * (degrees + 1)) ** _SMOOTHNESS
    chords = np.linspace(0, math.sqrt(2), 2**15 + 1)
    return chords, np.asarray(np.polynomial.legendre.legval(1 - chords**2, series), np.float64)


# Head-related impulse responses from SOFA files (AES69), convention SimpleFreeFieldHRIR.

CONVENTION = "SimpleFreeFieldHRIR"
FEWEST_DIRECTIONS = 4
MOST_DIRECTIONS = 20_000
MOST_TAPS = 16_384
MOST_VALUES = 2**25
SAMPLE_RATES = (8_000.0, 192_000.0)
DISTANCES = (0.1, 100.0)
# Measured radii scatter by a few per cent; sets of several distances differ by far more.
_DISTANCE_SPREAD = 0.1


def read_sofa(path: str | Path) -> HrtfSet:
    """Read a SOFA file of convention SimpleFreeFieldHRIR, with all sources at one distance."""
    path = Path(path)
    with opened(path) as file:
        file.require_convention(CONVENTION)
        responses = _responses(file)
        directions, distance = _sources(file, len(responses))
        left_first = _left_first(file)
        sample_rate = _sample_rate(file)
        return HrtfSet(
            name=file.text("Title") or path.stem,
            directions=directions,
            distance=distance,
            responses=responses[:, left_first],
            delays=_delays(file, responses.shape)[:, left_first] / sample_rate,
            sample_rate=sample_rate,
            source=file.text("References"),
            licence=file.text("License"),
        )


def _responses(file: Container) -> Array:
    shape = file.shape("Data.IR")
    if len(shape) != 3 or shape[1] != 2:
        raise FileFormatError(
            f"its variable Data.IR has shape {shape}, and (directions, 2 ears, taps) is demanded: "
            "save it again with a SOFA library"
        )
    if not FEWEST_DIRECTIONS <= shape[0] <= MOST_DIRECTIONS:
        raise FileFormatError(
            f"it holds {shape[0]} directions, and {FEWEST_DIRECTIONS} to {MOST_DIRECTIONS:,} are "
            "read: use a set of that size"
        )
    if not 1 <= shape[2] <= MOST_TAPS or np.prod(shape) > MOST_VALUES:
        raise FileFormatError(
            f"its responses have {shape[2]} taps in {shape[0]} directions, and 1 to {MOST_TAPS:,} "
            f"taps and {MOST_VALUES:,} values in all are read: cut them"
        )
    responses = file.numbers("Data.IR", shape)
    if not responses.any(axis=2).all():
        raise FileFormatError("a response in Data.IR is all zeros: take that measurement out")
    return responses


def _sample_rate(file: Container) -> float:
    rates = np.unique(file.numbers("Data.SamplingRate", (1,), file.shape("Data.IR")[:1]))
    min_rate, max_rate = SAMPLE_RATES
    if len(rates) != 1 or not min_rate <= rates[0] <= max_rate:
        raise FileFormatError(
            f"its sample rate is {', '.join(map(rounded, rates[:3]))} Hz, and one "
            f"from {rounded(min_rate)} to {rounded(max_rate)} Hz is read: resample it"
        )
    return float(rates[0])


def _delays(file: Container, shape: tuple[int, ...]) -> Array:
    """Return the delays (M, 2) in samples."""
    delays = file.numbers("Data.Delay", (1, 2), shape[:2])
    if np.ptp(delays) > MOST_TAPS:
        raise FileFormatError(
            f"its delays spread over {rounded(np.ptp(delays))} samples, and {MOST_TAPS:,} are the "
            "bound: give Data.Delay in samples"
        )
    return np.broadcast_to(delays, shape[:2])


def _sources(file: Container, count: int) -> tuple[Array, float]:
    """Return unit vectors (M, 3) in the head's frame, and the distance of all sources, m."""
    if np.any(file.numbers("ListenerPosition", (1, 3), (count, 3))):
        raise FileFormatError(
            "its ListenerPosition is not the origin: give SourcePosition relative to the listener"
        )
    positions = file.points("SourcePosition", (count, 3))
    distances = np.linalg.norm(positions, axis=1)
    distance = float(np.median(distances))
    if not DISTANCES[0] <= distance <= DISTANCES[1]:
        raise FileFormatError(
            f"its sources are {rounded(distance)} m away, and {DISTANCES[0]:g} to {DISTANCES[1]:g} "
            "m are read: give SourcePosition in metres"
        )
    if np.ptp(distances) > _DISTANCE_SPREAD * distance:
        raise FileFormatError(
            f"its sources are {rounded(distances.min())} to {rounded(distances.max())} m away, and "
            "one distance is read: keep the measurements of one"
        )
    return positions / distances[:, np.newaxis] @ _frame(file, count).T, distance


def _frame(file: Container, count: int) -> Array:
    """Return the head's axes in the file's frame: forward, left and up, as rows."""
    view = file.points("ListenerView", (1, 3), (count, 3))
    up = file.points("ListenerUp", (1, 3), (count, 3), typed="ListenerView")
    left = np.cross(up[0], view[0])
    if np.ptp(view, axis=0).any() or np.ptp(up, axis=0).any() or np.linalg.norm(left) < 1e-3:
        raise FileFormatError(
            f"its ListenerView {view[0]} and ListenerUp {up[0]} change, vanish or are parallel, "
            "and one head held still is read: write view (1, 0, 0) and up (0, 0, 1)"
        )
    axes = np.stack([view[0], left, np.cross(view[0], left)])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _left_first(file: Container) -> list[int]:
    """Return the receivers that are the left and the right ear; y points to the left."""
    one = file.shape("ReceiverPosition")
    lateral = file.points("ReceiverPosition", (2, 3), (2, 3, 1), (2, 3, one[-1]))[:, 1]
    if np.isclose(*lateral):
        raise FileFormatError(
            f"its ReceiverPosition has both ears at y = {rounded(lateral[0])} m, so left is not "
            "known: write the left ear at y > 0, the right one at y < 0"
        )
    return [0, 1] if lateral[0] > lateral[1] else [1, 0]


STEP = 5.0  # degrees between the nodes of the grid, over azimuth and elevation
AZIMUTHS = np.arange(-STEP, 361 + 2 * STEP, STEP)  # one more at the start and two at the end
ELEVATIONS = np.arange(-90 - STEP, 91 + 2 * STEP, STEP)  # beyond a pole is the other side
NEAR_STEPS = 72  # between angles 0 and pi of the near field
NEAR_LASTING = 48 / 48000  # s, of the near field's responses
_SPECTRUM = 512  # bins, from which those are cut
_KUHN = 1.5 * HEAD_RADIUS / AIR.sound_speed  # s
_COLUMNS, _NEAR_COLUMNS = len(AZIMUTHS), NEAR_STEPS + 4
_MIN_DISTANCE, _MAX_DISTANCE = NEAR * HEAD_RADIUS, (1 + HEIGHTS[-3]) * HEAD_RADIUS
_PER_STEP = np.array([180 / math.pi / STEP] * 2 + [1 / KNOT_STEP, NEAR_STEPS / math.pi])
_FIRST = np.array([90 / STEP, 180 / STEP, -math.log(NEAR - 1) / KNOT_STEP, 0]) + 1


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredHead:
    """A head with the responses that were measured on it.

    Parameters
    ----------
    measured : HrtfSet
        Its responses.

    Examples
    --------
    >>> from struck.ears import MeasuredHead
    >>> head = MeasuredHead.named("kemar")
    >>> left = np.array([[0.0, 1.0, 0.0]])
    >>> delays, responses = head.prepared(48_000).toward(left, np.array([2.0]))
    >>> responses.shape[:2]
    (1, 2)
    """

    measured: HrtfSet

    @classmethod
    @checked
    def named(cls, name: str) -> MeasuredHead:
        """Return a head whose responses come with struck.

        Parameters
        ----------
        name : str
            Name: "kemar".

        Returns
        -------
        MeasuredHead
            The head.

        Raises
        ------
        OptionError
            If there is no such name.
        """
        return cls(read_bundled(name))

    @classmethod
    def read(cls, path: str | Path) -> MeasuredHead:
        """Read a measured head from a SOFA file.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        MeasuredHead
            The head.

        Raises
        ------
        FileFormatError
            If the file cannot be read as a measured head.
        MissingDependencyError
            If h5py is not installed.
        """
        return cls(read_sofa(path))

    @property
    def name(self) -> str:
        """Name of the measured head."""
        return self.measured.name

    @property
    def references(self) -> tuple[str, ...]:
        """Keys of the papers behind it."""
        return self.measured.references

    def prepared(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Compute the filters of the head, and keep them.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz, from 4,000 to 768,000.
        brief : bool, default False
            Shorten measured responses, for live playing.

        Returns
        -------
        Filters
            Filters from directions to both ears.

        Raises
        ------
        OptionError
            If the sample rate is out of range.
        """
        require_rate(sample_rate, 768000)
        lengths = (BRIEF,) if brief else ()
        return prepare(self.measured, sample_rate, *lengths)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFilters:
    """Delays and spectra on a grid of directions, with cubics between its nodes.

    Spectra are those of responses with zeros behind, so that a product is a convolution.
    """

    # (elevations * azimuths, 2 + 4 bins): delays, s, and spectra of both ears as measured
    grid: Single
    # (KNOTS * (NEAR_STEPS + 4), 2 + 4 bins): terms of delays, s, and factors of spectra
    near: Single
    taps: int  # of the responses
    length: int  # of the transforms
    gain: float  # factor on the set's own level

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return delays (n, 2), s, and responses (n, 2, taps); see `struck.ears.heads.Filters`."""
        places = _places(directions, distances)
        cells = places.astype(np.intp)
        weights = ((places - cells)[..., None] ** POWERS @ CATMULL_ROM).astype(np.float32)
        far_values = _mixed(self.grid, cells[:, :2], weights[:, :2], _COLUMNS)
        near_values = _mixed(self.near, cells[:, 2:], weights[:, 2:], _NEAR_COLUMNS)
        delays = far_values[:, :2].astype(np.float64) + near_values[:, :2]
        spectra = far_values[:, 2:].view(np.complex64) * near_values[:, 2:].view(np.complex64)
        responses = np.fft.irfft(spectra.reshape(len(places), 2, -1), self.length)
        return delays, responses[..., : self.taps].astype(np.float32)


def _places(directions: Array, distances: Array) -> Array:
    """Return elevation, azimuth, height and angle to the left ear in steps of the tables."""
    x, y, z = directions.T
    places = np.empty((len(distances), 4))
    places[:, 0] = np.arctan2(z, np.hypot(x, y))
    places[:, 1] = np.arctan2(-y, -x)
    clipped_distances = np.minimum(np.maximum(distances, _MIN_DISTANCE), _MAX_DISTANCE)
    places[:, 2] = np.log(clipped_distances / HEAD_RADIUS - 1)
    places[:, 3] = np.arctan2(np.hypot(x, z), y)
    places *= _PER_STEP
    places += _FIRST
    return places


def _mixed(table: Single, cells: NDArray[np.intp], weights: Single, columns: int) -> Single:
    """Return the cubics (n, ..) over the 16 nodes around each place."""
    node_weights = (weights[:, 0, :, None] * weights[:, 1, None, :]).reshape(-1, 1, 16)
    rows = (cells[:, 0] * columns + cells[:, 1])[:, None] + _NEIGHBOURS[columns]
    return np.matmul(node_weights, table.take(rows, axis=0), dtype=np.float32)[:, 0]


_NEIGHBOURS = {
    columns: (np.arange(-1, 3)[:, None] * columns + np.arange(-1, 3)).reshape(-1)
    for columns in (_COLUMNS, _NEAR_COLUMNS)
}


@lru_cache(maxsize=8)
def prepare(hrtf_set: HrtfSet, sample_rate: float, lasting: float = LASTING) -> MeasuredFilters:
    """Return the filters of a set at a sample rate, each lasting some seconds."""
    ready = align(hrtf_set, sample_rate, _nodes(), lasting)
    taps, near_taps = ready.responses.shape[-1], round(NEAR_LASTING * sample_rate)
    length = next_fast_len(taps + near_taps - 1, real=True)
    return MeasuredFilters(
        grid=_grid(ready, length),
        near=_make_near_table(hrtf_set.distance, sample_rate, near_taps, length),
        taps=taps,
        length=length,
        gain=ready.gain,
    )


def _nodes() -> Array:
    azimuths, elevations = np.meshgrid(AZIMUTHS, ELEVATIONS)
    return directions_of(azimuths.ravel(), elevations.ravel())


def _grid(ready: Aligned, length: int) -> Single:
    """Return delays and spectra on the grid, by a spline through the measured directions."""
    nodes = _nodes()
    # Far from all that was measured, delays tend to Kuhn's for low frequencies, which are smooth.
    excess_times = ready.delays + _KUHN * (ready.directions @ EARS.T)
    measured_values = np.hstack([excess_times, ready.responses.reshape(len(excess_times), -1)])
    node_values = splined(ready.directions, measured_values, nodes)
    delays = node_values[:, :2] - _KUHN * (nodes @ EARS.T)
    return _table(delays, node_values[:, 2:].reshape(len(nodes), 2, -1), length)


def _table(delays: Array, responses: Array, length: int) -> Single:
    """Return rows of delays (n, 2) and of the spectra of responses (n, 2, taps)."""
    spectra = np.fft.rfft(responses, length).reshape(len(responses), -1)
    return np.concatenate([delays, spectra.view(np.float64)], axis=1).astype(np.float32)


@lru_cache(maxsize=8)
def _make_near_table(reference: float, sample_rate: float, taps: int, length: int) -> Single:
    """Return the change with distance over heights and angles, mirrored beyond 0 and pi."""
    angles = np.linspace(0, np.pi, NEAR_STEPS + 1)
    frequencies = np.linspace(0, sample_rate / 2, _SPECTRUM + 1)
    tables: list[Single] = []
    for distance in (1 + HEIGHTS) * HEAD_RADIUS:
        gains = distance_gain(frequencies, angles, distance, reference).T
        extra_times = arrival_delay(angles, distance) - arrival_delay(angles, reference)
        table = _table(
            _mirror_ears(extra_times), _mirror_ears(minimum_phase(np.log(gains))[:, :taps]), length
        )
        tables.append(np.pad(table, ((1, 2), (0, 0)), mode="reflect"))
    return np.concatenate(tables)


def _mirror_ears(left: Array) -> Array:
    """Return values (A, ..) over the angle to the left ear for both ears, (A, 2, ..)."""
    return np.stack([left, left[::-1]], axis=1)
