"""Volume meshes: nodes and elements of one kind, in VTK's node order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.solids.elements import ELEMENTS, Element

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VolumeMesh:
    """Nodes and elements of one kind.

    Parameters
    ----------
    nodes : array (N, 3)
        m.
    elements : array (E, n)
        Node indices in VTK's order for the kind.
    kind : str
        "tet4", "tet10", "hex20" or "wedge15".
    up : str
        The axis that points up.

    Raises
    ------
    MeshError
        On an unknown kind, a wrong count of nodes an element, or indices out of range.
    """

    nodes: Array
    elements: Index
    kind: str
    up: str = "z"

    def __post_init__(self) -> None:
        if self.kind not in ELEMENTS:
            raise MeshError(f"elements of kind {self.kind!r} are unknown: use {sorted(ELEMENTS)}")
        wanted = len(ELEMENTS[self.kind].nodes)
        if self.elements.ndim != 2 or self.elements.shape[1] != wanted or not len(self.elements):
            raise MeshError(
                f"{self.kind} elements have shape {self.elements.shape}, not (E, {wanted})"
            )
        if self.elements.min() < 0 or self.elements.max() >= len(self.nodes):
            raise MeshError(f"elements name nodes outside 0 to {len(self.nodes) - 1}")

    @property
    def element(self) -> Element:
        """The reference element of this kind."""
        return ELEMENTS[self.kind]
