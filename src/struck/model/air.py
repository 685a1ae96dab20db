"""Air: the medium that carries sound from a body to an ear."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """A gas at rest.

    Parameters
    ----------
    density : float
        kg/m^3.
    sound_speed : float
        m/s.
    """

    density: float
    sound_speed: float

    @property
    def impedance(self) -> float:
        """Characteristic impedance rho c, Pa s/m."""
        return self.density * self.sound_speed


AIR = Air(density=1.2041, sound_speed=343.21)
"""Dry air at 20 degrees Celsius and 101.325 kPa."""
