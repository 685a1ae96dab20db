"""Elastic impact after Hertz: how long a striker touches a body, and how hard it pushes.

The body is taken as flat at the contact and as rigid except for the dent; its mass is the effective
mass at the contact. The blow is quasi-static: waves within the striker are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from struck.excitation.excitation import require_known
from struck.model.arrays import checked, require_number
from struck.model.material import Material
from struck.model.provenance import table_of

# 2.8683: contact time in units of (m^2 / (R E*^2 v))^(1/5) (Johnson 1985, section 11.4)
CONTACT_CONSTANT = 4 * math.sqrt(math.pi) / 5 * math.gamma(0.4) / math.gamma(0.9) * (15 / 16) ** 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Striker:
    """A round, elastic head.

    Parameters
    ----------
    name : str
        What people call it.
    radius : float
        Of the surface that touches, m.
    mass : float
        Of what moves in the blow, kg.
    youngs_modulus : float
        Pa.
    poisson_ratio : float
        Between -1 and 0.5.
    restitution : float
        Speed apart over speed together, 0 to 1.
    source : str
        Where the figures come from.
    """

    name: str
    radius: float
    mass: float
    youngs_modulus: float
    poisson_ratio: float
    restitution: float
    source: str = ""

    @classmethod
    def named(cls, name: str) -> Striker:
        """Look a striker up in ``strikers.toml``, in any case.

        Raises
        ------
        OptionError
            If there is no striker of that name; the nearest are offered.
        """
        key = require_known(name, strikers(), "striker")
        return cls(name=key, **strikers()[key])


def strikers() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of strikers.

    Returns
    -------
    mapping of str to mapping
        Entries of ``strikers.toml`` by name.

    Examples
    --------
    >>> sorted(struck.excitation.strikers())
    ['brass', 'felt', 'fingertip', 'glass', 'plastic', 'rubber', 'steel', 'wood']
    """
    return table_of("struck.excitation", "strikers")


def contact_modulus(*solids: Striker | Material) -> float:
    """Return E* of solids in contact, Pa: 1/E* = sum of (1 - nu^2)/E (Johnson 1985, 4.2)."""
    return 1 / sum((1 - solid.poisson_ratio**2) / solid.youngs_modulus for solid in solids)


def effective_mass(
    *, mass: float, centre: ArrayLike, inertia: ArrayLike, point: ArrayLike, direction: ArrayLike
) -> float:
    """Return the mass that a free rigid body shows to a push, kg.

    Parameters
    ----------
    mass : float
        kg.
    centre : array-like (3,)
        Centre of mass, m.
    inertia : array-like (3, 3)
        Moments of inertia about it, kg m^2.
    point : array-like (3,)
        Where the push acts, m.
    direction : array-like (3,)
        Unit vector n of the push.

    Returns
    -------
    float
        1 / (1/M + (r x n) . I^-1 (r x n)): the impulse divided by the speed it gives the point
        along n.
    """
    arm = np.asarray(point, float) - np.asarray(centre, float)
    torque = np.cross(arm, np.asarray(direction, float))
    return float(1 / (1 / mass + torque @ np.linalg.solve(np.asarray(inertia, float), torque)))


def joint_mass(*masses: float) -> float:
    """Return the mass of colliding bodies as seen by their approach, kg: 1/m = sum of 1/m_i."""
    return 1 / sum(1 / mass for mass in masses)


@checked
def contact_time(*, mass: float, radius: float, modulus: float, speed: float) -> float:
    """Compute the duration of an elastic impact.

    Parameters
    ----------
    mass : float
        Effective mass of both bodies, kg.
    radius : float
        Effective radius of curvature of both bodies, m.
    modulus : float
        Contact modulus E*, Pa.
    speed : float
        Approach speed, m/s.

    Returns
    -------
    float
        2.8683 (m^2 / (R E*^2 v))^(1/5), s (Johnson 1985, section 11.4).

    Raises
    ------
    OptionError
        If a number is not positive, or impossible for a body that strikes.

    Examples
    --------
    >>> from struck.excitation import contact_time
    >>> round(contact_time(mass=0.05, radius=0.01, modulus=1e10, speed=1.0), 6)
    0.000217
    """
    arguments = {"mass": mass, "radius": radius, "modulus": modulus, "speed": speed}
    for name, value in arguments.items():
        require_number(name, value, 1e-30, 1e30, hint="it must exceed 0, and 1e-30 is the least")
    return CONTACT_CONSTANT * (mass**2 / (radius * modulus**2 * speed)) ** 0.2
