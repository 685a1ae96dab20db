"""Analysis: from a body and a material to its modal model, by elements or by formula."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from struck.analysis.cached_steps import Stage, Stages, holding
from struck.analysis.discretisation import Discretisation, Elements, FileOptions, discretise
from struck.analysis.fluid_options import FluidOptions
from struck.analysis.source_options import Source, is_shape, require_applicable
from struck.core import machine
from struck.core.machine import in_few_threads
from struck.errors import (
    NoModeError,
    OptionError,
    ScaleWarning,
    StruckError,
    require_choice,
)
from struck.files.cache import opened
from struck.model.arrays import Array, Mask, checked, numbers, require_numbers
from struck.model.damping import Band, require_band
from struck.model.gains import Radiation
from struck.model.material import Air, Material
from struck.model.mesh import Mesh, places_of
from struck.model.model import ModalModel
from struck.model.modes import Modes
from struck.model.provenance import ForecastStage, Progress, Provenance, reported, shown, silent
from struck.radiation import added_mass, by_name
from struck.radiation.added_mass import recoil_of
from struck.solids import resolution
from struck.solids.fem import factorisation
from struck.solids.fem.error_estimates import (
    MIN_WIDTH_RATIO,
    SINGLE_MESH_FACTOR,
    add_shape_errors,
    cut_off,
    nodes_needed,
    quantile_error,
    residual_errors,
    stated_errors,
    times_too_wide,
)
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import vibration_modes, without_modes
from struck.solids.resolution import Cost, Forecast
from struck.solids.surface.repair import require_holes
from struck.solids.volume_mesh import VolumeMesh, linear_tetrahedra

COARSE_MODES: Stage[Modes] = holding("coarse modes", Modes, Mesh, Provenance)
MODES: Stage[Modes] = holding("modes", Modes, Mesh, Provenance)


if TYPE_CHECKING:
    from struck.shapes.shape import Shape

Fixed = ArrayLike | Callable[[Array], Mask]
METHODS = ("formula", "fem", "obrien2002", "obrien2002-consistent")
BAND = (20.0, 20_000.0)
# Coarse meshes come out too stiff, so modes below the band's end may be computed above it.
_BAND_FACTOR = 1.15
_MODES_NEAR_END = 10  # modes from whose errors the limit of completeness is estimated
_CUBIC_FACTOR = 1.5  # times the functions of coarse cubic elements that fine ones have at least
_MAX_ERROR_RATIO = 0.75  # times the errors before, or less: else more elements would not help
CERTAIN = 2.0  # a body is refused if a forecast of memory, over this, exceeds the limit


def _model_to_bytes(model: ModalModel) -> bytes:
    from struck.files import model_file  # only where models are kept

    return model_file.to_bytes(model)


def _model_from_bytes(data: bytes) -> ModalModel:
    from struck.files import model_file

    return model_file.from_bytes(data)


MODEL: Stage[ModalModel] = Stage(name="model", pack=_model_to_bytes, unpack=_model_from_bytes)


@checked
def analyze(
    body: Source,
    material: Material | str,
    *,
    units: str | None = None,
    size: float | None = None,
    part: str | None = None,
    up: str | None = None,
    wall: float | None = None,
    holes: str | None = None,
    repair: bool | None = None,
    repair_seconds: float | None = None,
    fixed: Fixed | None = None,
    accuracy: str | None = None,
    band: Band | None = None,
    damping: str = "own",
    radiation: str = "power",
    air: bool = True,
    recoil: bool = True,
    filled: float | None = None,
    immersed: float | None = None,
    air_mass: bool = False,
    modes: int | None = None,
    method: str | None = None,
    backend: str | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress | None = shown,
) -> ModalModel:
    """Compute the modal model of a body.

    Parameters
    ----------
    body : path, Mesh, VolumeMesh, mesh object, (vertices, faces), solid or shape
        The body to analyze:

        - path of a surface mesh (OBJ, STL, PLY, OFF, GLB, glTF; also compressed by gz, bz2, xz or
          zip) or of a volume mesh (VTK, VTU, MSH, INP);
        - mesh object of trimesh, Open3D or PyVista, or arrays of vertices (V, 3), m, and faces
          (F, 3);
        - body of `struck.solids` or `struck.shapes`.
    material : Material or str
        A material, or its name as listed by `struck.materials`.
    units : {"m", "cm", "mm", "in", "ft"}, optional
        Unit of the coordinates. Default: the unit of a mesh object that has one, otherwise metres.
    size : float, optional
        Scale the body so that the longest edge of its bounding box has this length, m.
    part : str, optional
        Name of the part to analyze if the file contains several (see ``struck info``).
    up : {"x", "y", "z"}, optional
        Axis that points up. Default: as the file format defines it.
    wall : float, optional
        Wall thickness, m. A closed surface becomes a hollow body with its wall inside the surface;
        an open one becomes a sheet, with half of the thickness on either side.
    holes : {"keep", "fill"}, optional
        What to do with holes in a surface that has a wall. Default: keep round and straight-edged
        holes, fill the others.
    repair : bool, optional
        If False, raise MeshError for holes, self-intersections or flipped faces. By default they
        are repaired, and a RepairWarning lists the repairs.
    repair_seconds : float, optional
        Processor time for the repair, s. Default: 10 s for reading and repair together.
    fixed : array-like (2, 3) or callable, optional
        Where the body is clamped: a box given by two corners, m, or a function of points (N, 3)
        that returns a mask (N,).
    accuracy : {"preview", "standard", "fine"}, optional
        Most frequencies have errors below 3, 0.5 or 0.1 %. Default: "standard".
    band : (float, float) or (str, str), optional
        Lowest and highest frequency, Hz or note names. All modes in the band are computed.
        Default: 20 to 20,000 Hz, unless that would take too long.
    damping : {"own", "heard"}, default "own"
        Damping constants of a material that is given by name: internal friction only, or tuned by
        ear to include mounting and radiation (see `Material.named`).
    radiation : {"power", "field", "obrien2002", "heuristic1998"}, default "power"
        How gains are computed. "power": radiated power of each mode, gains in Pa/(N s). "field":
        the same with directivity, by boundary elements, which takes minutes (see
        `ModalModel.radiating`). The other two are those of the papers; their gains are relative.
    air : bool, default True
        Include the losses to the air in the decay rates: radiated sound, and friction and heat
        conduction at the surface. The methods and radiation laws of the papers never include them,
        and damping "heard" contains them.
    recoil : bool, default True
        Include the sound of a free body that is accelerated as a whole. The methods of the papers
        never include it.
    filled : float, optional
        Level of the water inside a vessel, m: a height along the axis that points up, in
        coordinates of the body. Default: empty. Other liquids: `struck.radiation.fill`.
    immersed : float, optional
        Level of the water outside, m, as `filled`, or ``math.inf`` for a body far below the
        surface. Default: none. Flat plates in a wall, other liquids: `struck.radiation.immerse`.
    air_mass : bool, default False
        Include the mass of the air that a membrane or thin plate moves, which lowers its
        frequencies, in free air on both sides. By default, `provenance.dropped` states an estimate
        if this lowers the lowest mode by more than 1 %. In a wall or over a kettle:
        `struck.radiation.add_air_mass`.
    modes : int, optional
        Keep only this many modes, those that are loudest over all contacts. `provenance` reports
        the audible difference, dB.
    method : str, optional
        For bodies of `struck.shapes`: "formula" (default) or "fem". For all others: "quadratic"
        elements (default, also called "fem"), or linear tetrahedra as in the 2002 paper with
        lumped ("obrien2002") or consistent mass ("obrien2002-consistent").
    backend : {"auto", "rslab", "superlu"}, optional
        Sparse factorisation. Default: "auto".
    cache : bool or path, default True
        True: cache intermediate results in the user's cache directory or in ``$STRUCK_CACHE``.
        False: no cache. A path: that directory.
    progress : callable or None, optional
        Called as ``progress(stage, fraction)``. Default: a line on stderr, or a bar in a notebook.
        None: silent.

    Returns
    -------
    ModalModel
        All modes in the band, verified by a Sturm count, with an estimated error of each frequency.

    Raises
    ------
    MeshError
        If the surface cannot be repaired (in time) or meshed.
    MaterialError
        If the material is unknown or its constants are out of range.
    OptionError
        If an option is unknown, out of range or does not apply to this body, such as a level that
        a vessel does not hold.
    FileFormatError
        If the file is missing, damaged or of an unknown format.
    SolverError
        If the eigenvalue solver does not converge.

    Examples
    --------
    A steel bar, 10 cm long:

    >>> bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> model.frequencies[:3].round()
    array([ 5028.,  9203., 11878.])

    A triangle mesh of a hollow sphere with a wall of 4 mm:

    >>> import trimesh
    >>> mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    >>> model = struck.analyze(
    ...     mesh, "glass", wall=0.004, units="m", accuracy="preview", progress=None
    ... )
    >>> len(model.frequencies) > 10
    True
    """
    progress, with_field = reported(progress), radiation == "field"
    radiation = "power" if with_field else radiation
    if modes is not None:
        from struck.perception.audibility import require_budget

        require_budget(modes)
    chosen = Material.of(material, damping)
    if chosen.doubt:
        warnings.warn(chosen.doubt, ScaleWarning, stacklevel=3)
    limits = require_band(BAND if band is None else band)  # before any file
    fluid = FluidOptions(inner_level=filled, outer_level=immersed, air_mass=air_mass)
    resolution.level(accuracy or "standard")
    require_holes(holes, wall)
    radiation_model = by_name(radiation)
    # The papers' own laws of radiation have neither.
    recoil, air = recoil and radiation_model.calibrated, air and radiation_model.calibrated
    file = FileOptions(units=units, size=size, part=part, up=up)
    formula = is_shape(body) and method in {None, "formula"}
    if is_shape(body) and not formula:
        require_choice("method", method, ("quadratic", *METHODS))
    options = {"wall": wall, "accuracy": accuracy, "repair": repair, "holes": holes}
    options["repair_seconds"] = repair_seconds
    file_options = {option.name: getattr(file, option.name) for option in fields(file)}
    require_applicable(
        body, formula=formula, **file_options, **options, fixed=fixed, backend=backend
    )
    if is_shape(body) and formula:
        recoil = recoil and not body.supported
        model = _by_formula(body, chosen, radiation_model, limits, progress, air=air, recoil=recoil)
    else:
        model = _by_elements(
            body,
            chosen,
            limits,
            file=file,
            options=options,
            fixed=fixed,
            chosen_band=band is not None,
            radiation=radiation,
            air=air,
            recoil=recoil,
            method="quadratic" if method is None or method == "fem" else method,
            backend=backend or "auto",
            stages=Stages(cache=opened(choice=cache), progress=progress),
        )
    model = fluid.load(model)
    if with_field:
        model = radiating(model, limits, cache=cache, progress=progress)
    if modes is not None:
        from struck.perception.audibility import budgeted

        model = budgeted(model, modes)
    return model


@in_few_threads
def _by_elements(
    body: Source,
    material: Material,
    band: tuple[float, float],
    *,
    file: FileOptions,
    options: Mapping[str, Any],
    fixed: Fixed | None,
    chosen_band: bool,
    radiation: str,
    air: bool,
    recoil: bool,
    method: str,
    backend: str,
    stages: Stages,
) -> ModalModel:
    """Compute the model of a body by finite elements."""
    if is_shape(body):
        places, playing = body.places, body.playing_place
        body = replace(body.solid(), places=places, playing_place=playing)
        fixed = _choose_fixed(fixed, body.fixed)
    lowest, highest = band
    solver = _solver(method, backend)
    air, recoil = air and method == "quadratic", recoil and method == "quadratic" and fixed is None
    stages.progress("cutting the body into elements", 0.0)
    source = discretise(body, file, stages, **options)
    coarser_levels = resolution.coarser(getattr(source, "accuracy", "preview"))
    solver = replace(solver, coarser=coarser_levels)
    work = _Work(
        stages=stages,
        material=material,
        highest=highest,
        fixed=fixed,
        method=method,
        solver=solver,
        air=air,
        recoils=recoil,
    )
    work.require_scale(source, asked=chosen_band)
    elements, modes = work.resolved(source)
    provenance = _merge_provenance(elements.provenance, modes, body, method)
    model = work.model(replace(modes, provenance=provenance), elements, radiation, lowest)
    return _recoiling(model) if recoil else model


def radiating(
    model: ModalModel,
    band: Band,
    *,
    near: bool = False,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress = silent,
) -> ModalModel:
    """Return the model with its timbre field; each finished frequency is kept in the cache."""
    from struck.radiation.boundary_elements import SurfaceField  # only where it takes minutes

    stage: Stage[SurfaceField] = holding("timbre field", SurfaceField, Mesh, Air)
    keep = partial(Stages(cache=opened(choice=cache)).get_or_compute, stage)
    return model.radiating(band=band, near=near, keep=keep, progress=progress)


def _recoiling(model: ModalModel) -> ModalModel:
    """Return a free body's model with its recoil."""
    if model.geometry is None or model.mass is None:
        return model
    return replace(
        model,
        recoil=recoil_of(model.geometry, model.mass),
        provenance=model.provenance.extended(references=added_mass.REFERENCES),
    )


@in_few_threads
def _by_formula(
    shape: Shape,
    material: Material,
    radiation: Radiation,
    band: tuple[float, float],
    progress: Progress,
    *,
    air: bool,
    recoil: bool,
) -> ModalModel:
    """Return the model of a shape."""
    modes = shape.modes(material, band, none=recoil, progress=progress)
    versions = {name: version(name) for name in ("struck", "numpy", "scipy")}
    provenance = modes.provenance.extended(body=repr(shape), versions=versions)
    model = ModalModel.of(
        replace(modes, provenance=provenance),
        material,
        radiation=radiation,
        lowest=band[0],
        places={**places_of(modes.surface), **shape.places},
        playing_place=shape.playing_place,
        air=air,
    )
    return _recoiling(model) if recoil else model


def _choose_fixed(fixed: Fixed | None, shape_fixed: Fixed | None) -> Fixed | None:
    if fixed is not None and shape_fixed is not None:
        raise OptionError("the shape itself defines where it is held: leave fixed= out")
    return shape_fixed if fixed is None else fixed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Work:
    """The modes and the model of a body's elements, computed or taken from the cache."""

    stages: Stages
    material: Material
    highest: float
    fixed: Fixed | None
    method: str
    solver: Solver
    air: bool
    recoils: bool

    def require_scale(self, source: Discretisation, *, asked: bool) -> None:
        """Forecast modes, time and memory; warn or refuse where they are too many."""
        forecast, nodes = Forecast.of(source.outline, self.material, source.wall), source.nodes
        is_held, doubt = self.fixed is not None, self.material.doubt
        try:
            warning = forecast.require_reasonable(
                self.highest,
                nodes,
                held=is_held,
                requested=asked,
                recoils=self.recoils,
                coarser=self.solver.coarser,
            )
        except OptionError as error:
            raise type(error)(f"{doubt}; else {error}" if doubt else str(error)) from error
        cost = Cost.of(forecast.modes(self.highest), nodes)
        if warning:
            warnings.warn(warning, ScaleWarning, stacklevel=6)
        self.stages.progress(ForecastStage.of(cost, cost.memory), 0.0)
        free = machine.available()
        factorisation.require(int(cost.memory / CERTAIN), free, self.solver.coarser)

    def resolved(self, source: Discretisation) -> tuple[Elements, Modes]:
        """Return elements and their modes, with errors estimated by a coarser resolution too."""
        coarse_elements, coarse_modes = self._coarse(source)
        nodes = 0
        if coarse_elements and coarse_modes and source.error and self.method == "quadratic":
            function_count = coarse_elements.mesh.functions
            min_factor = _CUBIC_FACTOR if coarse_elements.mesh.cubic else 0.0
            nodes = max(
                nodes_needed(coarse_modes, function_count, source.error),
                round(min_factor * function_count),
            )
        elements = source.fine(self.stages, nodes)
        try:
            modes = self._modes(elements.mesh, MODES, self.highest)
        except NoModeError as error:
            if not self.recoils:
                raise
            none = without_modes(
                self._promoted(elements.mesh),
                self.material,
                self.highest,
                solver=self.solver,
                why=f"{str(error).partition(';')[0]}: what is heard is its recoil",
            )
            return elements, none
        judged_modes = self._judged(elements, modes, coarse_elements, coarse_modes)
        has_improved = True
        while has_improved and (finer := self._finer(source, elements, judged_modes)):
            coarse_elements, coarse_modes, old_error = elements, modes, quantile_error(judged_modes)
            elements, modes = finer, self._modes(finer.mesh, MODES, self.highest)
            judged_modes = self._judged(elements, modes, coarse_elements, coarse_modes)
            has_improved = quantile_error(judged_modes) < _MAX_ERROR_RATIO * old_error
        return elements, judged_modes

    def _finer(self, source: Discretisation, elements: Elements, modes: Modes) -> Elements | None:
        """Return finer elements where the stated errors are far above the accuracy's."""
        if source.error is None or self.method != "quadratic":
            return None
        times = times_too_wide(quantile_error(modes), source.error)
        finer_elements = source.finer(self.stages, elements.times * times) if times > 1 else None
        if (
            finer_elements is None
            or elements.mesh.width() < MIN_WIDTH_RATIO * finer_elements.mesh.width()
        ):
            return None
        return finer_elements

    def _judged(
        self, elements: Elements, modes: Modes, coarse: Elements | None, first: Modes | None
    ) -> Modes:
        """Return modes with stated errors, from the shape and from coarser elements if any."""
        finer = coarse.mesh.width() / elements.mesh.width() if coarse else 1.0
        errors = stated_errors(modes, first, finer) + elements.stiffened
        cut = cut_off(elements.outline, modes) if elements.outline else 0.0
        errors = add_shape_errors(errors, elements.volume_error, cut, layer=elements.mesh.cubic)
        judge = "the next degree of polynomials"
        if coarse and finer >= MIN_WIDTH_RATIO:
            judge = f"{coarse.mesh.functions} nodes beside these"
        provenance = modes.provenance.extended(references=("bank1993",), errors_by=judge)
        # A mode just beyond the band's end may truly lie below it, by as much as its neighbours.
        doubt = float(np.quantile(errors[-_MODES_NEAR_END:], 0.9)) if len(errors) else 0.0
        certain = modes.complete_to / (1 + doubt)
        return replace(modes, errors=errors, complete_to=certain, provenance=provenance)

    def model(self, modes: Modes, elements: Elements, radiation: str, lowest: float) -> ModalModel:
        """Return the model of the modes, with its outermost places and the elements' places."""
        places, playing = {**places_of(modes.surface), **elements.places}, elements.playing_place
        self.stages.progress("computing how loudly modes radiate", 0.0)
        return self.stages.get_or_compute(
            MODEL,
            lambda: ModalModel.of(
                modes,
                self.material,
                radiation=by_name(radiation),
                lowest=lowest,
                places=places,
                playing_place=playing,
                air=self.air,
            ),
            modes=modes,
            material=self.material,
            radiation=radiation,
            lowest=lowest,
            places=places,
            playing_place=playing,
            air=self.air,
        )

    def _coarse(self, source: Discretisation) -> tuple[Elements | None, Modes | None]:
        """Return coarse elements and their modes, where they can be had."""
        try:
            coarse = source.coarse(self.stages)
            if coarse is None:
                return None, None
            return coarse, self._modes(coarse.mesh, COARSE_MODES, _BAND_FACTOR * self.highest)
        except StruckError:  # the finer elements raise what is wrong with the body itself
            return None, None

    def _promoted(self, given: VolumeMesh) -> VolumeMesh:
        return given.promoted() if self.method == "quadratic" else linear_tetrahedra(given)

    def _modes(self, given: VolumeMesh, stage: Stage[Modes], highest: float) -> Modes:
        mesh = self._promoted(given)
        held = _find_held(self.fixed, mesh)
        material = self.material

        def estimate(values: Array, vectors: Array) -> Array:
            return SINGLE_MESH_FACTOR * residual_errors(mesh, material, values, vectors)

        compute = partial(
            vibration_modes,
            mesh,
            material,
            highest,
            fixed=held,
            solver=self.solver,
            estimate=estimate,
            progress=self.stages.progress,
        )
        return self.stages.get_or_compute(
            stage,
            compute,
            mesh=mesh,
            elastic=(material.density, material.youngs_modulus, material.poisson_ratio),
            highest=highest,
            fixed=held,
            solver=self.solver,
        )


def _solver(method: str, backend: str) -> Solver:
    if method == "formula":
        raise OptionError(
            "method is 'formula': this body has none, as it is no shape: leave method= out"
        )
    require_choice("method", method, ("quadratic", *METHODS))
    return Solver(lumped=method == "obrien2002", backend=backend)


def _find_held(fixed: Fixed | None, mesh: VolumeMesh) -> Mask | None:
    if fixed is None:
        return None
    if callable(fixed):
        held = np.asarray(fixed(mesh.nodes), dtype=bool)
        if held.shape != (len(mesh.nodes),):
            raise OptionError(f"fixed() gave shape {held.shape}: return one bool a point")
    else:
        box = numbers("fixed", fixed)
        if box.shape != (2, 3):
            raise OptionError(
                f"fixed has shape {box.shape}: give two corners of a box, (2, 3) in m"
            )
        held = ((mesh.nodes >= box.min(axis=0)) & (mesh.nodes <= box.max(axis=0))).all(axis=1)
    if not held.any() or held.all():
        low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
        raise OptionError(
            f"fixed= holds {held.sum()} of {len(held)} nodes: the body reaches from "
            f"{np.round(low, 4).tolist()} to {np.round(high, 4).tolist()} m; give a box that holds "
            "a part of it"
        )
    return held


def _merge_provenance(start: Provenance, modes: Modes, body: Source, method: str) -> Provenance:
    """Join how the elements and the modes were made, with versions and the input's hash."""
    paper = ("obrien2002",) if method != "quadratic" else ()
    versions = {name: version(name) for name in ("struck", "numpy", "scipy", "rslab", "libigl")}
    provenance = replace(
        start,
        method=f"{start.method}, {modes.provenance.method}",
        details={**start.details, **modes.provenance.details, **_input(body), "versions": versions},
    )
    modes_provenance = modes.provenance
    return provenance.extended(
        references=(*paper, *modes_provenance.references), dropped=modes_provenance.dropped
    )


def _input(body: Source) -> dict[str, object]:
    if not isinstance(body, str | os.PathLike):
        return {}
    path = Path(body)
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


@checked
def model_of_modes(
    points: ArrayLike,
    faces: ArrayLike,
    frequencies: ArrayLike,
    shapes: ArrayLike,
    *,
    material: Material,
    mass: float,
    centre: ArrayLike,
    inertia: ArrayLike,
    complete_to: float = 0.0,
    radiation: Radiation | None = None,
    air: bool = True,
    places: Mapping[str, Array] | None = None,
    method: str = "modes of another program",
    up: str = "z",
) -> ModalModel:
    """Make a model of modes that another program computed, or that were measured.

    Parameters
    ----------
    points : array-like (V, 3)
        Vertices of the surface, m.
    faces : array-like (F, 3) of int
        Vertex indices of each triangle, counter-clockwise seen from outside.
    frequencies : array-like (M,)
        Natural frequencies, ascending, Hz.
    shapes : array-like (V, 3, M)
        Mass-normalised mode shapes at the vertices, kg^-1/2.
    material : Material
        Material, whose damping gives the decay rates.
    mass : float
        Mass, kg.
    centre : array-like (3,)
        Centre of mass, m.
    inertia : array-like (3, 3)
        Moments of inertia about the centre of mass, kg m^2.
    complete_to : float, default 0.0
        Frequency below which no mode is missing, Hz.
    radiation : Radiation, optional
        Estimate of the radiated sound. Default: the radiated power.
    air : bool, default True
        Include the losses to the air in the decay rates.
    places : mapping of str to array (3,), optional
        Contacts by name, m.
    method : str, default "modes of another program"
        Origin of the modes, for `provenance`.
    up : {"y", "z"}, default "z"
        Axis that points up.

    Returns
    -------
    ModalModel
        With the material's damping and without recoil; the errors of its frequencies are NaN.

    Raises
    ------
    OptionError
        If numbers are not finite, or arrays do not fit each other.
    MeshError
        If the surface has no faces, or impossible ones.

    Notes
    -----
    Mass-normalised means that the sum over all nodes of mass times squared displacement is 1 kg m^2
    for each mode, divided by kg m^2: a shape u of any scale is divided by sqrt(u^T M u). Rotations
    of shell elements are left out, and of the inner nodes only the mass counts.
    """
    surface = Mesh(points=np.asarray(points), faces=np.asarray(faces), up=up)
    natural, forms = np.asarray(frequencies, float), np.asarray(shapes, float)
    _require_fitting(natural, forms, len(surface.points))
    unknown = np.full(len(natural), np.nan)
    modes = Modes(
        frequencies=natural,
        surface=surface,
        shapes=forms,
        mass=float(mass),
        centre=_array_of_shape("centre", centre, 3),
        inertia=_array_of_shape("inertia", inertia, 3, 3),
        complete_to=complete_to,
        poisson_slopes=unknown,
        errors=unknown,
        provenance=Provenance(method=method),
    )
    radiation = radiation or by_name("power")
    return ModalModel.of(modes, material, radiation=radiation, lowest=0.0, places=places, air=air)


def _array_of_shape(name: str, values: ArrayLike, *shape: int) -> Array:
    array = numbers(name, values)
    require_numbers(name, array, shape)
    return array


def _require_fitting(frequencies: Array, shapes: Array, vertices: int) -> None:
    if frequencies.ndim != 1:
        raise OptionError(f"frequencies have shape {frequencies.shape}: give them in a row")
    if shapes.shape != (vertices, 3, len(frequencies)):
        raise OptionError(
            f"shapes have shape {shapes.shape}, not ({vertices}, 3, {len(frequencies)}): give "
            "one displacement (3,) at each vertex for each frequency"
        )
    if not np.isfinite(shapes).all() or not np.isfinite(frequencies).all():
        raise OptionError("frequencies or shapes are not finite: leave those modes out")
    if not len(frequencies) or np.any(np.diff(frequencies) < 0) or frequencies.min() <= 0:
        raise OptionError("frequencies must ascend from above 0 Hz: leave rigid motions out")
