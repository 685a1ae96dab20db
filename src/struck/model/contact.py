"""A contact: where and along which direction a body is touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from struck.errors import ContactError, counted, require_choice, rounded
from struck.model.arrays import Array, Index, numbers
from struck.model.mesh import Mesh, Surface

Place = str | Sequence[float] | Array | None
# Share of the body's extent, or of a coordinate's range, within which a point counts as on it.
_SNAP = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contact:
    """A point on a body with the direction of a push.

    Parameters
    ----------
    point : array (3,)
        On the surface, m.
    direction : array (3,)
        Unit vector of the push. Default: the inward normal.
    normal : array (3,)
        Outward unit normal of the surface there.
    distance : float
        How far the asked-for point was from the surface, m.
    name : str
        Of the place, "" where it has none.
    """

    point: Array
    direction: Array
    normal: Array
    distance: float
    name: str = ""

    @property
    def place(self) -> str:
        """The place in words, as "the rim", "+x" or "(0.1, 0, 0.02) m"."""
        if self.name and self.normal.any():
            kind, _, number = self.name.partition(":")
            return f"{kind} {number}" if number else f"{'the ' * self.name.isalpha()}{self.name}"
        if not self.point.size:
            return "its one place"
        return _text(self.point).removesuffix("" if self.normal.any() else " m")

    @classmethod
    def on(cls, locator: Surface, mesh: Mesh, point: Array, direction: Place = None) -> Contact:
        """Find the contact nearest to `point`.

        Raises
        ------
        ContactError
            When it is farther than 2 % of the body's extent, or the direction is no direction.
        """
        push = None if direction is None else _three(direction, "direction")[None]
        target = _three(point, "contact")
        (nearest,), (unit_push,), (normal,), _ = nearest_contacts(locator, mesh, target[None], push)
        distance = float(np.linalg.norm(nearest - target))
        return cls(point=nearest, direction=unit_push, normal=normal, distance=distance)

    @classmethod
    def recorded(
        cls,
        at: Place,
        places: Mapping[str, Array],
        coordinates: tuple[str, ...],
        direction: Place = None,
    ) -> Contact:
        """Find a contact of a body without a surface, by the coordinates that recordings have.

        Raises
        ------
        ContactError
            When it is no name of `places`, nor a number for each of `coordinates`, or has a
            direction, of which recordings know nothing.
        """
        if direction is not None:
            raise ContactError(
                f"direction is {direction!r}: this body was recorded as it was struck and knows no "
                "other way to push; leave direction= out"
            )
        if at is None and places:
            at = next(iter(places))
        if isinstance(at, str):
            require_choice("the place", at, places, ContactError)
        point = np.asarray(places[at] if isinstance(at, str) else at, dtype=np.float64)
        if point.shape != (len(coordinates),) or not np.isfinite(point).all():
            raise ContactError(f"contact is {at!r}: {_choice(coordinates, places)}")
        return cls(
            point=point,
            direction=np.zeros(3),
            normal=np.zeros(3),
            distance=0.0,
            name=at if isinstance(at, str) else "",
        )


def nearest_contacts(
    locator: Surface, mesh: Mesh, points: Array, directions: Array | None
) -> tuple[Array, Array, Array, Index]:
    """Return points on a surface, unit pushes, normals (K, 3) and faces (K,) of contacts.

    Raises
    ------
    ContactError
        When one is farther than 2 % of the body's extent, or a direction is no direction.
    """
    lengths, faces, nearest = locator.closest(points)
    reach, worst = _SNAP * mesh.extent, int(np.argmax(lengths))
    if lengths[worst] > reach:
        raise ContactError(
            f"the contact {_text(points[worst])} is {rounded(lengths[worst], 3)} m off the body, "
            f"more than {rounded(reach, 3)} m: the nearest point is {_text(nearest[worst])}"
        )
    normals = mesh.normals_at(faces, nearest)
    if directions is None:
        return nearest, -normals, normals, faces
    return nearest, np.array([_unit(direction) for direction in directions]), normals, faces


def require_recorded(points: Array, lowest: Array, highest: Array) -> None:
    """Refuse contacts (K, D) more than 2 % of a coordinate's range outside of it."""
    reach = _SNAP * (highest - lowest)
    is_outside = (points < lowest - reach) | (points > highest + reach)
    if np.isnan(points).any() or is_outside.any():
        bad_point = points[np.argmax(is_outside.any(axis=1))]
        nearest = np.clip(bad_point, lowest, highest)
        raise ContactError(
            f"the contact {bad_point.tolist()} lies outside of what was recorded: the nearest is "
            f"{nearest.tolist()}"
        )


def raised(mesh: Mesh, place: Array) -> Array:
    """Return the point on top of a flat body where its plan has `place` (1,) or (2,), m (3,)."""
    low, high = mesh.bounds
    middle = (low + high) / 2
    return np.concatenate([place, middle[len(place) : 2], high[2:]])


def located(mesh: Mesh, places: Mapping[str, Array], at: Place, axes: int = 3) -> Array:
    """Return the point of a name, of "vertex:120" or of coordinates, m (3,)."""
    if not isinstance(at, str):
        place = np.asarray(at, dtype=np.float64)
        if axes in {1, 2} and place.shape not in {(axes,), (3,)}:
            raise ContactError(
                f"contact is {at!r}: give {counted(axes, 'coordinate')} or x, y, z, in m"
            )
        return raised(mesh, place) if place.shape == (axes,) != (3,) else place
    kind, _, number = at.partition(":")
    if kind == "vertex" and number.isdecimal() and int(number) < len(mesh.points):
        return mesh.points[int(number)]
    if at not in places:
        vertex_hint = f", vertex:0 to vertex:{len(mesh.points) - 1}, or a point in m"
        require_choice(
            "the place", at, (*sorted(places), "loudest"), ContactError, more=vertex_hint
        )
    return places[at]


def _choice(coordinates: tuple[str, ...], places: Mapping[str, Array]) -> str:
    """Return the contacts that a recorded body has, in words."""
    names = ", ".join(map(repr, places))
    if not coordinates:
        return (
            f"it was recorded at one place, which has no coordinates: strike {names or 'nothing'}"
        )
    return f"give a finite number for each of {', '.join(coordinates)}"


def _three(values: object, name: str) -> Array:
    array = numbers(name, values, error=ContactError)
    if array.shape != (3,) or not np.isfinite(array).all():
        text = ", ".join(map(rounded, array.ravel()[:6]))
        raise ContactError(f"{name} is ({text}): give three finite numbers x, y, z, in m")
    return array


def _unit(vector: Array) -> Array:
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(vector))
    if not 0 < length < np.inf:
        text = ", ".join(map(rounded, vector))
        raise ContactError(f"direction is ({text}): give a vector with a length, below 1e150")
    return vector / length


def _text(point: Array) -> str:
    return "(" + ", ".join(rounded(value, 4) for value in np.round(point, 9) + 0.0) + ") m"
