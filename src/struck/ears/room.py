"""A room as a box: reflections as images of the source behind its walls."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.heads import minimum_phase
from struck.ears.reverberation import Reverberation, statistical_time
from struck.errors import MissingDependencyError, OptionError, require_choice, rounded
from struck.model.arrays import (
    Array,
    Index,
    Single,
    checked,
    numbers,
    require_number,
    require_sample_rate,
)
from struck.model.material import AIR
from struck.model.provenance import table_of

Wall = str | float
WALLS = ("x0", "x1", "y0", "y1", "z0", "z1")  # z0 is the floor, z1 the ceiling
BANDS = 125.0 * 2.0 ** np.arange(7)  # Hz: centres of the octave bands of absorption (7,)
_MIN_AMPLITUDE = 1e-5  # -100 dB, which keeps logarithms finite
_SPECTRUM = 8192  # points of the circle on which a short response is built


def pyroomacoustics() -> ModuleType:
    """Return the library pyroomacoustics; MissingDependencyError where it is not installed.

    Its import would import sounddevice, which opens PortAudio for as long as Python runs: from then
    on `struck.play` would see no device that comes or goes.
    """
    is_hidden = "pyroomacoustics" not in sys.modules and sys.modules.get("sounddevice") is None
    if is_hidden:
        sys.modules["sounddevice"] = None  # type: ignore[assignment] # as the import system has it
    try:
        import pyroomacoustics as library  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise MissingDependencyError(
            'full responses of a room are made by pyroomacoustics: pip install "struck[room]"'
        ) from error
    finally:
        if is_hidden:
            del sys.modules["sounddevice"]
    return library


_MAX_EDGE = 1000.0  # m, an edge of a room
_MOST_ORDERS = 24  # some 20,000 images
_LOWEST_FULL_RATE = 4000.0  # Hz: below it there is no band of the walls to filter by
_MOST_FULL_ORDERS = 60  # of whole responses, computed once


@dataclass(frozen=True, slots=True, kw_only=True)
class Images:
    """Images of any source in a box; the first is the source itself."""

    # The image (images, 3) of a source at p is at signs * p + offsets, m; a sign of -1 mirrors.
    signs: Array
    offsets: Array
    counts: Index  # (images, 6): how often the sound met each of `WALLS`

    def __len__(self) -> int:
        return len(self.signs)

    @property
    def reflections(self) -> Index:
        """How often the sound met a wall: (images,)."""
        return self.counts.sum(axis=1)

    def at(self, positions: ArrayLike) -> Array:
        """Return the images of sources: (..., 3) -> (..., images, 3), m."""
        return self.signs * np.asarray(positions, np.float64)[..., None, :] + self.offsets


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """A box-shaped room along the axes of the scene.

    Parameters
    ----------
    size : tuple of three floats
        Edges along x, y and z, m.
    walls : str, float or mapping of str to them, default "brick"
        Material by name (see `wall_materials`), or fraction of the energy that is absorbed in all
        bands, 0 to 1; for all walls, or for each of "x0", "x1", "y0", "y1", "z0" (floor), "z1"
        (ceiling).
    order : int, default 2
        Maximum number of reflections of the image sources.
    reverberation : Reverberation, optional
        Sound after the image sources; `expected_reverberation` computes one from the walls.
    corner : tuple of three floats, default (0, 0, 0)
        Corner with the lowest coordinates, m.

    Raises
    ------
    OptionError
        If an argument is out of range, or a wall is unknown or missing.

    Notes
    -----
    Images: J. B. Allen and D. A. Berkley, J. Acoust. Soc. Am. 65(4), 943-950, 1979. A wall
    reflects the pressure by sqrt(1 - absorption), whatever the angle; air absorbs nothing.

    Examples
    --------
    >>> room = struck.Room(size=(5.0, 4.0, 3.0), walls="brick")
    >>> room.reverberation_time().round(1)
    array([3.4, 3.4, 3.4, 2.5, 2. , 1.4, 1.4])
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> body = struck.Body(model=model, excitations=struck.Strike(), position=(3.0, 2.0, 1.0))
    >>> ear = struck.Mono(position=(1.0, 2.0, 1.5))
    >>> struck.render(body, seconds=0.5, listener=ear, room=room).samples.shape
    (1, 24000)
    """

    size: tuple[float, float, float]
    walls: Wall | Mapping[str, Wall] = "brick"
    order: int = 2
    reverberation: Reverberation | None = None
    corner: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.size) != 3 or not all(0 < edge <= _MAX_EDGE for edge in self.size):
            raise OptionError(
                f"a room of size {self.size}: give three lengths above 0 and at most "
                f"{rounded(_MAX_EDGE)}, in m, as 5, 4, 3"
            )
        if len(self.corner) != 3 or not all(map(math.isfinite, self.corner)):
            raise OptionError(f"a corner at {self.corner}: give three coordinates, m")
        hint = f"give 0, 1, 2, ... {_MOST_ORDERS}, and leave later ones to a Reverberation"
        require_number("order of reflections", self.order, 0, _MOST_ORDERS, whole=True, hint=hint)
        self.absorptions()

    @property
    def volume(self) -> float:
        """Volume of the room, m^3."""
        return math.prod(self.size)

    @property
    def areas(self) -> Array:
        """Areas of the six walls, in the order of `WALLS`, m^2 (6,)."""
        return np.repeat(self.volume / np.array(self.size), 2)

    def absorptions(self) -> Array:
        """Compute the absorption coefficients of the walls.

        Returns
        -------
        array (6, 7)
            Absorbed fraction of the energy for each wall and band.

        Raises
        ------
        OptionError
            If walls are missing or unknown.
        """
        walls = self.walls if isinstance(self.walls, Mapping) else dict.fromkeys(WALLS, self.walls)
        if set(walls) != set(WALLS):
            raise OptionError(f"walls are given for {', '.join(walls)}: give {', '.join(WALLS)}")
        return np.array([_absorption(walls[name]) for name in WALLS])

    @checked
    def require_inside(self, positions: ArrayLike, name: str) -> None:
        """Raise an error if a position is outside the room.

        Parameters
        ----------
        positions : array-like (K, 3)
            Positions, m.
        name : str
            Noun for the positions in the message.

        Raises
        ------
        OptionError
            If a position is outside the room. It names the first.
        """
        points = numbers(name, positions, width=3).reshape(-1, 3)
        low, high = np.array([self.corner, np.add(self.corner, self.size)], np.float64)
        slack = 1e-9 * (high - low)  # a centre of mass is at 0 to rounding alone
        is_outside = ~np.all((points >= low - slack) & (points <= high + slack), axis=1)
        if is_outside.any():
            position_text, low, high = (
                ", ".join(rounded(x, 4) for x in coordinates)
                for coordinates in (points[is_outside][0], low, high)
            )
            raise OptionError(
                f"the {name} at {position_text} m is outside the room, which reaches from {low} "
                f"to {high} m: move it in, or make the room larger"
            )

    def images(self) -> Images:
        """Compute the images up to the order, by ascending number of reflections.

        Returns
        -------
        Images
            Signs, offsets and wall counts of the images.
        """
        span = range(-self.order, self.order + 1)
        cells = [c for c in itertools.product(span, repeat=3) if sum(map(abs, c)) <= self.order]
        cell = np.array(sorted(cells, key=lambda c: sum(map(abs, c))))
        odd = cell % 2
        signs = 1.0 - 2 * odd
        offsets = (cell + odd) * np.array(self.size) + 2 * odd * np.array(self.corner)
        # A way over m rooms to the right meets the right wall first, then both in turn.
        near_counts, far_counts = (np.abs(cell) + (cell < 0)) // 2, (np.abs(cell) + (cell > 0)) // 2
        counts = np.stack([near_counts, far_counts], axis=2).reshape(-1, 6).astype(np.int64)
        return Images(signs=signs, offsets=offsets, counts=counts)

    @checked
    def responses(self, sample_rate: float, taps: int = 64) -> Single:
        """Compute short minimum-phase filters for the reflections of each image.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.
        taps : int, default 64
            Length, samples. 64 at 48 kHz follow each reflection within 0.1 dB up to 16 kHz, of
            curtains within 0.3 dB.

        Returns
        -------
        array (images, taps), float32
            Filters; that of the source itself is 1, 0, 0, ... Levels below -100 dB are raised to
            -100 dB.

        Raises
        ------
        OptionError
            If the sample rate is not positive, or `taps` is below 1 or above 4,096.
        """
        require_sample_rate(sample_rate)
        if not 1 <= taps <= _SPECTRUM // 2:
            raise OptionError(f"filters of {taps} taps: give 1 to {_SPECTRUM // 2}")
        frequencies = sample_rate * np.arange(_SPECTRUM // 2 + 1) / _SPECTRUM
        place = np.log(np.maximum(frequencies, BANDS[0]))
        reflected_fractions = [
            1 - np.interp(place, np.log(BANDS), row) for row in self.absorptions()
        ]
        logarithms = 0.5 * np.log(np.maximum(reflected_fractions, _MIN_AMPLITUDE**2))
        distinct_counts, rows = np.unique(self.images().counts, axis=0, return_inverse=True)
        magnitudes = np.maximum(distinct_counts @ logarithms, math.log(_MIN_AMPLITUDE))
        return minimum_phase(magnitudes)[rows.ravel(), :taps].astype(np.float32)

    @checked
    def reverberation_time(self, formula: str = "eyring") -> Array:
        """Compute the reverberation time T60 in each of `BANDS`.

        Parameters
        ----------
        formula : {"eyring", "sabine"}, default "eyring"
            Formula.

        Returns
        -------
        array (7,)
            T60, s.
        """
        return statistical_time(self.volume, self.areas, self.absorptions(), formula)

    def expected_reverberation(self, seed: int = 0) -> Reverberation:
        """Compute the reverberation of these walls by Eyring's formula.

        Parameters
        ----------
        seed : int, default 0
            Seed of its noise.

        Returns
        -------
        Reverberation
            The reverberation.

        Raises
        ------
        OptionError
            If in some band the walls absorb nothing or everything.
        """
        times = dict(zip(BANDS.tolist(), self.reverberation_time().tolist(), strict=True))
        return Reverberation(seconds=times, volume=self.volume, seed=seed)

    def mixing_time(self) -> float:
        """Compute the time at which the reverberation replaces the images.

        That is when sound has met `order` + 1 walls on average, with a mean free path of 4 V / S
        (Kuttruff 2009, chapter 5).

        Returns
        -------
        float
            Time after the emission, s.
        """
        return (self.order + 1) * 4 * self.volume / float(self.areas.sum()) / AIR.sound_speed

    @checked
    def full_responses(
        self, source: ArrayLike, listeners: ArrayLike, sample_rate: float, order: int = 12
    ) -> Single:
        """Compute impulse responses of the room by pyroomacoustics, with images up to a high order.

        Parameters
        ----------
        source : array (3,)
            Position of the source, m, scene frame.
        listeners : array (listeners, 3)
            Positions of the listeners, m, scene frame.
        sample_rate : float
            Sample rate, a whole number, Hz.
        order : int, default 12
            Maximum number of reflections.

        Returns
        -------
        array (listeners, n), float32
            Response from the emission of an impulse that is 1 at 1 m, without frequencies below 10
            Hz.

        Raises
        ------
        OptionError
            If a source or listener is outside the room, the sample rate is not a whole number of at
            least 4,000, or the order is not from 0 to 60.
        MissingDependencyError
            If pyroomacoustics is not installed.
        """
        points = numbers("listener", listeners, width=3).reshape(-1, 3)
        self.require_inside(numbers("source", source, width=3)[:3], "source")
        self.require_inside(points, "listener")
        require_sample_rate(sample_rate, whole=True, least=_LOWEST_FULL_RATE)
        require_number("order of images", order, 0, _MOST_FULL_ORDERS, whole=True)
        library = pyroomacoustics()
        walls = self._materials(library)
        box = library.ShoeBox(self.size, fs=int(sample_rate), materials=walls, max_order=int(order))
        box.set_sound_speed(AIR.sound_speed)
        box.add_source(np.asarray(source, np.float64) - self.corner)
        box.add_microphone_array((points - self.corner).T)
        box.compute_rir()
        lead = library.constants.get("frac_delay_length") // 2
        rows = [row[0][lead:] for row in box.rir]
        longest = max(map(len, rows))
        return np.stack([np.pad(row, (0, longest - len(row))) for row in rows]).astype(np.float32)

    def _materials(self, library: ModuleType) -> dict[str, Any]:
        names = ("west", "east", "south", "north", "floor", "ceiling")
        tables = [{"coeffs": row, "center_freqs": BANDS.tolist()} for row in self.absorptions()]
        return dict(zip(names, map(library.Material, tables), strict=True))


def wall_materials() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of wall materials.

    Returns
    -------
    mapping of str to mapping
        By name: absorption in 7 bands, and its source.

    Examples
    --------
    >>> len(struck.ears.wall_materials()["brick"]["absorption"])
    7
    """
    return table_of("struck.ears", "walls")


def _absorption(wall: Wall) -> Array:
    """Return the absorbed share of the energy of a wall in each band (7,)."""
    if isinstance(wall, str):
        materials = wall_materials()
        require_choice("walls", wall.strip().lower(), materials)
        return np.array(materials[wall.strip().lower()]["absorption"])
    if not 0 <= wall <= 1:
        raise OptionError(f"a wall that absorbs {wall} of the energy: give 0 to 1, or a name")
    return np.full(len(BANDS), float(wall))
