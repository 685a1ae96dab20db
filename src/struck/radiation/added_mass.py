"""Recoil of a rigid body from its shape: the air that it displaces and the air that it carries.

Long waves see the volume of a body and its added mass: those of its convex hull, and of the
ellipsoid that has the hull's inertia (Lamb 1932, articles 114 and 373). Short waves see its faces,
each of which radiates as a piston. One damped mode an axis goes from one to the other.
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
# boundary elements on ellipsoids, discs, cans and rods, by the share of the moved air in all that
# is displaced, from a needle along its axis (0) by a ball (1/3) to a thin plate (1).
_SHARES = (0.0, 0.3, 1 / 3, 0.5, 0.85, 1.0)
_DAMPINGS = (0.99, 0.72, 2**-0.5, 0.69, 0.44, 0.40)
_CORNERS = (0.85, 1.0, 1.0, 1.0, 0.94, 0.905)
# A body more than so many times as long as wide is damped more across, by this for each time.
_SLENDER, _MORE = 3.5, 0.025


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hull:
    """Convex hull of a body, along the principal axes of its inertia."""

    axes: Array  # (3, 3), a row each
    volume: float  # m^3
    half: Array  # (3,), half-axes of the ellipsoid of the same inertia, m
    shadows: Array  # (3,), area of the shadow along each axis, m^2
    faced: Array  # (3,), integral over the surface of the square of the normal's component, m^2

    @classmethod
    def of(cls, surface: Mesh) -> Hull:
        """Return the hull of a surface; MeshError where it has no volume."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            found = ConvexHull(surface.points)
        except QhullError as error:
            raise MeshError("the body is flat: it has no volume that could move air") from error
        corners = surface.points[found.simplices] - surface.points[found.vertices].mean(axis=0)
        crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(crossed, axis=1) / 2
        volumes = np.abs(np.einsum("fd,fd->f", corners[:, 0], found.equations[:, :3])) * areas / 3
        spread = _spread(corners, volumes)
        variances, axes = np.linalg.eigh(spread)
        normals = np.abs(found.equations[:, :3] @ axes)
        return cls(
            axes=axes.T,
            volume=float(found.volume),
            half=np.sqrt(5 * variances),
            shadows=areas @ normals / 2,
            faced=areas @ np.square(normals),
        )

    @property
    def carried(self) -> Array:
        """Volumes of air that move with it along each axis (3,), m^3.

        Lamb's, of the ellipsoid. What is flat carries air by its own shadow, not by that of the
        ellipsoid, whose shadow is a quarter larger than a disc's.
        """
        factors = lamb(self.half)
        ellipsoid = 4 / 3 * np.pi * np.prod(self.half)
        flat = np.square(factors / (1 + factors))
        larger = self.shadows * self.half / (np.pi * np.prod(self.half))
        return factors * ellipsoid * larger ** (1.5 * flat)


def _spread(corners: Array, volumes: Array) -> Array:
    """Return the covariance (3, 3) of places in tetrahedra from the origin to faces (F, 3, 3)."""
    sums = corners.sum(axis=1)
    centre = volumes @ sums / 4 / volumes.sum()
    squares = np.einsum("f,fcd,fce->de", volumes, corners, corners)
    every = squares + np.einsum("f,fd,fe->de", volumes, sums, sums)
    return every / 20 / volumes.sum() - np.outer(centre, centre)


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
    moved = hull.volume + hull.carried
    share = hull.carried / moved
    # Far away, root mean square over directions, of a force that grows by 1 N/s or is 1 N.
    levels = air.density * moved / (4 * np.pi * np.sqrt(3) * air.sound_speed * mass)
    highest = air.impedance * np.sqrt(hull.faced / (4 * np.pi)) / mass
    corners = np.interp(share, _SHARES, _CORNERS) * np.sqrt(highest / levels)
    dampings = np.interp(share, _SHARES, _DAMPINGS)
    middle, longest = np.sort(hull.half)[1:]
    slender = max(longest / middle - _SLENDER, 0.0)
    dampings += _MORE * slender * (hull.half < longest)
    return Recoil(
        axes=hull.axes,
        levels=levels,
        corners=corners / (2 * np.pi),
        dampings=np.clip(dampings, *DAMPINGS),
    )
