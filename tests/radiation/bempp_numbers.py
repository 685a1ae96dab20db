"""Make `bempp.npz`: the sound of three bodies by bempp-cl, which is no part of this library.

Galerkin boundary elements by Burton & Miller: linear pressure, constant velocity, on the same
triangles; those of the block are cut into four, which keep the velocity of the whole.

python -m tests.radiation.bempp_numbers   where bempp-cl 0.4 is installed
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck.model.material import AIR
from struck.model.mesh import Mesh
from tests.radiation import bodies
from tests.radiation.bodies import Motion, ball, bowl_mode, ovalling, upward

PLACE = Path(__file__).with_name("bempp.npz")
WAYS = np.asarray(ball(1.0, 1).points)  # 42 directions
DISTANCE = 1.0  # m
BEND = upward(lambda x, _: np.cos(2 * np.pi * x / 0.12))
# Body, its motion, frequencies in Hz, and how often each edge is halved for bempp-cl.
CASES: dict[str, tuple[Callable[[], Mesh], Motion, tuple[float, ...], int]] = {
    "bowl": (lambda: bodies.bowl(0.06, 0.004, 36, 18), bowl_mode(2), (1000.0, 3000.0), 0),
    "hoop": (lambda: bodies.hoop(0.05, 0.01, 48, 20), ovalling(2), (1200.0, 5000.0), 0),
    "block": (lambda: bodies.box((0.12, 0.05, 0.03), (16, 7, 4)), BEND, (1000.0, 6000.0), 1),
}


def velocities(mesh: Mesh, motion: Motion) -> NDArray[np.float64]:
    """Return normal velocities (F,) of a motion of a body's points."""
    return np.einsum("fcd,fd->f", motion(mesh.points)[mesh.faces] / 3, mesh.face_normals)


def by_bempp(
    mesh: Mesh, flows: NDArray[np.float64], wave_number: float, halvings: int = 0
) -> NDArray[np.complex128]:
    """Return pressures (P,) at `DISTANCE` in all `WAYS`, Pa; time goes as exp(+i w t)."""
    from bempp_cl import api
    from bempp_cl.api.linalg import lu
    from bempp_cl.api.operators.boundary import helmholtz, sparse
    from bempp_cl.api.operators.potential import helmholtz as around

    api.GLOBAL_PARAMETERS.quadrature.regular = 6
    grid = api.Grid(mesh.points.T, mesh.faces.T.astype(np.uint32))
    parents = np.arange(len(mesh.faces))
    for _ in range(halvings):
        grid, parents = grid.refine(), np.repeat(parents, 4)
    constant, linear = api.function_space(grid, "DP", 0), api.function_space(grid, "P", 1)
    # bempp-cl's time goes as exp(-i w t): the slope of pressure is i w rho v there.
    slopes = api.GridFunction(
        constant, coefficients=1j * wave_number * AIR.impedance * flows[parents]
    )
    spaces, turn = (linear, linear, linear), 1j / wave_number
    given = (constant, linear, linear)
    left = (
        0.5 * sparse.identity(*spaces)
        - helmholtz.double_layer(*spaces, wave_number)
        + turn * helmholtz.hypersingular(*spaces, wave_number)
    )
    right = (
        -helmholtz.single_layer(*given, wave_number) * slopes
        - turn
        * (0.5 * sparse.identity(*given) + helmholtz.adjoint_double_layer(*given, wave_number))
        * slopes
    )
    pressure = lu(left, right)
    places = DISTANCE * WAYS.T
    heard = around.double_layer(linear, places, wave_number).evaluate(pressure)
    heard = heard - around.single_layer(constant, places, wave_number).evaluate(slopes)
    return heard[0].conj()


def main() -> None:
    """Write the numbers."""
    found = {}
    for name, (make, motion, frequencies, halvings) in CASES.items():
        mesh = make()
        flows = velocities(mesh, motion)
        for frequency in frequencies:
            wave_number = 2 * np.pi * frequency / AIR.sound_speed
            found[f"{name} {frequency:.0f}"] = by_bempp(mesh, flows, wave_number, halvings)
    np.savez_compressed(PLACE, **found)


if __name__ == "__main__":
    main()
