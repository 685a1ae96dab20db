"""A surface as shaded, coloured triangles seen from one side, farthest first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh, Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MOST_FACES = 20_000  # surfaces of more faces are drawn with about this number
_COLOURS = "RdBu_r"  # diverges from white, and the colour-blind can read it
_FEWEST_FACES = 3_000
_EXAGGERATION = 0.06
_ELEVATION = np.deg2rad(24)
_CLAY = np.array([0.80, 0.81, 0.83])
_LIGHT = np.array([-0.42, 0.58, 0.70])
_OUTLINE, _FAINT = "#3a3a3a", "#6b6b6b"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Painter:
    """A surface with a point of view."""

    surface: Mesh  # as drawn
    sources: sparse.csr_array  # weights of the body's vertices at those drawn
    view: Array  # (3, 3): as `view_of`
    remark: str = ""  # how it was simplified, if it was

    @classmethod
    def of(cls, surface: Mesh) -> Painter:
        """Look at a surface from above its longer side."""
        drawn = _thinned(surface) if len(surface.faces) > MOST_FACES else surface
        sources, remark = sparse.eye_array(len(surface.points), format="csr"), ""
        if len(drawn.faces) < len(surface.faces):
            remark = f"\ndrawn with {len(drawn.faces):,} of {len(surface.faces):,} faces"
            sources = _interpolation(surface, drawn.points)
        return cls(surface=drawn, sources=sources, view=view_of(surface), remark=remark)

    @property
    def aspect(self) -> float:
        """Width over height of the picture."""
        width, height = np.ptp(self._frame(), axis=0)
        return float(width / height)

    def paint(self, axes: Axes, shape: Array | None = None, *, signed: bool = False) -> None:
        """Draw the body at rest, or displaced by a shape (V, 3) of either sign or as `signed`."""
        if shape is None:
            self._draw(axes, self.surface, None)
            return
        moves = self.sources @ shape
        moves = moves / max(np.linalg.norm(moves, axis=1).max(), np.finfo(float).tiny)
        normals = self.surface.corner_normals
        outward = np.einsum("fcd,fcd->fc", moves[self.surface.faces], normals)
        sign = 1.0 if signed or outward.max() >= -outward.min() else -1.0
        points = self.surface.points + sign * _EXAGGERATION * self.surface.extent * moves
        self._draw(axes, Mesh(points=points, faces=self.surface.faces), sign * outward)

    def paint_modes(
        self,
        figure: Figure | SubFigure,
        shapes: Sequence[Array],
        titles: Sequence[str],
        captions: Sequence[str],
        *,
        columns: int | None = None,
        signed: bool = False,
    ) -> list[Axes]:
        """Draw shapes (V, 3) in rows, a title above and a caption below each, and the scale."""
        columns = len(shapes) if columns is None else columns
        grid = figure.subplots(-(-len(shapes) // columns), columns, squeeze=False)
        panels = list(grid.flat)[: len(shapes)]
        for empty in grid.flat[len(shapes) :]:
            empty.set_axis_off()
        for axes, shape, title, caption in zip(panels, shapes, titles, captions, strict=True):
            self.paint(axes, shape, signed=signed)
            axes.set_title(title, fontsize=10)
            place = {"transform": axes.transAxes, "ha": "center", "va": "top"}
            axes.text(0.5, 0.0, caption, fontsize=8, color=_FAINT, **place)
        _explain_colours(figure, list(grid.flat), self.remark)
        return panels

    def toward(self, direction: Array) -> Painter:
        """Look from the other side if a surface that faces along `direction` (3,) is hidden."""
        if self.view[2] @ direction >= 0:
            return self
        half_turn = np.where(np.arange(3) == "xyz".index(self.surface.up), 1.0, -1.0)
        return replace(self, view=self.view * half_turn)

    def _frame(self) -> Array:
        """Return the corners (2, 2) of the view, m."""
        flat = self.surface.points @ self.view[:2].T
        margin = _EXAGGERATION * self.surface.extent * 1.05
        return np.stack([flat.min(axis=0) - margin, flat.max(axis=0) + margin])

    def _draw(self, axes: Axes, surface: Mesh, values: Array | None) -> None:
        from matplotlib.collections import PolyCollection

        corners = _corners(surface, np.zeros(surface.faces.shape) if values is None else values)
        places, colours = _visible(corners, self.view, coloured=values is not None)
        outline = PolyCollection(
            cast("list[Array]", places), facecolors=_OUTLINE, edgecolors=_OUTLINE
        )
        outline.set(linewidth=1.6, rasterized=True, joinstyle="round")
        axes.add_collection(outline, autolim=False)
        shade(axes, places, colours.reshape(-1, 3))
        frame(axes, *self._frame())


def view_of(surface: Mesh) -> Array:
    """Return unit vectors to the right, upward and toward the eye, above the longer side (3, 3)."""
    up = "xyz".index(surface.up)
    first, second = (up + 1) % 3, (up + 2) % 3
    size = np.ptp(surface.bounds, axis=0)
    around = np.deg2rad(-62 if size[first] >= size[second] else -28)
    toward = np.zeros(3)
    toward[[first, second]] = np.cos(_ELEVATION) * np.array([np.cos(around), np.sin(around)])
    toward[up] = np.sin(_ELEVATION)
    right = np.cross(np.eye(3)[up], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def facing(places: Array) -> Index:
    """Return which triangles (F, 3, 3), seen along z, face the eye, farthest first."""
    first, second = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    front = np.flatnonzero(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0)
    return front[np.argsort(places[front, :, 2].mean(axis=1))]


def shade(axes: Axes, places: Array, colours: NDArray[np.floating]) -> None:
    """Draw triangles (F, 3, 2) in order, in the colours of their corners (3 F, 3 or 4)."""
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    across, upward = places.reshape(-1, 2).T
    shades = TriMesh(Triangulation(across, upward, np.arange(len(across)).reshape(-1, 3)))
    shades.set(facecolor=colours, rasterized=True)
    axes.add_collection(shades, autolim=False)


def frame(axes: Axes, low: Array, high: Array) -> None:
    """Show a rectangle from its low to its high corner (2,), m, with equal scales."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()


def _explain_colours(figure: Figure | SubFigure, panels: list[Axes], remark: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(-1, 1), _COLOURS)
    bar = figure.colorbar(scale, ax=panels, location="bottom", shrink=0.5, aspect=45, pad=0.03)
    bar.set_ticks([-1, 0, 1], labels=["inward", "0", "outward"], fontsize=8)
    bar.set_label(
        f"displacement along the normal, share of the largest (exaggerated in the shapes){remark}",
        fontsize=8,
    )
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine


def _thinned(surface: Mesh) -> Mesh:
    """Collapse short edges until few enough faces are left."""
    import igl

    points, faces = np.asfortranarray(surface.points), np.asfortranarray(surface.faces)
    moved, left, _, _ = igl.decimate(points, faces, MOST_FACES)
    faces_left = np.asarray(left, np.int64)
    if not len(faces_left):  # a surface that is no manifold is drawn whole
        return surface
    return Mesh(points=np.asarray(moved, np.float64), faces=faces_left, up=surface.up)


def _interpolation(surface: Mesh, points: Array) -> sparse.csr_array:
    """Return weights (K, V) of the vertices around the nearest places of `points` (K, 3)."""
    faces, weights = Surface(surface).barycentric(points)
    rows = np.repeat(np.arange(len(points)), 3)
    entries = (weights.ravel(), (rows, surface.faces[faces].ravel()))
    return sparse.csr_array(entries, shape=(len(points), len(surface.points)))


def _corners(surface: Mesh, values: Array) -> Array:
    """Return place, normal and one of `values` (F, 3) at all corners, small enough (F, 3, 7)."""
    places, normals = surface.points[surface.faces], surface.corner_normals
    corners = np.concatenate([places, normals, values[:, :, None]], axis=2)
    while len(corners) < _FEWEST_FACES:
        corners = _quartered(corners)
    return corners


def _quartered(corners: Array) -> Array:
    """Split each triangle at the midpoints of its edges: smoother shades on coarse surfaces."""
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    (a, b, c), (ab, bc, ca) = corners.swapaxes(0, 1), middles.swapaxes(0, 1)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def _visible(corners: Array, view: Array, *, coloured: bool) -> tuple[Array, Array]:
    """Return visible triangles (F, 3, 2), farthest first, and their corners' colours (F, 3, 3)."""
    places = corners[:, :, :3] @ view.T
    order = facing(places)
    values, normals = corners[order, :, 6], corners[order, :, 3:6] @ view.T
    base = np.broadcast_to(_CLAY, normals.shape)
    if coloured:
        import matplotlib as mpl

        base = mpl.colormaps[_COLOURS]((values + 1) / 2)[..., :3]
    return places[order, :, :2], _lit(base, normals)


def _lit(base: Array, normals: Array) -> Array:
    """Return colours under soft light from above and the left, with a little gloss."""
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    diffuse = 0.5 + 0.5 * (normals @ light)
    gloss = np.clip(normals @ (half / np.linalg.norm(half)), 0, 1) ** 40
    return np.clip(base * (0.45 + 0.58 * diffuse[..., None]) + 0.16 * gloss[..., None], 0, 1)
