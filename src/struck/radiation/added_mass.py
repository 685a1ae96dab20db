"""Recoil of a rigid body from its shape: the air that it displaces and the air that it carries.

The recoil in long waves depends on the volume of a body and on its added mass, which are taken from
its convex hull and from the ellipsoid of the same inertia (Lamb 1932, articles 114 and 373). In
short waves each face radiates as a piston. One damped mode per axis joins both limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.errors import MeshError
from struck.model.arrays import Array
from struck.model.material import AIR, Air
from struck.model.mesh import Mesh
from struck.model.recoil import DAMPINGS, Recoil

REFERENCES = ("chadwick2012", "lamb1932")
# Between long and short waves the shape decides: corner and damping ratio that come nearest to
# boundary elements on ellipsoids, discs, cans and rods, by the ratio of the carried volume to that
# of carried and displaced air: a needle along its axis 0, a ball 1/3, a thin plate 1.
_CARRIED_FRACTIONS = (0.0, 0.3, 1 / 3, 0.5, 0.85, 1.0)
_DAMPINGS = (0.99, 0.72, 2**-0.5, 0.69, 0.44, 0.40)
_CORNERS = (0.85, 1.0, 1.0, 1.0, 0.94, 0.905)
# Ratio of length to width above which the damping across a body is larger, and by how much for each
# unit of the ratio.
_SLENDER_RATIO, _DAMPING_PER_RATIO = 3.5, 0.025


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hull:
    """Convex hull of a body, along the principal axes of its inertia."""

    axes: Array  # (3, 3), a row each
    volume: float  # m^3
    half: Array  # (3,), half-axes of the ellipsoid of the same inertia, m
    shadows: Array  # (3,), area of the shadow along each axis, m^2
    # (3,), integral over the surface of the square of the normal's component, m^2
    facing_areas: Array

    @classmethod
    def of(cls, surface: Mesh) -> Hull:
        """Return the hull of a surface; MeshError where it has no volume."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            hull = ConvexHull(surface.points)
        except QhullError as error:
            raise MeshError("the body is flat: it has no volume that could move air") from error
        corners = surface.points[hull.simplices] - surface.points[hull.vertices].mean(axis=0)
        cross_products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(cross_products, axis=1) / 2
        volumes = np.abs(np.einsum("fd,fd->f", corners[:, 0], hull.equations[:, :3])) * areas / 3
        covariance = _covariance(corners, volumes)
        variances, axes = np.linalg.eigh(covariance)
        normals = np.abs(hull.equations[:, :3] @ axes)
        return cls(
            axes=axes.T,
            volume=float(hull.volume),
            half=np.sqrt(5 * variances),
            shadows=areas @ normals / 2,
            facing_areas=areas @ np.square(normals),
        )

    @property
    def carried_volumes(self) -> Array:
        """Volumes of air that move with the body along each axis (3,), m^3.

        They are those of the ellipsoid (Lamb). A flat body carries air in proportion to its
        shadow, and the shadow of the ellipsoid is a quarter larger than that of a disc.
        """
        factors = lamb(self.half)
        ellipsoid = 4 / 3 * np.pi * np.prod(self.half)
        flat = np.square(factors / (1 + factors))
        shadow_ratios = self.shadows * self.half / (np.pi * np.prod(self.half))
        return factors * ellipsoid * shadow_ratios ** (1.5 * flat)


def _covariance(corners: Array, volumes: Array) -> Array:
    """Return the covariance (3, 3) of places in tetrahedra from the origin to faces (F, 3, 3)."""
    sums = corners.sum(axis=1)
    centre = volumes @ sums / 4 / volumes.sum()
    squares = np.einsum("f,fcd,fce->de", volumes, corners, corners)
    second_moments = squares + np.einsum("f,fd,fe->de", volumes, sums, sums)
    return second_moments / 20 / volumes.sum() - np.outer(centre, centre)


def lamb(half: Array) -> Array:
    """Return added over displaced mass of an ellipsoid of half-axes (3,), along each (3,).

    Lamb 1932, article 114: k = alpha / (2 - alpha), where alpha is a b c times the integral over
    u from 0 to infinity of 1 / ((a^2 + u) root((a^2 + u) (b^2 + u) (c^2 + u))): Carlson's R_D.
    """
    from scipy.special import elliprd

    squares = np.square(half)
    integral = elliprd(np.roll(squares, -1), np.roll(squares, -2), squares)
    alpha = 2 / 3 * np.prod(half) * integral
    return np.asarray(alpha / (2 - alpha), np.float64)


def recoil_of(surface: Mesh, mass: float, air: Air = AIR) -> Recoil:
    """Return the recoil of a free body of `mass` kg within a surface.

    Raises
    ------
    MeshError
        When the surface encloses no volume.
    """
    hull = Hull.of(surface)
    moved_volumes = hull.volume + hull.carried_volumes
    carried_fractions = hull.carried_volumes / moved_volumes
    # Far away, root mean square over directions, of a force that grows by 1 N/s or is 1 N.
    levels = air.density * moved_volumes / (4 * np.pi * np.sqrt(3) * air.sound_speed * mass)
    short_wave_levels = air.impedance * np.sqrt(hull.facing_areas / (4 * np.pi)) / mass
    corners = np.interp(carried_fractions, _CARRIED_FRACTIONS, _CORNERS) * np.sqrt(
        short_wave_levels / levels
    )
    dampings = np.interp(carried_fractions, _CARRIED_FRACTIONS, _DAMPINGS)
    half_width, half_length = np.sort(hull.half)[1:]
    excess_ratio = max(half_length / half_width - _SLENDER_RATIO, 0.0)
    dampings += _DAMPING_PER_RATIO * excess_ratio * (hull.half < half_length)
    return Recoil(
        axes=hull.axes,
        levels=levels,
        corners=corners / (2 * np.pi),
        dampings=np.clip(dampings, *DAMPINGS),
    )
