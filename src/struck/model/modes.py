"""Modes: how an undamped body vibrates, its shapes on its surface, and other materials."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from struck.errors import MaterialError, rounded
from struck.model.arrays import Array, brief
from struck.model.gains import TransverseShapes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.provenance import Provenance

# Largest relative error of the first-order formula for a unit change of Poisson's ratio, squared,
# as found on bars, plates, shells and solids (tests/physics/test_materials.py).
_SECOND_ORDER = 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stiffness:
    """Natural frequencies with their dependence on the elastic constants."""

    frequencies: Array  # (M,), natural, Hz
    poisson_slopes: Array | None  # (M,), d ln f / d nu at constant Young's modulus
    errors: Array | None  # (M,), relative
    complete_to: float  # no mode below is missing, Hz
    tensioned: bool = False  # a tension, which stays, drives the body back, not the material


def changed(modes: Stiffness, old: Material, new: Material) -> Stiffness:
    """Return the modes of the same body made of `new`; MaterialError without slopes."""
    # With the same Poisson's ratio frequencies go with sqrt(E / density) (2002, section 3.3). With
    # another, the energy of unchanged stresses counts: in compliances, 2 (1 + nu) / E for shear
    # and 3 (1 - 2 nu) / E for bulk, it is linear in nu, and so is 1 / f^2. The stored slope
    # d ln f / d nu gives the line. It is exact for stretched, sheared and evenly bent parts;
    # keeping the shapes instead (Rayleigh's quotient) errs by 1 % on every bent bar.
    lightness = old.density / new.density
    is_known = modes.poisson_slopes is not None and np.isfinite(modes.poisson_slopes).all()
    if modes.tensioned:
        if not is_known:
            raise MaterialError(
                "tension and stiffness together drive this body back, and their shares are "
                "unknown: compute the modes again with the other material"
            )
        new = replace(new, youngs_modulus=old.youngs_modulus, poisson_ratio=old.poisson_ratio)
    if np.isclose(old.poisson_ratio, new.poisson_ratio, rtol=0, atol=1e-9):
        factor = float(np.sqrt(new.youngs_modulus / old.youngs_modulus * lightness))
        frequencies, complete_to = modes.frequencies * factor, modes.complete_to * factor
        return replace(modes, frequencies=frequencies, complete_to=complete_to)
    if modes.poisson_slopes is None or not is_known:
        raise MaterialError(
            f"Poisson's ratio would change from {rounded(old.poisson_ratio)} to "
            f"{rounded(new.poisson_ratio)}, and the slopes of these modes with it are unknown: "
            "compute them again"
        )
    return _first_order(modes, modes.poisson_slopes, old, new, lightness)


def _first_order(
    modes: Stiffness, slopes: Array, old: Material, new: Material, lightness: float
) -> Stiffness:
    step = new.poisson_ratio - old.poisson_ratio
    least, greatest = _extreme_factors(old, new, lightness)
    stretch = new.youngs_modulus / old.youngs_modulus * lightness
    compliance = np.clip(1 - 2 * slopes * step, stretch / greatest**2, stretch / least**2)
    old_errors = np.zeros_like(slopes) if modes.errors is None else np.nan_to_num(modes.errors)
    return Stiffness(
        frequencies=modes.frequencies * np.sqrt(stretch / compliance),
        poisson_slopes=slopes / compliance,
        errors=old_errors + _SECOND_ORDER * step**2,
        complete_to=modes.complete_to * least,
    )


def _extreme_factors(old: Material, new: Material, lightness: float) -> tuple[float, float]:
    """Bound any frequency's change: no strain follows more than bulk or shear alone."""
    bulk = new.bulk_modulus / old.bulk_modulus
    shear = new.shear_modulus / old.shear_modulus
    extremes = np.sqrt(np.array([min(bulk, shear), max(bulk, shear)]) * lightness)
    return float(extremes[0]), float(extremes[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Undamped modes of a body with its surface.

    Parameters
    ----------
    frequencies : array (M,)
        Natural frequencies, ascending, Hz.
    surface : Mesh
        Surface of the body, on which the shapes are given.
    shapes : array (V, 3, M)
        Mass-normalised mode shapes at the vertices, kg^-1/2.
    mass : float
        Mass, kg.
    centre : array (3,)
        Centre of mass, m.
    inertia : array (3, 3)
        Moments of inertia about `centre`, kg m^2.
    complete_to : float
        Frequency below which no mode is missing, Hz.
    poisson_slopes : array (M,)
        d ln f / d(Poisson's ratio) at constant Young's modulus.
    errors : array (M,)
        Relative discretisation error of each frequency; NaN if unknown.
    supported : bool, default False
        Whether the body is clamped or supported somewhere, so that it has no rigid-body modes.
    tensioned : bool, default False
        Whether tension, not the stiffness of the material, is the restoring force.
    formula : TransverseShapes or None, default None
        Mode shapes in closed form, at any point.
    provenance : Provenance, optional
        Method, versions, references, and what was left out.
    """

    __repr__ = brief
    frequencies: Array
    surface: Mesh
    shapes: Array
    mass: float
    centre: Array
    inertia: Array
    complete_to: float
    poisson_slopes: Array
    errors: Array
    supported: bool = False
    tensioned: bool = False
    formula: TransverseShapes | None = None
    provenance: Provenance = field(default_factory=Provenance)
