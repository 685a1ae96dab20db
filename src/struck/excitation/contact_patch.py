"""The area of contact: a push spread over a disc drives each mode by the mean of its shape.

A patch wider than a mode's waves does not drive that mode, which is why a soft, broad finger
sounds duller than a nail (2007 lets the area of contact shape the sound).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array
from struck.model.contact import Contact
from struck.model.model import ModalModel

_RINGS, _SPOKES = 4, 12


def drive(model: ModalModel, contact: Contact, *, radius: float = 0.0) -> Array:
    """Return the mean of each mode shape over a disc of contact, along its push, kg^-1/2 (M,)."""
    return drive_at(model, contact.point, contact.normal, contact.direction, radius=radius)


def drive_at(
    model: ModalModel, point: Array, normal: Array, direction: Array, *, radius: float = 0.0
) -> Array:
    """Return `drive` of a disc about `point`, in the plane whose unit normal is `normal`."""
    if not radius:
        return _rank_one(model, point[None], direction)[0]
    if not normal.any():
        raise OptionError(
            f"the area of contact has a radius of {radius} m, but this body was recorded and has "
            "no surface: leave patch= out"
        )
    places, weights = _disc()
    offsets = places @ np.stack(_tangents(normal)) * radius
    return weights @ _rank_one(model, point + offsets, direction)


def _rank_one(model: ModalModel, points: Array, direction: Array) -> Array:
    drives = model.gains.at(points, np.broadcast_to(direction, (len(points), 3)))
    if drives.shape[1] != 1:
        raise OptionError(
            f"the gains are a sum of {drives.shape[1]} products of contact and listener, and a "
            "push needs one: use the model's expanded() gains"
        )
    if not np.isfinite(drives).all():
        wrong = np.count_nonzero(~np.isfinite(drives).all(axis=(0, 1)))
        raise OptionError(
            f"{wrong} of {drives.shape[2]} modes have gains that are not finite: analyze the body "
            "again, or look at its model file"
        )
    return drives[:, 0]


@cache
def _disc() -> tuple[Array, Array]:
    """Return points (K, 2) and weights (K,) that average over the unit disc to degree 7."""
    nodes, weights = np.polynomial.legendre.leggauss(_RINGS)
    radii = np.sqrt((nodes + 1) / 2)
    turns = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    rim = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = (radii[:, None, None] * rim).reshape(-1, 2)
    return points, np.repeat(weights / 2 / _SPOKES, _SPOKES)


def _tangents(normal: Array) -> tuple[Array, Array]:
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
