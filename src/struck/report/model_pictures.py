"""Pictures of a model: its modes, its response to a blow, its timbre field, and recorded places."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError, counted, rounded
from struck.excitation.pulses import SPECTRA
from struck.excitation.strike import Strike
from struck.model.arrays import Array, Complex, Mask, checked, numbers, require_numbers
from struck.model.contact import Contact
from struck.model.gains import Gains, ShapeGains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.picture_style import in_default_style
from struck.radiation.directivity import RadiatingGains
from struck.radiation.multipoles import CLOSE
from struck.report.charts import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    chart,
    description,
    overview,
    quantity,
    save,
)
from struck.report.energy_picture import balance_picture, radiation_picture
from struck.report.nodal_lines import draw_nodal_lines
from struck.report.surface_picture import Painter
from struck.scene.body import centre_of, radius_of
from struck.scene.energy import Energy
from struck.scene.render import render

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

BRIGHTNESS = "brightness"
MOST_MODES = 64  # mode shapes in one picture
_INSTANTS = (0.125, 0.25, 0.5, 1.0)  # after a blow, periods of the lowest mode
_RANGE = 30.0  # levels shown below the loudest direction, dB
_FAR = 20.0  # radii, distance of the far field
_UNKNOWN = 0.1  # m: radius of a body of which none is known
_AROUND, _POLAR = 96, 49  # directions of the balloon
_SPAN, _CELLS = 4.0, 121  # of slices: radii from the centre, points along an edge
_AT_ONCE = 256  # places
_PLANES = (("above", 0, 1), ("front", 0, 2), ("side", 1, 2))  # name, axis across, axis up
_BODY = "#cfcfcf"
_SILENT = 1e-6  # of the power of the loudest place in slices: 60 dB below it counts as silent
_SOFT = "grey: the body, and where it is 60 dB softer than at the loudest place"
_LENGTH_TOLERANCE = 1e-6  # m
_WIDE = 8.0  # ratio of frequencies from which ticks at 1, 2 and 5 are enough


@checked
def show(
    model: ModalModel,
    path: str | os.PathLike[str] | None = None,
    *,
    field: int | str | None = None,
    strike: Strike | None = None,
    modes: int | None = None,
    nodal_lines: int | None = None,
    energy: bool | Energy = False,
) -> Figure:
    """Draw a model: its shape, its first modes and the spectrum of a strike.

    At most one of `field`, `strike`, `modes`, `nodal_lines` and `energy` selects another picture.

    Parameters
    ----------
    model : ModalModel
        The model.
    path : path, optional
        File to save the picture to; the ending selects the format.
    field : int or "brightness", optional
        Directivity of the mode of this index, or brightness of a strike in slices around the body.
    strike : Strike, optional
        Motion of the surface after this strike (O'Brien, Shen and Gatchalian 2002, figure 4).
    modes : int, optional
        Number of mode shapes to draw.
    nodal_lines : int, optional
        Number of modes to draw with their nodal lines (Chladni figures), from the broad side of a
        flat body, from above for others. Pictures count modes from 1.
    energy : bool or Energy, default False
        True: radiation efficiency of each mode, and the part of its energy that is lost as sound.
        A result of `struck.energy`: where that energy goes, in third octaves.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.

    Raises
    ------
    FileFormatError
        If the folder does not exist, or the ending is not that of a picture.
    OptionError
        If the model has no field, no such mode, no mode shapes or no calibrated radiation.
    ContactError
        If the contact of the strike is not on the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> figure = struck.show(model, "bar.png")
    """
    requests = {"field": field, "strike": strike, "modes": modes, "nodal_lines": nodal_lines}
    requests["energy"] = None if energy is False else energy
    names = [name for name, value in requests.items() if value is not None]
    if len(names) > 1:
        raise OptionError(f"{' and '.join(names)} are two pictures: give one at a time")
    if strike is not None:
        figure = _response(model, strike)
    elif modes is not None:
        figure = _mode_shapes(model, modes)
    elif nodal_lines is not None:
        count = _count(model, "nodal_lines", nodal_lines)
        gains, title = _surface_gains(model), description(model)
        figure = draw_nodal_lines(gains, model.frequencies[:count], title)
    elif energy is not False:
        figure = (
            balance_picture(model, energy)
            if isinstance(energy, Energy)
            else radiation_picture(model)
        )
    elif field is None:
        sound, contact = render(model, Strike()), model.contact()
        figure = overview(model, sound, at=contact.place if contact.point.size else "")
    elif not model.gains.directional:
        raise OptionError(
            "the model has no timbre field, it radiates equally in all directions: compute one "
            "with model.radiating(), or fit recordings at several places"
        )
    else:
        figure = _slices(model) if field == BRIGHTNESS else _directivity(model, field)
    if path is not None:
        save(figure, path)
    return figure


def _surface_gains(model: ModalModel) -> ShapeGains:
    if not isinstance(model.gains, ShapeGains) or not len(model.frequencies):
        raise OptionError(
            "the model has no mode shapes to draw, as those of recordings and of bodies without a "
            "mode in the band: analyze a body, or draw the model without strike=, modes= and "
            "nodal_lines="
        )
    return model.gains


def _count(model: ModalModel, name: str, count: int) -> int:
    """Return how many modes to draw, refused where there are not as many."""
    _surface_gains(model)
    most = min(MOST_MODES, len(model.frequencies))
    if not 0 < count <= most:
        raise OptionError(f"{name} is {count}: give 1 to {most}, as many as there are to draw")
    return count


# Mode shapes, as figure 4 of 1998, and the response of a surface to a blow, as figure 4 of 2002.


@in_default_style
def _mode_shapes(model: ModalModel, count: int) -> Figure:
    gains, count = _surface_gains(model), _count(model, "modes", count)
    columns = math.ceil(math.sqrt(count))
    painter = Painter.of(gains.surface)
    rows = -(-count // columns)
    figure = chart(3.2 * columns, (3.2 / np.clip(painter.aspect, 0.8, 4.0) + 0.5) * rows + 0.8)
    shapes = [gains.shapes[:, :, mode].astype(np.float64) for mode in range(count)]
    titles = [f"{n + 1}:  {value:.1f} Hz" for n, value in enumerate(model.frequencies[:count])]
    painter.paint_modes(figure, shapes, titles, [""] * count, columns=columns)
    return figure


@checked
def blow_response(model: ModalModel, strike: Strike, times: Array) -> tuple[Array, Array]:
    """Compute the motion of a surface after a strike, by its modes.

    Parameters
    ----------
    model : ModalModel
        Model with mode shapes.
    strike : Strike
        The strike.
    times : array (T,)
        Times from the middle of the strike, not before its end, s.

    Returns
    -------
    velocity : array (V, 3)
        Of the vertices if the blow took no time, m/s: its impulse projected on the modes.
    displacements : array (T, V, 3)
        Of the vertices, m, without the motion of the body as a whole.

    Raises
    ------
    OptionError
        If the model has no mode shapes, or times are negative or not finite.
    ContactError
        If the contact is not on the body.
    """
    gains = _surface_gains(model)
    times = numbers("times", times).reshape(-1)
    require_numbers("times", times, times.shape, least=0.0)
    contact = model.contact(strike.at, strike.direction)
    blow = strike.resolved(model, contact)
    drives = gains.at(contact.point[None], contact.direction[None]).reshape(-1)
    # A pulse of spectrum S about its middle leaves the motion of an impulse there, times S.
    lasting = SPECTRA[strike.shape](model.frequencies * blow.duration)
    rates = 2 * np.pi * model.frequencies
    swings = np.exp(-np.outer(times, model.decays)) * np.sin(np.outer(times, rates)) / rates
    shapes = gains.shapes.astype(np.float64)
    displacements = np.einsum("vdm,tm->tvd", shapes, blow.impulse * drives * lasting * swings)
    return shapes @ (blow.impulse * drives), displacements


@in_default_style
def _response(model: ModalModel, strike: Strike) -> Figure:
    gains = _surface_gains(model)
    contact = model.contact(strike.at, strike.direction)
    blow = strike.resolved(model, contact)
    times = blow.duration / 2 + np.array(_INSTANTS) / model.frequencies[0]
    velocity, displacements = blow_response(model, strike, times)
    painter = Painter.of(gains.surface).toward(-contact.direction)
    titles = [f"impulse on {counted(len(model.frequencies), 'mode')}"]
    titles += [f"{quantity(time - blow.duration / 2, 's', 3)} after the blow" for time in times]
    amplitudes = [np.linalg.norm(value, axis=1).max() for value in displacements]
    captions = [f"up to {quantity(np.linalg.norm(velocity, axis=1).max(), 'm/s')}"]
    captions += [f"up to {quantity(value, 'm')}" for value in amplitudes]
    figure = chart(13.0, float(np.clip(2.6 / painter.aspect, 1.4, 4.2)) + 1.6)
    during = f" in {quantity(blow.duration, 's')}" if blow.duration else ""
    title = f"response to a blow of {quantity(blow.impulse, 'N s')}{during} at {contact.place}"
    figure.suptitle(title, fontsize=12, color=INK)
    panels = painter.paint_modes(figure, [velocity, *displacements], titles, captions, signed=True)
    panels[0].plot(*(painter.view[:2] @ contact.point), "o", color=ORANGE, ms=7, mec="white")
    return figure


# Where a field is recorded, as figure 4 of 2007.


def _places(name: str, places: Array) -> Array:
    rows = numbers(name, places, width=3).reshape(-1, 3)
    require_numbers(name, rows, rows.shape)
    return rows


@in_default_style
@checked
def grid_picture(
    contacts: Array,
    listeners: Array,
    *,
    directions: Array | None = None,
    surface: Mesh | None = None,
) -> Figure:
    """Draw contacts as arrows and listeners as dots around a body.

    Parameters
    ----------
    contacts : array (P, 3)
        Contacts in body coordinates, m.
    listeners : array (Q, 3)
        Listeners in body coordinates, m.
    directions : array (P, 3), optional
        Direction of the push at each contact. Default: toward the z axis.
    surface : Mesh, optional
        The body, m.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    OptionError
        When there is nothing to draw, or places are not finite.
    """
    contact_points, listener_points = _places("contacts", contacts), _places("listeners", listeners)
    reach = max(float(np.abs(np.concatenate([contact_points, listener_points])).max()), 1e-3)
    pushes = (
        -contact_points * [1, 1, 0] if directions is None else _places("directions", directions)
    )
    require_numbers("directions", pushes, contact_points.shape)
    pushes = np.where(np.linalg.norm(pushes, axis=1, keepdims=True) > 0, pushes, [-1.0, 0, 0])
    figure = chart(7.0, 6.4)
    axes = _space(figure.add_subplot(projection="3d"))
    if surface is not None:
        axes.plot_trisurf(*surface.points.T, triangles=surface.faces, color=_BODY, alpha=0.6)
    axes.scatter(
        *listener_points.T,
        s=26,
        c=FAINT,
        depthshade=False,
        label=counted(len(listener_points), "listener"),
    )
    pushes = 0.25 * reach * pushes / np.linalg.norm(pushes, axis=1, keepdims=True)
    label = counted(len(contact_points), "contact")
    axes.quiver(*(contact_points - pushes).T, *pushes.T, color=ORANGE, linewidth=2, label=label)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    axes.set_aspect("equal")
    axes.legend(loc="upper left", frameon=False, fontsize=9)
    return figure


# The directivity of a mode: a balloon as far out as it is loud there, in dB, and three cuts.


@in_default_style
def _directivity(model: ModalModel, mode: int | str) -> Figure:
    if isinstance(mode, str) or not 0 <= mode < len(model.frequencies):
        raise OptionError(
            f"field is {mode!r}: give the index of a mode, from 0 to {len(model.frequencies) - 1}, "
            f"or {BRIGHTNESS!r}"
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
        f"mode {mode + 1}: {model.frequencies[mode]:.0f} Hz, loudest "
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
    cuts.set_yticks([0, 10, 20, 30], [f"{rounded(level - _RANGE)} dB" for level in (0, 10, 20, 30)])
    cuts.set_ylim(0, _RANGE)
    cuts.tick_params(labelsize=8, labelcolor=FAINT)
    cuts.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), fontsize=8, frameon=False)
    return figure


def _space(axes: Axes) -> Axes3D:
    from mpl_toolkits.mplot3d import Axes3D

    if not isinstance(axes, Axes3D):
        raise TypeError(f"{axes!r} is flat")
    return axes


def _draw_balloon(figure: Figure, ways: Array, radii: Array) -> None:
    from matplotlib import colormaps

    axes = _space(figure.add_subplot(1, 2, 1, projection="3d"))
    x, y, z = np.moveaxis(ways * radii[..., None], -1, 0)
    colours = colormaps["viridis"](radii / _RANGE)
    axes.plot_surface(x, y, z, facecolors=colours, rstride=1, cstride=1, linewidth=0)
    limits = (-_RANGE, _RANGE)
    axes.set(xlim=limits, ylim=limits, zlim=limits, xlabel="x", ylabel="y", zlabel="z")
    axes.set(xticklabels=[], yticklabels=[], zticklabels=[])
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=22, azim=-58)


def _powers(model: ModalModel, directions: Array, mode: int) -> Array:
    """Return squares of a mode's gain far away along unit directions (P, 3): (P,)."""
    distance = _FAR * (radius_of(model) or _UNKNOWN)
    gains = _toward(model.gains, centre_of(model) + distance * directions)[:, :, mode]
    return np.square(np.abs(gains)).sum(axis=1)


def _shown(shares: Array) -> Array:
    """Return how far out a share of the loudest power is drawn, dB above the lowest level."""
    return np.maximum(_RANGE + 10 * np.log10(np.maximum(shares, 1e-30)), 0.0)


# Brightness of a strike on three planes through the centre, as figure 5 of 2007.


@in_default_style
def _slices(model: ModalModel) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    centre = centre_of(model)
    reach = _SPAN * (radius_of(model) or _UNKNOWN)
    line = np.linspace(-reach, reach, _CELLS)
    figure = chart(12.0, 4.6)
    contact = model.contact(None)
    where = (
        f"brightness of a strike at {contact.name or contact.place}: the centroid of its spectrum"
    )
    figure.suptitle(f"{where}\n{_SOFT}", fontsize=12, color=INK)
    panels = figure.subplots(1, 3)
    slices = [_brightness(model, contact, centre, line, across, up) for _, across, up in _PLANES]
    least = _SILENT * max(np.nanmax(powers) for _, powers in slices)
    images = [np.where(powers >= least, values, np.nan) for values, powers in slices]
    finite_values = np.concatenate([values[np.isfinite(values)] for values in images])
    scale = LogNorm(*_colour_range(*np.percentile(finite_values, (1, 99)).tolist()))
    for axes, (name, across, up), values in zip(panels, _PLANES, images, strict=True):
        axes.set_facecolor(_BODY)
        axes.pcolormesh(
            centre[across] + line, centre[up] + line, values, norm=scale, cmap="viridis",
            rasterized=True,
        )  # fmt: skip
        axes.set(xlabel=f"{'xyz'[across]} (m)", ylabel=f"{'xyz'[up]} (m)", aspect="equal")
        axes.set_title(f"from {name}", fontsize=10, color=INK)
    bar = figure.colorbar(ScalarMappable(scale, "viridis"), ax=list(panels), pad=0.01, label="Hz")
    ticks = _round_ticks(scale.vmin or 1.0, scale.vmax or 1.0)
    bar.set_ticks(ticks, labels=[f"{value:.0f}" for value in ticks], minor=False)
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine
    return figure


def _colour_range(low: float, high: float) -> tuple[float, float]:
    """Return the range of frequencies, Hz, that colours show: an octave at least, about theirs."""
    middle, half = np.sqrt(low * high), max(np.sqrt(high / low), np.sqrt(2.0))
    return float(middle / half), float(middle * half)


def _round_ticks(low: float, high: float) -> list[float]:
    """Return round numbers within a range of frequencies, Hz, of an octave or more."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    coarse, fine = (1, 2, 5), (1, 1.2, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8)
    ticks = np.multiply.outer(decades, coarse if high / low > _WIDE else fine).ravel()
    return ticks[(ticks >= low) & (ticks <= high)].tolist()


def _brightness(
    model: ModalModel, contact: Contact, centre: Array, line: Array, across: int, up: int
) -> tuple[Array, Array]:
    """Return centroids, Hz, and powers (n, n) on a plane through the centre; NaN within a body."""
    places = np.tile(centre, (len(line) ** 2, 1))
    places[:, across] += np.tile(line, len(line))
    places[:, up] += np.repeat(line, len(line))
    drives = model.gains.at(contact.point[None], contact.direction[None])[0]
    lasting = 1 / np.maximum(model.decays, 1e-3 * model.natural_frequencies)
    values, powers = np.full((2, len(places)), np.nan)
    is_known = _known(model, places - centre, places)
    gains = (_toward(model.gains, places[is_known]) * drives).sum(axis=1)
    energies = np.square(np.abs(gains)) * lasting
    total_energy = energies.sum(axis=1)
    values[is_known] = (
        energies @ model.frequencies / np.where(total_energy > 0, total_energy, np.nan)
    )
    powers[is_known] = total_energy
    return values.reshape(len(line), -1), powers.reshape(len(line), -1)


def _known(model: ModalModel, offsets: Array, places: Array) -> Mask:
    """Return which places (P,) are outside of a body, and of where its field is not known."""
    gains, distances = model.gains, np.linalg.norm(offsets, axis=1)
    if not isinstance(gains, ShapeGains):
        return distances > max(getattr(gains, "radius", 0.0), 1e-6)
    if isinstance(gains, RadiatingGains) and not gains.near:
        return distances > CLOSE * gains.field.radius + _LENGTH_TOLERANCE
    close_indices = np.flatnonzero(distances < gains.radius)
    is_known = np.ones(len(places), np.bool_)
    if len(close_indices):
        is_known[close_indices] = ~gains.locator.holds(places[close_indices])
    return is_known


def _toward(gains: Gains, places: Array) -> Complex:
    """Return outputs (P, R, M) at places (P, 3), some at a time, so that memory does not grow."""
    parts = [gains.toward(places[n : n + _AT_ONCE]) for n in range(0, len(places), _AT_ONCE)]
    return np.concatenate(parts)
