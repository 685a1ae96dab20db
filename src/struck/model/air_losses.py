"""Losses of modes to the air: decay rates by radiated sound and by the boundary layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.model.arrays import Array, Index, require_numbers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AirLosses:
    """Decay rates of modes by what the surrounding air takes from them.

    Parameters
    ----------
    sound : array (M,)
        Decay rates by radiated sound, 1/s.
    surface : array (M,)
        Decay rates by viscosity and heat conduction in the boundary layers on the surface, 1/s.
    uncertainty : array (M,)
        Uncertainty of `sound`, dB: the exact value is within it, above or below, for 19 of 20
        modes.
    """

    sound: Array
    surface: Array
    uncertainty: Array

    def __post_init__(self) -> None:
        modes = np.shape(self.sound)[-1:]
        for name in ("sound", "surface", "uncertainty"):
            require_numbers(name, getattr(self, name), modes, least=0)

    @property
    def total(self) -> Array:
        """Decay rates by both losses (M,), 1/s."""
        return self.sound + self.surface

    def bounds(self, decays: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest decay rates (M,), 1/s, within the uncertainty.

        `decays` (M,) are the rates by all losses, of which `sound` is a part.
        """
        factors = 10 ** (self.uncertainty / 10)
        lowest = np.maximum(decays - self.sound * (1 - 1 / factors), 0.0)
        return lowest, decays + self.sound * (factors - 1)

    def chosen(self, modes: Index) -> AirLosses:
        """Return the losses of some modes (K,), in that order."""
        return AirLosses(
            sound=self.sound[modes],
            surface=self.surface[modes],
            uncertainty=self.uncertainty[modes],
        )

    def means(self, groups: Index) -> AirLosses:
        """Return losses of which each is the mean over its group, by the groups' numbers (M,)."""
        return AirLosses(
            sound=group_means(groups, self.sound),
            surface=group_means(groups, self.surface),
            uncertainty=self.uncertainty,
        )

    def scaled(self, size: float, density: float) -> AirLosses:
        """Return the losses of a body `size` times as large and `density` times as dense.

        Its frequencies are 1 / size times as high, so that waves fit the body as before: powers go
        as area times squared shapes, which go as 1 / (density size^3). Boundary layers take a power
        per area that goes as the root of the frequency, too.
        """
        return AirLosses(
            sound=self.sound / (size * density),
            surface=self.surface / (size**1.5 * density),
            uncertainty=self.uncertainty,
        )


def group_means(groups: Index, values: Array) -> Array:
    """Return for each value (M,) the mean over its group, by the groups' numbers (M,) from 0 on."""
    if not len(values):
        return values
    return (np.bincount(groups, values) / np.bincount(groups))[groups]


def decays_of_pressures(pressures: Array, impedance: float) -> Array:
    """Return decay rates by sound (M,), 1/s, of modes with the pressures (M,) at 1 m.

    A mode with the pressure p at 1 m (root mean square over directions), in Pa for a modal velocity
    of 1 kg^1/2 m/s, radiates 2 pi p^2 / (rho c), in W, of its energy of 1/2 J, which falls at twice
    the decay rate.
    """
    return np.asarray(2 * np.pi * np.square(pressures) / impedance)
