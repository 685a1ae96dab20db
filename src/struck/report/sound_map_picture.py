"""A sound map as a picture: its body coloured by brightness, stored contacts marked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from struck.model.arrays import Array, Mask
from struck.model.mesh import Mesh
from struck.perception.auditory_scale import integrated
from struck.perception.sound_map import SoundMap
from struck.report.surface_picture import Painter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

_COLOURS = "viridis"  # as bright as the sound, and the colour-blind can read it
_SILENT, _INK, _FAINT = "#d9d9d9", "#222222", "#6b6b6b"


def sound_map_picture(sound_map: SoundMap, *, cells: bool = True) -> Figure:
    """Draw a sound map coloured by brightness: the centroid of the spectrum.

    Parameters
    ----------
    sound_map : SoundMap
    cells : bool
        Beside what the body sounds like, draw what the map plays: the cells that share a sound.

    Returns
    -------
    Figure
        Seen from above the longer side; grey where the body is silent, dots at stored contacts.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    scene = _Scene.of(sound_map)
    panels = [("the body", _heard(sound_map, sound_map.brightness))]
    if cells:
        played = np.repeat(sound_map.stored_brightness[sound_map.owners][:, None], 3, axis=1)
        panels.append(("the map", _heard(sound_map, played)))
    shown = np.concatenate([values[scene.facing].ravel() for _, values in panels])
    low, high = _range(shown)
    scale = LogNorm(low, high)
    figure = Figure(
        figsize=scene.size(len(panels)), dpi=120, layout="constrained", facecolor="white"
    )
    figure.suptitle(_title(sound_map, len(scene.dots)), fontsize=11, color=_INK)
    drawn = figure.subplots(scene.rows(len(panels)), scene.columns(len(panels)), squeeze=False)
    for axes, (title, values) in zip(drawn.flat, panels, strict=True):
        scene.paint(axes, values, scale)
        axes.set_title(title, fontsize=10, color=_INK)
    bar = figure.colorbar(
        ScalarMappable(scale, _COLOURS), ax=list(drawn.flat), location="bottom", shrink=0.6,
        aspect=45, pad=0.03,
    )  # fmt: skip
    _label(bar.ax, low, high)
    return figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scene:
    """What the eye sees of a map: places (F, 3, 2) of triangles, those that face it, and dots."""

    surface: Mesh
    places: Array
    depths: Array
    facing: Mask
    dots: Array

    @classmethod
    def of(cls, sound_map: SoundMap) -> _Scene:
        view = Painter.of(_box(sound_map.surface)).view
        seen = sound_map.surface.points[sound_map.surface.faces] @ view.T
        first, second = seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0]
        toward = -sound_map.directions @ view[2] > 0
        return cls(
            surface=sound_map.surface,
            places=seen[:, :, :2],
            depths=seen[:, :, 2].mean(axis=1),
            facing=first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0,
            dots=(sound_map.contacts @ view.T)[toward, :2],
        )

    @property
    def aspect(self) -> float:
        """Width over height of a panel."""
        width, height = np.ptp(self.places.reshape(-1, 2), axis=0)
        return float(np.clip(width / max(height, 1e-9 * width), 0.25, 12.0))

    def columns(self, count: int) -> int:
        """Return how many panels stand side by side: flat bodies go below each other."""
        return 1 if self.aspect > 2.5 else count

    def rows(self, count: int) -> int:
        """Return how many rows the panels make."""
        return -(-count // self.columns(count))

    def size(self, count: int) -> tuple[float, float]:
        """Return width and height of the figure, inches."""
        width = min(9.0, 4.6 * max(1.0, self.aspect / 1.4))
        height = float(np.clip(width / self.aspect, 0.8, 6.5)) + 0.4
        return width * self.columns(count), height * self.rows(count) + 1.3

    def paint(self, axes: Axes, values: Array, scale: Normalize) -> None:
        """Draw the triangles in the colours of their corners' values (F, 3), and the dots."""
        import matplotlib as mpl
        from matplotlib.collections import TriMesh
        from matplotlib.tri import Triangulation

        order = np.flatnonzero(self.facing)
        order = order[np.argsort(self.depths[order])]
        across, upward = self.places[order].reshape(-1, 2).T
        shades = TriMesh(Triangulation(across, upward, np.arange(len(across)).reshape(-1, 3)))
        colours = mpl.colormaps[_COLOURS].with_extremes(bad=_SILENT)
        painted = colours(scale(np.ma.masked_invalid(values[order].ravel())))
        shades.set(facecolor=painted, rasterized=True)
        axes.add_collection(shades, autolim=False)
        axes.plot(*self.dots.T, "o", ms=3, mfc="white", mec=_INK, mew=0.7)
        low, high = self.places.reshape(-1, 2).min(axis=0), self.places.reshape(-1, 2).max(axis=0)
        margin = 0.03 * (high - low).max()
        axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        axes.set_aspect("equal")
        axes.set_axis_off()


def _box(surface: Mesh) -> Mesh:
    """Return one triangle with a surface's bounds: its point of view without its triangles."""
    low, high = surface.bounds
    corners = np.stack([low, [high[0], low[1], low[2]], high])
    return Mesh(points=corners, faces=np.array([[0, 1, 2]]), up=surface.up)


def _range(values: Array) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return 20.0, 20_000.0
    low, high = (float(each) for each in np.percentile(known, [1, 99]))
    return (low, high) if high > 1.01 * low else (low / 1.1, high * 1.1)


def _label(axes: Axes, low: float, high: float) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    steps = np.geomspace(1.03 * low, 0.97 * high, 5)
    digits = 10 ** (np.floor(np.log10(steps)) - 1)
    axes.xaxis.set_major_locator(FixedLocator((np.round(steps / digits) * digits).tolist()))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda hertz, _: f"{hertz:g}"))
    axes.set_xlabel("brightness: centroid of the spectrum (Hz)", fontsize=8, color=_FAINT)
    axes.tick_params(labelsize=8)


def _heard(sound_map: SoundMap, values: Array) -> Array:
    """Return values at corners (F, 3), NaN where the sound is below 0 dB."""
    energies = np.square(np.abs(sound_map.gains)) @ integrated(sound_map.decays)
    loudness = sound_map.factors * np.sqrt(energies)[sound_map.owners][:, None]
    return np.where(loudness > loudness.max() * 10 ** (-sound_map.level / 20), values, np.nan)


def _title(sound_map: SoundMap, seen: int) -> str:
    count = len(sound_map.contacts)
    return (
        f"{count} stored sound{'s' * (count != 1)}, {seen} on this side: at {sound_map.level:g} dB "
        f"no contact is farther than {sound_map.bound:.2f} dB from what is stored for it"
    )
