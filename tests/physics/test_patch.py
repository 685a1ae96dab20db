"""Patch tests and manufactured solutions on distorted, straight-sided elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from struck import Material
from struck.solids import VolumeMesh
from struck.solids.fem.assembly import System, assemble
from struck.solids.fem.factorisation import factorise
from tests.physics.bodies import distorted, grid, on_the_surface

Array = NDArray[np.float64]
MATERIAL = Material(density=3.0, youngs_modulus=7.0, poisson_ratio=0.31)
SIZE = np.array([1.0, 1.3, 0.8])
LINEAR = {"tet4": "tet4", "tet10": "tet4", "hex8": "hex8", "hex20": "hex8"}
LINEAR |= {"wedge6": "wedge6", "wedge15": "wedge6"}
EVERY_KIND = sorted(LINEAR)
# A displacement gradient without any symmetry.
GRADIENT = np.array([[0.3, -0.7, 0.2], [0.5, 0.1, -0.4], [-0.2, 0.6, 0.9]])


def patch(kind: str, share: float = 0.15) -> VolumeMesh:
    """Return a distorted box of elements of a kind, with straight edges."""
    mesh = distorted(grid(LINEAR[kind], (3, 3, 3), SIZE), share)
    return mesh if kind == LINEAR[kind] else mesh.promoted()


def both_triangles(system: System) -> sparse.csc_matrix:
    lower = system.shifted(0.0)
    return (lower + sparse.tril(lower, -1).T).tocsc()


def scale_of(stiffness: sparse.csc_matrix, displacement: Array) -> float:
    """Return the largest force that would arise if no terms cancelled."""
    return float((abs(stiffness) @ np.abs(displacement)).max())


def test_patches_are_distorted_and_straight() -> None:
    for kind in EVERY_KIND:
        mesh = patch(kind)
        assert mesh.straight().all()
        volumes = np.linalg.det(mesh.jacobians(mesh.element.mass_rule.points[:1])).ravel()
        assert volumes.min() > 0
        assert volumes.max() / volumes.min() > 1.3


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_linear_displacement_leaves_no_force_inside(kind: str) -> None:
    mesh = patch(kind)
    stiffness = both_triangles(assemble(mesh, MATERIAL))
    displacement = (mesh.nodes @ GRADIENT.T + [1.0, -2.0, 0.5]).ravel()
    force = (stiffness @ displacement).reshape(-1, 3)
    assert not on_the_surface(mesh).all()
    inside = force[~on_the_surface(mesh)]
    assert np.abs(inside).max() <= 1e-12 * scale_of(stiffness, displacement)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_linear_displacement_stores_the_exact_energy(kind: str) -> None:
    mesh = patch(kind)
    stiffness = both_triangles(assemble(mesh, MATERIAL))
    displacement = (mesh.nodes @ GRADIENT.T).ravel()
    strain = (GRADIENT + GRADIENT.T) / 2
    dilatation, squares = np.trace(strain), np.square(strain).sum()
    density = MATERIAL.first_lame * dilatation**2 / 2 + MATERIAL.shear_modulus * squares
    energy = displacement @ (stiffness @ displacement) / 2
    assert energy == pytest.approx(density * SIZE.prod(), rel=1e-12)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_rigid_motion_moves_the_exact_mass(kind: str) -> None:
    mesh = patch(kind)
    between = assemble(mesh, MATERIAL).mass_matrix()
    rotation = np.cross([0.3, -0.5, 0.8], mesh.nodes)
    second = np.diag(SIZE**2) / 3 + np.outer(SIZE, SIZE) / 4 * (1 - np.eye(3))
    inertia = MATERIAL.density * SIZE.prod() * (np.trace(second) * np.eye(3) - second)
    spin = np.array([0.3, -0.5, 0.8])
    assert between.sum() == pytest.approx(MATERIAL.density * SIZE.prod(), rel=1e-12)
    moving = np.einsum("nd,nd->", rotation, between @ rotation)
    assert moving == pytest.approx(spin @ inertia @ spin, rel=1e-12)


def sheared(mesh: VolumeMesh) -> VolumeMesh:
    """Turn cells into parallelepipeds: on these all quadratic kinds hold every quadratic."""
    return replace(mesh, nodes=mesh.nodes @ np.array([[1, 0.2, 0], [0.1, 1, 0.3], [0, -0.2, 1]]))


QUADRATIC_PATCHES = {
    "tet10": lambda: patch("tet10"),
    "hex20": lambda: sheared(grid("hex8", (3, 2, 3), SIZE)).promoted(),
    "wedge15": lambda: sheared(grid("wedge6", (3, 2, 3), SIZE)).promoted(),
}


def quadratic_solution(points: Array) -> tuple[Array, Array]:
    """Return a displacement, quadratic in position, and the body force that holds it (uniform).

    u_i = A_ijk x_j x_k with A symmetric in j and k; force = -(lambda + mu) grad div u - mu lap u.
    """
    random = np.random.default_rng(5).normal(size=(3, 3, 3))
    curvature = (random + random.transpose(0, 2, 1)) / 2
    displacement = np.einsum("ijk,nj,nk->ni", curvature, points, points)
    both = MATERIAL.first_lame + MATERIAL.shear_modulus
    gradient_of_dilatation = 2 * np.einsum("iik->k", curvature)
    laplacian = 2 * np.einsum("ijj->i", curvature)
    return displacement, -both * gradient_of_dilatation - MATERIAL.shear_modulus * laplacian


@pytest.mark.parametrize("kind", QUADRATIC_PATCHES)
@pytest.mark.parametrize("backend", ["rslab", "superlu"])
def test_manufactured_quadratic_solution_is_found(kind: str, backend: str) -> None:
    mesh = QUADRATIC_PATCHES[kind]()
    assert mesh.kind == kind
    exact, force = quadratic_solution(mesh.nodes)
    system = assemble(mesh, MATERIAL)
    held = on_the_surface(mesh)
    load = system.mass_matrix() @ np.tile(force / MATERIAL.density, (len(held), 1))
    known = np.where(held[:, None], exact, 0.0)
    pull = (both_triangles(system) @ known.ravel()).reshape(-1, 3)
    factor = factorise(system.free(~held).shifted(0.0), backend)
    found = factor.solve((load - pull)[~held].reshape(-1, 1)).reshape(-1, 3)
    assert len(found) > 20
    assert np.abs(found - exact[~held]).max() <= 1e-10 * np.abs(exact).max()


def test_linear_elements_do_not_hold_a_quadratic_solution() -> None:
    # So that the test above can fail: the same field leaves forces inside on linear elements.
    mesh = patch("tet4")
    exact, force = quadratic_solution(mesh.nodes)
    system = assemble(mesh, MATERIAL)
    load = system.mass_matrix() @ np.tile(force / MATERIAL.density, (len(mesh.nodes), 1))
    rest = (both_triangles(system) @ exact.ravel()).reshape(-1, 3) - load
    assert np.abs(rest[~on_the_surface(mesh)]).max() > 1e-3 * np.abs(load).max()
