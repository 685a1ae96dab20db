"""Nodal lines: where the surface of a body stands still in a mode, seen on its broad side.

Chladni (Entdeckungen über die Theorie des Klanges, 1787) made them visible by sand on plates. Here
they are the zeros of a mode's motion along the normal, drawn over the outline of what is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.gains import ShapeGains
from struck.model.mesh import Mesh
from struck.model.picture_style import in_default_style
from struck.report.charts import FAINT, INK, chart, hertz

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FLAT = 0.5  # of the next larger extent: a body that thin is seen from its broad side
_ZERO = 1e-5  # of the largest motion along the normal: less is rounding, or an edge that is held
_IN_PLANE = 1e-3  # of the largest motion: a mode whose motion along the normal is less has no lines
_ENOUGH_FACES = 12_000  # of a body whose shapes are known beyond its vertices
_DEEP = 0.02  # of the extent: faces that far below others are hidden
_LEANING = 0.2  # cosine between the normal of a face of a flat body's broad side and the view
_PIXELS = 200  # along an edge of the picture in which hidden faces are searched
_STEEP = 3.0  # in a pixel of that picture a surface may rise by this many pixels
_PALE = 2.2  # times the largest motion, where colours would be full
_MARGIN = 0.03  # of the extent, around the outline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanView:
    """The visible side of a surface, in a plane."""

    points: Array  # (V, 2): of all vertices, to the right and upward, m
    faces: Index  # (F, 3): that are seen, numbers of vertices
    normals: Array  # (V, 3): unit, outward, of the visible side
    name: str  # from where it is seen

    @classmethod
    def of(cls, surface: Mesh) -> PlanView:
        """Look at a flat body's broad side, at others from above."""
        view, name = _view(surface)
        seen = surface.points @ view.T
        # The faces of a thin edge are no part of the broad side, though some lean toward the eye.
        least = _LEANING if np.ptp(seen[:, 2]) <= _FLAT * np.ptp(seen[:, :2], axis=0).min() else 0
        front = np.flatnonzero(surface.face_normals @ view[2] > least)
        front = front[~_hidden(seen[surface.faces[front]], _DEEP * surface.extent)]
        faces = surface.faces[front]
        normals = np.zeros_like(surface.points)
        for corner in faces.T:
            np.add.at(normals, corner, surface.area_vectors[front])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.maximum(lengths, np.finfo(float).tiny)
        return cls(points=seen[:, :2], faces=faces, normals=normals, name=name)

    def outline(self) -> Array:
        """Return the edges of the visible faces, as segments (S, 2, 2)."""
        return self.points[_border(self.faces)]

    def motion(self, shape: Array) -> Array:
        """Return the motion of the vertices along the normal (V,) in a mode (V, 3).

        It is a share of the largest motion; zero everywhere in a mode that moves in the plane.
        """
        seen = np.unique(self.faces)
        along = np.zeros(len(shape))
        along[seen] = np.einsum("vd,vd->v", shape[seen], self.normals[seen])
        largest = np.abs(along).max(initial=0.0)
        if largest <= _IN_PLANE * np.linalg.norm(shape, axis=1).max():
            return np.zeros(len(shape))
        return along / largest

    def nodal_lines(self, motion: Array) -> Array:
        """Return where a motion (V,) along the normal is zero, as segments (S, 2, 2)."""
        return zero_lines(self.points, self.faces, motion)


def zero_lines(points: Array, faces: Index, values: Array) -> Array:
    """Return segments (S, 2, 2) on which values (V,), linear on triangles (F, 3), pass zero.

    Triangles at a border that is held, where all is zero, have none.
    """
    largest = np.abs(values).max(initial=0.0)
    is_moving = np.abs(values) > _ZERO * largest
    edges = _border(faces)
    is_held = np.zeros(len(values), np.bool_)
    is_held[edges[~is_moving[edges].any(axis=1)]] = True
    # Zero counts as above zero, so that each line is found once, from below.
    is_negative = values[faces] < 0
    is_crossed = is_negative.any(axis=1) & ~is_negative.all(axis=1)
    is_crossed &= is_moving[faces].any(axis=1) & ~is_held[faces].any(axis=1)
    start = faces[is_crossed]
    end = np.roll(start, -1, axis=1)
    through = (values[start] < 0) != (values[end] < 0)  # two edges of each triangle
    start, end = start[through], end[through]
    shares = values[start] / (values[start] - values[end])
    ends = points[start] + shares[:, None] * (points[end] - points[start])
    return ends.reshape(-1, 2, 2)


def _border(faces: Index) -> Index:
    """Return the edges (E, 2) that one triangle (F, 3) has alone."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, counts = np.unique(edges, axis=0, return_counts=True)
    return edges[counts == 1]


@in_default_style
def draw_nodal_lines(gains: ShapeGains, frequencies: Array, title: str) -> Figure:
    """Draw the first modes from their broad side: nodal lines, and which way each part moves."""
    from matplotlib.collections import LineCollection

    count = len(frequencies)
    surface, shapes = _refined(gains, count)
    plan = PlanView.of(surface)
    columns = math.ceil(math.sqrt(count))
    rows = -(-count // columns)
    low, high = plan.points[plan.faces].min(axis=(0, 1)), plan.points[plan.faces].max(axis=(0, 1))
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.12, 2.5))
    figure = chart(3.0 * columns, (2.9 * aspect + 0.45) * rows + 0.9)
    around = f"{title}, seen from {plan.name}" if title else f"seen from {plan.name}"
    figure.suptitle(f"{around}\nblack: nodal lines; red and blue move opposite ways", fontsize=10)
    grid = figure.subplots(rows, columns, squeeze=False)
    outline = plan.outline()
    for mode, axes in enumerate(grid.flat):
        axes.set_axis_off()
        if mode >= count:
            continue
        motion = plan.motion(shapes[:, :, mode])
        _shade(axes, plan, motion)
        axes.add_collection(LineCollection(list(outline), colors=FAINT, linewidths=0.8))
        lines = plan.nodal_lines(motion)
        axes.add_collection(
            LineCollection(list(lines), colors=INK, linewidths=1.7, capstyle="round")
        )
        # Across a string a line is shorter than a pixel, of which the renderer draws nothing.
        axes.plot(*lines.reshape(-1, 2).T, "o", color=INK, markersize=1.7, markeredgewidth=0)
        remark = "" if motion.any() else "\nmoves in its plane"
        axes.set_title(f"{mode + 1}:  {hertz(frequencies[mode])}{remark}", fontsize=9, color=INK)
        margin = _MARGIN * float((high - low).max())
        axes.set(xlim=(low[0] - margin, high[0] + margin), aspect="equal")
        axes.set(ylim=(low[1] - margin, high[1] + margin))
    size = rounded(1e3 * float((high - low)[0]), 3)
    figure.text(0.01, 0.005, f"width {size} mm", fontsize=8, color=FAINT)
    return figure


def _refined(gains: ShapeGains, count: int) -> tuple[Mesh, Array]:
    """Return the surface and its first mode shapes (V, 3, count): finer where they are known."""
    surface = gains.surface
    if gains.formula is None:
        return surface, gains.shapes[:, :, :count].astype(np.float64)
    formula = gains.formula.chosen(np.arange(count))
    while len(surface.faces) < _ENOUGH_FACES:
        surface = _quartered(surface)
    return surface, formula.displacements(surface.points)


def _quartered(surface: Mesh) -> Mesh:
    """Return a surface with each triangle split at the midpoints of its edges."""
    faces = surface.faces
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, number = np.unique(edges, axis=0, return_inverse=True)
    middles = len(surface.points) + number.reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = faces.T, middles.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    points = np.concatenate([surface.points, surface.points[edges].mean(axis=1)])
    return Mesh(
        points=points, faces=np.concatenate([np.column_stack(p) for p in parts]), up=surface.up
    )


def _shade(axes: Axes, plan: PlanView, motion: Array) -> None:
    """Draw which way each part moves, in pale colours."""
    from matplotlib.tri import Triangulation

    across, upward = plan.points.T
    seen = Triangulation(across, upward, plan.faces)
    pale = {"cmap": "RdBu_r", "vmin": -_PALE, "vmax": _PALE, "rasterized": True}
    axes.tripcolor(seen, motion, shading="gouraud", **pale)


def _view(surface: Mesh) -> tuple[Array, str]:
    """Return unit vectors right, upward and toward the eye (3, 3), and from where that is."""
    weights = np.linalg.norm(surface.area_vectors, axis=1)
    offsets = surface.centroids - np.average(surface.centroids, axis=0, weights=weights)
    axes = np.linalg.eigh(np.einsum("f,fi,fj->ij", weights, offsets, offsets))[1].T[::-1]
    spans = np.ptp(surface.points @ axes.T, axis=0)
    up = "xyz".index(surface.up)
    thin_axis = int(np.argmin(spans))
    eye_direction = (
        axes[thin_axis] if spans[thin_axis] <= _FLAT * np.sort(spans)[1] else np.eye(3)[up]
    )
    # A body whose broad side faces along an axis, within rounding, is seen along that.
    nearest_axis = int(np.argmax(np.abs(eye_direction)))
    if abs(eye_direction[nearest_axis]) > 1 - 1e-6:
        eye_direction = np.eye(3)[nearest_axis]
    eye_direction = eye_direction * (
        1.0 if eye_direction[np.argmax(np.abs(eye_direction))] > 0 else -1.0
    )
    # To the right the axis of the body's coordinates that has most of its extent across.
    projector = np.eye(3) - np.outer(eye_direction, eye_direction)
    lengths = np.ptp(surface.points @ projector, axis=0) * np.linalg.norm(projector, axis=1)
    right_direction = projector[int(np.argmax(np.round(lengths / surface.extent, 6)))]
    right_direction = right_direction / np.linalg.norm(right_direction)
    name = f"+{'xyz'[nearest_axis]}" if eye_direction[nearest_axis] == 1 else "its broad side"
    return np.stack(
        [right_direction, np.cross(eye_direction, right_direction), eye_direction]
    ), name


def _hidden(corners: Array, deep: float) -> Mask:
    """Return which triangles (F, 3, 3), seen along the last axis, lie well behind others."""
    shares = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4), (0, 1, 1), (1, 0, 1), (1, 1, 0)])
    shares = shares / shares.sum(axis=1, keepdims=True)
    samples = np.einsum("pc,fcd->fpd", shares, corners)
    low = samples[..., :2].min(axis=(0, 1))
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    width = (samples[..., :2].max(axis=(0, 1)) - low).max()
    step = max(width / _PIXELS, 0.5 * float(np.quantile(edges, 0.9)))  # as far apart as samples
    cells = ((samples[..., :2] - low) / step).astype(int) @ np.array([1, _PIXELS + 1])
    nearest = np.full((_PIXELS + 1) ** 2, -np.inf)
    np.maximum.at(nearest, cells, samples[..., 2])
    return samples[:, 0, 2] < nearest[cells[:, 0]] - max(deep, _STEEP * step)
