"""Laws that hold on any mesh: six rigid motions, invariance, scaling, mass."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation

from struck import Material
from struck.solids import Block, Tube, VolumeMesh
from struck.solids.fem.assembly import assemble
from struck.solids.fem.factorisation import factorise
from struck.solids.fem.lanczos import rigid_motions
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import curve_elements
from struck.solids.lattice import cells_in
from struck.solids.surface.distance import FilledBody
from struck.solids.volume_mesh import linear_tetrahedra
from tests.physics.bodies import bumpy, custom

Array = NDArray[np.float64]
MATERIAL = custom(density=2700.0, youngs=70e9, poisson=0.33)
SPEED = np.sqrt(MATERIAL.youngs_modulus / MATERIAL.density)
LAWS = 1e-9
SAMPLE = [0, 14]  # one full, one hollow
FORTY = range(1, 41)
PARTS = 4  # of the forty, so that their proofs are short


@lru_cache(maxsize=len(SAMPLE))
def body(seed: int) -> VolumeMesh:
    """Return a random curved body, about every third one hollow."""
    surface = bumpy(seed)
    wall = 0.3 * np.ptp(surface.bounds, axis=0).min() if seed % 3 == 2 else None
    filling = FilledBody(mesh=surface, wall=wall)
    spacing = surface.extent / 4 if wall is None else 0.75 * wall
    mesh, _ = curve_elements(cells_in(filling.depths, filling.bounds, spacing), filling.onto)
    return mesh


def band_of(mesh: VolumeMesh) -> float:
    """Return a frequency that some modes lie below, Hz."""
    return 1.2 * SPEED / np.ptp(mesh.nodes, axis=0).max()


def frequencies(mesh: VolumeMesh, material: Material = MATERIAL, factor: float = 1.0) -> Array:
    """Return the frequencies in a band that is `factor` times as wide, Hz."""
    solver = Solver(dense_limit=0)
    return vibration_modes(mesh, material, factor * band_of(mesh), solver=solver).frequencies


@lru_cache(maxsize=len(SAMPLE))
def known(seed: int) -> Array:
    """Return a body's own frequencies in its band, Hz; once for all laws."""
    return frequencies(body(seed))


def same(found: Array, seed: int) -> None:
    assert len(known(seed)) >= 3
    assert found == pytest.approx(known(seed), rel=LAWS)


def check_rotation_and_translation(seed: int) -> None:
    mesh = body(seed)
    random = np.random.default_rng(seed)
    turned = mesh.nodes @ Rotation.random(rng=random).as_matrix().T
    moved = turned + random.uniform(-1, 1, 3)  # ten times as far as the body is large
    there = vibration_modes(
        replace(mesh, nodes=moved), MATERIAL, band_of(mesh), solver=Solver(dense_limit=0)
    )
    same(there.frequencies, seed)


def check_scaling(seed: int) -> None:
    mesh = body(seed)
    factor = float(np.random.default_rng(seed).uniform(0.05, 20))
    same(frequencies(replace(mesh, nodes=factor * mesh.nodes)) * factor, seed)


def check_material(seed: int) -> None:
    """2002, section 3.3: with the same Poisson's ratio only sqrt(E / density) matters."""
    mesh = body(seed)
    stiffer, denser = np.random.default_rng(seed).uniform(0.01, 10, 2)
    other = replace(
        MATERIAL,
        youngs_modulus=stiffer * MATERIAL.youngs_modulus,
        density=denser * MATERIAL.density,
    )
    factor = float(np.sqrt(stiffer / denser))
    same(frequencies(mesh, other, factor) / factor, seed)


def check_rigid_motions(seed: int) -> None:
    mesh = body(seed)
    system = assemble(mesh, MATERIAL)
    lower = system.shifted(0.0)
    stiffness = lower + sparse.tril(lower, -1).T
    motions = rigid_motions(mesh.nodes)
    assert np.linalg.matrix_rank(motions) == 6
    assert np.abs(stiffness @ motions).max() <= 1e-12 * (abs(stiffness) @ np.abs(motions)).max()
    # None between a thousandth and a fifth of the lowest elastic frequency, by Sturm count.
    lowest = 2 * np.pi * known(seed)[0]
    for share in (1e-3, 0.2):
        shifted = system.shifted((share * lowest) ** 2)
        assert [factorise(shifted, name).negative for name in ("rslab", "superlu")] == [6, 6]


def check_mass(seed: int) -> None:
    mesh = body(seed)
    modes = vibration_modes(mesh, MATERIAL, band_of(mesh))
    assert modes.mass == pytest.approx(MATERIAL.density * mesh.volume(), rel=1e-12)
    straight = linear_tetrahedra(mesh).promoted()
    surface, _ = straight.surface()
    modes = vibration_modes(straight, MATERIAL, band_of(mesh))
    assert modes.mass == pytest.approx(MATERIAL.density * surface.volume, rel=1e-12)


LAW = {
    "rotation and translation": check_rotation_and_translation,
    "scaling": check_scaling,
    "material": check_material,
    "six rigid motions": check_rigid_motions,
    "mass": check_mass,
}


@pytest.mark.parametrize(
    "seed", [SAMPLE[0], *(pytest.param(seed, marks=pytest.mark.prove) for seed in SAMPLE[1:])]
)
@pytest.mark.parametrize("law", LAW)
def test_law_on_random_bodies(law: str, seed: int) -> None:
    LAW[law](seed)


@pytest.mark.prove
@pytest.mark.parametrize("part", range(PARTS))
def test_laws_on_forty_random_bodies(part: int) -> None:
    for seed in FORTY[part::PARTS]:
        for law in LAW.values():
            law(seed)


def test_mass_centre_and_inertia_of_a_block() -> None:
    size = np.array([0.2, 0.05, 0.03])
    modes = vibration_modes(Block(size=tuple(size)).volume_mesh("preview"), MATERIAL, 30_000.0)
    mass = MATERIAL.density * size.prod()
    inertia = mass / 12 * np.diag(np.square(size).sum() - np.square(size))
    assert modes.mass == pytest.approx(mass, rel=1e-12)
    assert modes.centre == pytest.approx(np.zeros(3), abs=1e-14)
    assert modes.inertia == pytest.approx(inertia, rel=1e-12, abs=1e-12 * mass)


def test_mass_and_inertia_of_a_tube() -> None:
    # The circles are made of 40 parabolas each.
    shape = Tube(length=0.3, radius=0.03, wall=0.01, elements=(40, 4, 1))
    modes = vibration_modes(shape.volume_mesh(), MATERIAL, 20_000.0)
    mass = MATERIAL.density * shape.volume
    squares = 0.03**2 + 0.02**2
    aside = mass * (3 * squares + 0.3**2) / 12
    assert modes.mass == pytest.approx(mass, rel=1e-5)
    assert modes.inertia == pytest.approx(np.diag([aside, aside, mass * squares / 2]), rel=1e-5)
