"""Mending: a surface closed and turned outward with its faces left where they are."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.model.mesh_topology import boxes_of, edges_of, pieces, submesh, volumes_of
from struck.solids.repair.openings import Closed, closed
from struck.solids.surface.shells import alike, apart, without_fins
from struck.solids.surface.welding import sewn, single, without_lines

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# A surface bounds a body while what closes it is small against it. The cap of an open cup,
# of a dome or of a dish is above a sixth of its wall; holes of scans are a few hundredths.
LARGEST_OPENING = 0.1
# Thinner than the rounding of single precision encloses nothing.
THINNEST = 1e-6


@dataclass(slots=True)
class Diary:
    """What was wrong with a mesh and what was changed, a sentence each."""

    found: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)

    def note(self, found: str, changed: str) -> None:
        """Write both down."""
        self.found.append(found)
        self.changed.append(changed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mended:
    """A surface whose faces are oriented alike, before and after its openings are filled.

    Parameters
    ----------
    open : Mesh
        Its openings as they are.
    closed : Closed
        All of them filled.
    labels : array (F,)
        The piece of each face of the closed surface.
    """

    open: Mesh
    closed: Closed
    labels: Index

    @property
    def mesh(self) -> Mesh:
        """The closed surface."""
        return self.closed.mesh

    @property
    def areas(self) -> Array:
        """Areas of the pieces, m^2 (P,)."""
        return np.bincount(self.labels, weights=self.mesh.areas).astype(np.float64)

    @property
    def filled(self) -> Array:
        """Areas of what fills the openings of each piece, m^2 (P,)."""
        fresh = np.arange(len(self.labels)) >= len(self.open.faces)
        areas = np.where(fresh, self.mesh.areas, 0.0)
        return np.bincount(self.labels, weights=areas).astype(np.float64)

    @property
    def solid(self) -> Flags:
        """Which pieces bound a body (P,): closed but for small openings, and not empty."""
        extents = boxes_of(self.mesh, self.labels).extents
        volumes = np.abs(volumes_of(self.mesh, self.labels))
        empty = volumes <= THINNEST * self.areas * extents
        return ~empty & (self.filled <= LARGEST_OPENING * self.areas)

    def holes(self, chosen: Flags) -> int:
        """Return how many openings the `chosen` pieces (P,) had."""
        piece = np.empty(len(self.mesh.points), np.int64)
        piece[self.mesh.faces] = self.labels[:, None]
        return int(sum(chosen[piece[rim[0]]] for rim in self.closed.rims))


def mended(mesh: Mesh, diary: Diary) -> Mended:
    """Drop what repeats or leans, turn faces alike, fill openings.

    Raises
    ------
    MeshError
        When the surface is one-sided.
    """
    mesh, repeated = single(mesh)
    if repeated:
        diary.note(
            f"{counted(repeated, 'face')} {_repeat(repeated)} others.",
            f"{counted(repeated, 'repeated face')} removed.",
        )
    mesh, leaning = without_fins(mesh)
    if leaning:
        diary.note(
            f"{counted(leaning, 'face')} in fins or inner walls {_meet(leaning)} the surface.",
            f"{counted(leaning, 'face')} of fins and inner walls removed.",
        )
    mesh = _apart(mesh, diary)
    mesh = without_needles(_alike(mesh, diary), diary)
    filled = closed(mesh)
    return Mended(open=mesh, closed=filled, labels=pieces(filled.mesh))


def sewn_up(mesh: Mesh, diary: Diary) -> Mesh:
    """Return the mesh with near vertices merged, and say so."""
    result, distance = sewn(mesh)
    if distance:
        merged = len(mesh.points) - len(result.points)
        diary.note(
            f"Faces stand apart by up to {distance:.1e} m.",
            f"{counted(merged, 'vertex')} within {distance:.1e} m of others merged.",
        )
    return result


def _apart(mesh: Mesh, diary: Diary) -> Mesh:
    crowded = int(np.count_nonzero(edges_of(mesh.faces).faces_at > 2))
    if not crowded:
        return mesh
    diary.note(
        f"{counted(crowded, 'edge')} shared by more than two faces.",
        f"Pieces taken apart at {counted(crowded, 'edge')}.",
    )
    return apart(mesh)


def _alike(mesh: Mesh, diary: Diary) -> Mesh:
    found = alike(mesh)
    if found is None:
        raise MeshError(
            "the mesh cannot be oriented (it is one-sided, like a Klein bottle) and so has no "
            "inside: rebuild it as the boundary of a solid"
        )
    result, turned = found
    if turned:
        diary.note(
            f"{counted(turned, 'face')} of {len(mesh.faces)} flipped against their neighbours.",
            f"{counted(turned, 'face')} turned to agree with the others.",
        )
    return result


def without_needles(mesh: Mesh, diary: Diary) -> Mesh:
    """Return the mesh without faces of no area, and say so."""
    mesh, flat = without_lines(mesh)
    if flat:
        diary.note(
            f"{counted(flat, 'face')} without area.",
            f"{counted(flat, 'face')} without area removed, their neighbours split.",
        )
    return mesh


def largest_piece(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the piece of the largest area, and how many others there are."""
    labels = pieces(mesh)
    areas = np.bincount(labels, weights=mesh.areas)
    return submesh(mesh, np.flatnonzero(labels == areas.argmax())), len(areas) - 1


def counted(count: int, noun: str) -> str:
    """Return a count with its noun: "1 face", "2 faces", "3 vertices"."""
    if count == 1:
        return f"1 {noun}"
    plural = {"vertex": "vertices", "body": "bodies", "patch": "patches"}
    last = noun.rsplit(maxsplit=1)[-1]
    return f"{count} {noun.removesuffix(last)}{plural.get(last, last + 's')}"


def _repeat(count: int) -> str:
    return "repeats" if count == 1 else "repeat"


def _meet(count: int) -> str:
    return "meets" if count == 1 else "meet"
