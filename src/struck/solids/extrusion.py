"""Plates and prisms: a polygon, meshed flat and laid in layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from struck.solids.hexahedra import divided, stacked
from struck.solids.outline import (
    Loops,
    Pairs,
    as_points,
    check_loops,
    contains,
    distance_to_edges,
    edges_of,
    signed_area,
)
from struck.solids.quadrilaterals import quadrilaterals
from struck.solids.resolution import extrusion_edge, require_counts, require_length
from struck.solids.volume_mesh import VolumeMesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Extrusion:
    """A plate or prism: a polygon in (x, y), with or without holes, from z = 0 to `height`.

    Parameters
    ----------
    outline : sequence of (x, y)
        Corners of a polygon that does not cross itself, m, in either direction round.
    height : float
        m.
    holes : sequence of sequences of (x, y)
        Polygons cut out, inside the outline and apart from each other, m.
    elements : tuple of two ints, optional
        Elements along the longer side of the outline's box and along the height, instead of an
        accuracy's. Elements are smaller where corners stand closer together.

    Raises
    ------
    OptionError
        On a height that is not positive, points that are not finite pairs, impossible counts.
    MeshError
        On outlines without an inside.
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
        """Volume, m^3."""
        return self._area * self.height

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts.

        "top" and "bottom": in the middle of the faces; "corner": on the top face, 1 % of the
        extent inside the corner farthest out; "side": the middle of the longest edge's face.
        """
        loops = self._loops
        middle, side = _deep_inside(loops), _middle_of_longest_edge(loops[0])
        places = {
            "top": (*middle, self.height),
            "bottom": (*middle, 0.0),
            "corner": (*_near_corner(loops), self.height),
            "side": (*side, self.height / 2),
        }
        return MappingProxyType({name: np.array(at) for name, at in places.items()})

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return 20-node hexahedra in layers.

        Parameters
        ----------
        accuracy : str
            "preview", "standard" or "fine", of about 600, 2,500 and 12,000 nodes where the
            outline has few corners; counts given as `elements` go first.

        Raises
        ------
        OptionError
            On an unknown accuracy.
        MeshError
            When the outline has corners too sharp or too close to mesh.
        """
        if self.elements is None:
            edge = extrusion_edge(self._area, self.height, accuracy)
            layers = max(1, round(self.height / edge))
        else:
            edge = float(np.ptp(self._loops[0], axis=0).max()) / self.elements[0]
            layers = self.elements[1]
        levels = divided(np.array([0.0, self.height]), layers)
        nodes, elements = stacked(quadrilaterals(self._loops, edge), levels)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")


_GRID = 41  # points a side of the search for the deepest one


def _deep_inside(loops: Loops) -> Array:
    """Return the centroid of the outline's corners' box, or the deepest point found inside."""
    low, high = loops[0].min(axis=0), loops[0].max(axis=0)
    shares = np.stack(np.meshgrid(*[np.linspace(0, 1, _GRID)] * 2), axis=-1).reshape(-1, 2)
    points = low + shares * (high - low)
    points = points[contains(edges_of(loops), points)]
    depths = distance_to_edges(edges_of(loops), points)
    # Among equally deep points the one nearest the middle: a long plate's middle, not its end.
    deep = points[depths > 0.98 * depths.max()]
    return deep[np.argmin(np.linalg.norm(deep - (low + high) / 2, axis=1))]


def _middle_of_longest_edge(loop: Array) -> Array:
    steps = np.roll(loop, -1, axis=0) - loop
    longest = np.argmax(np.linalg.norm(steps, axis=1))
    return loop[longest] + steps[longest] / 2


def _near_corner(loops: Loops) -> Array:
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
