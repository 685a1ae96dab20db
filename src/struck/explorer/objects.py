"""Objects of the room: shapes of 1998, bodies of finite elements and a recorded drum.

The room is 5 m wide; x points right, y away from the person and z up, and the floor is z = 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np

from struck.analysis.analysis import analyze
from struck.analysis.source_options import Source, applicable
from struck.model.arrays import Array
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.model.provenance import Progress, table_of
from struck.recordings.fit import fit_recordings
from struck.report.gallery import SKIN, WIRE, bird
from struck.shapes import (
    Bar,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    RoundSection,
    String,
)
from struck.solids import Tube, VolumeMesh
from struck.solids.revolution import bell, bowl

_BAND = 8000.0  # Hz, the highest frequency of bodies with many modes
_DRUM = 2000.0  # Hz, of membranes, which have thousands more
_FURNITURE = 2000.0  # Hz, of wood whose boards have hundreds of modes beyond
_SHARP = 1500.0  # Hz, of the one with an inward corner, each of whose modes is searched for

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """One object of the room: how it is computed, where it stands, and its texts.

    Parameters
    ----------
    name : str
        Name in addresses.
    title : str
        Name on the page.
    text : str
        A sentence about it.
    kind : str
        "formula", "elements", "recording" or "file": the source of its modes.
    make : callable
        Computes its model, and reports its progress.
    position : tuple of 3
        Of its coordinates' origin in the room, m.
    rotation : array (3, 3)
        Turns its coordinates into those of the room.
    swelling : tuple of 3
        How many times thicker it is drawn along its own axes, where it is too thin to be seen.
    figure : str
        "drum" or "": how a body without a surface is drawn; by default as a recording.
    """

    name: str
    title: str
    text: str
    make: Callable[[Progress], ModalModel]
    position: Place
    kind: str = "elements"
    rotation: Array = field(default_factory=lambda: np.eye(3))
    swelling: Place = (1.0, 1.0, 1.0)
    figure: str = ""

    def json_values(self) -> dict[str, object]:
        """Return the facts of the object before it is computed."""
        return {
            "id": self.name,
            "title": self.title,
            "text": self.text,
            "kind": self.kind,
            "position": list(self.position),
            "rotation": np.asarray(self.rotation).tolist(),
            "swelling": list(self.swelling),
            "figure": self.figure,
        }


def rotation_matrix(*, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Return the rotation about x, then y, then z by angles in degrees (3, 3)."""
    (cx, cy, cz), (sx, sy, sz) = (np.round(f(np.radians([x, y, z])), 15) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @ about_y @ about_x


def furniture(*boxes: tuple[Place, Place]) -> VolumeMesh:
    """Return boxes, each by its lowest corner and its size in mm, as one body of hexahedra."""
    corners = np.array(boxes, np.float64) / 1000
    low, high = corners[:, 0], corners.sum(axis=1)
    lines = [_lines(np.unique(np.append(low[:, k], high[:, k]).round(9))) for k in range(3)]
    cell_centres = np.stack(
        np.meshgrid(*((line[1:] + line[:-1]) / 2 for line in lines), indexing="ij"), axis=-1
    )
    is_inside = ((cell_centres[..., None, :] > low) & (cell_centres[..., None, :] < high)).all(
        axis=-1
    )
    cells = np.argwhere(is_inside.any(axis=-1))
    numbers = np.arange(math.prod(map(len, lines))).reshape(*map(len, lines))
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    corner_numbers = np.stack([numbers[tuple((cells + step).T)] for step in _CORNERS], axis=1)
    used_nodes, elements = np.unique(corner_numbers, return_inverse=True)
    return VolumeMesh(
        nodes=nodes[used_nodes], elements=elements.reshape(corner_numbers.shape), kind="hex8"
    ).promoted()


# Corners of a hexahedron in VTK's order.
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_LONGEST = 0.08  # m, of an edge


def _lines(breaks: Array) -> Array:
    """Return coordinates that include `breaks`, none farther apart than `_LONGEST`."""
    parts = [
        np.linspace(a, b, math.ceil((b - a) / _LONGEST), endpoint=False)
        for a, b in itertools.pairwise(breaks)
    ]
    return np.concatenate([*parts, breaks[-1:]])


def table() -> VolumeMesh:
    """Return a table of 0.9 m by 0.56 m with a top of 30 mm on four legs of 55 mm."""
    legs = [((x, y, 0), (55, 55, 470)) for x in (20, 825) for y in (20, 485)]
    return furniture(((0, 0, 470), (900, 560, 30)), *legs)


def chair() -> VolumeMesh:
    """Return a chair with a seat of 420 mm, its back held by the two legs behind."""
    front_legs = [((x, 0, 0), (40, 40, 430)) for x in (0, 380)]
    back_legs = [((x, 380, 0), (40, 40, 880)) for x in (0, 380)]
    rails = [((40, 385, z), (340, 25, 90)) for z in (560, 760)]
    return furniture(((0, 0, 430), (420, 420, 24)), *front_legs, *back_legs, *rails)


def plan_analysis(
    body: Callable[[], Source], material: Material | str, **options: object
) -> Callable[[Progress], ModalModel]:
    """Return a function that analyzes a body with the given options."""

    def make(progress: Progress) -> ModalModel:
        source = body()
        chosen: dict[str, Any] = {**applicable(source, accuracy="preview"), **options}
        return analyze(source, material, progress=progress, **chosen)

    return make


def fit_drum(progress: Progress) -> ModalModel:
    """Return the model of the recorded drum."""
    with resources.as_file(resources.files("struck.report") / "tabla.wav") as path:
        return fit_recordings(path, progress=progress).model


def _entry(name: str) -> dict[str, Any]:
    """Return the entry of an object in `objects.toml`: its texts and where it stands."""
    entry = {"turned": {}, **table_of("struck.explorer", "objects")[name]}
    return {"name": name, "rotation": rotation_matrix(**entry.pop("turned")), **entry}


_FORMULAS = (
    Thing(
        **_entry("string"),
        kind="formula",
        make=plan_analysis(lambda: String(length=0.65, radius=4e-4, tension=80.7), WIRE),
    ),
    Thing(
        **_entry("bar"),
        kind="formula",
        make=plan_analysis(
            lambda: Bar(length=0.4, width=0.04, thickness=0.008, ends="free"),
            "steel",
            damping="heard",
        ),
    ),
    Thing(
        **_entry("rod"),
        kind="formula",
        make=plan_analysis(
            lambda: Bar(length=0.4, section=RoundSection(radius=0.006), ends="free"),
            "aluminium",
            damping="heard",
        ),
    ),
    Thing(
        **_entry("square"),
        kind="formula",
        make=plan_analysis(
            lambda: RectangularMembrane(length=0.4, width=0.4, thickness=2.5e-4, tension=3000.0),
            SKIN,
            band=(20.0, _DRUM),
        ),
    ),
    Thing(
        **_entry("l_membrane"),
        kind="formula",
        make=plan_analysis(
            lambda: PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000.0),
            SKIN,
            band=(20.0, _SHARP),
        ),
    ),
    Thing(
        **_entry("plate"),
        kind="formula",
        make=plan_analysis(
            lambda: RectangularPlate(length=0.4, width=0.3, thickness=0.005, edges="free"),
            "glass",
            damping="heard",
            band=(20.0, _BAND),
        ),
    ),
)


# Lengths of the chimes, m: D5, E5, F#5, A5, B5 and D6, by 1/sqrt of the frequency.
_LENGTHS = tuple(0.505 * (2 ** (-steps / 24)) for steps in (0, 2, 4, 7, 9, 12))


def _chimes() -> Iterator[Thing]:
    for number, length in enumerate(_LENGTHS):
        yield Thing(
            name=f"chime_{number + 1}",
            title=f"Chime {number + 1}",
            text=f"An aluminium tube, {1000 * length:.0f} mm long: one of six wind chimes "
            "(O'Brien et al. 2002).",
            make=plan_analysis(
                lambda length=length: Tube(length=length, radius=0.0125, wall=0.001),
                "aluminium",
                damping="heard",
            ),
            position=(0.32 + 0.11 * number, 0.85, 1.55 - length / 2),
        )


_ELEMENTS = (
    Thing(**_entry("bowl"), make=plan_analysis(bowl, "bronze")),
    Thing(**_entry("bell"), make=plan_analysis(bell, "bronze")),
    Thing(
        **_entry("figurine"),
        make=plan_analysis(lambda: bird().scaled(1.8), "ceramic", wall=0.004, damping="heard"),
    ),
    Thing(**_entry("table"), make=plan_analysis(table, "oak", band=(20.0, _FURNITURE))),
    Thing(**_entry("chair"), make=plan_analysis(chair, "oak", band=(20.0, _FURNITURE))),
)


def things() -> list[Thing]:
    """Return the objects of the room, formulas first, slow ones last."""
    tabla = Thing(**_entry("tabla"), kind="recording", make=fit_drum, figure="drum")
    return [*_FORMULAS, tabla, *_chimes(), *_ELEMENTS]
