"""Draw the elements of everyday bodies, cut open: docs/images/thin_bodies.png.

Run it after a change of how bodies are filled: `python -m docs.thin_bodies`.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt  # the backend is chosen first

from struck.solids import VolumeMesh
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from tests.physics.everyday import BODIES

PICTURE = Path(__file__).parent / "images/thin_bodies.png"
SHOWN = ["mug", "wine glass", "bell", "table", "crate", "guitar box", "hollow cube", "coin"]
OUTER, CUT = np.array([0.80, 0.81, 0.83]), np.array([0.95, 0.70, 0.45])
SIDES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
LIGHT = np.array([-0.3, 0, 0.4])
ELEVATION, TURN = np.deg2rad(28), np.deg2rad(25)
Triangles = NDArray[np.int64]


def boundary(elements: Triangles) -> Triangles:
    """Return the sides of tetrahedra that only one of them has."""
    sides = elements[:, SIDES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    return sides[first[count == 1]]


def draw(axes: Axes, mesh: VolumeMesh) -> None:
    """Draw what lies behind the middle, the sides of cut elements in another colour."""
    corners = mesh.elements[:, :4]
    middle = (mesh.nodes[:, 1].min() + mesh.nodes[:, 1].max()) / 2
    sides = boundary(corners[mesh.nodes[corners].mean(axis=1)[:, 1] > middle])
    whole = {tuple(side) for side in np.sort(boundary(corners), axis=1)}
    cut = np.array([tuple(side) not in whole for side in np.sort(sides, axis=1)])
    turn = np.array([[np.cos(TURN), np.sin(TURN), 0], [-np.sin(TURN), np.cos(TURN), 0], [0, 0, 1]])
    towards = np.array([0, -np.cos(ELEVATION), np.sin(ELEVATION)])
    up = np.array([0, np.sin(ELEVATION), np.cos(ELEVATION)])
    points = mesh.nodes[sides] @ turn.T
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    order = np.argsort((points @ towards).mean(axis=1))
    order = order[(normals @ towards)[order] > 0]
    light = 0.55 + 0.45 * np.clip(normals @ (towards + LIGHT), 0, 1)
    colours = np.clip(np.where(cut[:, None], CUT, OUTER) * light[:, None], 0, 1)
    flat = np.stack([points[..., 0], points @ up], axis=-1)
    axes.add_collection(
        PolyCollection(
            list(flat[order]), facecolors=colours[order], edgecolors="#333333", linewidths=0.1
        )
    )
    axes.autoscale()
    axes.set_aspect("equal")
    axes.axis("off")


def main() -> None:
    """Draw each body of the list at standard."""
    figure, panels = plt.subplots(2, 4, figsize=(13, 7), layout="constrained")
    for axes, name in zip(panels.flat, SHOWN, strict=True):
        found = fill_body(FilledBody(mesh=BODIES[name]()), "standard")
        draw(axes, found.mesh)
        axes.set_title(f"{name}: {found.path}, {len(found.mesh.nodes):,} nodes", fontsize=10)
        print(name, found.path, len(found.mesh.nodes), flush=True)
    figure.savefig(PICTURE, dpi=90)


if __name__ == "__main__":
    main()
