"""Contact sheet: pictures of a scene at the moments that matter, with the sound below."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError, rounded
from struck.files.sound import Sound
from struck.model.arrays import Array
from struck.model.picture_style import in_default_style
from struck.report.charts import FAINT, draw_spectrogram, plain, powers_in_time
from struck.report.depth_image import GROUND, DepthImage
from struck.report.scene_moments import MIN_SEPARATION, moments_of
from struck.scene.animation import COLOURS, course_of, group_of
from struck.scene.body import Body, RigidBody
from struck.scene.events import Events

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_COLUMNS = 4
_MIN_FREQUENCY = 50.0  # Hz, of the spectrogram
_MOST_FACES = 4_000  # of a body as it is drawn
_ELEVATION, _AZIMUTH = np.deg2rad(22), np.deg2rad(-58)
_LIGHT = np.array([-0.42, 0.58, 0.70]) / np.linalg.norm([-0.42, 0.58, 0.70])
_AMBIENT = 0.4  # of the brightness that a face has which looks away from the light
_MARGIN = 0.06  # of a frame's larger edge
_WIDE = 420  # pixels of a frame
_MIN_ASPECT, _MAX_ASPECT = 0.45, 1.3  # height of a frame over its width
# Separate frames are drawn if most bodies need less than this fraction of the common one.
_OWN_FRAME_FRACTION = 0.6
# Length of a body that stays over the space of those that move: a larger one is ground, which is
# cut off. Chosen by judgement: in a picture of such ground the others have 5 % of the width.
_GROUND_RATIO = 20.0
_TILES = 12.0  # across a frame, about
_TILE_COLOURS = np.array([[0.95, 0.95, 0.94], [0.905, 0.905, 0.895]])
_SHADOW = np.array([0.70, 0.70, 0.70])
_SHADOW_HEIGHT = 1e-4  # of a frame, that shadows lie above their plane
_LEVEL = 0.5  # cosine between a plane's normal and upward: steeper planes get no shadows
_MAX_LEGEND_ENTRIES = 8  # bodies whose colours are explained
# Colours of moving bodies: Paul Tol's "bright" and "muted" schemes, for colour-blind readers too.
_PALETTE = (
    *("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377"),
    *("#ddcc77", "#332288", "#88ccee", "#cc6677", "#44aa99", "#999933"),
)


@in_default_style
def contact_sheet(events: Events, sound: Sound, *, seconds: float) -> Figure:
    """Draw a scene at the start, at its largest blows and between them, above its spectrogram.

    Planes are drawn as tiled floors, and every body is within each picture, except the ground: a
    body that stays where it is and is more than 20 times larger than the space of those that move.

    Parameters
    ----------
    events : Events
        With a scene whose bodies are where they move.
    sound : Sound
    seconds : float
        How long the bodies move, s.

    Raises
    ------
    OptionError
        On no body with a surface.
    """
    from matplotlib.figure import Figure

    things = _list_things(events.scene.bodies)
    if not things:
        raise OptionError("no body of the scene has a surface: there is nothing to draw")
    planes = [body for body in events.scene.bodies.values() if _is_plane(body)]
    view = _view()
    moments = moments_of(events, seconds)
    framed = _select_framed(things, [moment.time for moment in moments])
    boxes = np.array([_box(framed, moment.time, view) for moment in moments])
    # Before ground of one colour, motion is seen against the frame alone.
    is_steady = len(framed) < len(things) and not planes and all(t.body.moves for t in framed)
    windows = _windows(boxes, is_common=is_steady)
    shape = float(np.ptp(windows[0], axis=0)[1] / np.ptp(windows[0], axis=0)[0])
    tile = _round(float(np.median(np.ptp(windows, axis=1)[:, 0])) / _TILES)
    decimals = max(2, math.ceil(-math.log10(max(seconds, 1e-9) * MIN_SEPARATION)))
    column_count = min(_MAX_COLUMNS, len(moments))
    rows = -(-len(moments) // column_count)
    high = rows * (13 / _MAX_COLUMNS * shape + 0.4) + 0.6
    figure = Figure(figsize=(13, high + 3.4), layout="constrained")
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(high, 3.4)).flat
    figure.get_layout_engine().set(h_pad=0.08)  # type: ignore[union-attr, call-arg]
    panels = list(upper.subplots(rows, column_count, squeeze=False).flat)
    for axes, moment, window in zip(panels, moments, windows, strict=False):
        pixel = float(np.ptp(window, axis=0)[0]) / _WIDE
        image = DepthImage(low=window[0], pixel=pixel, width=_WIDE, height=round(_WIDE * shape))
        for plane in planes:
            _add_plane(image, plane, things, moment.time, view, tile)
        for number, thing in enumerate(things):
            thing.add(image, number, moment.time, view)
        _show(axes, image, window, f"{moment.time:.{decimals}f} s", moment.caption)
    for axes in panels[len(moments) :]:
        axes.set_axis_off()
    _explain(upper, things, planes, tile)
    axes = lower.subplots()
    clock, frequencies, powers, strongest = powers_in_time(sound, _MIN_FREQUENCY)
    levels = 10 * np.log10(np.maximum(powers / max(strongest, 1e-200), 1e-20))
    draw_spectrogram(axes, clock, frequencies, levels)
    for moment in moments[1:]:
        axes.axvline(moment.time, color="white", linewidth=0.5, alpha=0.5)
    axes.set(ylabel="frequency (Hz)", xlabel="time (s); white lines: the pictures above")
    return figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Thing:
    """A body as it is drawn."""

    name: str
    body: Body
    corners: Array  # (F, 3, 3), in its coordinates, m
    colour: Array  # (3,)

    def corners_at(self, time: float) -> Array:
        """Return its triangles in the scene at a time, m (F, 3, 3)."""
        place, rotation = course_of(self.body, np.array([time]))
        return self.corners @ rotation[0].T + place[0]

    def add(self, image: DepthImage, number: int, time: float, view: Array) -> None:
        """Draw it into an image."""
        corners = self.corners_at(time) @ view.T
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        light = _AMBIENT + (1 - _AMBIENT) * (0.5 + 0.5 * normals @ _LIGHT)
        image.add_triangles(corners, light[:, None] * self.colour, number)


def _list_things(bodies: Mapping[str, Body]) -> list[_Thing]:
    """Return the bodies with a surface, each that moves in a different colour."""
    from matplotlib.colors import to_rgb

    things, moving = [], 0
    for name, body in bodies.items():
        corners = _corners(body)
        if corners is None:
            continue
        colour = np.asarray(COLOURS[group_of(body)])
        if body.moves:
            colour = np.array(to_rgb(_PALETTE[moving % len(_PALETTE)]))
            moving += 1
        things.append(_Thing(name=name, body=body, corners=corners, colour=colour))
    return things


def _corners(body: Body) -> Array | None:
    """Return the triangles of a body (F, 3, 3), not too many; None of a body without a surface."""
    surface = body.model.geometry
    if surface is None:
        return None
    points, faces = surface.points, surface.faces
    if len(faces) > _MOST_FACES:
        import igl

        decimation = igl.decimate(np.asfortranarray(points), np.asfortranarray(faces), _MOST_FACES)
        faces_left = np.asarray(decimation[1], np.int64)
        if len(faces_left):  # else it is no manifold, and drawn whole
            points, faces = np.asarray(decimation[0], np.float64), faces_left
    return points[faces]


def _is_plane(body: Body) -> bool:
    return isinstance(body.model, RigidBody) and body.model.plane


def _view() -> Array:
    """Return unit vectors to the right, upward and toward the eye (3, 3)."""
    level = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
    toward = np.cos(_ELEVATION) * level + np.array([0.0, 0.0, np.sin(_ELEVATION)])
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _select_framed(things: Sequence[_Thing], times: Sequence[float]) -> list[_Thing]:
    """Return the bodies that the pictures hold whole: without ground that hides their scale."""
    moving = [thing for thing in things if thing.body.moves] or list(things)
    points = [thing.corners_at(time).reshape(-1, 3) for thing in moving for time in times]
    reach = float(np.ptp(np.concatenate(points), axis=0).max())
    return [
        thing
        for thing in things
        if thing.body.moves
        or float(np.ptp(thing.corners.reshape(-1, 3), axis=0).max()) <= _GROUND_RATIO * reach
    ]


def _box(things: Sequence[_Thing], time: float, view: Array) -> Array:
    """Return the corners (2, 2) of the rectangle that holds all bodies at a time."""
    flat = [thing.corners_at(time).reshape(-1, 3) @ view[:2].T for thing in things]
    low, high = (
        np.min([points.min(axis=0) for points in flat], axis=0),
        np.max([points.max(axis=0) for points in flat], axis=0),
    )
    return np.stack([low, high])


def _windows(boxes: Array, *, is_common: bool) -> Array:
    """Return the corners of each picture (N, 2, 2), all of one shape, about its bodies.

    It is the same for all, unless a body that goes far away makes most of them small by that, and
    `is_common` is false.
    """
    common_box = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    sizes = np.ptp(boxes, axis=1)
    min_size = _OWN_FRAME_FRACTION * np.ptp(common_box, axis=0).max()
    if is_common or np.median(sizes.max(axis=1)) > min_size:
        boxes = np.repeat(common_box[None], len(boxes), axis=0)
    sizes = np.ptp(boxes, axis=1)
    sizes = sizes + 2 * _MARGIN * sizes.max(axis=1, keepdims=True)
    shape = float(np.clip(np.median(sizes[:, 1] / sizes[:, 0]), _MIN_ASPECT, _MAX_ASPECT))
    width = np.maximum(sizes[:, 0], sizes[:, 1] / shape)
    half = np.stack([width, width * shape], axis=1) / 2
    middles = boxes.mean(axis=1)
    return np.stack([middles - half, middles + half], axis=1)


def _round(length: float) -> float:
    """Return 1, 2 or 5 times a power of ten near a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * min((1, 2, 5, 10), key=lambda times: abs(np.log(times * power / length))))


def _add_plane(
    image: DepthImage, plane: Body, things: Sequence[_Thing], time: float, view: Array, tile: float
) -> None:
    """Draw a plane, and the shadows of bodies above it."""
    place, rotation = course_of(plane, np.array([time]))
    origin, axes = place[0], rotation[0].T  # rows: the plane's own directions in the scene
    image.add_plane(view @ origin, axes @ view.T, tile, *_TILE_COLOURS)
    normal = axes[2]
    if normal[2] < _LEVEL:
        return
    lift = _SHADOW_HEIGHT * image.width * image.pixel
    for thing in things:
        corners = thing.corners_at(time)
        heights = (corners - origin) @ normal
        is_above = (heights > 0).all(axis=1)
        flat = corners[is_above] - (heights[is_above] - lift)[:, :, None] * normal
        colours = np.broadcast_to(_SHADOW, (len(flat), 3))
        image.add_triangles(flat @ view.T, colours, GROUND)


def _show(axes: Axes, image: DepthImage, window: Array, title: str, caption: str) -> None:
    (left, low), (right, high) = window.tolist()
    axes.imshow(image.image(), origin="lower", extent=(left, right, low, high))
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color="#bbbbbb", linewidth=0.6)
    text = f"{title}: {plain(caption)}" if caption else title
    axes.set_title(text, fontsize=9, pad=4)


def _explain(figure: object, things: Sequence[_Thing], planes: Sequence[Body], tile: float) -> None:
    """Say which colour is which body, and how large the tiles of a floor are."""
    from matplotlib.patches import Patch

    moving = [thing for thing in things if thing.body.moves]
    keys = [Patch(color=thing.colour.tolist(), label=plain(thing.name)) for thing in moving]
    keys = keys if len(keys) <= _MAX_LEGEND_ENTRIES else []
    if planes:
        size = f"{rounded(tile)} m" if tile >= 1 else f"{rounded(100 * tile)} cm"
        label = f"floor: tiles of {size}"
        keys.append(Patch(facecolor=_TILE_COLOURS[1].tolist(), edgecolor=FAINT, label=label))
    if keys:
        figure.legend(  # type: ignore[attr-defined]
            handles=keys, loc="outside lower center", ncols=len(keys), fontsize=8, frameon=False
        )
