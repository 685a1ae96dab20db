"""Solids of simple form on structured, curved 20-node hexahedra.

Each is a frozen description with three members: `volume_mesh`, the named `places` where it is
struck, and its exact `volume`. None knows a material.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, checked
from struck.solids.hexahedra import divide_breaks, lattice, quadrilaterals, stack_layers
from struck.solids.meridian import INSET, Patch, revolve
from struck.solids.polygon_mesh import (
    Loops,
    Pairs,
    as_points,
    check_loops,
    contains,
    distance_to_edges,
    edges_of,
    signed_area,
)
from struck.solids.resolution import (
    block_counts,
    extrusion_edge,
    refine_counts,
    refine_round_counts,
    require_counts,
    require_length,
    require_round,
    round_sizes,
    tube_counts,
)
from struck.solids.volume_mesh import VolumeMesh


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Extrusion:
    """A plate or prism: a polygon in (x, y), with or without holes, from z = 0 to `height`.

    Parameters
    ----------
    outline : sequence of (x, y)
        Corners of a polygon that does not cross itself, in either direction, m.
    height : float
        Height, m.
    holes : sequence of sequences of (x, y), default ()
        Polygons that are cut out, disjoint and inside the outline, m.
    elements : tuple of two ints, optional
        Number of elements along the longer side of the bounding box of the outline, and along the
        height. Elements are smaller where corners are closer together. Default: by the accuracy.

    Raises
    ------
    OptionError
        If the height is not positive, points are not finite pairs, or counts are impossible.
    MeshError
        If the outline has no inside.

    Examples
    --------
    >>> from struck.solids import Extrusion
    >>> triangle = Extrusion(outline=[(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)], height=0.005)
    >>> float(round(triangle.volume_mesh("preview").volume(), 9))
    2.5e-05
    """

    outline: Pairs
    height: float
    holes: Sequence[Pairs] = ()
    elements: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        require_length("height of the extrusion", self.height)
        if self.elements is not None:
            require_counts(self.elements, ("across", "along the height"), (1, 1))
        object.__setattr__(self, "outline", as_points("the outline", self.outline))
        holes = tuple(as_points(f"hole {i + 1}", hole) for i, hole in enumerate(self.holes))
        object.__setattr__(self, "holes", holes)
        check_loops(self._loops)

    @property
    def _loops(self) -> Loops:
        return tuple(np.array(loop) for loop in (self.outline, *self.holes))

    @property
    def _area(self) -> float:
        outer, *holes = (abs(signed_area(loop)) for loop in self._loops)
        return outer - sum(holes)

    @property
    def volume(self) -> float:
        """Volume of the extrusion, m^3."""
        return self._area * self.height

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the extrusion by name, m.

        "top" and "bottom": the deepest points of these faces; "corner": on the top face, 1 % of the
        extent inside the corner farthest out; "side": the middle of the longest edge's face.
        """
        loops = self._loops
        place, side = _find_deepest_place(loops), _midpoint_of_longest_edge(loops[0])
        places = {
            "top": (*place, self.height),
            "bottom": (*place, 0.0),
            "corner": (*_find_place_near_corner(loops), self.height),
            "side": (*side, self.height / 2),
        }
        return _freeze_places(places)

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return 20-node hexahedra in layers.

        Parameters
        ----------
        accuracy : {"preview", "standard", "fine"}, default "standard"
            Resolution, if the body has no `elements`: about 600, 2,500 and 12,000 nodes for an
            outline with few corners.
        finer : float, default 1.0
            Approximate factor of the number of elements in each direction.

        Returns
        -------
        VolumeMesh
            Nodes and elements.

        Raises
        ------
        OptionError
            On an unknown accuracy.
        MeshError
            When the outline has corners too sharp or too close to mesh.
        """
        if self.elements is None:
            edge = extrusion_edge(self._area, self.height, accuracy) / finer
            layers = max(1, round(self.height / edge))
        else:
            edge = float(np.ptp(self._loops[0], axis=0).max()) / self.elements[0] / finer
            layers = max(1, round(self.elements[1] * finer))
        levels = divide_breaks(np.array([0.0, self.height]), layers)
        nodes, elements = stack_layers(quadrilaterals(self._loops, edge), levels)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")


_GRID = 41  # points per side of the search for the deepest one


def _find_deepest_place(loops: Loops) -> Array:
    """Return the centroid of the outline's corners' box, or the deepest point found inside."""
    low, high = loops[0].min(axis=0), loops[0].max(axis=0)
    fractions = np.stack(np.meshgrid(*[np.linspace(0, 1, _GRID)] * 2), axis=-1).reshape(-1, 2)
    points = low + fractions * (high - low)
    points = points[contains(edges_of(loops), points)]
    depths = distance_to_edges(edges_of(loops), points)
    # Among equally deep points the one nearest the middle: a long plate's middle, not its end.
    deep = points[depths > 0.98 * depths.max()]
    return deep[np.argmin(np.linalg.norm(deep - (low + high) / 2, axis=1))]


def _midpoint_of_longest_edge(loop: Array) -> Array:
    steps = np.roll(loop, -1, axis=0) - loop
    longest = np.argmax(np.linalg.norm(steps, axis=1))
    return loop[longest] + steps[longest] / 2


def _find_place_near_corner(loops: Loops) -> Array:
    """Return a point just inside the corner farthest from the middle of the outline's box."""
    loop = loops[0]
    extent = np.ptp(loop, axis=0)
    corner = int(np.argmax(np.linalg.norm(loop - (loop.min(axis=0) + extent / 2), axis=1)))
    arms = np.stack([loop[corner - 1], loop[(corner + 1) % len(loop)]]) - loop[corner]
    inward = (arms / np.linalg.norm(arms, axis=1)[:, None]).sum(axis=0)
    step = 0.01 * extent.max() * inward / np.linalg.norm(inward)
    while not contains(edges_of(loops), (loop[corner] + step)[None])[0]:
        step = step / 2
    return loop[corner] + step


Places = Mapping[str, Array]


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """A straight tube along z with its centre at the origin, or a rod if the wall fills it.

    Parameters
    ----------
    length : float
        Length, m.
    radius : float
        Outer radius, m.
    wall : float
        Wall thickness, m; at most `radius`, which makes a solid rod.
    elements : tuple of three ints, optional
        Number of elements around (a multiple of 4), along, and through the wall. Default: by the
        accuracy.

    Raises
    ------
    OptionError
        If lengths are not positive, the wall is thicker than the radius, or counts are impossible.

    Examples
    --------
    >>> chime = Tube(length=0.505, radius=0.0125, wall=0.001)
    >>> chime.volume_mesh("preview").nodes.shape
    (1320, 3)
    """

    length: float
    radius: float
    wall: float
    elements: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        for name in ("length", "radius", "wall"):
            require_length(f"{name} of the tube", getattr(self, name))
        if self.wall > self.radius:
            raise OptionError(
                f"wall of the tube is {self.wall} m: at most its radius, {self.radius} m, fits "
                "(and makes a solid rod)"
            )
        if self.elements is not None:
            require_counts(self.elements, ("around", "along", "through"), (4, 1, 1))
            require_round(self.elements[0])

    @property
    def volume(self) -> float:
        """Volume of the material, m^3."""
        return float(np.pi * self.length * self.wall * (2 * self.radius - self.wall))

    @property
    def places(self) -> Places:
        """Contacts on the outer side: "middle", "quarter" of the length, "end" 1 % off it."""
        heights = {"middle": 0.0, "quarter": 0.25, "end": 0.5 - INSET}
        return _freeze_places({k: (self.radius, 0, z * self.length) for k, z in heights.items()})

    @property
    def playing_place(self) -> str:
        """Name of the place where a tube is struck by default: where all bending modes speak."""
        return "end"

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return curved 20-node hexahedra.

        Parameters
        ----------
        accuracy : {"preview", "standard", "fine"}, default "standard"
            Resolution, if the body has no `elements`.
        finer : float, default 1.0
            Approximate factor of the number of elements in each direction.

        Returns
        -------
        VolumeMesh
            Nodes and elements.
        """
        counts = self.elements or tube_counts(self.length, self.radius, self.wall, accuracy)
        around_count, along_count, through_count = refine_round_counts(
            counts, round_sizes(self.length, self.radius, self.wall), finer
        )
        nodes, elements = revolve([self._patch(along_count, through_count)], around_count)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")

    def _patch(self, along_count: int, through_count: int) -> Patch:
        bore = self.radius - self.wall

        def at(u: Array, v: Array) -> Array:
            return np.stack([bore + u * self.wall, (v - 0.5) * self.length], axis=-1)

        unit_interval = np.array([0.0, 1.0])
        return Patch(
            at=at,
            along=divide_breaks(unit_interval, through_count),
            across=divide_breaks(unit_interval, along_count),
            rings=through_count if bore == 0 else 0,
        )


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A rectangular block with its centre at the origin.

    Parameters
    ----------
    size : tuple of three floats
        Edges along x, y and z, m.
    elements : tuple of three ints, optional
        Number of elements along x, y and z. Default: by the accuracy.

    Raises
    ------
    OptionError
        If edges are not positive, or counts are impossible.

    Examples
    --------
    >>> block = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> round(struck.analyze(block, "oak", accuracy="preview", progress=None).mass, 4)
    0.0152
    >>> block.volume_mesh("preview").nodes.shape
    (408, 3)
    """

    size: tuple[float, float, float]
    elements: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        if len(self.size) != 3:
            raise OptionError(f"size of the block is {self.size}: give its edges along x, y and z")
        for axis, edge in zip("xyz", self.size, strict=True):
            require_length(f"edge of the block along {axis}", edge)
        if self.elements is not None:
            require_counts(self.elements, ("along x", "along y", "along z"), (1, 1, 1))

    @property
    def volume(self) -> float:
        """Volume of the block, m^3."""
        return float(np.prod(self.size))

    @property
    def places(self) -> Places:
        """Contacts: the centres of faces, and near the edges of the top.

        "top" (also "middle"), "bottom", "side" (towards +y); on the top face "end" (towards +x)
        and "corner" (+x, +y), both 1 % off the edges.
        """
        edge = 0.5 - INSET
        positions = {
            "top": (0, 0, 0.5),
            "middle": (0, 0, 0.5),
            "bottom": (0, 0, -0.5),
            "side": (0, 0.5, 0),
            "end": (edge, 0, 0.5),
            "corner": (edge, edge, 0.5),
        }
        return _freeze_places(
            {name: np.multiply(position, self.size) for name, position in positions.items()}
        )

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return 20-node hexahedra.

        Parameters
        ----------
        accuracy : {"preview", "standard", "fine"}, default "standard"
            Resolution, if the body has no `elements`: about 600, 2,500 and 12,000 nodes.
        finer : float, default 1.0
            Approximate factor of the number of elements in each direction.

        Returns
        -------
        VolumeMesh
            Nodes and elements.

        Raises
        ------
        OptionError
            On an unknown accuracy.
        """
        counts = refine_counts(self.elements or block_counts(self.size, accuracy), self.size, finer)
        x, y, z = (
            divide_breaks(np.array([-side / 2, side / 2]), count)
            for side, count in zip(self.size, counts, strict=True)
        )
        nodes, elements = stack_layers(lattice(x, y), z)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")


def _freeze_places(places: Mapping[str, Array | tuple[float, float, float]]) -> Places:
    return MappingProxyType({name: np.array(at, float) for name, at in places.items()})
