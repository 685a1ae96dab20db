"""The solid that a closed-form body stands for, to compute it by finite elements instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.solids import Block, Tube
from struck.solids.volume_mesh import VolumeMesh

Array = NDArray[np.float64]
Turn = tuple[tuple[float, ...], ...]
Held = Callable[[Array], NDArray[np.bool_]]

# Turns the axis of a tube, z, towards x.
ALONG_X: Turn = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
UPRIGHT: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# Share of the body's extent within which a node counts as on its end.
_NEAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterpart:
    """A solid in the frame of a closed-form body: turned, then moved by `offset`.

    Parameters
    ----------
    solid : Block or Tube
    turn : matrix (3, 3)
        Of a rotation.
    offset : vector (3,)
        m.
    ends : tuple of (axis, m)
        Where the solid is held: at the planes across the axis (0 or 1) at these places.
    rim : float or None
        Where it is held, too: at this distance from the axis z, m.
    """

    solid: Block | Tube
    turn: Turn = UPRIGHT
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ends: tuple[tuple[int, float], ...] = ()
    rim: float | None = None
    places: Mapping[str, Array] = field(default_factory=lambda: MappingProxyType({}))

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return the solid's elements in this frame."""
        mesh = self.solid.volume_mesh(accuracy)
        return replace(mesh, nodes=mesh.nodes @ np.array(self.turn).T + np.array(self.offset))

    @property
    def fixed(self) -> Held | None:
        """Where it is held, as `struck.analyze` asks for it."""
        return self._held if self.ends or self.rim else None

    def _held(self, points: Array) -> NDArray[np.bool_]:
        near = _NEAR * float(np.ptp(points, axis=0).max())
        held = np.zeros(len(points), bool)
        for axis, place in self.ends:
            held |= np.abs(points[:, axis] - place) <= near
        if self.rim is not None:
            held |= np.hypot(points[:, 0], points[:, 1]) >= self.rim - near
        return held


def require_clamped_or_free(kind: str, ends: tuple[str, ...]) -> None:
    """Refuse supports that no surface of a solid can have.

    Raises
    ------
    OptionError
        Where an end is neither clamped nor free.
    """
    for end in ends:
        if end not in {"clamped", "free"}:
            raise OptionError(
                f"an end of the {kind} is {end!r}: elements can only be held ('clamped') or let "
                "go ('free'); take method='formula'"
            )
