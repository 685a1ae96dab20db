"""How many elements a solid of simple form is cut into, and which dimensions it may have.

The counts come from convergence studies of chimes, bowls, glasses, bars and plates: one layer of
20-node hexahedra carries the bending of a wall; along it, elements are counted by the waves that
the accuracy should still resolve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from struck.errors import OptionError

ACCURACIES = ("preview", "standard", "fine")


def level(accuracy: str) -> int:
    """Return 0, 1 or 2 for "preview", "standard" or "fine"; OptionError on any other."""
    if accuracy not in ACCURACIES:
        raise OptionError(f"accuracy is {accuracy!r}: give one of {', '.join(ACCURACIES)}")
    return ACCURACIES.index(accuracy)


def require_length(name: str, value: float) -> None:
    """Raise OptionError unless `value` is a positive, finite length in m."""
    if not (math.isfinite(value) and value > 0):
        raise OptionError(f"{name} is {value} m: it must exceed 0")


def require_counts(elements: tuple[int, ...], names: Sequence[str], least: Sequence[int]) -> None:
    """Raise OptionError unless `elements` holds a whole number of at least `least` a direction."""
    if len(elements) != len(names):
        raise OptionError(f"elements are {elements}: give {len(names)} counts, {', '.join(names)}")
    for name, count, bound in zip(names, elements, least, strict=True):
        if count != int(count) or count < bound:
            raise OptionError(
                f"elements {name} are {count}: give a whole number of at least {bound}"
            )


def require_round(around: int) -> None:
    """Raise OptionError unless `around` is a multiple of 4."""
    if around % 4:
        raise OptionError(
            f"elements around are {around}: give a multiple of 4, as {around // 4 * 4}"
        )


_SLENDER = 20  # radii: longer tubes bend below the frequencies at which their section does
_TUBE_AROUND = (12, 16, 24)
_TUBE_ALONG = (15, 48, 96)  # of a tube 40 radii long
_TUBE_THROUGH = (2, 3, 4)  # of a tube whose wall fills it almost
_ROD = ((8, 1), (12, 1), (16, 2))  # around, and between core and side
_FLAT = 0.1  # radii: a thinner disk bends as a plate
_DISK = ((24, 6), (32, 8), (48, 12))  # around, and between core and side, in one layer


def tube_counts(length: float, radius: float, wall: float, accuracy: str) -> tuple[int, int, int]:
    """Return elements around, along and through a tube."""
    if wall == radius:
        return disk_counts(length, radius, accuracy)
    if length < _SLENDER * radius:
        return shell_counts(length, radius, wall, accuracy)
    step = level(accuracy)
    along = round(_TUBE_ALONG[step] * max(1.0, math.sqrt(length / radius / 40)))
    return _TUBE_AROUND[step], along, math.ceil(_TUBE_THROUGH[step] * wall / radius)


def disk_counts(length: float, radius: float, accuracy: str) -> tuple[int, int, int]:
    """Return elements around, along, and between core and side of a rod or disk."""
    if length > _FLAT * radius:
        return solid_counts(length, radius, accuracy)
    around, rings = _DISK[level(accuracy)]
    return around, 1, rings


def solid_counts(length: float, radius: float, accuracy: str) -> tuple[int, int, int]:
    """Return elements around, along, and between core and side of a solid of revolution."""
    around, rings = _ROD[level(accuracy)]
    arc = 2 * math.pi * radius / around
    return around, max(around // 2, math.ceil(length / arc)), rings


_SHELL_AROUND = (20, 32, 48)
_SHELL_ALONG = (14, 24, 40)  # at least, unless the wall is thick
_SHELL_EDGES = (1, 2, 4)  # at most so many elements along a stretch as long as the wall is thick


def shell_counts(length: float, radius: float, wall: float, accuracy: str) -> tuple[int, int, int]:
    """Return elements around, along the mid-line and through the wall of a body of revolution."""
    step = level(accuracy)
    around = _SHELL_AROUND[step]
    arc = 2 * math.pi * radius / around
    thick = math.ceil(_SHELL_EDGES[step] * length / wall)
    along = max(min(_SHELL_ALONG[step], thick), math.ceil(length / arc))
    return around, along, math.ceil(wall * along / length / 2)


_NODES = (600, 2_500, 12_000)


def block_counts(size: tuple[float, float, float], accuracy: str) -> tuple[int, int, int]:
    """Return the elements along x, y and z: edges near equal, as many as the nodes allow."""
    budget = _NODES[level(accuracy)]
    least = _least_cuts(size)
    edge, counts = max(size), least
    while _block_nodes(finer := _cuts(size, edge, least)) <= budget:
        edge, counts = edge / 1.05, finer
    return counts


def _least_cuts(size: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return what torsion takes: two elements across a bar's section, one through a strip's."""
    thin, middle, _ = sorted(size)
    x, y, z = (2 if side > middle / 2 or side > thin else 1 for side in size)
    return x, y, z


def _cuts(
    size: tuple[float, float, float], edge: float, least: tuple[int, int, int]
) -> tuple[int, int, int]:
    x, y, z = (max(low, round(side / edge)) for side, low in zip(size, least, strict=True))
    return x, y, z


def _block_nodes(counts: tuple[int, int, int]) -> int:
    """Return the nodes of a block of 20-node hexahedra: corners and middles of edges."""
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
