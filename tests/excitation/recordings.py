"""Recorded bodies of each kind: of one place, fields over one and two coordinates, tables."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from struck.model.gains import Gains
from struck.model.model import ModalModel
from struck.model.survey import Survey, from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable

Array = NDArray[np.float64]

FREQUENCIES = np.array([310.0, 560.0, 820.0, 1230.0, 1900.0, 3100.0])
DECAYS = np.array([4.0, 6.0, 5.0, 9.0, 12.0, 20.0])
PITCH = 0.24
"""Metres a unit of a height, and of u; a unit of v, or of an azimuth, is `WIDTH`."""
WIDTH = 0.1
HEARD = (1.0, 0.3, 0.2)
KINDS = ("one", "field", "plane", "round", "table")


def model(gains: Gains, coordinates: tuple[str, ...]) -> ModalModel:
    return ModalModel(
        frequencies=FREQUENCIES,
        natural_frequencies=np.hypot(FREQUENCIES, DECAYS / (2 * np.pi)),
        decays=DECAYS,
        gains=gains,
        complete_to=0.0,
        places={"recorded": np.full(len(coordinates), 0.5)},
        coordinates=coordinates,
    )


def shapes(contacts: Array) -> Array:
    """Return smooth drives over one coordinate or two (P, M)."""
    waves = np.arange(1, len(FREQUENCIES) + 1) / 3
    first = np.cos(np.pi * np.outer(contacts[:, 0], waves) + 0.4)
    if contacts.shape[1] == 1:
        return first
    return first * np.cos(np.pi * np.outer(contacts[:, 1], waves[::-1]) / 2)


def surveyed(contacts: Array, symmetry: str = "none") -> Survey:
    """Return what listeners all around hear of contacts (P, D)."""
    places = np.concatenate(
        [
            from_spherical(distance, np.linspace(0, np.pi, 5), polar)
            for distance in (0.7, 1.3)
            for polar in (0.6, 1.5)
        ]
    )
    chance = np.random.default_rng(3)
    sides = chance.normal(size=(2, 4, len(FREQUENCIES)))
    x, y, z = places.T / np.linalg.norm(places, axis=1)
    around = np.stack([np.ones_like(x), x, z, x**2 - y**2], axis=1)
    outputs = around @ (sides[0] + 1j * sides[1]) / np.linalg.norm(places, axis=1)[:, None]
    gains = shapes(contacts[:, :1] if symmetry == "axial" else contacts)[:, None] * outputs[None]
    return Survey.full(contacts, places, gains, FREQUENCIES, symmetry=symmetry)


@cache
def recorded(kind: str, *, charted: bool = True) -> ModalModel:
    """Return a body of one of `KINDS`."""
    heights = np.linspace(0, 1, 5)[:, None]
    corners = np.stack(np.meshgrid(heights[:, 0], heights[:, 0]), axis=-1).reshape(-1, 2)
    if kind == "one":
        outputs = np.exp(1j * np.arange(len(FREQUENCIES))) / np.arange(1, len(FREQUENCIES) + 1)
        return model(SinglePoint(outputs=outputs), ())
    if kind == "field":
        made = model(TimbreField.of(surveyed(heights, "axial")), ("height",))
    elif kind == "table":
        made = model(TimbreTable.of(surveyed(heights, "axial")), ("height",))
    elif kind == "plane":
        made = model(TimbreField.of(surveyed(corners)), ("u", "v"))
    else:
        made = model(TimbreField.of(surveyed(corners, "axial")), ("height", "azimuth (rad)"))
    pitch = [PITCH, WIDTH][: len(made.coordinates)]
    return made.charted(pitch=pitch) if charted else made


def axes(kind: str) -> int:
    """Return how many coordinates paths over a body of a kind have; of one place, metres."""
    return {"plane": 2, "round": 2}.get(kind, 1)


def path(kind: str) -> list[Array]:
    """Return the ends of a way over a body, in its own coordinates."""
    ends = np.array([[0.1, 0.2], [0.9, 0.6]])[:, : axes(kind)]
    return list(ends * (0.25 if kind == "one" else 1.0))


def metres(kind: str) -> Array:
    """Return metres a unit of each coordinate."""
    return np.ones(1) if kind == "one" else np.array([PITCH, WIDTH][: axes(kind)])
