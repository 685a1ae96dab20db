"""What touches a body, and what is said of it at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError
from struck.excitation.excitation import require_at_least_zero, require_positive
from struck.excitation.friction import Rubbed
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.roughness import Roughness, profile
from struck.model.arrays import Array
from struck.model.contact import Contact
from struck.model.model import ModalModel

HEAVIEST = 1e6  # N, the largest load


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tool:
    """What touches.

    Parameters
    ----------
    roughness : str or Roughness
        Of the two surfaces together: a name in ``roughness.toml``, or a profile.
    striker : str
        Of what the tip is, a name in ``strikers.toml``.
    radius : float or None
        Of the tip, m; None takes the striker's.
    patch : float
        Radius of the area over which mode shapes are averaged, m; 0 is a point.

    Raises
    ------
    OptionError
        On unknown names, or numbers outside their bounds.
    """

    roughness: str | Roughness = "wood"
    striker: str = "plastic"
    radius: float | None = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "roughness", profile(self.roughness))
        Striker.named(self.striker)
        require_positive(radius=self.radius)
        require_at_least_zero(patch=self.patch)

    def on(self, model: ModalModel) -> Rubbed:
        """Return its tip in contact with a model."""
        tip = Striker.named(self.striker)
        solids = (tip,) if model.material is None else (tip, model.material)
        return Rubbed(
            roughness=profile(self.roughness),
            modulus=contact_modulus(*solids),
            radius=self.radius or tip.radius,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Update:
    """Place, load and speed of a touch from one sample on."""

    sample: int  # number of the first sample that it holds for
    contact: Contact  # place, and direction of the load
    drive: Array  # (M,), kg^-1/2, of each mode there
    force: float  # N, at least 0
    speed: float  # m/s, at least 0


def load_of(force: float) -> float:
    """Return a load, N, or raise an OptionError."""
    if not 0 <= force <= HEAVIEST:
        raise OptionError(f"force is {force}: it must lie from 0 to {HEAVIEST:g} N")
    return float(force)


def speed_of(velocity: float | ArrayLike) -> float:
    """Return the magnitude of a velocity, m/s, or raise an OptionError."""
    vector = np.asarray(velocity, np.float64)
    if vector.ndim > 1 or not np.isfinite(vector).all():
        raise OptionError(f"velocity is {velocity!r}: give a finite number or (x, y, z) in m/s")
    return float(np.linalg.norm(vector))
