"""Solids of revolution of any side: domes, balls and eggs, which close on the axis, and undercuts.

A slender column along the axis is filled by discs without a pole; the meridian outside it is cut
into quadrilaterals, which are turned about the axis. Both share their nodes where they meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from struck.errors import MeshError, rounded
from struck.model.arrays import Array, Index, Mask
from struck.solids.hexahedra import (
    QuadrilateralSheet,
    angles,
    merge_meshes,
    quadrilaterals,
    stack_layers,
)
from struck.solids.meridian import (
    INSET,
    Contour,
    Counts,
    MeridianCurve,
    Patch,
    Points,
    revolve,
    segment,
)

Map = Callable[[Array, Array], Array]

_COLUMN = 0.4  # radius of the column over that of the body, unless a waist is narrower
_WAIST = 0.7  # the same over that of the waist
_BEND = 0.5  # rad by which the side turns from one node to the next at most
_DENSE = 4000  # points of the side among which the nearest ones are sought
_ON_AXIS, _TOUCHING = 1e-9, 1e-5  # over the largest radius, and that of the column


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LatheSolid:
    """A solid between the axis and a curve from bottom to top; ends off the axis are flat."""

    side: MeridianCurve
    breaks: Array  # where elements must end along it, its ends among them, m

    @property
    def length(self) -> float:
        """Length of a side of the profile, m."""
        return float(self.breaks[-1])

    def contour(self) -> Contour:
        """Return the bounding curves, each with its start and end."""
        bottom, top = self.side.at(np.array([0.0, self.length]))
        flats = [(bottom * (0, 1), bottom), (top, top * (0, 1))]
        first, last = (
            [(segment(start, end), 0.0, 1.0)] if np.any(start != end) else []
            for start, end in flats
        )
        axis = segment(top * (0, 1), bottom * (0, 1))
        return [*first, (self.side, 0.0, self.length), *last, (axis, 0.0, 1.0)]

    def check(self) -> None:
        """Raise MeshError where the side reaches the axis between its ends, or runs downward."""
        r, z = self._samples.T
        inner = slice(1, -1)
        if r[inner].min(initial=np.inf) <= _ON_AXIS * r.max():
            place = z[1 + int(np.argmin(r[inner]))]
            raise MeshError(
                f"the side reaches the axis at z = {place:.6g} m, between its ends: only these may "
                "lie on it, at r = 0"
            )
        if z[-1] <= z[0]:
            raise MeshError(
                f"the side runs from z = {z[0]:.6g} m to z = {z[-1]:.6g} m: list it from bottom "
                "to top"
            )

    @property
    def _samples(self) -> Array:
        return self.side.at(self._positions)

    @property
    def _positions(self) -> Array:
        return np.unique(np.append(np.linspace(0, self.length, _DENSE), self.breaks))

    def mesh(self, counts: Counts) -> tuple[Array, Index]:
        """Return nodes (N, 3) and 20-node hexahedra (E, 20)."""
        radius, first, last = self._column()
        sheet, levels = self._mesh_outside_column(radius, first, last, self.length / counts.along)
        column = Patch(
            at=self._column_map(radius, first, last),
            along=np.array([0.0, 1.0]),
            across=levels,
            rings=1,
        )
        nodes, elements = revolve([column], counts.around)
        ring = stack_layers(sheet, np.append(angles(counts.around), 7 * np.pi / 4))
        z, r, angle = ring[0].T
        ring_nodes = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
        return merge_meshes([nodes, ring_nodes], [elements, ring[1]])

    def _column(self) -> tuple[float, float, float]:
        """Return the column's radius, and where along the side it leaves and meets the side."""
        at, r = self._positions, self._samples[:, 0]
        waists = (r[1:-1] <= r[:-2]) & (r[1:-1] <= r[2:])
        flats = r[[0, -1]] > _ON_AXIS * r.max()
        waist_radius = np.min(np.append(r[1:-1][waists], r[[0, -1]][flats]), initial=np.inf)
        radius = min(_COLUMN * float(r.max()), _WAIST * float(waist_radius))
        outer_samples = np.flatnonzero(r >= radius)
        first, last = int(outer_samples[0]), int(outer_samples[-1])
        ends = [
            float(np.interp(radius, r[[inner, outer]], at[[inner, outer]]))
            for inner, outer in ((max(first - 1, 0), first), (min(last + 1, len(r) - 1), last))
        ]
        rising = np.diff(r[: first + 1]) > 0, np.diff(r[last:]) < 0
        if not all(np.all(steps) for steps in rising):
            raise MeshError(
                f"the side turns back toward the axis within {rounded(radius, 4)} m of it, near an "
                "end: let it leave the axis outward, or end it there with a flat"
            )
        return radius, ends[0], ends[1]

    def _column_map(self, radius: float, first: float, last: float) -> Map:
        """Return the map from u outward and v upward to (r, z) in the column."""
        at, points = self._positions, self._samples
        ends = self.side.at(np.array([first, last]))
        caps = []
        for chosen, end in ((at < first, ends[0]), (at > last, ends[1])):
            r, z = points[chosen].T
            order = np.argsort(r)
            caps.append((np.append(r[order], radius), np.append(z[order], end[1])))

        def map_column(u: Array, v: Array) -> Array:
            low, high = (np.interp(u * radius, *cap) for cap in caps)
            return np.stack([u * radius, (1 - v) * low + v * high], axis=-1)

        return map_column

    def _mesh_outside_column(
        self, radius: float, first: float, last: float, size: float
    ) -> tuple[QuadrilateralSheet, Array]:
        """Return quadrilaterals in (z, r) outside the column, and levels where they meet it."""
        curve = self.side.at(self._strides(first, last, size))
        low, high = curve[[0, -1]] * (0, 1) + (radius, 0)
        # Where the side leaves the column there is no flat between.
        has_flat = np.abs(curve[[0, -1], 0] - radius) > _TOUCHING * radius
        loop = np.vstack([low, curve[1 - has_flat[0] : len(curve) - 1 + has_flat[1]], high])
        sheet = quadrilaterals((loop[:, ::-1],), size)
        z, r = sheet.points.T
        is_shared = np.abs(r - radius) <= _ON_AXIS * radius
        levels = (np.sort(z[is_shared]) - low[1]) / (high[1] - low[1])
        return replace(
            sheet, points=self._move_onto_side(sheet, is_shared, curve[[0, -1], 1], size)
        ), levels

    def _strides(self, first: float, last: float, size: float) -> Array:
        """Return positions along the side at most `size` apart, and closer where it bends."""
        breaks = self.breaks[(self.breaks > first) & (self.breaks < last)]
        breaks = np.concatenate([[first], breaks, [last]])
        parts = [breaks[:1]]
        for start, end in pairwise(breaks):
            at = np.linspace(start, end, _DENSE)
            steps = np.diff(self.side.at(at), axis=0)
            angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
            bends = np.abs(np.diff(angle, prepend=angle[0])) / _BEND
            strides = np.cumsum(np.maximum(np.linalg.norm(steps, axis=1) / size, bends))
            count = math.ceil(strides[-1])
            parts.append(np.interp(np.linspace(0, strides[-1], count + 1)[1:], strides, at[1:]))
        return np.concatenate(parts)

    def _move_onto_side(
        self, sheet: QuadrilateralSheet, shared: Mask, flats: Array, size: float
    ) -> Array:
        """Return the nodes (N, 2), moved onto the side where they are near it."""
        edges, counts = np.unique(np.sort(_edges(sheet), axis=1), axis=0, return_counts=True)
        is_boundary = np.zeros(len(sheet.points), bool)
        is_boundary[edges[counts == 1]] = True
        is_level = np.abs(sheet.points[:, :1] - flats).min(axis=1) <= _ON_AXIS * size
        side_nodes = np.flatnonzero(is_boundary & ~shared & ~is_level)
        at, points = self._positions, self._samples[:, ::-1]
        _, nearest_samples = KDTree(points).query(sheet.points[side_nodes])
        nearest_samples = np.clip(nearest_samples, 1, len(at) - 2)
        # Foot of the perpendicular on the chord at the nearest sample, then on the curve.
        start, end = points[nearest_samples - 1], points[nearest_samples + 1]
        chords = end - start
        fractions = np.sum((sheet.points[side_nodes] - start) * chords, axis=1) / np.sum(
            chords**2, axis=1
        )
        place = at[nearest_samples - 1] + np.clip(fractions, 0, 1) * (
            at[nearest_samples + 1] - at[nearest_samples - 1]
        )
        result = sheet.points.copy()
        result[side_nodes] = self.side.at(place)[:, ::-1]
        return result

    def places(self) -> Points:
        """Return points (r, z) by name."""
        bottom, side, rim, top = self.side.at(self.length * np.array([0.0, 0.5, 1 - INSET, 1.0]))
        return {"top": top * (0, 1), "bottom": bottom * (0, 1), "side": side, "rim": rim}


def _edges(sheet: QuadrilateralSheet) -> Index:
    """Return the two halves of each side of the quadrilaterals (8 Q, 2)."""
    outline_nodes = sheet.quads[:, [0, 4, 1, 5, 2, 6, 3, 7]]
    return np.stack([outline_nodes, np.roll(outline_nodes, -1, axis=1)], axis=-1).reshape(-1, 2)
