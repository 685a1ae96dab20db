"""One layer of curved 15-node wedges through a thin wall.

The triangles are those of the stuffed body's boundary at mid-wall, so they are of good shape
whatever the input's are; their nodes move along the shortest way to both faces of the wall.
"""

from __future__ import annotations

import numpy as np

from struck.solids.curving import curved
from struck.solids.distance import Body
from struck.solids.volume import VolumeMesh


def layered(body: Body, wall: float, spacing: float) -> tuple[VolumeMesh, int]:
    """Return a wall as quadratic wedges with edges of about `spacing`, m.

    Parameters
    ----------
    body : Body
        Hollow body.
    wall : float
        Its wall, m.
    spacing : float
        Lattice at mid-wall, m.

    Returns
    -------
    VolumeMesh
        Wedges from the inner to the outer face of the wall.
    int
        Count of nodes that had to stay short of the surface.
    """
    middle, _ = Body(mesh=body.mesh, inset=wall / 2).stuffed(spacing).surface()
    count = len(middle.points)
    faces = [body.offset(middle.points, np.full(count, depth)) for depth in (wall, 0.0)]
    linear = VolumeMesh(
        nodes=np.vstack(faces),
        elements=np.hstack([middle.faces, middle.faces + count]),
        kind="wedge6",
        up=body.mesh.up,
    )
    return curved(linear, body.projected)
