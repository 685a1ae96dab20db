"""Solids of simple form on structured, curved 20-node hexahedra.

Each is a frozen description with three members: `volume_mesh`, the named `places` where it is
struck, and its exact `volume`. None knows a material.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.solids.extrusion import Extrusion
from struck.solids.hexahedra import divided, lattice, stacked
from struck.solids.meridian import Patch, revolved
from struck.solids.resolution import (
    block_counts,
    require_counts,
    require_length,
    require_round,
    tube_counts,
)
from struck.solids.revolution import Revolution, Stem
from struck.solids.volume_mesh import VolumeMesh

__all__ = ["Block", "Extrusion", "Revolution", "Stem", "Tube"]

Array = NDArray[np.float64]
Places = Mapping[str, Array]

# Places near an edge stand off it by this share, so that their normal is that of one face.
_INSET = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """A straight tube along z, its middle at the origin; a rod where the wall fills it.

    Parameters
    ----------
    length : float
        m.
    radius : float
        Outer radius, m.
    wall : float
        Thickness of the wall, m; at most `radius`, which makes a solid rod.
    elements : tuple of three ints, optional
        Elements around (a multiple of 4), along and through, instead of an accuracy's.

    Raises
    ------
    OptionError
        On lengths that are not positive, a wall thicker than the radius, impossible counts.

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
        heights = {"middle": 0.0, "quarter": 0.25, "end": 0.5 - _INSET}
        return _frozen({k: (self.radius, 0, z * self.length) for k, z in heights.items()})

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return curved 20-node hexahedra.

        Parameters
        ----------
        accuracy : str
            "preview", "standard" or "fine"; counts given as `elements` go first.

        Raises
        ------
        OptionError
            On an unknown accuracy.
        """
        around, along, through = self.elements or tube_counts(
            self.length, self.radius, self.wall, accuracy
        )
        nodes, elements = revolved([self._patch(along, through)], around)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")

    def _patch(self, along: int, through: int) -> Patch:
        bore = self.radius - self.wall

        def at(u: Array, v: Array) -> Array:
            return np.stack([bore + u * self.wall, (v - 0.5) * self.length], axis=-1)

        whole = np.array([0.0, 1.0])
        return Patch(
            at=at,
            along=divided(whole, through),
            across=divided(whole, along),
            rings=through if bore == 0 else 0,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A rectangular block, its centre at the origin.

    Parameters
    ----------
    size : tuple of three floats
        Edges along x, y and z, m.
    elements : tuple of three ints, optional
        Elements along x, y and z, instead of an accuracy's.

    Raises
    ------
    OptionError
        On edges that are not positive, or impossible counts.
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
        """Volume, m^3."""
        return float(np.prod(self.size))

    @property
    def places(self) -> Places:
        """Contacts: the centres of faces, and near the edges of the top.

        "top" (also "middle"), "bottom", "side" (towards +y); on the top face "end" (towards +x)
        and "corner" (+x, +y), both 1 % off the edges.
        """
        edge = 0.5 - _INSET
        shares = {
            "top": (0, 0, 0.5),
            "middle": (0, 0, 0.5),
            "bottom": (0, 0, -0.5),
            "side": (0, 0.5, 0),
            "end": (edge, 0, 0.5),
            "corner": (edge, edge, 0.5),
        }
        return _frozen({name: np.multiply(share, self.size) for name, share in shares.items()})

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return 20-node hexahedra.

        Parameters
        ----------
        accuracy : str
            "preview", "standard" or "fine", of about 600, 2,500 and 12,000 nodes; counts given
            as `elements` go first.

        Raises
        ------
        OptionError
            On an unknown accuracy.
        """
        counts = self.elements or block_counts(self.size, accuracy)
        x, y, z = (
            divided(np.array([-side / 2, side / 2]), count)
            for side, count in zip(self.size, counts, strict=True)
        )
        nodes, elements = stacked(lattice(x, y), z)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")


def _frozen(places: Mapping[str, Array | tuple[float, float, float]]) -> Places:
    return MappingProxyType({name: np.array(at, float) for name, at in places.items()})
