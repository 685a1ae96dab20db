"""Fluid loading: the frequencies of a body that moves a fluid along with its surface.

The fluid adds a mass matrix to the unit matrix of mass-normalised modes. The modes of the loaded
body are combinations of those of the body in vacuum: solutions of a generalised eigenproblem of as
many equations. Derivation, limits and measured errors: docs, "Fluid loading".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.spatial import Delaunay, KDTree

from struck.errors import MeshError, OptionError, counted, require_choice, rounded
from struck.model.arrays import Array, Index, checked, require_number
from struck.model.damping import Each
from struck.model.gains import ShapeGains, canonical_signs
from struck.model.material import AIR, Air
from struck.model.mesh import MAX_COORDINATE, Mesh, part_mesh
from struck.model.mesh_topology import edges_of, submesh
from struck.model.model import ModalModel
from struck.radiation.boundary_elements import MIN_WALL_RATIO, Walls, edge_length
from struck.radiation.fluid_mass import SheetInFluid, surface_mass
from struck.radiation.on_surface import Skin, laplacian
from struck.radiation.wet_surface import (
    WetSurface,
    coarsen,
    find_cavity_walls,
    find_outer_walls,
)

SETTINGS = ("free", "wall", "one side")
# Densities of liquids, kg/m^3, at 20 degrees Celsius, and the speed of sound in water, m/s.
LIQUIDS = {"water": 998.2, "sea water": 1024.8}
_LIQUID_SPEED = 1482.0
# kg/m^3: platinum has 21,450, and no liquid is denser; hydrogen has 0.08.
_MAX_DENSITY, _MIN_DENSITY = 21_500.0, 0.01
# Triangles of a wet surface: with 1,470 and 5,880 of them, the lowest frequency of a glass of 3 cm
# that is filled up to 2 cm below the rim differs by 0.4 %.
_MAX_FACES = 3000
# Triangles of a flat sheet: with 1,084 and 3,960 of them, the added mass of the shape of a
# clamped disc differs by 0.5 %; that of heads with 960 is 2 to 4 % too small.
_MAX_SHEET_FACES = 1100
_ELEMENTS_PER_WAVE = 6  # as for radiated fields: fewer do not resolve the shape of a mode
_SPLINE_NODES = 9  # wave numbers of a sheet's added mass, between which a spline interpolates
_SHEET_RATIO = 0.05  # thickness over extent above which a flat body counts as a solid one
_MIN_COSINE = 0.99  # cosine between a normal and z, from which a face lies in the plane of a sheet
_MAX_AREA_DIFFERENCE = 0.01  # of the upper side and the lower one of a sheet, over the area
# Mean square of the motion across a sheet, over the largest, below which a mode moves in its plane.
# Shapes are mass-normalised, so that bending modes are within 3 % of each other on plates, and
# within 20 % on a block of 300 x 200 x 4 mm, whose mode in the plane has less than 0.001.
_MIN_BENDING = 0.1
# Start of the note on a model that leaves out a mass of the air that matters.
AIR_LEFT_OUT = "the mass of the air"
# Fraction of the modes whose frequencies are computed again without the rest, and the difference up
# to which a frequency counts as converged.
_SUBSPACE_FRACTION, _MAX_ERROR = 0.75, 0.01
# Least share of wave number squared that is left for the near field when sound in the fluid has
# waves as long as the mode's: the infinite plane of the formula would have an infinite mass there.
_MIN_NEAR_FIELD = 0.1
_ITERATIONS = 40  # half steps to the loaded frequency: 2^-40 of the way is left
_MIN_INERTIA = 0.1  # of a mode with its fluid, over that without
_THINNING = 0.75  # distance of the vertices of a thinned sheet, over the edges that it is to have
_FLAT = 1e-6  # of the extent: points nearer to a sheet lie on it, within rounding


@checked
def immerse(
    model: ModalModel,
    fluid: str | float = "water",
    *,
    level: float | None = None,
    filled: float | None = None,
    setting: str = "free",
) -> ModalModel:
    """Compute the model of a body that is immersed in a liquid.

    The liquid is incompressible and has no viscosity. A vessel whose rim is above the level is dry
    inside by default; otherwise, all faces below the level are wet.

    Parameters
    ----------
    model : ModalModel
        Computed model of the dry body.
    fluid : {"water", "sea water"} or float, default "water"
        Name of the liquid, or its density, kg/m^3.
    level : float, optional
        Height of the surface of the liquid along the axis `model.geometry.up`, in coordinates of
        the body, m. Default: no surface, the liquid extends to infinity.
    filled : float, optional
        Height of the surface of the same liquid inside a vessel whose rim is above `level`, m.
    setting : {"free", "wall", "one side"}, default "free"
        Surroundings of a membrane or thin plate: "free" in liquid all around, "wall" in a
        rigid wall without end with liquid on both sides, "one side" the same with liquid on the
        side of positive z alone.

    Returns
    -------
    ModalModel
        The loaded model. Its outputs are those of its motion in air.

    Raises
    ------
    OptionError
        If the model was recorded or is loaded already, the density is not that of a liquid or gas,
        the level is below the body, the vessel does not hold the liquid inside, or a setting is
        given that is only for flat sheets.
    MeshError
        If a wet wall is too thin for boundary elements.

    Notes
    -----
    Modes of the dry body outside the model are missing in the shapes of the loaded one, so that its
    frequencies are too high, most of all the highest: `errors` contains an estimate, and
    `provenance.dropped` the number of modes that it exceeds 1 % for.

    Examples
    --------
    >>> plate = struck.shapes.CircularPlate(radius=0.1, thickness=0.002, edge="clamped")
    >>> dry = struck.analyze(plate, "steel", band=(20, 3000), progress=None)
    >>> wet = struck.radiation.immerse(dry, "water", setting="one side")
    >>> bool(wet.frequencies[0] < 0.5 * dry.frequencies[0])
    True
    """
    gains = _require_dry(model)
    density, name = _density_of(fluid)
    require_choice("setting", setting, SETTINGS)
    details: dict[str, object] = {"fluid": name}
    heights = [height for height in (level, filled) if height is not None]
    for height in heights:
        _require_level(height)
    sheet = _FlatSheet.of(gains)
    if sheet is not None:
        if heights:
            raise OptionError(
                f"level is {rounded(heights[0], 4)} m, and a flat sheet can be immersed without a "
                "level alone, far from the surface of the liquid: leave level= out (in `analyze`: "
                "immersed=math.inf)"
            )
        medium = Air(density=density, sound_speed=_LIQUID_SPEED)
        return _load_sheet(model, gains, sheet, medium, setting, details | {"setting": setting})
    if setting != "free":
        raise OptionError(
            f"setting is {setting!r}, which is for membranes and plates thinner than "
            f"{_SHEET_RATIO} of their extent across z: leave setting= out"
        )
    if filled is not None:
        if level is None:
            raise OptionError(
                f"filled is {rounded(filled, 4)} m, and a liquid without a surface around the "
                "vessel fills it too: give level=, or leave filled= out"
            )
        find_cavity_walls(gains.surface, max(level, filled))  # else the liquids would meet
    bodies = [_LiquidBody(walls=_find_wet_skin(gains, level), level=level)]
    if level is not None:
        details["level"] = f"{rounded(level, 4)} m"
    if filled is not None:
        details["filled"] = f"{rounded(filled, 4)} m"
        bodies.append(_LiquidBody(walls=_find_wet_cavity(gains, filled), level=filled))
    return _load_surface(model, gains, bodies, density, details)


@checked
def fill(model: ModalModel, level: float, fluid: str | float = "water") -> ModalModel:
    """Compute the model of a vessel that contains a liquid up to a level, as of a wine glass.

    The liquid is incompressible and has no viscosity; there is air outside.

    Parameters
    ----------
    model : ModalModel
        Computed model of the empty vessel.
    level : float
        Height of the surface of the liquid along the axis `model.geometry.up`, in coordinates of
        the body, m.
    fluid : {"water", "sea water"} or float, default "water"
        Name of the liquid, or its density, kg/m^3.

    Returns
    -------
    ModalModel
        The loaded model. Its outputs are those of its motion in air, also of the wet faces.

    Raises
    ------
    OptionError
        If the model was recorded or is loaded already, the density is not that of a liquid or gas,
        or the body holds no liquid up to this level; the message has the range of levels.

    Notes
    -----
    See `immerse` on the errors of high modes.

    Examples
    --------
    >>> bowl = struck.solids.bowl(radius=0.06, height=0.04, wall=0.002)
    >>> empty = struck.analyze(bowl, "glass", accuracy="preview", progress=None)
    >>> full = struck.radiation.fill(empty, level=0.03)
    >>> bool(full.frequencies[0] < empty.frequencies[0])
    True
    """
    gains = _require_dry(model)
    density, name = _density_of(fluid)
    _require_level(level)
    liquid = _LiquidBody(walls=_find_wet_cavity(gains, level), level=level)
    details: dict[str, object] = {"fluid": f"{name}, inside", "level": f"{rounded(level, 4)} m"}
    return _load_surface(model, gains, [liquid], density, details)


@checked
def add_air_mass(
    model: ModalModel, *, setting: str = "free", kettle: float | None = None, air: Air = AIR
) -> ModalModel:
    """Compute the model of a membrane or thin plate with the mass of the air that it moves.

    The air lowers the frequencies of a drum head by tens of per cent. The mass of each mode is that
    at its frequency in air: sound is not infinitely fast.

    Parameters
    ----------
    model : ModalModel
        Computed model of the sheet in vacuum, such as of `struck.shapes.CircularMembrane`.
    setting : {"free", "wall", "one side"}, default "free"
        "free" in air all around, "wall" in a rigid wall without end with air on both sides, "one
        side" the same with air on the side of positive z alone.
    kettle : float, optional
        Volume of air that the sheet closes off, m^3, which acts as a spring on modes that change
        it. Default: none.
    air : Air, default Air(density=1.2041, sound_speed=343.21)
        The gas; density in kg/m^3, speed of sound in m/s.

    Returns
    -------
    ModalModel
        The loaded model.

    Raises
    ------
    OptionError
        If the model was recorded or is loaded already, the body is no flat sheet across z, or the
        volume is not positive.

    Examples
    --------
    >>> head = struck.shapes.CircularMembrane(radius=0.328, thickness=0.00019, tension=4000.0)
    >>> pet = struck.Material(density=1390.0, youngs_modulus=5e9, poisson_ratio=0.38)
    >>> vacuum = struck.analyze(head, pet, band=(20, 500), progress=None)
    >>> air = struck.radiation.add_air_mass(vacuum)
    >>> bool(air.frequencies[0] < 0.7 * vacuum.frequencies[0])
    True
    """
    gains = _require_dry(model)
    require_choice("setting", setting, SETTINGS)
    if kettle is not None:
        require_number("kettle", kettle, 1e-12, hint="a volume must exceed 0", unit=" m^3")
    _density_of(air.density)
    require_number("speed of sound", air.sound_speed, 1.0, hint="air has 343 m/s", unit=" m/s")
    sheet = _FlatSheet.of(gains)
    if sheet is None:
        raise OptionError(
            f"the body is no flat sheet across z, of at most {_SHEET_RATIO} of its extent in "
            "thickness, and other bodies are too heavy for the air to matter: leave the model "
            "as it is (in `analyze`: air_mass=False)"
        )
    details: dict[str, object] = {"fluid": "air", "setting": setting}
    if kettle is not None:
        details["kettle"] = f"{rounded(kettle, 4)} m^3"
    return _load_sheet(model, gains, sheet, air, setting, details, kettle)


def _require_dry(model: ModalModel) -> ShapeGains:
    """Return the gains of a model that can be loaded; OptionError on others."""
    if not isinstance(model.gains, ShapeGains) or model.geometry is None:
        raise OptionError(
            "the model was recorded, and only a computed one knows the motion of its surface: "
            "analyze the body"
        )
    if "fluid" in model.provenance.details:
        raise OptionError(
            f"the model is loaded by {model.provenance.details['fluid']} already: load the model "
            "of the dry body"
        )
    if not model.gains.count:
        raise OptionError("the model has no modes to load: widen the band of the analysis")
    return model.gains


def _require_level(level: float) -> None:
    """Raise OptionError unless a level is a coordinate that a body may have, m."""
    hint = "it must be a finite height in coordinates of the body"
    require_number("level", level, -MAX_COORDINATE, MAX_COORDINATE, hint=hint, unit=" m")


def _density_of(fluid: str | float) -> tuple[float, str]:
    """Return the density of a liquid, kg/m^3, and its name."""
    if isinstance(fluid, str):
        require_choice("fluid", fluid, tuple(LIQUIDS))
        return LIQUIDS[fluid], fluid
    require_number(
        "density of the fluid",
        fluid,
        _MIN_DENSITY,
        _MAX_DENSITY,
        hint="water has 998.2 kg/m^3",
        unit=" kg/m^3",
    )
    return float(fluid), f"liquid of {rounded(fluid, 5)} kg/m^3"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LiquidBody:
    """Liquid on some faces of a body, up to a level, m, or without a surface."""

    walls: WetSurface
    level: float | None


def _find_wet_cavity(gains: ShapeGains, level: float) -> WetSurface:
    """Return the faces that a liquid in a vessel wets, in triangles that are not too many."""
    walls = find_cavity_walls(gains.surface, level)
    if len(walls.mesh.faces) > _MAX_FACES:
        coarse_surface = coarsen(gains.surface, walls, _MAX_FACES)
        walls = find_cavity_walls(coarse_surface.mesh, level)
        walls = replace(walls, weights=walls.weights @ coarse_surface.weights)
    return walls


def _find_wet_skin(gains: ShapeGains, level: float | None) -> WetSurface:
    """Return the faces of a body's skin below a level; MeshError if a wall is too thin."""
    surface = gains.surface
    skin = part_mesh(
        surface.points, surface.faces[Skin.of(surface, gains.centre).faces], surface.up
    )
    height = np.inf if level is None else level
    wet_surface = find_outer_walls(skin, height)
    if len(wet_surface.mesh.faces) > _MAX_FACES:
        coarse_surface = coarsen(skin, wet_surface, _MAX_FACES)
        skin = coarse_surface.mesh
        part = find_outer_walls(skin, height)
        wet_surface = replace(part, weights=part.weights @ coarse_surface.weights)
    # A wall that is dry on its other side may be as thin as it likes.
    walls = Walls.of(skin, wet_surface.mesh).between(wet_surface.mesh, _FLAT * skin.extent)
    if walls.min_ratio < MIN_WALL_RATIO:
        depth, place = walls.shallowest
        position = ", ".join(rounded(coordinate, 3) for coordinate in place)
        raise MeshError(
            f"the body is {rounded(1000 * depth, 2)} mm thick at ({position}) m, "
            f"{rounded(walls.min_ratio, 2)} of the boundary elements there, of {MIN_WALL_RATIO} at "
            "least: analyze it with a finer accuracy, or as a membrane or plate of struck.shapes"
        )
    return wet_surface


def _load_surface(
    model: ModalModel,
    gains: ShapeGains,
    bodies: list[_LiquidBody],
    density: float,
    details: dict[str, object],
) -> ModalModel:
    """Return the model loaded by incompressible liquids that do not touch each other."""
    motions = _Motions.of(model, gains)
    masses = [
        surface_mass(
            liquid.walls.mesh, liquid.walls.normal_velocities(motions.shapes), density, liquid.level
        )
        for liquid in bodies
    ]
    face_count = sum(len(liquid.walls.mesh.faces) for liquid in bodies)
    # Sound in the liquid goes once around the body in a period.
    max_frequency = _LIQUID_SPEED / (2 * np.pi * gains.radius)
    loaded_model = motions.load(np.sum(masses, axis=0), details | {"wet faces": face_count})
    count = int(np.count_nonzero(loaded_model.natural_frequencies > max_frequency))
    if not count:
        return loaded_model
    note = (
        f"{counted(count, 'mode')} above {rounded(max_frequency, 3)} Hz: the compressibility of "
        "the liquid is neglected, whose sound goes less than once around the body in a period"
    )
    return replace(loaded_model, provenance=loaded_model.provenance.extended(dropped=(note,)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Motions:
    """Motions of a dry body: its modes, after those as a rigid body if it is free."""

    model: ModalModel
    gains: ShapeGains
    shapes: Array  # (V, 3, R + M), kg^-1/2
    squares: Array  # (R + M,), squared angular frequencies, 1/s^2; 0 of rigid motions

    @classmethod
    def of(cls, model: ModalModel, gains: ShapeGains) -> _Motions:
        """Return the motions of a model."""
        rigid_motions = _compute_rigid_motions(model, gains.surface.points)
        squares = np.square(2 * np.pi * model.natural_frequencies)
        return cls(
            model=model,
            gains=gains,
            shapes=np.concatenate([rigid_motions, gains.shapes.astype(np.float64)], axis=2),
            squares=np.concatenate([np.zeros(rigid_motions.shape[2]), squares]),
        )

    @property
    def rigid_count(self) -> int:
        """Number of motions as a rigid body, R."""
        return len(self.squares) - self.gains.count

    def load(
        self, mass: Array, details: dict[str, object], stiffness: Array | float = 0.0
    ) -> ModalModel:
        """Return the model with an added mass and stiffness (R + M, R + M) of all motions."""
        model, first = self.model, self.rigid_count
        squares, vectors = self._solve(mass, stiffness, len(self.squares))
        frequencies = np.sqrt(squares[first:]) / (2 * np.pi)
        vectors = vectors[:, first:]
        estimates = self._subspace_errors(mass, stiffness, frequencies)
        shapes = np.tensordot(self.shapes, vectors, 1)
        shapes *= canonical_signs(self.gains.surface, shapes)
        gains = ShapeGains.radiating(
            self.gains.surface, shapes, frequencies, self.gains.centre, self.gains.radiation
        )
        leading_modes = np.argmax(np.abs(vectors[first:]), axis=0)
        slopes, errors = model.poisson_slopes, model.errors
        lowering = float(np.min(frequencies / model.natural_frequencies))
        provenance = model.provenance
        others = tuple(note for note in provenance.dropped if not note.startswith(AIR_LEFT_OUT))
        loaded_model = replace(
            model,
            frequencies=frequencies,
            natural_frequencies=frequencies,
            gains=gains,
            poisson_slopes=None if slopes is None else slopes[leading_modes],
            errors=estimates + (0.0 if errors is None else errors[leading_modes]),
            # A mode beyond the model's may have come down as far as its lowest ratio.
            complete_to=model.complete_to * min(lowering, 1.0),
            recoil=None,
            provenance=replace(provenance, dropped=others).extended(
                references=("lamb1920", "wilton1984"),
                dropped=self._notes(estimates, frequencies),
                **details,
            ),
        )
        material = model.material
        return loaded_model.damped(
            Each(rates=model.decays) if material is None else material.damping
        )

    def _solve(self, mass: Array, stiffness: Array | float, count: int) -> tuple[Array, Array]:
        """Solve the loaded eigenproblem in the first `count` motions."""
        matrix = (np.diag(self.squares) + stiffness)[:count, :count]
        squares, vectors = eigh(matrix, np.eye(count) + mass[:count, :count])
        return np.maximum(squares, 0.0), vectors

    def _subspace_errors(self, mass: Array, stiffness: Array | float, frequencies: Array) -> Array:
        """Estimate by how much each frequency (M,) is too high for lack of further motions.

        By as much as it falls with the last quarter of the modes, and for these themselves by as
        much as that is of any other mode. NaN if there is one mode alone.
        """
        count = len(frequencies)
        subspace_count = min(int(np.ceil(_SUBSPACE_FRACTION * count)), count - 1)
        if subspace_count == 0:
            return np.full(count, np.nan)
        squares, _ = self._solve(mass, stiffness, self.rigid_count + subspace_count)
        subspace_frequencies = np.sqrt(squares[self.rigid_count :]) / (2 * np.pi)
        differences = np.maximum(subspace_frequencies / frequencies[:subspace_count] - 1, 0.0)
        return np.append(differences, np.full(count - subspace_count, differences.max()))

    def _notes(self, estimates: Array, frequencies: Array) -> tuple[str, ...]:
        """Return the notes on what the loaded model lacks."""
        notes = []
        bad_modes = np.flatnonzero(~(estimates <= _MAX_ERROR))
        if len(bad_modes):
            notes.append(
                f"{counted(len(bad_modes), 'mode')} from {rounded(frequencies[bad_modes[0]], 4)} "
                "Hz up with a frequency that may be more than "
                f"{_MAX_ERROR:.0%} too high: analyze the dry body in a wider band"
            )
        if self.model.recoil is not None:
            notes.append("its recoil, which is of the dry body")
        if self.gains.directional:
            notes.append("its timbre field, which is of the dry body: compute it again")
        return tuple(notes)


def _compute_rigid_motions(model: ModalModel, points: Array) -> Array:
    """Return the mass-normalised motions of a free body as a whole (V, 3, 6), or (V, 3, 0)."""
    mass, centre, inertia = model.mass, model.centre, model.inertia
    if model.supported or mass is None or centre is None or inertia is None:
        return np.zeros((len(points), 3, 0))
    moments, axes = np.linalg.eigh(inertia)
    rotations = np.cross(axes.T[None], (points - centre)[:, None]) / np.sqrt(moments)[:, None]
    translations = np.broadcast_to(np.eye(3) / np.sqrt(mass), (len(points), 3, 3))
    return np.concatenate([translations, np.moveaxis(rotations, 1, 2)], axis=2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FlatSheet:
    """The upper side of a flat body that is thin across z."""

    mesh: Mesh  # V vertices, open
    vertices: Index  # (V,), their numbers on the surface of the body

    @classmethod
    def of(cls, gains: ShapeGains) -> _FlatSheet | None:
        """Return the upper side of a flat body, or None if it is not flat."""
        surface = gains.surface
        extents = np.ptp(surface.bounds, axis=0)
        if extents[2] > _SHEET_RATIO * extents[:2].min():
            return None
        heights = surface.face_normals[:, 2]
        upper, lower = (np.flatnonzero(sign * heights > _MIN_COSINE) for sign in (1, -1))
        area = surface.areas[upper].sum()
        if not len(upper) or abs(area - surface.areas[lower].sum()) > _MAX_AREA_DIFFERENCE * area:
            return None
        return cls(mesh=submesh(surface, upper), vertices=np.unique(surface.faces[upper]))

    def thin_out(self, max_faces: int) -> _FlatSheet:
        """Return the sheet with some of its vertices, so that it has about `max_faces` at most."""
        if len(self.mesh.faces) <= max_faces:
            return self
        spacing = edge_length(self.mesh) * np.sqrt(len(self.mesh.faces) / max_faces)
        rim = _rim_vertices(self.mesh)
        order = np.concatenate([rim, np.setdiff1d(np.arange(len(self.vertices)), rim)])
        plan = self.mesh.points[:, :2]
        neighbours = KDTree(plan).query_ball_point(plan, _THINNING * spacing)
        is_free, vertices = np.ones(len(plan), bool), []
        for vertex in order:
            if is_free[vertex]:
                vertices.append(vertex)
                is_free[neighbours[vertex]] = False
        numbers = np.array(vertices)
        triangles = Delaunay(plan[numbers]).simplices
        corners = plan[numbers][triangles]
        x_sides, y_sides = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
        doubled_areas = x_sides[:, 0] * y_sides[:, 1] - y_sides[:, 0] * x_sides[:, 1]
        triangles[doubled_areas < 0] = triangles[doubled_areas < 0, ::-1]
        # Delaunay's triangles also fill the holes and hollows of a plan.
        centres = self.mesh.points[numbers][triangles].mean(axis=1)
        distances, _, _ = self.mesh.locator.closest(centres)
        is_inside = (distances < _FLAT * self.mesh.extent) & (
            np.abs(doubled_areas) > _FLAT * spacing**2
        )
        mesh = part_mesh(self.mesh.points[numbers], triangles[is_inside].astype(np.int64))
        return _FlatSheet(mesh=mesh, vertices=self.vertices[numbers])


def _rim_vertices(mesh: Mesh) -> Index:
    """Return the vertices on the rim of an open surface, its corners first."""
    edges = edges_of(mesh.faces)
    ends = edges.ends[edges.faces_at == 1]
    sums = np.zeros_like(mesh.points)
    for start, end in (ends.T, ends.T[::-1]):
        sides = mesh.points[end] - mesh.points[start]
        np.add.at(sums, start, sides / np.linalg.norm(sides, axis=1)[:, None])
    rim = np.unique(ends)
    # The unit vectors to both neighbours cancel where the rim is straight.
    return rim[np.argsort(-np.linalg.norm(sums[rim], axis=1), kind="stable")]


def _load_sheet(
    model: ModalModel,
    gains: ShapeGains,
    sheet: _FlatSheet,
    medium: Air,
    setting: str,
    details: dict[str, object],
    kettle: float | None = None,
) -> ModalModel:
    """Return the model of a flat sheet loaded by a gas or liquid, and by a closed volume of it."""
    motions = _Motions.of(model, gains)
    if kettle is not None and motions.rigid_count:
        raise OptionError(
            f"kettle is {rounded(kettle, 4)} m^3, and a free plate closes off no air: leave "
            "kettle= out"
        )
    mass, plane_count = _sheet_mass(motions, sheet, medium, setting)
    stiffness: Array | float = 0.0
    if kettle is not None:
        velocities = motions.shapes[sheet.vertices, 2]
        volumes = np.einsum("f,fcm->m", sheet.mesh.areas / 3, velocities[sheet.mesh.faces])
        stiffness = cavity_stiffness(volumes, kettle, medium)
    if plane_count:
        details = details | {"modes loaded as on an infinite plane": plane_count}
    return motions.load(mass, details, stiffness)


def _sheet_mass(
    motions: _Motions, sheet: _FlatSheet, medium: Air, setting: str
) -> tuple[Array, int]:
    """Return the added mass of a sheet (R + M, R + M), and the number of modes of a plane.

    Modes whose waves the elements do not resolve have the mass of an infinite plane in waves.
    """
    thin_sheet, first, squares = (
        sheet.thin_out(_MAX_SHEET_FACES),
        motions.rigid_count,
        motions.squares,
    )
    velocities = motions.shapes[sheet.vertices, 2]
    waves = _shape_waves(sheet.mesh, velocities[:, first:], squares[first:], motions.model)
    is_resolved = waves <= 2 * np.pi / (_ELEMENTS_PER_WAVE * edge_length(thin_sheet.mesh))
    block = np.concatenate([np.arange(first), first + np.flatnonzero(is_resolved)])
    mass = np.zeros((len(squares), len(squares)))
    mass[np.ix_(block, block)] = _block_mass(
        SheetInFluid(mesh=thin_sheet.mesh),
        motions.shapes[thin_sheet.vertices, 2][:, block],
        squares[block],
        medium,
        setting,
    )
    plane = first + np.flatnonzero(~is_resolved)
    side_count = 1 if setting == "one side" else 2
    mass[plane, plane] = side_count * _plane_masses(
        sheet.mesh, velocities[:, plane], waves[~is_resolved], squares[plane], medium, side_count
    )
    return mass, len(plane)


def _plane_masses(
    mesh: Mesh, velocities: Array, waves: Array, squares: Array, medium: Air, side_count: int
) -> Array:
    """Return the added masses (M,) on one side of an infinite plane in waves, on `side_count`.

    Each is that at the frequency of the loaded mode.
    """
    mean_squares = mesh.areas @ np.square(velocities)[mesh.faces].mean(axis=1)
    masses = np.zeros(len(waves))
    for _ in range(_ITERATIONS):
        sound_waves = squares / (1 + side_count * masses) / medium.sound_speed**2
        near_squares = np.maximum(waves**2 - sound_waves, _MIN_NEAR_FIELD * waves**2)
        masses = (masses + medium.density * mean_squares / np.sqrt(near_squares)) / 2
    return masses


def estimate_air_lowering(model: ModalModel) -> float:
    """Estimate by which fraction air lowers the lowest mode of a flat sheet; 0 for other bodies.

    The mass is that on both sides of an infinite plane in waves as long as the mode's, and half of
    it on a sheet with free edges, around which the air flows. On plates and heads, the
    lowering is 0.8 to 1.4 times that of `add_air_mass`.
    """
    gains = model.gains
    sheet = _FlatSheet.of(gains) if isinstance(gains, ShapeGains) and gains.count else None
    if sheet is None or not isinstance(gains, ShapeGains):
        return 0.0
    velocities = gains.shapes[sheet.vertices, 2, :1].astype(np.float64)
    squares = np.square(2 * np.pi * model.natural_frequencies[:1])
    waves = _shape_waves(sheet.mesh, velocities, squares, model)
    masses = _plane_masses(sheet.mesh, velocities, waves, squares, AIR, 2)
    side_count = 2 if model.supported else 1
    return float(1 - (1 + side_count * masses[0]) ** -0.5)


def _shape_waves(mesh: Mesh, velocities: Array, squares: Array, model: ModalModel) -> Array:
    """Return wave numbers of the shapes of a sheet (M,), 1/m, by its law of dispersion.

    They grow with the frequency of a membrane, and with its root on a plate. The factor is the
    median over the lower half of the bending modes, whose shapes the triangles represent best, of
    the root of the mean squared slope over the mean square.
    """
    stiffness, masses = laplacian(mesh)
    laws = squares ** (1 / 2 if model.tensioned else 1 / 4)
    mean_squares = masses @ np.square(velocities)
    # Modes in the plane of the sheet follow another law.
    bending = np.flatnonzero(mean_squares > _MIN_BENDING * mean_squares.max(initial=0.0))
    low = bending[: (len(bending) + 1) // 2]
    if not len(low):
        return laws
    slopes = np.einsum("vm,vm->m", velocities[:, low], stiffness @ velocities[:, low])
    return np.median(np.sqrt(slopes / mean_squares[low]) / laws[low]) * laws


def _block_mass(
    sheet: SheetInFluid, velocities: Array, squares: Array, medium: Air, setting: str
) -> Array:
    """Return the added mass (K, K) of motions (V, K) of a sheet, each at its loaded frequency.

    A matrix at one wave number serves one mode. Its entry for two modes is taken as the mean of
    those at the wave numbers of both, so that one symmetric matrix serves all.
    """
    side_count = {"free": 1, "wall": 2, "one side": 1}[setting]
    operator = sheet.mass if setting == "free" else sheet.mass_in_wall
    max_wave_number = float(np.sqrt(squares.max(initial=0.0))) / medium.sound_speed
    if max_wave_number == 0:  # no modes, or motions as a rigid body alone
        return side_count * operator(velocities, medium.density, 0.0)
    nodes = np.linspace(0, max_wave_number, _SPLINE_NODES)
    samples = np.array([side_count * operator(velocities, medium.density, node) for node in nodes])
    diagonals = CubicSpline(nodes, np.diagonal(samples, axis1=1, axis2=2))
    modes = np.arange(len(squares))
    wave_numbers = np.sqrt(squares) / medium.sound_speed
    for _ in range(_ITERATIONS):
        inertias = np.maximum(1 + diagonals(wave_numbers)[modes, modes], _MIN_INERTIA)
        targets = np.sqrt(squares / inertias) / medium.sound_speed
        wave_numbers = (wave_numbers + targets) / 2
    at_modes = CubicSpline(nodes, samples)(wave_numbers)
    rows = at_modes[modes[:, None], modes[:, None], modes]
    return (rows + rows.T) / 2


def cavity_stiffness(volumes: Array, cavity: float, air: Air) -> Array:
    """Return the stiffness (M, M) of enclosed air, whose pressure is the same everywhere.

    Parameters
    ----------
    volumes : array (M,)
        Volume that each mode displaces per modal coordinate, m^3 kg^-1/2.
    cavity : float
        Volume of the air, m^3.
    air : Air
        The gas.
    """
    return air.density * air.sound_speed**2 / cavity * np.outer(volumes, volumes)
