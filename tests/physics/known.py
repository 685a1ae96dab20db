"""Bodies whose frequencies are known without finite elements, and how well."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import trimesh
from numpy.typing import NDArray

from struck import Material, Mesh
from struck.analysis.analysis import Source
from struck.solids import Block, Tube
from tests.physics import spheres
from tests.physics.bodies import ALUMINIUM, CHIME, UNIT, ball, box, grid
from tests.physics.reference import BREATHING, CHIME_RADIUS, CHIME_WALL
from tests.physics.ritz_solid import Family, Section, solid_frequencies
from tests.physics.ritz_tube import tube_frequencies

Array = NDArray[np.float64]
STEEL = Material(density=8000.0, youngs_modulus=200e9, poisson_ratio=0.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """A body with its elastic frequencies up to `highest`, Hz, as well as they are `certain`.

    What `struck.analyze` warns of is `said`, if anything.
    """

    source: Callable[[], Source]
    material: Material
    frequencies: Callable[[], Array]
    highest: float
    certain: float
    wall: float | None = None
    said: str = ""


# Spheres. Facets of 2 % of the radius on either side of the sphere, of its volume altogether.

RADIUS = 0.05
_SPHERE = np.sqrt(ALUMINIUM.shear_modulus / ALUMINIUM.density) / RADIUS / (2 * np.pi)


def _sphere(highest: float, wall: float | None = None) -> Known:
    return Known(
        source=partial(ball, RADIUS, 6),
        material=ALUMINIUM,
        frequencies=partial(_waves, highest, 0.0 if wall is None else 1 - wall / RADIUS),
        highest=highest * _SPHERE,
        certain=1e-5,
        wall=wall,
    )


@cache
def _waves(highest: float, bore: float) -> Array:
    nu = ALUMINIUM.poisson_ratio
    found = [BREATHING[nu] * (bore == 0)]
    for n in range(1, 21):
        roots = spheres.torsional(n, highest, bore=bore)
        roots += spheres.spheroidal(n, nu, highest, bore=bore)
        found += (2 * n + 1) * roots
    return np.sort([root for root in found if 0 < root < highest]) * _SPHERE


# Blocks and rods, by Ritz's method.


@cache
def _cube() -> Array:
    section = Section.rectangle(1, 1, Family(degree=14))
    return solid_frequencies(section, 1.0, 14, UNIT)


@cache
def _plate(height: float, degrees: tuple[int, int]) -> Array:
    layers = tuple(np.pi * k / height / 2 for k in (1, 3))
    section = Section.rectangle(1, 1, Family(degree=degrees[0], decays=layers))
    return solid_frequencies(section, height, degrees[1], STEEL)


@cache
def _bar() -> Array:
    section = Section.rectangle(*_BAR[:2], Family(degree=10))
    return solid_frequencies(section, _BAR[2], 24, STEEL)


@cache
def _rod(radius: float, length: float, degrees: tuple[int, int]) -> Array:
    return solid_frequencies(Section.disc(radius, degrees[0]), length, degrees[1], STEEL)


def cylinder(radius: float, length: float, sides: int = 128) -> Mesh:
    """Return a prism of exactly the section of a cylinder."""
    swept = trimesh.creation.cylinder(radius=1, height=length, sections=sides)
    wider = radius * np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    return Mesh(points=np.array(swept.vertices) * [wider, wider, 1], faces=np.array(swept.faces))


def hollow_cylinder(radius: float, wall: float, length: float, sides: int = 128) -> Mesh:
    """Return a prism of exactly the section of a tube."""
    wider = np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    swept = trimesh.creation.annulus(
        r_min=wider * (radius - wall), r_max=wider * radius, height=length, sections=sides
    )
    return Mesh(points=np.array(swept.vertices), faces=np.array(swept.faces))


def flat_sheet(side: float) -> Mesh:
    """Return an open square of two triangles."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * side / 2
    return Mesh(points=corners, faces=np.array([(0, 1, 2), (0, 2, 3)]))


def turned(mesh: Mesh) -> Mesh:
    """Return the mesh turned so that no edge lies along an axis."""
    about = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0))[:3, :3]
    return Mesh(points=mesh.points @ about.T, faces=mesh.faces)


# Tubes, by Ritz's method too.


@cache
def _tube(tube: Tube, material: Material, highest: float) -> Array:
    lame = (material.first_lame, material.shear_modulus)
    found: list[float] = []
    for order in range(30):
        family = tube_frequencies(
            tube.length,
            tube.radius,
            tube.wall,
            lame,
            material.density,
            order=order,
            count=40,
            degrees=(5, 40),
        )
        elastic = family[(family > 1e-3 * highest) & (family < highest)].tolist()
        if order > 1 and not elastic:
            break
        found += (2 if order else 1) * elastic  # cosine and sine
    return np.sort(found)


_BAR = (0.03, 0.01, 0.2)
_ROD = Tube(length=0.1, radius=0.01, wall=0.01)
_DISC = Tube(length=0.01, radius=0.05, wall=0.05)
_CHIME = Tube(length=0.505, radius=CHIME_RADIUS, wall=CHIME_WALL)
_THICK = Tube(length=0.1, radius=0.02, wall=0.006)
_SHORT = Tube(length=0.08, radius=0.03, wall=0.0015)


def _in_cube(source: Callable[[], Source]) -> Known:
    highest = 7.0 / (2 * np.pi)
    return Known(source=source, material=UNIT, frequencies=_cube, highest=highest, certain=2e-6)


def _steel(
    source: Callable[[], Source],
    frequencies: Callable[[], Array],
    highest: float,
    *,
    certain: float = 2e-6,
    wall: float | None = None,
    said: str = "",
) -> Known:
    return Known(
        source=source,
        material=STEEL,
        frequencies=frequencies,
        highest=highest,
        certain=certain,
        wall=wall,
        said=said,
    )


def _as_rod(source: Callable[[], Source]) -> Known:
    return _steel(source, partial(_rod, 0.01, 0.1, (12, 24)), 1.4e5, certain=1e-5)


def _as_disc(source: Callable[[], Source]) -> Known:
    return _steel(source, partial(_rod, 0.05, 0.01, (18, 5)), 3.5e4, certain=1e-5)


def _as_plate(source: Callable[[], Source], wall: float | None = None, said: str = "") -> Known:
    plate = partial(_plate, 0.01, (16, 3))
    return _steel(source, plate, 900.0, certain=1e-5, wall=wall, said=said)


def _as_thick_plate(source: Callable[[], Source]) -> Known:
    return _steel(source, partial(_plate, 0.1, (14, 5)), 3000.0, certain=1e-5)


def _as_bar(source: Callable[[], Source]) -> Known:
    return _steel(source, _bar, 4e4)


def _as_tube(tube: Tube, source: Callable[[], Source], highest: float) -> Known:
    return _steel(source, partial(_tube, tube, STEEL, highest), highest)


def _as_chime(source: Callable[[], Source]) -> Known:
    return Known(
        source=source,
        material=CHIME,
        frequencies=partial(_tube, _CHIME, CHIME, 9_500.0),
        highest=9_500.0,
        certain=1e-5,
    )


BODIES: Mapping[str, Known] = {
    "sphere": _sphere(4.8),
    "hollow sphere": _sphere(2.6, 0.008),
    "thin hollow sphere": _sphere(1.9, 0.002),
    "cube of hexahedra": _in_cube(lambda: Block(size=(1, 1, 1))),
    "cube stuffed": _in_cube(lambda: box(1, 1, 1)),
    "cube turned": _in_cube(lambda: turned(box(1, 1, 1))),
    "rod of hexahedra": _as_rod(lambda: _ROD),
    "rod stuffed": _as_rod(lambda: cylinder(0.01, 0.1)),
    "disc of hexahedra": _as_disc(lambda: _DISC),
    "disc stuffed": _as_disc(lambda: cylinder(0.05, 0.01)),
    "plate of hexahedra": _as_plate(lambda: Block(size=(1, 1, 0.01))),
    "plate of a sheet": _as_plate(
        lambda: flat_sheet(1.0), wall=0.01, said="open: a sheet with one side"
    ),
    "thick plate of hexahedra": _as_thick_plate(lambda: Block(size=(1, 1, 0.1))),
    "thick plate stuffed": _as_thick_plate(lambda: turned(box(1, 1, 0.1))),
    "bar of hexahedra": _as_bar(lambda: Block(size=_BAR)),
    "bar stuffed": _as_bar(lambda: box(*_BAR)),
    "chime": _as_chime(lambda: _CHIME),
    "thick tube of hexahedra": _as_tube(_THICK, lambda: _THICK, 4e4),
    "thick tube stuffed": _as_tube(_THICK, lambda: hollow_cylinder(0.02, 0.006, 0.1), 4e4),
    "short tube of hexahedra": _as_tube(_SHORT, lambda: _SHORT, 2e4),
}
# Elements of another program: one resolution, whatever the accuracy.
GIVEN: Mapping[str, Known] = {
    "tetrahedra": _in_cube(lambda: grid("tet4", (5, 5, 5))),
    "fine tetrahedra": _in_cube(lambda: grid("tet4", (9, 9, 9))),
    "hexahedra": _in_cube(lambda: grid("hex8", (5, 5, 5))),
    "wedges": _in_cube(lambda: grid("wedge6", (5, 5, 5))),
    "bar": _as_bar(lambda: grid("hex8", (4, 2, 20), _BAR)),
    "plate": _as_thick_plate(lambda: grid("tet4", (16, 16, 1), (1, 1, 0.1))),
    "chime": _as_chime(lambda: _CHIME.volume_mesh("standard")),
}
