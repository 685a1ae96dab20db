"""Modes: how an undamped body vibrates, its shapes on its surface, and other materials."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import MaterialError, OptionError
from struck.model.arrays import Array
from struck.model.gains import TransverseShapes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.provenance import Provenance

# How natural frequencies follow the material, without a new decomposition.
#
# With the same Poisson's ratio they go with sqrt(E / density) (2002, section 3.3). With another,
# the energy of unchanged stresses counts: in compliances, 2 (1 + nu) / E for shear and 3 (1 - 2 nu)
# / E for bulk, it is linear in nu, and so is 1 / f^2. The stored slope d ln f / d nu gives the
# line. It is exact for stretched, sheared and evenly bent parts; keeping the shapes instead
# (Rayleigh's quotient) errs by 1 % on every bent bar.

# Largest relative error of the first-order formula for a unit change of Poisson's ratio, squared,
# as found on bars, plates, shells and solids (tests/physics/test_materials.py).
_SECOND_ORDER = 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stiffness:
    """Natural frequencies with what a change of material needs to know."""

    frequencies: Array  # (M,), natural, Hz
    poisson_slopes: Array | None  # (M,), d ln f / d nu at constant Young's modulus
    errors: Array | None  # (M,), relative
    complete_to: float  # no mode below is missing, Hz
    tensioned: bool = False  # a tension, which stays, drives the body back, not the material


def changed(modes: Stiffness, old: Material, new: Material) -> Stiffness:
    """Return the modes of the same body made of `new`; MaterialError without slopes."""
    lightness = old.density / new.density
    if modes.tensioned:
        _require_slack(modes)
        new = replace(new, youngs_modulus=old.youngs_modulus, poisson_ratio=old.poisson_ratio)
    if np.isclose(old.poisson_ratio, new.poisson_ratio, rtol=0, atol=1e-9):
        factor = float(np.sqrt(new.youngs_modulus / old.youngs_modulus * lightness))
        return Stiffness(
            frequencies=modes.frequencies * factor,
            poisson_slopes=modes.poisson_slopes,
            errors=modes.errors,
            complete_to=modes.complete_to * factor,
            tensioned=modes.tensioned,
        )
    if modes.poisson_slopes is None or not np.isfinite(modes.poisson_slopes).all():
        raise MaterialError(
            f"Poisson's ratio would change from {old.poisson_ratio:g} to {new.poisson_ratio:g}, "
            "and these modes do not tell how they follow it: compute them anew"
        )
    return _first_order(modes, modes.poisson_slopes, old, new, lightness)


def _require_slack(modes: Stiffness) -> None:
    if modes.poisson_slopes is None or not np.isfinite(modes.poisson_slopes).all():
        raise MaterialError(
            "tension and stiffness together drive this body back, and the modes do not tell their "
            "shares: compute them anew with the other material"
        )


def _first_order(
    modes: Stiffness, slopes: Array, old: Material, new: Material, lightness: float
) -> Stiffness:
    step = new.poisson_ratio - old.poisson_ratio
    least, greatest = _extreme_factors(old, new, lightness)
    stretch = new.youngs_modulus / old.youngs_modulus * lightness
    compliance = np.clip(1 - 2 * slopes * step, stretch / greatest**2, stretch / least**2)
    carried = np.zeros_like(slopes) if modes.errors is None else np.nan_to_num(modes.errors)
    return Stiffness(
        frequencies=modes.frequencies * np.sqrt(stretch / compliance),
        poisson_slopes=slopes / compliance,
        errors=carried + _SECOND_ORDER * step**2,
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
        The body's surface, where the shapes are given.
    shapes : array (V, 3, M)
        Mass-normalised mode shapes at the surface's vertices, kg^-1/2.
    mass : float
        kg.
    centre : array (3,)
        Centre of mass, m.
    inertia : array (3, 3)
        Moments of inertia about `centre`, kg m^2.
    complete_to : float
        No mode below this frequency is missing, Hz.
    poisson_slopes : array (M,)
        d ln f / d(Poisson's ratio) at constant Young's modulus.
    errors : array (M,)
        Relative discretisation error of each frequency; NaN where unknown.
    supported : bool
        Whether the body is held somewhere, so that it cannot move as a rigid one.
    tensioned : bool
        Whether tension, not the material's stiffness, drives it back.
    formula : TransverseShapes or None
        The shapes at any place, where they are known beyond the vertices.
    provenance : Provenance
        How the modes were made.
    """

    frequencies: NDArray[np.float64]
    surface: Mesh
    shapes: NDArray[np.float64]
    mass: float
    centre: NDArray[np.float64]
    inertia: NDArray[np.float64]
    complete_to: float
    poisson_slopes: NDArray[np.float64]
    errors: NDArray[np.float64]
    supported: bool = False
    tensioned: bool = False
    formula: TransverseShapes | None = None
    provenance: Provenance = field(default_factory=Provenance)

    @classmethod
    def given(
        cls,
        surface: Mesh,
        frequencies: ArrayLike,
        shapes: ArrayLike,
        *,
        mass: float,
        centre: ArrayLike,
        inertia: ArrayLike,
        complete_to: float,
        method: str,
    ) -> Modes:
        """Take modes that another program computed; what it does not tell stays unknown.

        Parameters
        ----------
        surface : Mesh
            The body's surface.
        frequencies : array (M,)
            Natural, ascending, Hz.
        shapes : array (V, 3, M)
            Mass-normalised, at the surface's vertices, kg^-1/2.
        mass, centre, inertia
            kg, m (3,) and kg m^2 about the centre (3, 3).
        complete_to : float
            No mode below it is missing, Hz; 0 where unknown.
        method : str
            What computed them.

        Raises
        ------
        OptionError
            When shapes do not fit points and frequencies, or frequencies do not ascend.
        """
        told, forms = np.asarray(frequencies, float), np.asarray(shapes, float)
        _require_fitting(told, forms, len(surface.points))
        unknown = np.full(len(told), np.nan)
        return cls(
            frequencies=told,
            surface=surface,
            shapes=forms,
            mass=float(mass),
            centre=np.asarray(centre, float),
            inertia=np.asarray(inertia, float),
            complete_to=complete_to,
            poisson_slopes=unknown,
            errors=unknown,
            provenance=Provenance(method=method),
        )


def _require_fitting(
    frequencies: NDArray[np.float64], shapes: NDArray[np.float64], vertices: int
) -> None:
    if shapes.shape != (vertices, 3, len(frequencies)):
        raise OptionError(
            f"shapes have shape {shapes.shape}, not ({vertices}, 3, {len(frequencies)}): give "
            "one displacement (3,) at each vertex for each frequency"
        )
    if not np.isfinite(shapes).all() or not np.isfinite(frequencies).all():
        raise OptionError("frequencies or shapes are not finite: leave those modes out")
    if not len(frequencies) or np.any(np.diff(frequencies) < 0) or frequencies.min() <= 0:
        raise OptionError("frequencies must ascend from above 0 Hz: leave rigid motions out")
