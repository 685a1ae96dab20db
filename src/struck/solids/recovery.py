"""How far frequencies are off, told from the strains alone (Zienkiewicz & Zhu 1987).

The strains of neighbouring elements differ where two meet. Averaged at the nodes they come out
closer to the truth, and the energy of the difference is what each eigenvalue is too high by.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.material import Material
from struck.solids.assembly import gradients
from struck.solids.elements import ELEMENTS, LINEAR
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
_COLUMNS = 32


def recovered_errors(mesh: VolumeMesh, material: Material, values: Array, vectors: Array) -> Array:
    """Return the relative error of each frequency (M,).

    Parameters
    ----------
    mesh : VolumeMesh
    material : Material
    values : array (M,)
        Eigenvalues, 1/s^2.
    vectors : array (N, 3, M)
        Mass-normalised.
    """
    parts = np.array_split(np.arange(len(values)), max(1, -(-len(values) // _COLUMNS)))
    energy = [_missing_energy(mesh, material, vectors[:, :, part]) for part in parts]
    return np.concatenate(energy) / (2 * values)


def _missing_energy(mesh: VolumeMesh, material: Material, vectors: Array) -> Array:
    average = _averaged(mesh, vectors)
    between = mesh.element.values(mesh.element.stiffness_rule.points)
    total = np.zeros(vectors.shape[2])
    for chunk in mesh.chunks(512):
        strains, weights = _strains(mesh, chunk, vectors)
        smooth = np.einsum("qn,enkm->eqkm", between, average[mesh.elements[chunk]], optimize=True)
        total += np.einsum("eq,eqm->m", weights, _density(smooth - strains, material))
    return total


def _density(strains: Array, material: Material) -> Array:
    """Return twice the elastic energy density of strains xx, yy, zz, 2yz, 2xz, 2xy (E, q, 6, M)."""
    trace = strains[:, :, :3].sum(axis=2)
    squares = 2 * (strains[:, :, :3] ** 2).sum(axis=2) + (strains[:, :, 3:] ** 2).sum(axis=2)
    return material.first_lame * trace**2 + material.shear_modulus * squares


def _averaged(mesh: VolumeMesh, vectors: Array) -> Array:
    """Return the strains at the nodes, averaged over the elements there by volume (N, 6, M)."""
    element = mesh.element
    corners = ELEMENTS[LINEAR[mesh.kind]]
    outward = corners.values(element.nodes) @ np.linalg.pinv(
        corners.values(element.stiffness_rule.points)
    )
    total = np.zeros((len(mesh.nodes), 6, vectors.shape[2]))
    share = np.zeros(len(mesh.nodes))
    for chunk in mesh.chunks(512):
        strains, weights = _strains(mesh, chunk, vectors)
        volumes = weights.sum(axis=1)
        at_nodes = np.einsum("nq,eqkm,e->enkm", outward, strains, volumes, optimize=True)
        members = mesh.elements[chunk]
        np.add.at(total, members.ravel(), at_nodes.reshape(-1, *total.shape[1:]))
        np.add.at(share, members.ravel(), np.repeat(volumes, members.shape[1]))
    return total / share[:, None, None]


def _strains(mesh: VolumeMesh, chunk: slice, vectors: Array) -> tuple[Array, Array]:
    """Return the strains at the quadrature points (E, q, 6, M) and the volume weights (E, q)."""
    chosen = np.arange(len(mesh.elements))[chunk]
    slopes, weights = gradients(mesh, chosen, mesh.element.stiffness_rule)
    shapes = vectors[mesh.elements[chosen]]
    g = np.einsum("eqnb,enam->eqabm", slopes, shapes, optimize=True)
    normal = [g[:, :, a, a] for a in range(3)]
    shear = [g[:, :, a, b] + g[:, :, b, a] for a, b in ((1, 2), (0, 2), (0, 1))]
    return np.stack([*normal, *shear], axis=2), weights
