"""Timbre fields as pictures: the directivity of a mode, and the brightness of a strike around."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError
from struck.excitation.strike import Strike
from struck.model.arrays import Array, Complex, Mask, checked
from struck.model.gains import Gains, ShapeGains
from struck.model.model import ModalModel
from struck.radiation.directivity import RadiatingGains
from struck.radiation.multipoles import CLOSE
from struck.report.charts import BLUE, FAINT, INK, ORANGE, chart, overview, save
from struck.scene.body import centre_of, radius_of
from struck.scene.render import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BRIGHTNESS = "brightness"
_RANGE = 30.0  # levels shown below the loudest direction, dB
_FAR = 20.0  # radii, from where directions are told
_UNKNOWN = 0.1  # m: radius of a body of which none is known
_AROUND, _POLAR = 96, 49  # directions of the balloon
_SPAN, _CELLS = 4.0, 121  # of slices: radii from the centre, points along an edge
_AT_ONCE = 256  # places
_PLANES = (("above", 0, 1), ("front", 0, 2), ("side", 1, 2))  # name, axis across, axis up
_BODY = "#cfcfcf"


@checked
def picture_of(
    model: ModalModel,
    path: str | os.PathLike[str] | None = None,
    field: int | str | None = None,
) -> Figure:
    """Draw a model, or its timbre field, as `struck.show` does, and save it where a path says."""
    if field is None:
        figure = overview(model, render(model, Strike()))
    elif not model.gains.directional:
        raise OptionError(
            "the model has no timbre field, it is heard alike on all sides: compute one with "
            "model.radiating(), or fit recordings at several places"
        )
    else:
        figure = _slices(model) if field == BRIGHTNESS else _directivity(model, field)
    if path is not None:
        save(figure, path)
    return figure


# The directivity of a mode: a balloon as far out as it is loud there, in dB, and three cuts.


def _directivity(model: ModalModel, mode: int | str) -> Figure:
    if isinstance(mode, str) or not 0 <= mode < len(model.frequencies):
        raise OptionError(
            f"field is {mode!r}: give the number of a mode, 0 to {len(model.frequencies) - 1}, or "
            f"{BRIGHTNESS!r}"
        )
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, _POLAR), np.linspace(0, 2 * np.pi, _AROUND + 1), indexing="ij"
    )
    flat = np.sin(polar)
    ways = np.stack([flat * np.cos(around), flat * np.sin(around), np.cos(polar)], axis=-1)
    powers = _powers(model, ways.reshape(-1, 3), mode).reshape(polar.shape)
    mean = (powers[:, :-1] * flat[:, :-1]).sum() / flat[:, :-1].sum()
    figure = chart(10.0, 5.2)
    figure.suptitle(
        f"mode {mode}: {model.frequencies[mode]:.0f} Hz, loudest "
        f"{10 * np.log10(powers.max() / mean):.1f} dB above the mean over directions",
        fontsize=12,
        color=INK,
    )
    _draw_balloon(figure, ways, _shown(powers / powers.max()))
    cuts = figure.add_subplot(1, 2, 2, projection="polar")
    angles = np.linspace(0, 2 * np.pi, 361)
    for (name, across, up), colour in zip(_PLANES, (BLUE, ORANGE, FAINT), strict=True):
        ring = np.zeros((len(angles), 3))
        ring[:, across], ring[:, up] = np.cos(angles), np.sin(angles)
        radii = _shown(_powers(model, ring, mode) / powers.max())
        label = f"from {name}: {'xyz'[across]} right, {'xyz'[up]} up"
        cuts.plot(angles, radii, color=colour, label=label)
    cuts.set_yticks([0, 10, 20, 30], [f"{level - _RANGE:g} dB" for level in (0, 10, 20, 30)])
    cuts.set_ylim(0, _RANGE)
    cuts.tick_params(labelsize=8, labelcolor=FAINT)
    cuts.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), fontsize=8, frameon=False)
    return figure


def _draw_balloon(figure: Figure, ways: Array, radii: Array) -> None:
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d import Axes3D

    axes = figure.add_subplot(1, 2, 1, projection="3d")
    if not isinstance(axes, Axes3D):
        raise TypeError(f"{axes!r} is flat")
    x, y, z = np.moveaxis(ways * radii[..., None], -1, 0)
    colours = colormaps["viridis"](radii / _RANGE)
    axes.plot_surface(x, y, z, facecolors=colours, rstride=1, cstride=1, linewidth=0)
    limits = (-_RANGE, _RANGE)
    axes.set(xlim=limits, ylim=limits, zlim=limits, xlabel="x", ylabel="y", zlabel="z")
    axes.set(xticklabels=[], yticklabels=[], zticklabels=[])
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=22, azim=-58)


def _powers(model: ModalModel, ways: Array, mode: int) -> Array:
    """Return squares of a mode's gain far away along unit ways (P, 3): (P,)."""
    far = _FAR * (radius_of(model) or _UNKNOWN)
    heard = _toward(model.gains, centre_of(model) + far * ways)[:, :, mode]
    return np.square(np.abs(heard)).sum(axis=1)


def _shown(shares: Array) -> Array:
    """Return how far out a share of the loudest power is drawn, dB above the lowest level."""
    return np.maximum(_RANGE + 10 * np.log10(np.maximum(shares, 1e-30)), 0.0)


# Brightness of a strike on three planes through the centre, as figure 5 of 2007.


def _slices(model: ModalModel) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    centre = centre_of(model)
    reach = _SPAN * (radius_of(model) or _UNKNOWN)
    line = np.linspace(-reach, reach, _CELLS)
    figure = chart(12.0, 4.6)
    figure.suptitle("brightness of a strike: the centroid of its spectrum", fontsize=12, color=INK)
    panels = figure.subplots(1, 3)
    drawn = [_brightness(model, centre, line, across, up) for _, across, up in _PLANES]
    known = np.concatenate([values[np.isfinite(values)] for values in drawn])
    scale = LogNorm(*np.percentile(known, (1, 99)))
    for axes, (name, across, up), values in zip(panels, _PLANES, drawn, strict=True):
        axes.set_facecolor(_BODY)
        axes.pcolormesh(
            centre[across] + line, centre[up] + line, values, norm=scale, cmap="viridis",
            rasterized=True,
        )  # fmt: skip
        axes.set(xlabel=f"{'xyz'[across]} (m)", ylabel=f"{'xyz'[up]} (m)", aspect="equal")
        axes.set_title(f"from {name}", fontsize=10, color=INK)
    bar = figure.colorbar(ScalarMappable(scale, "viridis"), ax=list(panels), pad=0.01, label="Hz")
    ticks = np.geomspace(scale.vmin or 1.0, scale.vmax or 1.0, 5)
    bar.set_ticks(ticks.tolist(), labels=[f"{each:.0f}" for each in ticks], minor=False)
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine
    return figure


def _brightness(model: ModalModel, centre: Array, line: Array, across: int, up: int) -> Array:
    """Return centroids (n, n), Hz, on a plane through the centre; NaN where nothing is known."""
    places = np.tile(centre, (len(line) ** 2, 1))
    places[:, across] += np.tile(line, len(line))
    places[:, up] += np.repeat(line, len(line))
    contact = model.contact(None)
    drives = model.gains.at(contact.point[None], contact.direction[None])[0]
    lasting = 1 / np.maximum(model.decays, 1e-3 * model.natural_frequencies)
    values, known = np.full(len(places), np.nan), _known(model, places - centre, places)
    gains = (_toward(model.gains, places[known]) * drives).sum(axis=1)
    energies = np.square(np.abs(gains)) * lasting
    total = energies.sum(axis=1)
    values[known] = energies @ model.frequencies / np.where(total > 0, total, np.nan)
    return values.reshape(len(line), len(line))


def _known(model: ModalModel, apart: Array, places: Array) -> Mask:
    """Return which places (P,) are outside of a body, and of where its field is not known."""
    gains, distances = model.gains, np.linalg.norm(apart, axis=1)
    if not isinstance(gains, ShapeGains):
        return distances > max(getattr(gains, "radius", 0.0), 1e-6)
    if isinstance(gains, RadiatingGains) and not gains.near:
        return distances >= CLOSE * gains.field.radius
    close = np.flatnonzero(distances < gains.radius)
    known = np.ones(len(places), np.bool_)
    if len(close):
        known[close] = ~gains.locator.holds(places[close])
    return known


def _toward(gains: Gains, places: Array) -> Complex:
    """Return outputs (P, R, M) at places (P, 3), some at a time, so that memory does not grow."""
    parts = [gains.toward(places[n : n + _AT_ONCE]) for n in range(0, len(places), _AT_ONCE)]
    return np.concatenate(parts)
