"""Convex parts of a hollow or bent mesh, by which it collides.

Engines take the convex hull of a mesh: a bowl would be a lid. CoACD (Wei et al., ACM Transactions
on Graphics 41(4), 2022) cuts it into pieces whose hulls are close to it. Hulls of thin walls are
still fat, so that masses never come from them.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from struck.analysis.cached_steps import Stages, holding
from struck.errors import MissingDependencyError
from struck.model.mesh import Mesh
from struck.scene.engines.links import PART, file_coordinates, touches, triangles

if TYPE_CHECKING:
    import mujoco

CONVEX_RATIO = 0.9  # of the hull's volume: meshes that fill more of it are convex enough
_CONCAVITY = 0.05  # CoACD's threshold
_SEED = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvexParts:
    """The parts of one mesh."""

    parts: tuple[Mesh, ...]


PARTS = holding("convex parts", ConvexParts, Mesh)


def is_concave(mesh: Mesh) -> bool:
    """Return whether a closed mesh fills clearly less than its convex hull."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(mesh.points[np.unique(mesh.faces)]).volume
    except QhullError:  # flat
        return False
    return 0 < abs(mesh.volume) < CONVEX_RATIO * hull


def convex_parts(mesh: Mesh, stages: Stages) -> Sequence[Mesh]:
    """Return convex parts of a mesh, from the cache or by CoACD."""

    def compute() -> ConvexParts:
        try:
            import coacd
        except ImportError:
            raise MissingDependencyError(
                'meshes are cut into convex parts by CoACD: pip install "struck[sim]"'
            ) from None
        coacd.set_log_level("error")
        hulls = coacd.run_coacd(
            coacd.Mesh(np.array(mesh.points), np.array(mesh.faces, np.int32)),
            threshold=_CONCAVITY,
            seed=_SEED,
        )
        parts = (Mesh(points=np.array(p, float), faces=np.array(f, np.int64)) for p, f in hulls)
        return ConvexParts(parts=tuple(parts))

    inputs = {"mesh": mesh, "threshold": _CONCAVITY, "coacd": _version()}
    return stages.get_or_compute(PARTS, compute, **inputs).parts


def cut(spec: mujoco.MjSpec, model: mujoco.MjModel, stages: Stages) -> list[str]:
    """Let concave meshes of a specification collide as their convex parts; return notes."""
    notes = []
    for geom in range(model.ngeom):
        if (
            model.geom_dataid[geom] < 0
            or not touches(model, geom)
            or _is_primitive_fit(model, geom)
        ):
            continue
        original_geom = spec.geom(model.geom(geom).name)
        points, faces = triangles(model, geom)
        points = file_coordinates(model, geom).apply(points)
        mesh = Mesh(points=points, faces=faces)
        if is_concave(mesh):
            parts = convex_parts(mesh, stages)
            _replace(spec, original_geom, parts)
            name = (
                original_geom.name
                if original_geom.parent.name == "world"
                else original_geom.parent.name
            )
            notes.append(
                f"{name!r} is concave and collides as {len(parts)} convex parts; "
                'convex="hull" lets it collide as its hull'
            )
    return notes


def _replace(spec: mujoco.MjSpec, original_geom: mujoco.MjsGeom, parts: Sequence[Mesh]) -> None:
    """Add parts that collide in place of a geom, which stays visible and keeps its mass."""
    for number, part in enumerate(parts):
        name = f"{original_geom.name}{PART}{number}"
        points, faces = part.points.ravel(), part.faces.ravel()
        spec.add_mesh(name=name, uservert=points, userface=faces.astype(np.int32))
        geom = original_geom.parent.add_geom(
            name=name,
            type=original_geom.type,
            meshname=name,
            mass=0.0,
            pos=original_geom.pos,
            quat=original_geom.quat,
        )
        for attribute in ("contype", "conaffinity", "condim", "priority", "friction", "solmix"):
            setattr(geom, attribute, getattr(original_geom, attribute))
        for attribute in ("solref", "solimp", "margin", "gap", "group", "rgba", "material"):
            setattr(geom, attribute, getattr(original_geom, attribute))
    original_geom.contype = original_geom.conaffinity = 0


def _is_primitive_fit(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a mesh was only there to fit a primitive to."""
    import mujoco

    return model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH


def _version() -> str:
    try:
        return version("coacd")
    except ImportError:
        return ""
