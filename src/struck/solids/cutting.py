"""Tetrahedra cut along a surface: the part on its inner side, in tetrahedra again.

Quadrilaterals are halved from their lowest-numbered corner, so neighbours agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.solids.volume_mesh import unique_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Tetrahedra with the depths of their corners below the surfaces that bound a body.

    Parameters
    ----------
    points : array (K, 3)
        m.
    depths : array (K, n)
        Below each of n surfaces, negative inside, exactly 0 on the surface, m.
    tetrahedra : array (T, 4)
        Point numbers.
    """

    points: Array
    depths: Array
    tetrahedra: Index

    def edges(self) -> Index:
        """Return the edges of the tetrahedra, each once (E, 2)."""
        pairs = np.sort(self.tetrahedra[:, np.array(PAIRS)].reshape(-1, 2), axis=1)
        return unique_rows(pairs)[0]

    def crossings(self, surface: int, edges: Index) -> Crossings:
        """Return where one of the surfaces crosses `edges` (E, 2)."""
        depth = self.depths[:, surface]
        crossed = edges[depth[edges[:, 0]] * depth[edges[:, 1]] < 0]
        first, second = depth[crossed].T
        share = first / (first - second)
        depths = _between(self.depths, crossed, share)
        depths[:, surface] = 0.0
        return Crossings(
            edges=crossed,
            share=share,
            points=_between(self.points, crossed, share),
            depths=depths,
        )

    def within(self, surface: int) -> Cells:
        """Return the parts of the tetrahedra inside one of the surfaces."""
        found = self.crossings(surface, self.edges())
        keys = found.edges[:, 0] * len(self.points) + found.edges[:, 1]

        def crossing(a: Index, b: Index) -> Index:
            return len(self.points) + np.searchsorted(
                keys, np.minimum(a, b) * len(self.points) + np.maximum(a, b)
            )

        signs = np.sign(self.depths[:, surface])[self.tetrahedra]
        order = np.argsort(signs, axis=1, kind="stable")
        ordered = np.take_along_axis(self.tetrahedra, order, axis=1)
        inside, outside = (signs < 0).sum(axis=1), (signs > 0).sum(axis=1)
        parts = [ordered[(outside == 0) & (inside > 0)]]
        for (few, many), stencil in _STENCILS.items():
            a, b, c, d = ordered[(inside == few) & (outside == many)].T
            parts += stencil(a, b, c, d, crossing)
        return Cells(
            points=np.vstack([self.points, found.points]),
            depths=np.vstack([self.depths, found.depths]),
            tetrahedra=np.vstack(parts),
        )

    def compact(self) -> Cells:
        """Give all tetrahedra positive volume; drop empty ones and unused points."""
        corners = self.points[self.tetrahedra]
        volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
        turned = np.where((volumes < 0)[:, None], self.tetrahedra[:, [0, 2, 1, 3]], self.tetrahedra)
        solid = turned[np.abs(volumes) > 1e-9 * np.abs(volumes).max(initial=0.0)]
        used, local = np.unique(solid, return_inverse=True)
        return replace(
            self,
            points=self.points[used],
            depths=self.depths[used],
            tetrahedra=local.reshape(-1, 4),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossings:
    """Where edges (E, 2) meet a surface: the share from their first end, points and depths."""

    edges: Index
    share: Array
    points: Array
    depths: Array


def _between(values: Array, edges: Index, share: Array) -> Array:
    return values[edges[:, 0]] * (1 - share)[:, None] + values[edges[:, 1]] * share[:, None]


def _prism(bottom: Index, top: Index) -> list[Index]:
    """Split prisms between triangles (m, 3) into three tetrahedra each.

    The lowest corner comes first; its two faces are halved from it, the face opposite from its
    own lowest corner.
    """
    lowest = np.hstack([bottom, top]).argmin(axis=1)
    flipped = (lowest >= 3)[:, None]
    low, high = np.where(flipped, top, bottom), np.where(flipped, bottom, top)
    turn = (lowest[:, None] % 3 + np.arange(3)) % 3
    low, high = np.take_along_axis(low, turn, axis=1), np.take_along_axis(high, turn, axis=1)
    (a, b, c), (x, y, z) = low.T, high.T
    from_b = (np.minimum(b, z) < np.minimum(c, y))[:, None]
    first = np.where(from_b, np.stack([a, b, c, z], 1), np.stack([a, b, c, y], 1))
    second = np.where(from_b, np.stack([a, b, z, y], 1), np.stack([a, y, c, z], 1))
    return [first, second, np.stack([a, x, y, z], axis=1)]


def _pyramid(apex: Index, quad: tuple[Index, Index, Index, Index]) -> list[Index]:
    """Split pyramids over quadrilaterals a, b, c, d into two tetrahedra each."""
    a, b, c, d = quad
    from_a = (np.minimum(a, c) < np.minimum(b, d))[:, None]
    first = np.where(from_a, np.stack([apex, a, b, c], 1), np.stack([apex, b, c, d], 1))
    second = np.where(from_a, np.stack([apex, a, c, d], 1), np.stack([apex, a, b, d], 1))
    return [first, second]


# By counts of corners inside and outside, corners ordered from inside to outside.
_STENCILS = {
    (1, 3): lambda a, b, c, d, x: [np.stack([a, x(a, b), x(a, c), x(a, d)], axis=1)],
    (1, 2): lambda a, b, c, d, x: [np.stack([a, b, x(a, c), x(a, d)], axis=1)],
    (1, 1): lambda a, b, c, d, x: [np.stack([a, b, c, x(a, d)], axis=1)],
    (2, 1): lambda a, b, c, d, x: _pyramid(c, (a, b, x(b, d), x(a, d))),
    (2, 2): lambda a, b, c, d, x: _prism(
        np.stack([a, x(a, c), x(a, d)], axis=1), np.stack([b, x(b, c), x(b, d)], axis=1)
    ),
    (3, 1): lambda a, b, c, d, x: _prism(
        np.stack([a, b, c], axis=1), np.stack([x(a, d), x(b, d), x(c, d)], axis=1)
    ),
}
