"""A vibrating skin in air: the pressure on it, and the power that leaves it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh
from struck.radiation.on_surface import Split, SurfaceHarmonics
from struck.radiation.point_sources import PointSources
from struck.radiation.spherical import sphere_efficiency, sphere_impedance

Array = NDArray[np.float64]

# Size ka from which the power is taken in both ways. Below, hardly any of the pressure on the skin
# does work, and the work is a small difference of guesses.
_WIDE_AS_A_WAVE = np.pi
# Size ka that the bundles still resolve. A motion that radiates there radiates above, too.
_WIDEST = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Radiator:
    """A skin, prepared for the power of many modes.

    Parameters
    ----------
    radius : float
        Of the sphere of the same area, m.
    harmonics : SurfaceHarmonics
        Of the skin, H of them.
    sources : PointSources
        Its faces, in K bundles.
    forces : array (K, 3, H)
        Integral of the harmonics times the normal over each bundle, m.
    """

    radius: float
    harmonics: SurfaceHarmonics
    sources: PointSources
    forces: Array

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> Radiator:
        """Prepare the skin `mesh`, of the area of a sphere of `radius`."""
        harmonics, sources = SurfaceHarmonics.of(mesh, radius), PointSources.of(mesh)
        return cls(
            radius=radius,
            harmonics=harmonics,
            sources=sources,
            forces=_by_bundle(sources.forces @ harmonics.functions),
        )

    def mean_squares(self, velocities: Array, wave_numbers: Array) -> Array:
        """Return mean squares over directions of the pressure at 1 m, in units of (rho c)^2.

        Parameters
        ----------
        velocities : array (F, M)
            Normal velocities of the faces, m/s.
        wave_numbers : array (M,)
            1/m.

        Returns
        -------
        array (M,)
            m^2/s^2.
        """
        split, sizes = self.harmonics.split(velocities), wave_numbers * self.radius
        near = self._through_skin(split, sizes)
        far = self._far_away(velocities, split, np.minimum(sizes, _WIDEST))
        return np.where(sizes < _WIDE_AS_A_WAVE, far, np.maximum(near, far))

    def _through_skin(self, split: Split, sizes: Array) -> Array:
        """Return mean squares from the work that the pressure does on the skin."""
        efficiencies = sphere_efficiency(self.harmonics.orders[:, None], sizes)
        rest = sphere_efficiency(split.rest_orders, sizes) * split.rest_powers
        return (np.sum(efficiencies * np.square(split.parts), axis=0) + rest) / (4 * np.pi)

    def _far_away(self, velocities: Array, split: Split, sizes: Array) -> Array:
        """Return mean squares from the waves that velocity and pressure on the skin send out."""
        wave_numbers = sizes / self.radius
        flows = self.sources.flows @ velocities
        moments = _by_bundle(self.sources.moments @ velocities)
        dipoles = self._forces(split, sizes) - 1j * wave_numbers * moments
        squares = [
            self.sources.mean_square(wave_number, flows[:, mode], dipoles[:, :, mode])
            for mode, wave_number in enumerate(wave_numbers)
        ]
        return np.square(wave_numbers / (4 * np.pi)) * squares

    def _forces(self, split: Split, sizes: Array) -> NDArray[np.complex128]:
        """Return the forces of the air on the bundles (K, 3, M) in units of rho c, m^3/s."""
        harmonics = sphere_impedance(self.harmonics.orders[:, None], sizes) * split.parts
        rest = _by_bundle(self.sources.forces @ split.rest)
        return self.forces @ harmonics + sphere_impedance(split.rest_orders, sizes) * rest


def _by_bundle(values: Array) -> Array:
    """Return rows (3 K, ...) as (K, 3, ...)."""
    return values.reshape(-1, 3, values.shape[1])
