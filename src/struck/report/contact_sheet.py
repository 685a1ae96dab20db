"""Contact sheet: pictures of a scene at a row of moments, with the sound below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError
from struck.files.sound import Sound
from struck.model.arrays import Array
from struck.model.mesh import Mesh
from struck.model.picture_style import in_default_style
from struck.report.charts import draw_spectrogram, powers_in_time
from struck.report.surface_picture import facing, frame, shade
from struck.scene.animation import COLOURS, course_of, group_of
from struck.scene.body import Body, Scene
from struck.scene.contacts import Contacts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOMENTS, _ACROSS = 12, 4
_LOWEST = 50.0  # Hz, of the spectrogram
_MOST_FACES = 4_000  # of a body as it is drawn
_FINEST = 40  # edges of triangles along the picture: smaller ones hide each other rightly
_ELEVATION, _AROUND = np.deg2rad(22), np.deg2rad(-58)
_LIGHT = np.array([-0.42, 0.58, 0.70]) / np.linalg.norm([-0.42, 0.58, 0.70])


@in_default_style
def contact_sheet(scene: Scene, contacts: Contacts, sound: Sound, *, seconds: float) -> Figure:
    """Draw a scene at twelve moments, and the spectrogram of its sound.

    Parameters
    ----------
    scene : Scene
        Its bodies where they move.
    contacts : Contacts
        Counted between one moment and the next.
    sound : Sound
    seconds : float
        How long the bodies move, s.

    Raises
    ------
    OptionError
        On no body with a surface.
    """
    from matplotlib.figure import Figure

    shown = [body for body in scene.bodies.values() if body.model.geometry is not None]
    if not shown:
        raise OptionError("no body of the scene has a surface: there is nothing to draw")
    times = np.linspace(0.0, seconds, _MOMENTS)
    view = _view()
    low, high = _window(shown, contacts, view)
    surfaces = [_drawn(body, float(np.max(high - low)) / _FINEST) for body in shown]
    figure = Figure(figsize=(13, 11.5), layout="constrained")
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(3, 1.1)).flat
    panels = upper.subplots(_MOMENTS // _ACROSS, _ACROSS).ravel()
    before = -1.0
    for axes, time in zip(panels, times, strict=True):
        _paint(axes, shown, surfaces, float(time), view)
        frame(axes, low, high)
        rows = (np.asarray(contacts.time) > before) & (np.asarray(contacts.time) <= time)
        pushed = float(np.linalg.norm(np.asarray(contacts.impulse)[rows], axis=1).sum())
        axes.set_title(f"{time:.2f} s", fontsize=10)
        axes.text(
            0.5, 0.0, f"{pushed:.3g} N s since", transform=axes.transAxes, ha="center", fontsize=8
        )
        before = float(time)
    axes = lower.subplots()
    clock, frequencies, powers, strongest = powers_in_time(sound, _LOWEST)
    levels = 10 * np.log10(np.maximum(powers / max(strongest, 1e-300), 1e-20))
    draw_spectrogram(axes, clock, frequencies, levels)
    axes.set(ylabel="frequency (Hz)", xlabel="time (s)")
    return figure


def _view() -> Array:
    """Return unit vectors to the right, upward and toward the eye (3, 3)."""
    level = np.array([np.cos(_AROUND), np.sin(_AROUND), 0.0])
    toward = np.cos(_ELEVATION) * level + np.array([0.0, 0.0, np.sin(_ELEVATION)])
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _window(bodies: Sequence[Body], contacts: Contacts, view: Array) -> tuple[Array, Array]:
    """Return the corners (2,) of the view: the places where bodies begin and where they touch."""
    moving = [body for body in bodies if body.moves] or list(bodies)
    corners = [np.asarray(contacts.position)]
    for body in moving:
        box = _geometry(body).bounds
        grid = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
        place, turn = course_of(body, np.zeros(1))
        corners.append(grid @ turn[0].T + place[0])
    flat = np.concatenate(corners) @ view[:2].T
    margin = 0.08 * np.ptp(flat, axis=0).max()
    return flat.min(axis=0) - margin, flat.max(axis=0) + margin


def _geometry(body: Body) -> Mesh:
    surface = body.model.geometry
    if surface is None:
        raise OptionError("the body has no surface: there is nothing to draw")
    return surface


def _drawn(body: Body, edge: float) -> tuple[Array, Array]:
    """Return triangles (F, 3, 3) no longer than an edge, m, and their normals (F, 3)."""
    import igl
    import trimesh

    surface = _geometry(body)
    points, faces = surface.points, surface.faces
    if len(faces) > _MOST_FACES:
        found = igl.decimate(np.asfortranarray(points), np.asfortranarray(faces), _MOST_FACES)
        left = np.asarray(found[1], np.int64)
        if len(left):
            points, faces = np.asarray(found[0], np.float64), left
    fine = max(edge, surface.extent / 60)
    divided = trimesh.remesh.subdivide_to_size(points, faces, fine, max_iter=12)
    corners = np.asarray(divided[0], np.float64)[np.asarray(divided[1], np.int64)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def _paint(
    axes: Axes,
    bodies: Sequence[Body],
    surfaces: Sequence[tuple[Array, Array]],
    time: float,
    view: Array,
) -> None:
    """Draw all bodies at a time, farthest triangles first."""
    places, colours = [], []
    for body, (corners, normals) in zip(bodies, surfaces, strict=True):
        origin, turn = course_of(body, np.array([time]))
        places.append((corners @ turn[0].T + origin[0]) @ view.T)
        light = 0.5 + 0.5 * (normals @ turn[0].T @ view.T @ _LIGHT)
        base = np.asarray(COLOURS[group_of(body)])
        colours.append(np.clip(base * (0.35 + 0.65 * light[:, None]), 0, 1))
    triangles, shades = np.concatenate(places), np.concatenate(colours)
    order = facing(triangles)
    shade(axes, triangles[order, :, :2], np.repeat(shades[order], 3, axis=0))
