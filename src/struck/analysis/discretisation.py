"""Discretisation: from a file, a surface or a solid to its elements, coarse and fine."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from struck.analysis.cached_steps import Stage, Stages, holding
from struck.errors import MeshError, OptionError, RepairWarning, rounded
from struck.model.arrays import Array
from struck.model.mesh import Arrays, Mesh
from struck.model.provenance import Provenance
from struck.solids.filling.filling import (
    Filling,
    accuracy_named,
    fill_body,
    fill_body_coarsely,
    nodes_allowed,
    nodes_expected,
)
from struck.solids.resolution import ACCURACIES as ACCURACY_NAMES
from struck.solids.surface.closedness import require_closed
from struck.solids.surface.distance import FilledBody, WalledSheet
from struck.solids.surface.repair import Repair, require_holes
from struck.solids.volume_mesh import QUADRATIC_KINDS, VolumeMesh

SURFACE: Stage[Repair] = holding("surface", Repair, Mesh)
ELEMENTS: Stage[VolumeMesh] = holding("elements", VolumeMesh)
COARSE: Stage[tuple[Filling, ...]] = holding("coarse filling", Filling, VolumeMesh)
FILLING: Stage[Filling] = holding("filling", Filling, VolumeMesh)

_COARSER, _STEP = 0.7, 1.1  # times as many elements in each direction
_FIRST = 2.0  # times the nodes, as coarse elements overstate what is missing
_PROMOTED = 6.0  # times the nodes of linear elements that quadratic ones have


@runtime_checkable
class Solid(Protocol):
    """A body of struck.solids: it makes its own elements.

    Where one is struck by default, its property `playing_place` names one of its `places`.
    """

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return the elements of the solid, `finer` times as many in each direction."""
        ...

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts by name."""
        ...

    @property
    def volume(self) -> float:
        """Exact volume, m^3."""
        ...


Source = str | os.PathLike[str] | Mesh | VolumeMesh | Solid | Arrays


@dataclass(frozen=True, slots=True, kw_only=True)
class FileOptions:
    """Options of `struck.analyze` that apply to files alone."""

    units: str | None = None
    size: float | None = None
    part: str | None = None
    up: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elements:
    """Elements of a body with its named places, origin, and share of the volume that they miss.

    What they were made to fill is the `outline`, where that is known.
    """

    mesh: VolumeMesh
    places: Mapping[str, Array] = field(default_factory=dict)
    playing_place: str | None = None  # its name, where the body has one
    provenance: Provenance
    volume_error: float = 0.0
    stiffened: float = 0.0  # relative, of frequencies, by what they miss along thin edges
    outline: Mesh | None = None
    times: float = 1.0  # as many in each direction as the accuracy begins with


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GivenElements:
    """Elements of another program."""

    mesh: VolumeMesh
    error: float | None = None  # of frequencies to aim at: these elements cannot be chosen by it
    wall: float | None = None
    units: str = "m"  # of the numbers that defined it, in words

    @property
    def outline(self) -> Mesh:
        """Surface of the body."""
        return self.mesh.surface()[0]

    @property
    def nodes(self) -> Sequence[float]:
        """Number of nodes, once elements are quadratic."""
        return [len(self.mesh.nodes) * (_PROMOTED if self.mesh.kind in QUADRATIC_KINDS else 1.0)]

    def coarse(self, _stages: Stages, /) -> Elements | None:
        """Return None: there is no second set."""
        return None

    def fine(self, _stages: Stages, _nodes: int, /) -> Elements:
        """Return the elements as they are."""
        return Elements(
            mesh=self.mesh,
            provenance=Provenance(method="given elements", details={"units": self.units}),
        )

    def finer(self, _stages: Stages, _times: float, /) -> Elements | None:
        """Return None: there are no others."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StructuredSolid:
    """A solid that makes its own elements."""

    solid: Solid
    accuracy: str
    wall: float | None = None

    @property
    def error(self) -> float | None:
        """Error of frequencies to aim at; None where the elements were given by their counts."""
        return None if self._has_elements else accuracy_named(self.accuracy).error

    @property
    def _has_elements(self) -> bool:
        return getattr(self.solid, "elements", None) is not None

    @property
    def outline(self) -> Mesh:
        """Surface of the body, roughly."""
        return self.solid.volume_mesh("preview").surface()[0]

    @property
    def nodes(self) -> Sequence[float]:
        """Numbers of nodes of the coarse mesh and of the first mesh."""
        count = self._count(self.accuracy, 1.0)
        return [count] if self._has_elements else [self._count(*self._coarser), count]

    @property
    def _coarser(self) -> tuple[str, float]:
        """The accuracy below, or this one with fewer elements in each direction."""
        below = ACCURACY_NAMES[: ACCURACY_NAMES.index(self.accuracy)]
        return (below[-1], 1.0) if below else (self.accuracy, _COARSER)

    def coarse(self, stages: Stages, /) -> Elements | None:
        """Return about a third of the nodes, unless the elements were given by their counts."""
        return None if self._has_elements else self._at(*self._coarser, stages)

    def fine(self, stages: Stages, nodes: int, /) -> Elements:
        """Return the elements of its accuracy, or up to `_FIRST` times as many nodes."""
        more = nodes / self._count(self.accuracy, 1.0)
        return self._most(min(max(more, 1.0), _FIRST) ** (1 / 3), stages)

    def finer(self, stages: Stages, times: float, /) -> Elements | None:
        """Return finer elements, `times` as many in each direction as to begin with."""
        return self._most(times, stages)

    def _most(self, times: float, stages: Stages) -> Elements:
        """Return elements of `times` the first counts, as far as the accuracy allows."""
        while (
            times > 1
            and self._count(self.accuracy, times) > accuracy_named(self.accuracy).max_nodes
        ):
            times = max(1.0, times / _STEP)
        return self._at(self.accuracy, times, stages)

    def _count(self, accuracy: str, finer: float) -> int:
        return len(self.solid.volume_mesh(accuracy, finer).nodes)

    def _at(self, accuracy: str, finer: float, stages: Stages) -> Elements:
        solid = self.solid
        mesh = stages.get_or_compute(
            ELEMENTS,
            lambda: solid.volume_mesh(accuracy, finer),
            body=solid,
            accuracy=accuracy,
            finer=finer,
        )
        details = {"body": repr(solid), "accuracy": accuracy}
        return Elements(
            mesh=mesh,
            places=solid.places,
            playing_place=getattr(solid, "playing_place", None),
            provenance=Provenance(method="structured elements", details=details),
            volume_error=abs(mesh.volume() / solid.volume - 1),
            times=finer,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilledSurface:
    """A surface that is filled with tetrahedra, or given a wall."""

    repair: Repair
    wall: float | None
    accuracy: str
    units: str  # of the numbers that defined it, in words
    up: str  # the upward axis, and why it is that, in words

    @property
    def error(self) -> float | None:
        """Relative error of frequencies that the mesh is made for."""
        return accuracy_named(self.accuracy).error

    @property
    def outline(self) -> Mesh:
        """Surface of the body, or the sheet that is given a wall."""
        return self.repair.mesh

    @property
    def _body(self) -> FilledBody | WalledSheet:
        if self.repair.sheet and self.wall is not None:
            return WalledSheet(mesh=self.repair.mesh, wall=self.wall)
        return FilledBody(mesh=self.repair.mesh, wall=self.wall)

    @property
    def nodes(self) -> Sequence[float]:
        """Number of nodes, coarse (0: none) and fine, roughly."""
        return nodes_expected(self._body, self.accuracy)

    def coarse(self, stages: Stages, /) -> Elements | None:
        """Return elements with about a third of the nodes, if they can resolve the body."""
        fillings = stages.get_or_compute(
            COARSE, lambda: fill_body_coarsely(self._body, self.accuracy), **self._inputs
        )
        return self._elements(fillings[0]) if fillings else None

    def fine(self, stages: Stages, nodes: int, /) -> Elements:
        """Return the elements of its accuracy, or more."""
        nodes = nodes_allowed(self.accuracy, nodes)
        filling = stages.get_or_compute(
            FILLING,
            lambda: fill_body(self._body, self.accuracy, nodes=nodes),
            nodes=nodes,
            **self._inputs,
        )
        return self._elements(filling)

    def finer(self, _stages: Stages, _times: float, /) -> Elements | None:
        """Return None: a surface is filled once, as that takes longer than its modes."""
        return None

    @property
    def _inputs(self) -> dict[str, object]:
        repair = self.repair
        return {
            "surface": repair.mesh,
            "sheet": repair.sheet,
            "wall": self.wall,
            "accuracy": self.accuracy,
        }

    def _elements(self, filling: Filling) -> Elements:
        details = {
            "units": self.units,
            "up": self.up,
            "accuracy": self.accuracy,
            "wall": self.wall,
            "path": f"{filling.path}: {filling.reason}",
            "lattice": filling.spacing,
            "volume_error": filling.volume_error,
            "nodes_short_of_the_surface": filling.short,
            "crumbs": filling.crumbs,
            **_repair_details(self.repair),
        }
        provenance = Provenance(
            method=filling.path,
            references=("barill2018", "labelle2007", "rivara1991", *filling.references),
            details=details,
        )
        # The volume of a wall of one face is sampled: as a measure of its shape that is too rough.
        sampled = self.wall is not None and not filling.mesh.cubic
        missing = 0.0 if sampled else filling.volume_error
        outline = self.repair.mesh if self.wall is None else None
        return Elements(
            mesh=filling.mesh,
            provenance=provenance,
            volume_error=missing,
            stiffened=filling.stiffened,
            outline=outline,
        )


def _repair_details(repair: Repair) -> dict[str, object]:
    if not repair.faults:
        return {}
    return {
        "found": " ".join(repair.faults),
        "repaired": " ".join(repair.changes),
        "volume_before": repair.volume_before,
        "volume_after": repair.volume_after,
    }


Discretisation = GivenElements | StructuredSolid | FilledSurface


def _require_thin(wall: float | None, extent: float) -> None:
    """Refuse a wall that no body of that longest edge, m, can have."""
    if wall is not None and wall > extent / 2:
        raise OptionError(
            f"wall is {rounded(wall)} m, and the longest edge of the body is {rounded(extent, 4)} "
            f"m: give at most {rounded(extent / 2, 3)} m, or leave it out for a solid body; 1 mm "
            "is wall=0.001"
        )


def discretise(
    body: Source,
    file: FileOptions,
    stages: Stages,
    *,
    wall: float | None,
    accuracy: str | None,
    repair: bool | None,
    holes: str | None = None,
    repair_seconds: float | None = None,
) -> Discretisation:
    """Return a body ready to be cut into elements, by options that apply to it."""
    require_holes(holes, wall)
    if wall is not None and not (np.isfinite(wall) and wall > 0):
        raise OptionError(f"wall is {wall}: a thickness must exceed 0 m")
    if repair is False and repair_seconds is not None:
        raise OptionError(
            f"repair_seconds={repair_seconds} limits a repair, and repair=False allows none: leave "
            "one of them out"
        )
    options = RepairOptions(wall=wall, holes=holes, seconds=repair_seconds)
    source = _load(body, file, stages, options, repair=repair is not False)
    if isinstance(source, Repair):
        _require_thin(wall, source.mesh.extent)
        _warn_of(body, source)
        from struck.files.meshes import units_of, up_of

        units, up, of_file = "m", source.mesh.up, isinstance(body, str | os.PathLike)
        if not isinstance(body, Mesh):
            units = units_of(body, file.units, file.size)
            up = up_of(up, file.up, of_file=of_file)
        level = accuracy or "standard"
        return FilledSurface(repair=source, wall=wall, accuracy=level, units=units, up=up)
    if isinstance(source, VolumeMesh):
        mine = isinstance(body, VolumeMesh)
        units = file.units or ("m" if mine else "m, as none were given")
        return GivenElements(mesh=source, units=units)
    return StructuredSolid(solid=source, accuracy=accuracy or "standard")


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairOptions:
    """Options of the repair of a surface."""

    wall: float | None  # m
    holes: str | None
    seconds: float | None  # of processor time


def _load(
    body: Source,
    file: FileOptions,
    stages: Stages,
    options: RepairOptions,
    *,
    repair: bool,
) -> Repair | VolumeMesh | Solid:
    """Return the body itself, from its file where it is a path."""
    if isinstance(body, str | os.PathLike):
        from struck.files.meshes import SUFFIXES, load_volume

        if Path(body).suffix.lower() in SUFFIXES:
            return load_volume(body, units=file.units)
        return stages.get_or_compute(
            SURFACE,
            lambda: _from_file(body, file, options, repair=repair),
            file=Path(body),
            options=file,
            wall=options.wall,
            repair=repair,
            holes=options.holes,
        )
    if isinstance(body, VolumeMesh | Solid):
        return body
    from struck.files.mesh_repair import repair_in_time
    from struck.files.meshes import arrays_of, mesh_of, part_of

    mesh = None
    if isinstance(body, Mesh):
        mesh = body
    elif arrays_of(body) is not None:
        mesh = mesh_of(body, units=file.units, size=file.size, up=file.up)
    if mesh is not None:
        mesh = mesh if file.part is None else part_of(mesh, file.part, file.size)
        return repair_in_time(mesh, **asdict(options))[0] if repair else _unrepaired(mesh)
    raise MeshError(
        f"{type(body).__name__} is no body: give a path, a solid, a Mesh, (vertices, faces), or an "
        "object of trimesh (of a Scene its .to_mesh()), Open3D or PyVista"
    )


def _from_file(
    path: str | os.PathLike[str],
    file: FileOptions,
    options: RepairOptions,
    *,
    repair: bool,
) -> Repair:
    from struck.files.meshes import load_body, load_mesh

    file_options = {option.name: getattr(file, option.name) for option in fields(file)}
    if not repair:
        return _unrepaired(load_mesh(path, **file_options, repair=False))
    return load_body(
        path,
        **file_options,
        wall=options.wall,
        holes=options.holes,
        repair_seconds=options.seconds,
    )


def _unrepaired(mesh: Mesh) -> Repair:
    require_closed(mesh)
    return Repair(mesh=mesh, volume_before=mesh.volume, volume_after=mesh.volume)


def _warn_of(body: Source, repair: Repair) -> None:
    """Warn of the faults of a surface and the changes that mended it."""
    if repair.faults:
        name = f"{body}" if isinstance(body, str | os.PathLike) else "the mesh"
        findings, changes = " ".join(repair.faults), " ".join(repair.changes)
        warnings.warn(f"{name}: {findings} {changes}", RepairWarning, stacklevel=4)
