"""From a body and a material to a model, stage by stage."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.closed import require_closed
from struck.errors import MeshError, OptionError
from struck.files.meshes import load_mesh
from struck.files.volumes import SUFFIXES, load_volume
from struck.material import Material
from struck.mesh import Mesh
from struck.model import ModalModel
from struck.modes import Modes
from struck.places import places_of
from struck.progress import Progress, silent
from struck.provenance import Provenance
from struck.radiation import by_name
from struck.solids.distance import Body
from struck.solids.linear import linear_tetrahedra
from struck.solids.meshing import filled
from struck.solids.vibration import Solver, vibration_modes
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
Fixed = ArrayLike | Callable[[Array], NDArray[np.bool_]]
METHODS = ("quadratic", "obrien2002", "obrien2002-consistent")
BAND = (20.0, 20_000.0)


@runtime_checkable
class Solid(Protocol):
    """A body of struck.solids: it makes its own elements."""

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return its elements."""
        ...

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts by name."""
        ...


Source = str | os.PathLike[str] | Mesh | VolumeMesh | Solid


@dataclass(frozen=True, slots=True, kw_only=True)
class FileOptions:
    """What only a file needs to be told: see `analyze`."""

    units: str | None = None
    size: float | None = None
    part: str | None = None
    up: str | None = None

    def refuse(self, reason: str, *taken: str) -> None:
        """Raise OptionError where an option was given that is not among those `taken`."""
        for field in fields(self):
            if getattr(self, field.name) is not None and field.name not in taken:
                raise OptionError(f"{field.name}= does not apply here: {reason}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filled:
    """Elements of a body with its named places and where they come from."""

    mesh: VolumeMesh
    places: Mapping[str, Array]
    provenance: Provenance


def analyze(
    body: Source,
    material: Material | str,
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
    wall: float | None = None,
    fixed: Fixed | None = None,
    accuracy: str = "standard",
    band: tuple[float, float] = BAND,
    damping: str = "own",
    radiation: str = "power",
    method: str = "quadratic",
    backend: str = "auto",
    progress: Progress = silent,
) -> ModalModel:
    """Compute the modal model of a body.

    Parameters
    ----------
    body : path, Mesh, VolumeMesh or a body of struck.solids
        A closed surface (OBJ, STL, PLY, OFF, GLB, glTF), or elements of another program (VTK,
        VTU, MSH, INP).
    material : Material or str
    units : str, optional
        Of a file's numbers: "m", "cm", "mm", "in" or "ft"; metres unless given.
    size : float, optional
        Longest edge of the body's bounding box instead, m.
    part : str, optional
        Which of several bodies in a file.
    up : str, optional
        The axis that points up; by the file format's custom unless given.
    wall : float, optional
        Thickness of the wall of a hollow body, m; without it a surface is filled.
    fixed : box (2, 3) or callable, optional
        Where the body is held: between two corners, m, or where ``fixed(points)`` is true.
    accuracy : str
        "preview", "standard" or "fine".
    band : pair of float
        All modes within it are computed, Hz.
    damping : str
        "own" or "heard": see `Material.named`. A Material keeps its own.
    radiation : str
        "power" (Pa) or "obrien2002" (relative).
    method : str
        "quadratic" elements; "obrien2002" for linear tetrahedra with lumped mass as in the
        paper, "obrien2002-consistent" for consistent mass.
    backend : str
        Sparse factorisation: "auto", "rslab" or "superlu".
    progress : callable
        Told the stage and the fraction of it that is done.

    Returns
    -------
    ModalModel
        Complete over the band, by Sturm count.

    Raises
    ------
    MeshError, MaterialError, OptionError, FileFormatError, SolverError
        With the value, the bound and the way out.
    """
    chosen = Material.named(material, damping) if isinstance(material, str) else material
    lowest, highest = _require_band(band)
    output = by_name(radiation)
    solver = _solver(method, backend)
    progress("mesh", 0.0)
    file = FileOptions(units=units, size=size, part=part, up=up)
    source = _loaded(body, file)
    body_filled = _filled(source, wall, accuracy)
    given = body_filled.mesh
    mesh = given.promoted() if method == "quadratic" else linear_tetrahedra(given)
    held = _held(fixed, mesh)
    modes = vibration_modes(mesh, chosen, highest, fixed=held, solver=solver, progress=progress)
    progress("radiation", 0.0)
    modes = replace(modes, provenance=_merged(body_filled.provenance, modes, body, method))
    places = {**places_of(modes.surface), **body_filled.places}
    return ModalModel.of(modes, chosen, radiation=output, lowest=lowest, places=places)


def _require_band(band: tuple[float, float]) -> tuple[float, float]:
    if len(band) != 2 or not 0 <= band[0] < band[1] < np.inf:
        raise OptionError(f"band is {band}: give two frequencies in Hz, the lower first")
    return float(band[0]), float(band[1])


def _solver(method: str, backend: str) -> Solver:
    if method not in METHODS:
        raise OptionError(f"method is {method!r}: give one of {', '.join(METHODS)}")
    return Solver(lumped=method == "obrien2002", backend=backend)


def _loaded(body: Source, file: FileOptions) -> Mesh | VolumeMesh | Solid:
    """Return the body itself; only files take the options of files."""
    if isinstance(body, str | os.PathLike):
        if Path(body).suffix.lower() in SUFFIXES:
            file.refuse("elements of another program take units= only", "units")
            return load_volume(body, units=file.units)
        return load_mesh(body, units=file.units, size=file.size, part=file.part, up=file.up)
    if isinstance(body, Mesh):
        file.refuse("a Mesh is in metres already")
        require_closed(body)
        return body
    if isinstance(body, VolumeMesh | Solid):
        file.refuse("this body has its own size")
        return body
    raise MeshError(f"{type(body).__name__} is no body: give a path, a Mesh or a solid")


def _filled(source: Mesh | VolumeMesh | Solid, wall: float | None, accuracy: str) -> Filled:
    if isinstance(source, Mesh):
        return _filled_surface(source, wall, accuracy)
    if wall is not None:
        raise OptionError("wall= applies to surfaces: this body has its elements already")
    if isinstance(source, VolumeMesh):
        return Filled(mesh=source, places={}, provenance=Provenance(method="given elements"))
    mesh = source.volume_mesh(accuracy)
    details = {"body": repr(source), "accuracy": accuracy}
    return Filled(
        mesh=mesh,
        places=source.places,
        provenance=Provenance(method="structured elements", details=details),
    )


def _filled_surface(mesh: Mesh, wall: float | None, accuracy: str) -> Filled:
    if wall is not None and not (np.isfinite(wall) and wall > 0):
        raise OptionError(f"wall is {wall}: a thickness must exceed 0 m")
    filling = filled(Body(mesh=mesh, wall=wall), accuracy)
    details = {
        "accuracy": accuracy,
        "wall": wall,
        "path": filling.path,
        "lattice": filling.spacing,
        "volume_error": filling.volume_error,
        "nodes_short_of_the_surface": filling.short,
    }
    provenance = Provenance(
        method=filling.path, references=("barill2018", "labelle2007"), details=details
    )
    return Filled(mesh=filling.mesh, places={}, provenance=provenance)


def _held(fixed: Fixed | None, mesh: VolumeMesh) -> NDArray[np.bool_] | None:
    if fixed is None:
        return None
    if callable(fixed):
        held = np.asarray(fixed(mesh.nodes), dtype=bool)
        if held.shape != (len(mesh.nodes),):
            raise OptionError(f"fixed() gave shape {held.shape}: return one bool a point")
    else:
        box = np.asarray(fixed, dtype=np.float64)
        if box.shape != (2, 3):
            raise OptionError(
                f"fixed has shape {box.shape}: give two corners of a box, (2, 3) in m"
            )
        held = ((mesh.nodes >= box.min(axis=0)) & (mesh.nodes <= box.max(axis=0))).all(axis=1)
    if not held.any() or held.all():
        low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
        raise OptionError(
            f"fixed= holds {held.sum()} of {len(held)} nodes: the body reaches from "
            f"{np.round(low, 4).tolist()} to {np.round(high, 4).tolist()} m"
        )
    return held


def _merged(start: Provenance, modes: Modes, body: Source, method: str) -> Provenance:
    """Join how the elements and the modes were made, with versions and the input's hash."""
    paper = ("obrien2002",) if method != "quadratic" else ()
    versions = {name: version(name) for name in ("struck", "numpy", "scipy", "rslab", "libigl")}
    joined = replace(
        start,
        method=f"{start.method}, {modes.provenance.method}",
        details={**start.details, **modes.provenance.details, **_input(body), "versions": versions},
    )
    return joined.extended(references=(*paper, *modes.provenance.references))


def _input(body: Source) -> dict[str, object]:
    if not isinstance(body, str | os.PathLike):
        return {}
    path = Path(body)
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
