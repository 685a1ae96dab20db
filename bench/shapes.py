"""Closed forms beside finite elements of the same bodies, 400 modes each.

CPU time of modes with their shapes on the surface, medians. Membranes by quadratic triangles of
scikit-fem and ARPACK, plates by struck's own elements; both as fine as the 400th mode needs to be
right within some percent, which is printed.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh
from skfem import Basis, ElementTriP2, MeshTri, condense
from skfem.models.poisson import laplace, mass

from struck.model.material import Material
from struck.model.modes import Modes
from struck.shapes import CircularMembrane, CircularPlate, PolygonMembrane, RectangularMembrane
from struck.shapes.shape import Shape
from struck.solids import Tube
from struck.solids.fem.vibration import vibration_modes

Array = NDArray[np.float64]
T = TypeVar("T")
MODES, TARGET = 400, 100.0
FILM = Material(density=1390.0, youngs_modulus=4.5e9, poisson_ratio=0.38)
STEEL = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.29)
RADIUS, THICKNESS, TENSION = 0.165, 2.5e-4, 3000.0


@dataclass(frozen=True)
class Body:
    """A body, its formula and its elements."""

    name: str
    shape: Shape
    material: Material
    elements: Callable[[Material, float], Array]


def membrane(mesh: MeshTri) -> Callable[[Material, float], Array]:
    """Return what computes the frequencies of a membrane over a triangulation."""

    def compute(material: Material, _highest: float) -> Array:
        basis = Basis(mesh, ElementTriP2())
        stiffness, masses = laplace.assemble(basis), mass.assemble(basis)
        inner = condense(stiffness, masses, D=basis.get_dofs(), expand=False)
        values = eigsh(inner[0], MODES, M=inner[1], sigma=0.0, return_eigenvectors=True)[0]
        speed = np.sqrt(TENSION / (material.density * THICKNESS))
        return np.sqrt(np.sort(values)) * speed / (2 * np.pi)

    return compute


def disk(material: Material, highest: float) -> Array:
    """Return the frequencies of a clamped disk by 20-node hexahedra."""
    solid = Tube(length=0.001, radius=RADIUS, wall=RADIUS, elements=(96, 1, 24))
    mesh = solid.volume_mesh()
    rim = np.hypot(mesh.nodes[:, 0], mesh.nodes[:, 1]) >= RADIUS * (1 - 1e-9)
    return vibration_modes(mesh, material, highest, fixed=rim).frequencies


BODIES = (
    Body(
        "rectangular membrane",
        RectangularMembrane(length=0.4, width=0.4, thickness=THICKNESS, tension=TENSION),
        FILM,
        membrane(MeshTri.init_sqsymmetric().refined(5).scaled(0.4)),
    ),
    Body(
        "circular membrane",
        CircularMembrane(radius=RADIUS, thickness=THICKNESS, tension=TENSION),
        FILM,
        membrane(MeshTri.init_circle(6).scaled(RADIUS)),
    ),
    Body(
        "clamped circular plate",
        CircularPlate(radius=RADIUS, thickness=0.001, edge="clamped"),
        STEEL,
        disk,
    ),
)


def highest_of(body: Body) -> float:
    """Return the end of a band that holds the first 400 modes and no more."""

    def count(highest: float) -> int:
        return len(body.shape.vibration(body.material, highest).frequencies)

    high = 1000.0
    while count(high) < MODES:
        high *= 2
    low = high / 2
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (middle, high) if count(middle) < MODES else (low, middle)
    return high


def timed(compute: Callable[[], T]) -> tuple[float, T]:
    """Return the CPU seconds and the result of a call."""
    begun = time.process_time()
    result = compute()
    return time.process_time() - begun, result


def show() -> None:
    """Print the table: formulas before and after each run of elements."""
    print(f"{'body':24} {'formula':>10} {'elements':>10} {'ratio':>8}  differ by")
    for body in BODIES:
        highest = highest_of(body)

        def formula(body: Body = body, highest: float = highest) -> Modes:
            return body.shape.modes(body.material, (1.0, highest))

        formula()  # imports
        before = [timed(formula)[0] for _ in range(5)]
        elements, found = timed(lambda b=body, h=highest: b.elements(b.material, 1.05 * h))
        ours = statistics.median(before + [timed(formula)[0] for _ in range(5)])
        exact = body.shape.vibration(body.material, highest).frequencies[:MODES]
        differ = np.abs(found[: len(exact)] / exact - 1).max()
        verdict = "met" if elements >= TARGET * ours else "MISSED"
        print(
            f"{body.name:24} {ours:8.3f} s {elements:8.1f} s {elements / ours:7.0f}x  "
            f"{100 * differ:.2f} %, {TARGET:g}x {verdict}"
        )
    polygon()


def polygon() -> None:
    """Print how long the first 100 modes of the L-shaped membrane take, for orientation."""
    drum = PolygonMembrane.l_shape(side=0.2, thickness=THICKNESS, tension=TENSION)
    highest = 100.0
    while len(drum.vibration(FILM, highest).frequencies) < 100:
        highest *= 1.3
    seconds, modes = timed(lambda: drum.modes(FILM, (1.0, highest)))
    count = len(modes.frequencies)
    print(f"L-shaped membrane, {count} modes: {seconds:.1f} s (orientation)\n")


if __name__ == "__main__":
    show()
