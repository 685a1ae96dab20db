"""Structured solids: exact volumes, sound meshes, and modes by scikit-fem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.sparse.linalg import eigsh
from scipy.spatial import KDTree
from scipy.special import spherical_jn, spherical_yn
from skfem.assembly import Dofs
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from struck.errors import MeshError, OptionError, StruckError
from struck.model.mesh import Surface
from struck.solids.bodies import Block, Extrusion, Tube
from struck.solids.revolution import Revolution, Stem, bell, bowl, wine_glass
from struck.solids.volume_mesh import VolumeMesh

Array = NDArray[np.float64]
Solid = Block | Extrusion | Revolution | Tube

# Corners and middles of edges of the unit cube in VTK's order, written out once more.
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
EDGES = [*((i, (i + 1) % 4) for i in range(4)), *((4 + i, 4 + (i + 1) % 4) for i in range(4))]
EDGES += [(i, i + 4) for i in range(4)]
NODES = np.array([*CORNERS, *(np.add(CORNERS[a], CORNERS[b]) / 2 for a, b in EDGES)], float)
SIDES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def circle(count: int, radius: float) -> Array:
    angle = np.arange(count) * 2 * np.pi / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def meridian_circle(radius: float, count: int = 25) -> list[list[float]]:
    """Half a circle from pole to pole, the poles at r = 0 exactly."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, count)
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points[[0, -1], 0] = 0
    return points.tolist()


L_SHAPE = [(0, 0), (1, 0), (1, 0.3), (0.4, 0.3), (0.4, 1), (0, 1)]
STAR = circle(10, 1.0) * np.where(np.arange(10) % 2, 0.4, 1.0)[:, None]
SPOOL = Revolution(  # two discs on a rod
    profile=[(0, 0.105), (0.05, 0.105)],
    wall=0.01,
    smooth=False,
    stem=Stem(radii=[0.01, 0.01], foot=[(0, 0.005), (0.04, 0.005)], foot_wall=0.01),
)
SOLIDS: dict[str, Solid] = {
    "chime": Tube(length=0.505, radius=0.0125, wall=0.001),
    "short tube": Tube(length=0.1, radius=0.03, wall=0.01),
    "rod": Tube(length=0.2, radius=0.01, wall=0.01),
    "bar": Block(size=(0.3, 0.03, 0.005)),
    "cube": Block(size=(0.1, 0.1, 0.1)),
    "L": Extrusion(outline=L_SHAPE, height=0.05),
    "star": Extrusion(outline=STAR, height=0.3),
    "washer": Extrusion(outline=circle(64, 0.1), holes=[circle(32, 0.04)], height=0.01),
    "bowl": bowl(),
    "bell": bell(),
    "wine glass": wine_glass(),
    "spool": SPOOL,
    "gong": Revolution(profile=[(0, 0), (0.2, 0)], wall=0.002),
    "pan": Revolution(profile=[(0, 0), (0.1, 0), (0.13, 0.06)], wall=0.004, smooth=False),
    "hollow sphere": Revolution(profile=meridian_circle(0.046), wall=0.008),
    "ring": Revolution(profile=[(0.05, 0), (0.06, 0.01), (0.05, 0.03)], wall=[0.003, 0.004, 0.002]),
    "pawn": Revolution(profile=[(0.02, 0), (0.008, 0.02), (0.01, 0.05)]),
}
each_solid = pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)


def shape_gradients(at: Array) -> Array:
    """Gradients of the 20 serendipity functions at (q, 3), by their textbook formulas."""
    x, sign = 2 * at[:, None, :] - 1, 2 * NODES - 1
    factor = 1 + x * sign
    gradients = np.zeros((len(at), 20, 3))
    for axis in range(3):
        others = factor[..., (axis + 1) % 3] * factor[..., (axis + 2) % 3]
        total = np.sum(x * sign, axis=2) - 2 + factor[..., axis]
        gradients[..., axis] = sign[:, axis] * others * total / 8
        for flat in range(3):
            middle = sign[:, flat] == 0
            square = 1 - x[:, :, flat] ** 2
            if flat == axis:
                value = -2 * x[:, :, axis] * others / 4
            else:
                rest = 3 - flat - axis
                value = square * sign[:, axis] * factor[..., rest] / 4
            gradients[:, middle, axis] = np.broadcast_to(value, (len(at), 20))[:, middle]
    return 2 * gradients


GAUSS = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
POINTS = np.array(list(product(GAUSS, repeat=3)))
WEIGHTS = np.array([np.prod(w) for w in product([5 / 18, 8 / 18, 5 / 18], repeat=3)])


def determinants(mesh: VolumeMesh) -> Array:
    jacobians = np.einsum("qnr,end->eqdr", shape_gradients(POINTS), mesh.nodes[mesh.elements])
    return np.linalg.det(jacobians)


def measured_volume(mesh: VolumeMesh) -> float:
    return float((determinants(mesh) @ WEIGHTS).sum())


def eight_node_sides(mesh: VolumeMesh) -> NDArray[np.int64]:
    """Return corners and middles of all sides (6 E, 8)."""
    middle = {frozenset(edge): 8 + i for i, edge in enumerate(EDGES)}
    order = [
        [*side, *(middle[frozenset((side[i], side[(i + 1) % 4]))] for i in range(4))]
        for side in SIDES
    ]
    return mesh.elements[:, np.array(order)].reshape(-1, 8)


@each_solid
@pytest.mark.parametrize("accuracy", ["preview", "standard"])
def test_no_element_folds(solid: Solid, accuracy: str) -> None:
    values = determinants(solid.volume_mesh(accuracy))
    assert (values.min(axis=1) > 0.3 * values.mean(axis=1)).all()


@each_solid
def test_elements_fit_together(solid: Solid) -> None:
    mesh = solid.volume_mesh("preview")
    sides = eight_node_sides(mesh)
    corners, counts = np.unique(np.sort(sides[:, :4], axis=1), axis=0, return_counts=True)
    whole = np.unique(np.sort(sides, axis=1), axis=0)
    assert set(counts) == {1, 2}
    assert len(whole) == len(corners), "neighbours share the middles of their edges too"
    assert np.array_equal(np.unique(mesh.elements), np.arange(len(mesh.nodes)))
    assert len(np.unique(mesh.nodes.round(9), axis=0)) == len(mesh.nodes)


HANDLES = {"chime": 0, "short tube": 0, "washer": 0, "ring": 0, "hollow sphere": 4}


@pytest.mark.parametrize("name", SOLIDS)
def test_surface_is_closed_and_of_the_right_topology(name: str) -> None:
    sides = eight_node_sides(SOLIDS[name].volume_mesh("preview"))[:, :4]
    _, first, counts = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    boundary = sides[first[counts == 1]]
    edges = np.sort(np.stack([boundary, np.roll(boundary, -1, axis=1)], axis=-1).reshape(-1, 2))
    distinct, shared = np.unique(edges, axis=0, return_counts=True)
    assert (shared == 2).all()
    euler = len(np.unique(boundary)) - len(distinct) + len(boundary)
    assert euler == HANDLES.get(name, 2)


STRAIGHT = {
    "bar": 0.3 * 0.03 * 0.005,
    "cube": 1e-3,
    "L": 0.58 * 0.05,
    "star": 0.3 * 10 * 0.5 * 0.4 * np.sin(np.pi / 5),
    "washer": 0.01 * (32 * 0.01 * np.sin(np.pi / 32) - 16 * 0.0016 * np.sin(np.pi / 16)),
}


@pytest.mark.parametrize("accuracy", ["preview", "standard", "fine"])
@pytest.mark.parametrize("name", STRAIGHT)
def test_straight_solids_have_their_exact_volume(name: str, accuracy: str) -> None:
    assert SOLIDS[name].volume == pytest.approx(STRAIGHT[name], rel=1e-12)
    mesh = SOLIDS[name].volume_mesh(accuracy)
    assert measured_volume(mesh) == pytest.approx(STRAIGHT[name], rel=1e-12)


def frustum(low: float, high: float, height: float) -> float:
    return np.pi * height * (low**2 + low * high + high**2) / 3


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (SOLIDS["chime"], np.pi * 0.505 * (0.0125**2 - 0.0115**2)),
        (SOLIDS["rod"], np.pi * 0.01**2 * 0.2),
        (SOLIDS["gong"], np.pi * 0.2**2 * 0.002),
        (SPOOL, np.pi * (0.05**2 * 0.01 + 0.04**2 * 0.01 + 0.01**2 * 0.09)),
        # Pappus: a rectangle 0.05 by 0.004, its centre 0.115 off the axis.
        (
            Revolution(profile=[(0.1, 0), (0.13, 0.04)], wall=0.004, smooth=False),
            2 * np.pi * 0.115 * 0.05 * 0.004,
        ),
        (
            Revolution(profile=[(0.03, 0), (0.02, 0.1), (0.05, 0.2)], smooth=False),
            frustum(0.03, 0.02, 0.1) + frustum(0.02, 0.05, 0.1),
        ),
        # A cone's wall with a tip: 2 pi times the integral of 0.8 (0.1 - 0.75 w)^2 / 2 over w
        # from -0.005 to 0.005, w being the depth in the wall.
        (
            Revolution(profile=[(0, 0), (0.08, 0.06)], wall=0.01, smooth=False),
            0.8 * np.pi * (0.1**2 * 0.01 + 0.75**2 * 0.01**3 / 12),
        ),
    ],
    ids=["chime", "rod", "gong", "spool", "frustum", "turned", "cone"],
)
def test_reported_volume_is_the_closed_form(solid: Solid, volume: float) -> None:
    assert solid.volume == pytest.approx(volume, rel=1e-12)


def test_smooth_wall_of_a_sphere_has_the_volume_of_the_sphere() -> None:
    exact = 4 / 3 * np.pi * (0.05**3 - 0.042**3)
    assert SOLIDS["hollow sphere"].volume == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("chime", (8, 20, 1)),
        ("rod", (8, 4, 1)),
        ("gong", (16, 10, 1)),
        pytest.param("bowl", (16, 12, 1), marks=pytest.mark.prove),
        pytest.param("bell", (16, 16, 1), marks=pytest.mark.prove),
        ("wine glass", (16, 16, 1)),
        pytest.param("hollow sphere", (16, 16, 1), marks=pytest.mark.prove),
        ("pawn", (12, 8, 1)),
    ],
)
def test_curved_volume_converges_to_the_exact_one(name: str, counts: tuple[int, int, int]) -> None:
    errors = []
    for factor in (1, 2):
        finer = (factor * counts[0], factor * counts[1], counts[2])
        solid = replace(SOLIDS[name], elements=finer)
        errors.append(abs(measured_volume(solid.volume_mesh()) / solid.volume - 1))
    assert errors[0] < 3e-3
    assert np.log2(errors[0] / errors[1]) > 3.3


def test_nodes_of_a_tube_lie_on_its_cylinders_and_planes() -> None:
    mesh = SOLIDS["chime"].volume_mesh("preview")
    assert mesh.nodes.shape == (1320, 3)
    radii, heights = np.hypot(mesh.nodes[:, 0], mesh.nodes[:, 1]), mesh.nodes[:, 2]
    # One layer: nodes on either cylinder, or half way through.
    assert np.abs(radii[:, None] - [0.0115, 0.012, 0.0125]).min(axis=1).max() < 1e-16
    assert np.ptp(heights) == 0.505


def test_nodes_of_a_bowl_lie_on_its_offset_ellipses() -> None:
    radius, height, wall = 0.1, 0.05, 0.003
    solid = bowl(radius=radius, height=height, wall=wall)
    sides = eight_node_sides(solid.volume_mesh("preview"))
    _, first, counts = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    nodes = solid.volume_mesh("preview").nodes[np.unique(sides[first[counts == 1]])]
    angle = np.linspace(0, np.pi / 2, 20001)
    r, z = radius * np.sin(angle), height * (1 - np.cos(angle))
    normal = np.stack([-height * np.sin(angle), radius * np.cos(angle)])
    offset = wall / 2 * normal / np.linalg.norm(normal, axis=0)
    edges = [np.stack([r, z]) + side * offset for side in (-1, 1)]
    off_rim = nodes[nodes[:, 2] < height - 1e-9]
    meridian = np.stack([np.hypot(off_rim[:, 0], off_rim[:, 1]), off_rim[:, 2]], axis=1)
    away = [KDTree(edge.T).query(meridian)[0] for edge in edges]
    # The spline through nine points of the ellipse stays that close to it.
    assert np.min(away, axis=0).max() < 5e-5


@each_solid
def test_places_lie_on_the_surface(solid: Solid) -> None:
    surface, _ = solid.volume_mesh("preview").surface()
    assert solid.places
    for name, place in solid.places.items():
        distance, _, nearest = Surface(surface).closest(place)
        assert distance[0] < 0.004 * surface.extent, name
        assert np.linalg.norm(nearest[0] - place) == pytest.approx(distance[0])


def test_places_are_where_their_names_say() -> None:
    chime, bar, gong = (SOLIDS[name].places for name in ("chime", "bar", "gong"))
    assert chime["end"] == pytest.approx([0.0125, 0, 0.49 * 0.505])
    assert chime["quarter"] == pytest.approx([0.0125, 0, 0.505 / 4])
    assert chime["middle"] == pytest.approx([0.0125, 0, 0])
    assert bar["top"] == pytest.approx([0, 0, 0.0025])
    assert bar["end"] == pytest.approx([0.147, 0, 0.0025])
    assert gong["top"] == pytest.approx([0, 0, 0.001])
    assert gong["bottom"] == pytest.approx([0, 0, -0.001])
    assert gong["rim"] == pytest.approx([0.198, 0, 0.001])
    assert SOLIDS["bowl"].places["bottom"] == pytest.approx([0, 0, -0.0015])
    assert SOLIDS["bell"].places["top"][2] > SOLIDS["bell"].places["rim"][2]
    assert SOLIDS["wine glass"].places["rim"][2] == pytest.approx(0.2, abs=0.003)
    assert SOLIDS["washer"].places["top"][2] == 0.01
    for place in SOLIDS["hollow sphere"].places.values():
        assert np.linalg.norm(place) == pytest.approx(0.05, rel=1e-3)  # its outside
    assert 0.04 < np.hypot(*SOLIDS["washer"].places["top"][:2]) < 0.1


def test_outline_may_run_either_way_round() -> None:
    turned = Extrusion(outline=L_SHAPE[::-1], height=0.05)
    assert turned.volume == pytest.approx(0.58 * 0.05, rel=1e-12)
    assert (determinants(turned.volume_mesh("preview")) > 0).all()


@pytest.mark.parametrize("count", [3, 17, 200])
def test_polygons_of_few_and_many_corners_mesh_well(count: int) -> None:
    mesh = Extrusion(outline=circle(count, 0.1), height=0.01).volume_mesh("standard")
    values = determinants(mesh)
    assert (values.min(axis=1) > 0.3 * values.mean(axis=1)).all()
    area = count / 2 * 0.01 * np.sin(2 * np.pi / count)
    assert measured_volume(mesh) == pytest.approx(area * 0.01, rel=1e-12)


def spiky_polygon(seed: int) -> Array:
    random = np.random.default_rng(seed)
    corners = random.integers(4, 30)
    angle, radius = np.sort(random.uniform(0, 2 * np.pi, corners)), random.uniform(0.2, 1, corners)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("seed", range(12))
def test_spiky_polygons_mesh(seed: int) -> None:
    outline = spiky_polygon(seed)
    mesh = Extrusion(outline=outline, height=0.2).volume_mesh("preview")
    values = determinants(mesh)
    assert (values.min(axis=1) > 0.2 * values.mean(axis=1)).all()
    x, y = outline.T
    area = abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    assert measured_volume(mesh) == pytest.approx(0.2 * area, rel=1e-11)


def test_counts_given_are_counts_used() -> None:
    assert len(Block(size=(1, 1, 1), elements=(2, 3, 4)).volume_mesh("fine").elements) == 24
    tube = Tube(length=1, radius=0.1, wall=0.01, elements=(12, 5, 2))
    assert len(tube.volume_mesh().elements) == 120
    plate = Extrusion(outline=[(0, 0), (2, 0), (2, 1), (0, 1)], height=0.1, elements=(8, 3))
    assert len(plate.volume_mesh().elements) == 8 * 4 * 3


@pytest.mark.parametrize("name", SOLIDS)
def test_finer_is_finer(name: str) -> None:
    preview, standard, fine = (
        len(SOLIDS[name].volume_mesh(level).nodes) for level in ("preview", "standard", "fine")
    )
    assert preview < standard < fine < 60_000


TUBE = {"length": 0.5, "radius": 0.01, "wall": 0.001}
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
INVALID = [
    (Tube, TUBE | {"length": 0}, r"length of the tube is 0.0 m: it must exceed 0"),
    (Tube, TUBE | {"radius": -0.01}, r"radius of the tube is -0.01 m"),
    (Tube, TUBE | {"wall": float("nan")}, r"wall of the tube is nan m"),
    (Tube, TUBE | {"wall": 0.02}, r"wall of the tube is 0.02 m: at most its radius, 0.01 m"),
    (Tube, TUBE | {"elements": (6, 2, 1)}, r"around are 6: give a multiple of 4"),
    (Tube, TUBE | {"elements": (8, 0, 1)}, r"along is 0: .* at least 1"),
    (Tube, TUBE | {"elements": (8, 2)}, r"give 3 counts"),
    (Block, {"size": (1, 1)}, r"give its edges along x, y and z"),
    (Block, {"size": (1, 0, 1)}, r"along y is 0.0 m"),
    (Extrusion, {"outline": SQUARE, "height": 0}, r"height of the extrusion is 0.0 m"),
    (Extrusion, {"outline": SQUARE[:2], "height": 1}, r"2 corners: give at least 3"),
    (Extrusion, {"outline": [(0, 0), (1, 1), (1, 0), (0, 1)], "height": 1}, r"crosses itself near"),
    (Extrusion, {"outline": [*SQUARE, (0, 0)], "height": 1}, r"repeats corner \(0, 0\)"),
    (Extrusion, {"outline": [(0, 0), (1, 0), (2, 0)], "height": 1}, r"folds back at"),
    (Extrusion, {"outline": [(0, 0, 0)] * 3, "height": 1}, r"give finite pairs"),
    (Extrusion, {"outline": [(0, 0), (1, 0), (0, np.inf)], "height": 1}, r"give finite pairs"),
    (
        Extrusion,
        {"outline": SQUARE, "height": 1, "holes": [[(2, 2), (3, 2), (2, 3)]]},
        r"hole 1 lies outside",
    ),
    (
        Extrusion,
        {"outline": SQUARE, "height": 1, "holes": [[(0.5, 0.5), (2, 0.5), (0.5, 0.8)]]},
        r"hole 1 touches another edge",
    ),
    (
        Extrusion,
        {"outline": SQUARE, "height": 1, "holes": [0.1 * circle(6, 4) + 0.5, circle(5, 0.1) + 0.5]},
        r"hole 2 overlaps",
    ),
    (Revolution, {"profile": [(0, 0)], "wall": 0.01}, r"1 points: give at least 2"),
    (Revolution, {"profile": [(-1, 0), (1, 0)], "wall": 0.01}, r"r = -1.0 m"),
    (Revolution, {"profile": [(0, 0), (1, 0)], "wall": 0}, r"wall is 0.0 m"),
    (Revolution, {"profile": [(0, 0), (1, 0)], "wall": [1, 2, 3]}, r"3 values for 2 points"),
    (Revolution, {"profile": [(1, 0), (1, 0)], "wall": 0.1}, r"repeats the point"),
    (Revolution, {"profile": [(1, 0), (2, 0), (1, 1), (1, 0)], "wall": 0.1}, r"closes on itself"),
    (Revolution, {"profile": [(0.1, 0), (0.1, 1)], "wall": 0.3}, r"reaches the axis"),
    (Revolution, {"profile": [(1, 0), (1.1, 0.1), (1, 0.2)], "wall": 0.5}, r"folds over itself"),
    (
        Revolution,
        {"profile": [(1, 0), (2, 0), (1.2, 0.01)], "wall": 0.001, "smooth": False},
        r"folds back at",
    ),
    (
        Revolution,
        {"profile": [(1, 0), (2, 1), (2, 0), (1, 1)], "wall": 0.01, "smooth": False},
        r"crosses itself",
    ),
    (Revolution, {"profile": [(0, 0), (1, 0)], "wall": 0.1, "elements": (4, 2, 1)}, r"at least 8"),
    (
        Revolution,
        {"profile": [(0, 0.1), (0.1, 0.1)], "stem": SPOOL.stem},
        r"a stem but no wall",
    ),
    (
        Revolution,
        {"profile": [(0.1, 0.1), (0.2, 0.1)], "wall": 0.01, "stem": SPOOL.stem},
        r"start on the axis",
    ),
    (
        Revolution,
        {"profile": [(0, 0.1), (0.005, 0.1)], "wall": 0.01, "stem": SPOOL.stem},
        r"stem ends with a radius of 0.01 m, the bowl reaches 0.005 m",
    ),
    (Stem, {"radii": [0.01], "foot": [(0, 0), (1, 0)], "foot_wall": 0.1}, r"1 radii"),
    (Stem, {"radii": [0.01, 0], "foot": [(0, 0), (1, 0)], "foot_wall": 0.1}, r"must exceed 0"),
]


@pytest.mark.parametrize(("kind", "arguments", "message"), INVALID)
def test_impossible_solids_are_refused(
    kind: Callable[..., object], arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(StruckError, match=message) as refused:
        kind(**arguments)
    assert isinstance(refused.value, MeshError | OptionError)
    assert "\n" not in str(refused.value)


@each_solid
def test_unknown_accuracy_is_refused(solid: Solid) -> None:
    with pytest.raises(OptionError, match="'coarse': give one of preview, standard, fine"):
        solid.volume_mesh("coarse")


def test_solids_are_values() -> None:
    again = Revolution(profile=np.array([(0, 0), (0.2, 0)]), wall=[0.002, 0.002])
    assert again == SOLIDS["gong"]
    assert hash(again) == hash(SOLIDS["gong"])


# Modes by scikit-fem, whose elements and assembly nobody here wrote.


@dataclass(repr=False)
class SerendipityMesh(skfem.MeshHex1):
    elem: type = skfem.ElementHexS2


def in_scikit_fem(mesh: VolumeMesh) -> skfem.Mesh:
    """Hand nodes over by their places in the reference cube: the node orders differ."""
    own = [int(np.argmin(np.abs(NODES - at).sum(axis=1))) for at in skfem.ElementHexS2.doflocs]
    corners, numbers = np.unique(mesh.elements[:, own[:8]], return_inverse=True)
    numbers = numbers.reshape(-1, 8).T
    linear = skfem.MeshHex1(mesh.nodes[corners].T.copy(), numbers.astype(np.int32))
    dofs = Dofs(linear, skfem.ElementHexS2())
    nodes = np.full((3, dofs.N), np.nan)
    for row, node in enumerate(own):
        nodes[:, dofs.element_dofs[row]] = mesh.nodes[mesh.elements[:, node]].T
    return SerendipityMesh(nodes, linear.t)


def frequencies(
    mesh: VolumeMesh, youngs_modulus: float, poisson_ratio: float, density: float, near: float
) -> Array:
    """Return the natural frequencies nearest to `near` above the rigid motions, Hz."""
    basis = skfem.Basis(in_scikit_fem(mesh), skfem.ElementVector(skfem.ElementHexS2()), intorder=5)
    elastic = linear_elasticity(*lame_parameters(youngs_modulus, poisson_ratio))
    stiffness = skfem.asm(elastic, basis).tocsc()
    mass = skfem.asm(skfem.BilinearForm(lambda u, v, _: density * dot(u, v)), basis).tocsc()
    start = np.random.default_rng(0).normal(size=mass.shape[0])
    shift = (2 * np.pi * near) ** 2
    values = eigsh(stiffness, 16, mass, sigma=shift, v0=start, return_eigenvectors=False)
    found = np.sqrt(np.maximum(np.sort(values), 0)) / (2 * np.pi)
    return found[found > near / 100]


ALUMINIUM = {"youngs_modulus": 68.3518e9, "poisson_ratio": 0.3298013, "density": 2700}
SHEAR_SPEED = np.sqrt(68.3518e9 / 2 / 1.3298013 / 2700)


@pytest.mark.prove
def test_a_chime_rings_as_converged_elasticity() -> None:
    # D3 of 2002, Table 2; references converged on 48 x 120 x 2 triquadratic elements. scikit-fem
    # integrates in full, which tells the mesh apart from our own rule.
    mesh = replace(SOLIDS["chime"], elements=(8, 20, 1)).volume_mesh()
    assert 3 * len(mesh.nodes) <= 4000
    found = frequencies(mesh, **ALUMINIUM, near=1000)
    for reference in (587.883, 1575.12, 2969.53, 3054.66):
        assert np.abs(found / reference - 1).min() < 5e-4


@pytest.mark.prove
def test_rod_twists_at_the_closed_form() -> None:
    # Torsion of a round rod has no dispersion: f = c_s / (2 length), exactly.
    exact = SHEAR_SPEED / (2 * 0.2)
    rod = Tube(length=0.2, radius=0.01, wall=0.01, elements=(8, 8, 1))
    found = frequencies(rod.volume_mesh(), **ALUMINIUM, near=exact)
    assert np.abs(found / exact - 1).min() < 2e-4


def torsion_of_hollow_sphere(order: int, inner: float, outer: float) -> float:
    """Lowest torsional frequency, Hz: traction d(f/r)/dr = 0 at both radii (Love 1927)."""

    def traction(function: Callable[..., Array], k: float, r: float) -> Array:
        return k * r * function(order, k * r, derivative=True) - function(order, k * r)

    def determinant(k: float) -> float:
        rows = [[traction(f, k, r) for f in (spherical_jn, spherical_yn)] for r in (inner, outer)]
        return float(np.linalg.det(rows))

    k = brentq(determinant, 1.5 / outer, 4.0 / outer)
    return float(k * SHEAR_SPEED / (2 * np.pi))


@pytest.mark.prove
def test_hollow_sphere_twists_at_the_closed_form() -> None:
    exact = torsion_of_hollow_sphere(2, 0.042, 0.05)
    sphere = replace(SOLIDS["hollow sphere"], elements=(12, 12, 1))
    found = frequencies(sphere.volume_mesh(), **ALUMINIUM, near=exact)
    close = np.abs(found / exact - 1) < 1e-3
    assert np.count_nonzero(close) == 5, "2 n + 1 modes, one frequency"
