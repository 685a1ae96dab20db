"""Estimated numbers of modes of bodies, and numbers of elements of solids of simple form.

Modes are counted as waves that fit into a body of volume V, surface S, length a and width b, as if
it were a plate of area S / 2 and thickness h = 2 V / S: bending waves of wavenumber
k = (omega sqrt(12) / (c h))^(1/2), with the part of the rim of free plates, waves in its plane, and
waves through the bulk by Weyl's law (Cremer, Heckl & Petersson 2005, Structure-Borne Sound,
section 4.5; Xie, Thompson & Jones 2004, J. Sound Vib. 274, 551, for the rim). Walls that are curved
by a radius R have fewer bending waves below their ring frequency c / (2 pi R), in proportion to its
square root (Szechenyi 1971, J. Sound Vib. 19, 65). The lowest mode is taken from a free beam of
that length and thickness, which no other body of them is much below.

Counts of elements come from convergence studies of chimes, bowls, glasses, bars and plates: one
layer of 20-node hexahedra carries the bending of a wall; along it, elements are counted by the
waves that the accuracy should still resolve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from struck.errors import NoModeError, OptionError, require_choice, rounded
from struck.model.arrays import Array, require_number
from struck.model.material import Material
from struck.model.mesh import Mesh

ElementCounts = tuple[int, int, int]
Sizes = tuple[float, float, float]

_MIN_LENGTH, _MAX_LENGTH = 1e-9, 1e6  # m

ACCURACIES = ("preview", "standard", "fine")


def level(accuracy: str) -> int:
    """Return 0, 1 or 2 for "preview", "standard" or "fine"; OptionError on any other."""
    require_choice("accuracy", accuracy, ACCURACIES)
    return ACCURACIES.index(accuracy)


def coarser(accuracy: str) -> str:
    """Return the accuracies below one as an argument, "" for the coarsest."""
    lower_accuracies = (
        reversed(ACCURACIES[: ACCURACIES.index(accuracy)]) if accuracy in ACCURACIES else ()
    )
    names = " or ".join(map(repr, lower_accuracies))
    return f"accuracy={names}" if names else ""


def require_length(name: str, value: float) -> None:
    """Raise OptionError unless `value` is a positive, finite length in m."""
    hint = f"it must exceed 0, and {_MIN_LENGTH:g} m are the least that is computed"
    require_number(name, value, _MIN_LENGTH, _MAX_LENGTH, hint=hint, unit=" m")


def require_counts(elements: tuple[int, ...], names: Sequence[str], minima: Sequence[int]) -> None:
    """Raise OptionError unless `elements` are whole numbers of at least `minima`."""
    if len(elements) != len(names):
        raise OptionError(f"elements are {elements}: give {len(names)} counts, {', '.join(names)}")
    for name, count, minimum in zip(names, elements, minima, strict=True):
        hint = f"give a whole number of at least {minimum}"
        require_number(f"elements {name}", count, minimum, _MAX_ELEMENTS, whole=True, hint=hint)


_MAX_ELEMENTS = 10_000  # in one direction


def require_round(around_count: int) -> None:
    """Raise OptionError unless the elements around are a multiple of 4."""
    if around_count % 4:
        raise OptionError(
            f"elements around are {around_count}: give a multiple of 4, as {around_count // 4 * 4}"
        )


def refine_counts(counts: ElementCounts, sizes: Sizes, factor: float) -> ElementCounts:
    """Return `factor` times as many elements in each direction of a body of such sizes, m.

    One flat layer stays one up to 2 times as many; another is doubled at once.
    """
    edges = [size / count for size, count in zip(sizes, counts, strict=True)]
    is_flat = [edge * _FLAT_LAYER < max(edges) for edge in edges]
    x, y, z = (
        round(n * factor)
        if n > 1
        else math.floor(factor)
        if is_thin
        else math.ceil(factor - _SLIGHT_REFINEMENT)
        for n, is_thin in zip(counts, is_flat, strict=True)
    )
    return max(1, x), max(1, y), max(1, z)


def refine_round_counts(counts: ElementCounts, sizes: Sizes, factor: float) -> ElementCounts:
    """Return the same around, along and through, in multiples of 4 around the axis."""
    around_count, along_count, through_count = refine_counts(counts, sizes, factor)
    return max(8, 4 * round(around_count / 4)), along_count, through_count


def round_sizes(length: float, radius: float, wall: float) -> Sizes:
    """Return the sizes of a tube or rod around, along and through, m."""
    return 2 * math.pi * radius, length, wall


_FLAT_LAYER = 3.0  # times as wide as thick: one layer bends right
_SLIGHT_REFINEMENT = 0.1  # finer than before: one layer stays one
_SLENDER_LENGTH = 20  # radii: longer tubes bend below the frequencies at which their section does
_TUBE_AROUND_COUNTS = (12, 16, 24)
_TUBE_ALONG_COUNTS = (15, 48, 96)  # of a tube 40 radii long
_TUBE_THROUGH_COUNTS = (2, 3, 4)  # of a tube whose wall fills it almost
_ROD = ((8, 1), (12, 1), (16, 2))  # around, and between core and side
_FLAT = 0.1  # radii: a thinner disk bends as a plate
_DISK = ((24, 6), (32, 8), (48, 12))  # around, and between core and side, in one layer


def tube_counts(length: float, radius: float, wall: float, accuracy: str) -> ElementCounts:
    """Return elements around, along and through a tube."""
    if wall == radius:
        return disk_counts(length, radius, accuracy)
    if length < _SLENDER_LENGTH * radius:
        return shell_counts(length, radius, wall, accuracy)
    step = level(accuracy)
    along_count = round(_TUBE_ALONG_COUNTS[step] * max(1.0, math.sqrt(length / radius / 40)))
    return (
        _TUBE_AROUND_COUNTS[step],
        along_count,
        math.ceil(_TUBE_THROUGH_COUNTS[step] * wall / radius),
    )


def disk_counts(length: float, radius: float, accuracy: str) -> ElementCounts:
    """Return elements around, along, and between core and side of a rod or disk."""
    if length > _FLAT * radius:
        return solid_counts(length, radius, accuracy)
    around_count, rings = _DISK[level(accuracy)]
    return around_count, 1, rings


def solid_counts(length: float, radius: float, accuracy: str) -> ElementCounts:
    """Return elements around, along, and between core and side of a solid of revolution."""
    step = level(accuracy)
    around_count, rings = _ROD[step]
    arc = 2 * math.pi * radius / around_count
    counts = around_count, max(2, math.ceil(length / arc)), rings
    return _raise_counts(counts, round_sizes(length, radius, radius), _rod_nodes, step)


_SHELL_AROUND_COUNTS = (20, 32, 48)
_SHELL_ALONG_COUNTS = (14, 24, 40)  # at least, unless the wall is thick
_THROUGH_FACTOR = 0.8  # elements may be longer through the wall than along it, by the inverse
_SHELL_EDGES = (1, 2, 4)  # maximum number of elements along a stretch as long as the wall is thick


def shell_counts(length: float, radius: float, wall: float, accuracy: str) -> ElementCounts:
    """Return elements around, along the mid-line and through the wall of a body of revolution."""
    step = level(accuracy)
    around_count = _SHELL_AROUND_COUNTS[step]
    arc = 2 * math.pi * radius / around_count
    thickness_count = math.ceil(_SHELL_EDGES[step] * length / wall)
    along_count = max(min(_SHELL_ALONG_COUNTS[step], thickness_count), math.ceil(length / arc))
    counts = around_count, along_count, math.ceil(wall * along_count / length * _THROUGH_FACTOR)
    return _raise_counts(counts, round_sizes(length, radius, wall), _ring_nodes, step)


def _raise_counts(
    counts: ElementCounts, sizes: Sizes, nodes: Callable[..., int], step: int
) -> ElementCounts:
    """Return more elements where these rules give few, as to short rings and flat discs."""
    factor = 1.0
    while (
        nodes(*(fine_counts := refine_round_counts(counts, sizes, factor)))
        < _MIN_NODE_FRACTION * _NODES[step]
    ):
        factor *= 1.1
    return fine_counts


def _rod_nodes(around_count: int, along_count: int, rings: int) -> int:
    """Return the nodes of a rod of 20-node hexahedra: corners and midside nodes."""
    cut = (around_count // 4) ** 2 + around_count * rings  # quadrilaterals of a section
    corners = cut + around_count // 2 + 1
    return corners * (2 * along_count + 1) + (2 * cut + around_count // 2) * (along_count + 1)


def _ring_nodes(around_count: int, along_count: int, through_count: int) -> int:
    """Return the nodes of a ring of 20-node hexahedra: corners and midside nodes."""
    corners = (along_count + 1) * (through_count + 1)
    return around_count * (
        2 * corners + along_count * (through_count + 1) + (along_count + 1) * through_count
    )


_NODES = (600, 2_500, 12_000)
_MIN_NODE_FRACTION = 0.8  # of these


def block_counts(size: tuple[float, float, float], accuracy: str) -> ElementCounts:
    """Return the elements along x, y and z: edges near equal, as many as the nodes allow."""
    budget = _NODES[level(accuracy)]
    min_counts = _find_min_counts(size)
    edge, counts = max(size), min_counts
    while _block_nodes(fine_counts := _cuts(size, edge, min_counts)) <= budget:
        edge, counts = edge / 1.05, fine_counts
    return counts


def _find_min_counts(size: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return element counts that torsion needs: two across a bar's section, one through a strip."""
    thickness, mid_side, _ = sorted(size)
    x, y, z = (2 if side > mid_side / 2 or side > thickness else 1 for side in size)
    return x, y, z


def _cuts(
    size: tuple[float, float, float], edge: float, min_counts: tuple[int, int, int]
) -> tuple[int, int, int]:
    x, y, z = (max(low, round(side / edge)) for side, low in zip(size, min_counts, strict=True))
    return x, y, z


def _block_nodes(counts: tuple[int, int, int]) -> int:
    """Return the nodes of a block of 20-node hexahedra: corners and midside nodes."""
    x, y, z = counts
    corners = (x + 1) * (y + 1) * (z + 1)
    return corners + sum(n * corners // (n + 1) for n in (x, y, z))


def extrusion_edge(area: float, height: float, accuracy: str) -> float:
    """Return the edge of near-cubic elements in an extrusion, m."""
    budget = _NODES[level(accuracy)]
    edge = math.sqrt(area)
    while _extrusion_nodes(area, height, edge / 1.05) <= budget:
        edge /= 1.05
    return edge


def _extrusion_nodes(area: float, height: float, edge: float) -> float:
    layers = max(1, round(height / edge))
    return (area / edge**2) * (3 * (layers + 1) + layers)


MOST_MODES = 100_000
"""Modes that an analysis takes on at most: the scale of a body that has more is wrong."""
MANY_MODES = 5_000
"""Modes of a body above which its scale is doubted: most were meant a thousand times smaller."""
MANY_SECONDS = 300.0
"""Seconds of processor time above which a person is warned that an analysis takes long."""
MANY_BYTES = 6 * 2**30
"""Bytes above which, as above that time, a band is computed only if it is requested."""
_RIGID_MODES = 6  # motions without bending, which the waves of a free body count too
_LOWEST_RATIO = 3.0  # a body's lowest mode is less than this many times below its forecast
_CLAMPED_RATIO = 7.0  # lowest mode of a free bar over that of a bar clamped at one end
_GRAIN = 1.5e-3  # m: no audible ball or die is smaller; such a body was given in mm
_MIN_RISE = 6.0  # a curved wall rises by at least this many thicknesses
_UNITS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_MIN_OBJECT_LENGTH, _MAX_OBJECT_LENGTH = 5e-3, 3.0  # m: lengths of things that are struck
# Seconds of a processor of 2023, and bytes: at all, a node, and a node and mode.
_SECONDS, _MEMORY = (0.2, 2.6e-4, 8e-6), (3e7, 4.5e4, 65.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Time and memory to find a number of modes, within a factor of about 2."""

    modes: float
    seconds: float  # of a processor
    memory: float  # bytes

    @classmethod
    def of(cls, modes: float, nodes: Sequence[float]) -> Self:
        """Return the cost of finding `modes` modes with sets of elements of `nodes` nodes each."""
        start, node, pair_cost = _SECONDS
        seconds = start + sum(nodes) * (node + pair_cost * modes)
        start, node, pair_cost = _MEMORY
        return cls(
            modes=modes, seconds=seconds, memory=start + max(nodes) * (node + pair_cost * modes)
        )

    @property
    def is_high(self) -> bool:
        """Whether the cost is so high that a person should agree first."""
        return self.seconds > MANY_SECONDS or self.memory > MANY_BYTES

    @property
    def effort(self) -> str:
        """Time and memory of an analysis in words."""
        minutes = self.seconds / 60
        time = (
            f"{_round_to_digit(self.seconds)} s"
            if minutes < 2
            else f"{_round_to_digit(minutes)} min"
        )
        return f"about {time} of a processor and {_round_to_digit(self.memory / 1e9)} GB"

    def __str__(self) -> str:
        return f"about {_round_to_digit(self.modes)} modes, {self.effort}"


def _round_to_digit(value: float) -> str:
    """Return a number rounded to one digit."""
    text = rounded(value, 1)
    return f"{float(text):,.0f}" if float(text) >= 1 else text


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """Forecast of nodes, modes, time and memory of a body before it is meshed."""

    material: Material
    volume: float  # m^3
    surface: float  # m^2, both sides of a wall
    sides: tuple[float, ...]  # (3,): of the body along its own axes, m, the longest first

    @classmethod
    def of(cls, mesh: Mesh, material: Material, wall: float | None = None) -> Self:
        """Return the forecast of a closed surface, or of walls along a surface."""
        area = float(mesh.areas.sum())
        is_solid = wall is None
        return cls(
            material=material,
            volume=abs(mesh.volume) if is_solid else area * wall,
            surface=area if is_solid else 2 * area,
            sides=_sides(mesh),
        )

    @cached_property
    def thickness(self) -> float:
        """Mean thickness of the body, m."""
        return 2 * self.volume / max(self.surface, math.ulp(0.0))

    @property
    def lowest(self) -> float:
        """Lowest frequency of the free body, Hz, of which the true one is seldom below half."""
        speed = math.sqrt(self.material.youngs_modulus / self.material.density)
        return 1.028 * speed * self.thickness / self.sides[0] ** 2

    def modes(self, max_frequency: float) -> float:
        """Return about how many modes there are up to a frequency, Hz."""
        omega, (a, b, _) = 2 * math.pi * max_frequency, self.sides
        material, area = self.material, self.surface / 2
        shear = math.sqrt(material.shear_modulus / material.density)
        young = material.youngs_modulus / material.density
        plane = math.sqrt(young / (1 - material.poisson_ratio**2))
        bulk = math.sqrt((material.first_lame + 2 * material.shear_modulus) / material.density)
        bent = math.sqrt(omega * math.sqrt(12) / (plane * self.thickness))
        bending = area * bent**2 / (4 * math.pi) * self._flat(max_frequency, plane)
        rim = 0.9 * (a + b) * bent / math.pi
        rods = a * omega / math.pi * (1 / shear + 1 / math.sqrt(young))
        sheets = area * omega**2 / (4 * math.pi) * (1 / shear**2 + 1 / plane**2)
        bulk_count = self.volume * omega**3 / (6 * math.pi**2) * (2 / shear**3 + 1 / bulk**3)
        return max(bending + rim + rods + sheets + bulk_count - _RIGID_MODES, 0.0)

    def _flat(self, max_frequency: float, plane: float) -> float:
        """Return the ratio of bending waves of curved walls to those of plates, up to a limit."""
        _, b, c = self.sides
        if c < _MIN_RISE * self.thickness:
            return 1.0
        radius = c / 2 + b**2 / (8 * c)
        ring = plane / (2 * math.pi * radius)
        high_fraction, low_fraction = (
            1 - ring / (3 * max_frequency),
            2 / 3 * math.sqrt(max_frequency / ring),
        )
        return high_fraction if max_frequency > ring else low_fraction

    def require_reasonable(
        self,
        max_frequency: float,
        nodes: Sequence[float] = (0.0,),
        *,
        held: bool = False,
        requested: bool = True,
        recoils: bool = False,
        coarser: str = "",
    ) -> str:
        """Return a warning about the scale, or ""; raise OptionError where the scale must be wrong.

        `max_frequency`, Hz, is the end of the band, and `requested` whether the user gave it. A
        body that is `held` has lower modes; one that `recoils` sounds without any. The `nodes` are
        those of each set of elements; the `coarser` settings, "" at the coarsest, reduce them.
        """
        count, min_frequency = (
            self.modes(max_frequency),
            self.lowest / _LOWEST_RATIO / (_CLAMPED_RATIO if held else 1.0),
        )
        if min_frequency > max_frequency:
            if recoils and self.sides[0] >= _GRAIN:
                return ""
            raise NoModeError(
                f"no mode lies below {rounded(max_frequency)} Hz: the lowest is at about "
                f"{rounded(self.lowest, 2)} Hz in {self._size} so check its units (lengths are in "
                "m), or widen band="
            )
        cost = Cost.of(count, nodes)
        if count <= MANY_MODES and not cost.is_high:
            return ""
        modes = f"about {_round_to_digit(count)} modes below {rounded(max_frequency)} Hz"
        message = f"{self._size} has {modes}"
        end = self._end(max_frequency, nodes)
        lower = (
            f"end the band lower, as in band=(20, {end:.0f})" if end > 20 else "check its lengths"
        )
        lower = f"{self._unit(max_frequency)}{lower}"
        coarsest = "simplify the mesh, or take a narrower band="
        hint = lower if end < max_frequency else f"take {coarser}" if coarser else coarsest
        if count > MOST_MODES:
            raise OptionError(f"{message}, and at most {MOST_MODES:,} are computed: {hint}")
        message = f"{message}, which take {cost.effort}: {hint}"
        if cost.is_high and not requested:
            raise OptionError(
                f"{message}, or request all of them by band=(20, {rounded(max_frequency)})"
            )
        return message

    @property
    def _size(self) -> str:
        length, thickness = rounded(self.sides[0], 3), rounded(self.thickness, 2)
        return f"a body of {length} m, {thickness} m thick in the mean,"

    def _unit(self, max_frequency: float) -> str:
        """Return the unit that was probably meant."""
        for unit, length in self._smaller(max_frequency):
            note = f"units={unit!r} of a file, and those of a solid are given in m"
            return f"if its lengths are in {unit} it is {rounded(length, 3)} m ({note}); else "
        return ""

    def _smaller(self, max_frequency: float) -> Iterator[tuple[str, float]]:
        for unit, factor in _UNITS.items():
            forecast = Forecast(
                material=self.material,
                volume=self.volume * factor**3,
                surface=self.surface * factor**2,
                sides=tuple(side * factor for side in self.sides),
            )
            if (
                _MIN_OBJECT_LENGTH <= forecast.sides[0] <= _MAX_OBJECT_LENGTH
                and forecast.modes(max_frequency) <= MANY_MODES
            ):
                yield unit, forecast.sides[0]

    def _end(self, max_frequency: float, nodes: Sequence[float]) -> float:
        """Return the end of a band that takes less long, in steps of a quarter octave."""
        none = Cost.of(0.0, nodes)
        min_seconds, memory = none.seconds, none.memory
        while (count := self.modes(max_frequency)) > MANY_MODES or (
            Cost.of(count, nodes).seconds > max(MANY_SECONDS, 2 * min_seconds)
            or Cost.of(count, nodes).memory > max(MANY_BYTES, 2 * memory)
        ):
            max_frequency /= 2**0.25
        return max_frequency


def _sides(mesh: Mesh) -> tuple[float, ...]:
    """Return the extents along the axes of the surface's inertia, m, the longest first."""
    vertices: Array = mesh.points[np.unique(mesh.faces)]
    centred = vertices - vertices.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return tuple(sorted(np.ptp(centred @ axes, axis=0).tolist(), reverse=True))
