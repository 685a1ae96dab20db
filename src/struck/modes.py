"""Modes: how an undamped body vibrates, and the shapes as seen on its surface."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError
from struck.forms import TransverseShapes
from struck.model.mesh import Mesh
from struck.model.provenance import Provenance


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
