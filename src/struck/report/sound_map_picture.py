"""A sound map as a picture: its body coloured by brightness, stored contacts marked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import counted, rounded
from struck.model.arrays import Array, Index, checked
from struck.model.picture_style import in_default_style
from struck.perception.auditory_scale import integrated
from struck.perception.sound_map import SoundMap
from struck.report.charts import FAINT, INK, chart
from struck.report.surface_picture import facing, frame, shade, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

_COLOURS = "viridis"  # as bright as the sound, and the colour-blind can read it
_SILENT = "#d9d9d9"


@in_default_style
@checked
def sound_map_picture(sound_map: SoundMap, *, cells: bool = True) -> Figure:
    """Draw the spectral centroid over the contacts of a sound map.

    Parameters
    ----------
    sound_map : SoundMap
        The map.
    cells : bool, default True
        Draw also the map: the spectral centroids of the stored sounds.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    scene = _Scene.of(sound_map)
    panels = [("the body", _mask_inaudible(sound_map, sound_map.brightness))]
    if cells:
        played = np.repeat(sound_map.stored_brightness[sound_map.owners][:, None], 3, axis=1)
        panels.append(("the map", _mask_inaudible(sound_map, played)))
    low, high = _range(np.concatenate([values[scene.order].ravel() for _, values in panels]))
    scale = LogNorm(low, high)
    columns = scene.columns(len(panels))
    rows = -(-len(panels) // columns)
    figure = chart(scene.width * columns, scene.height * rows + 1.3)
    figure.suptitle(_title(sound_map, len(scene.dots)), fontsize=11, color=INK)
    panel_axes = figure.subplots(rows, columns, squeeze=False)
    for axes, (title, values) in zip(panel_axes.flat, panels, strict=True):
        scene.paint(axes, values, scale)
        axes.set_title(title, fontsize=10, color=INK)
    bar = figure.colorbar(
        ScalarMappable(scale, _COLOURS), ax=list(panel_axes.flat), location="bottom", shrink=0.6,
        aspect=45, pad=0.03,
    )  # fmt: skip
    _label(bar.ax, low, high)
    return figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scene:
    """The triangles of a map and its stored contacts, seen from above the longer side."""

    places: Array  # (F, 3, 3): of the triangles, the last coordinate toward the eye
    order: Index  # of those that face the eye, farthest first
    dots: Array  # (K, 2): stored contacts on that side

    @classmethod
    def of(cls, sound_map: SoundMap) -> _Scene:
        view = view_of(sound_map.surface)
        seen = sound_map.surface.points[sound_map.surface.faces] @ view.T
        is_visible = -sound_map.directions @ view[2] > 0
        dots = (sound_map.contacts @ view.T)[is_visible, :2]
        return cls(places=seen, order=facing(seen), dots=dots)

    @property
    def aspect(self) -> float:
        """Width over height of a panel."""
        width, height = np.ptp(self.places[:, :, :2].reshape(-1, 2), axis=0)
        return float(np.clip(width / max(height, 1e-9 * width), 0.25, 12.0))

    def columns(self, count: int) -> int:
        """Return how many panels stand side by side: flat bodies go below each other."""
        return 1 if self.aspect > 2.5 else count

    @property
    def width(self) -> float:
        """Width of a panel, inches."""
        return min(9.0, 4.6 * max(1.0, self.aspect / 1.4))

    @property
    def height(self) -> float:
        """Height of a panel, inches."""
        return float(np.clip(self.width / self.aspect, 0.8, 6.5)) + 0.4

    def paint(self, axes: Axes, values: Array, scale: Normalize) -> None:
        """Draw the triangles in the colours of their corners' values (F, 3), and the dots."""
        import matplotlib as mpl

        colours = mpl.colormaps[_COLOURS].with_extremes(bad=_SILENT)
        face_colours = colours(scale(np.ma.masked_invalid(values[self.order].ravel())))
        shade(axes, self.places[self.order, :, :2], face_colours)
        axes.plot(*self.dots.T, "o", ms=3, mfc="white", mec=INK, mew=0.7)
        flat = self.places[:, :, :2].reshape(-1, 2)
        low, high = flat.min(axis=0), flat.max(axis=0)
        margin = 0.03 * (high - low).max()
        frame(axes, low - margin, high + margin)


def _range(values: Array) -> tuple[float, float]:
    finite_values = values[np.isfinite(values)]
    if not len(finite_values):
        return 20.0, 20_000.0
    low, high = (float(value) for value in np.percentile(finite_values, [1, 99]))
    return (low, high) if high > 1.01 * low else (low / 1.1, high * 1.1)


def _label(axes: Axes, low: float, high: float) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    steps = np.geomspace(1.03 * low, 0.97 * high, 5)
    digits = 10 ** (np.floor(np.log10(steps)) - 1)
    axes.xaxis.set_major_locator(FixedLocator((np.round(steps / digits) * digits).tolist()))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda hertz, _: rounded(hertz)))
    axes.set_xlabel("brightness: centroid of the spectrum (Hz)", fontsize=8, color=FAINT)
    axes.tick_params(labelsize=8)


def _mask_inaudible(sound_map: SoundMap, values: Array) -> Array:
    """Return values at corners of faces (F, 3), NaN where the sound is below the map's level."""
    energies = np.square(np.abs(sound_map.gains)) @ integrated(sound_map.decays)
    loudness = sound_map.factors * np.sqrt(energies)[sound_map.owners][:, None]
    return np.where(loudness > loudness.max() * 10 ** (-sound_map.level / 20), values, np.nan)


def _title(sound_map: SoundMap, seen: int) -> str:
    return (
        f"{counted(len(sound_map.contacts), 'stored sound')}, {seen} on this side: at "
        f"{rounded(sound_map.level)} dB no contact is farther than {sound_map.bound:.2f} dB from "
        "what is stored for it"
    )
