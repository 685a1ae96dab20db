"""The modal model: the one thing that every source makes and every player reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from struck.gains import Gains
from struck.material import Material
from struck.mesh import Mesh
from struck.provenance import Provenance

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalModel:
    """Frequencies, decays and gains of a body.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing (damped) frequencies, ascending with their natural ones, Hz.
    natural_frequencies : array (M,)
        Hz.
    decays : array (M,)
        Amplitude decay rates, 1/s.
    gains : Gains
        Drive over contacts and output over listeners.
    material, mass, centre, inertia, geometry
        None where unknown, as for recordings.
    complete_to : float
        No mode below this frequency is missing, Hz.
    poisson_slopes, errors : array (M,) or None
        As in Modes.
    places : mapping
        Contacts by name, m, each (3,).
    coordinates : tuple of str
        Names and units of a contact's axes.
    provenance : Provenance
        Method, versions, what was dropped, references.
    """

    frequencies: Array
    natural_frequencies: Array
    decays: Array
    gains: Gains
    material: Material | None = None
    mass: float | None = None
    centre: Array | None = None
    inertia: Array | None = None
    geometry: Mesh | None = None
    complete_to: float
    poisson_slopes: Array | None = None
    errors: Array | None = None
    places: Mapping[str, Array] = field(default_factory=dict)
    coordinates: tuple[str, ...] = ("x (m)", "y (m)", "z (m)")
    provenance: Provenance = field(default_factory=Provenance)
