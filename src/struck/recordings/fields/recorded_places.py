"""Where a body was struck and heard, as far as its gains tell: what a file of them holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.gains import ExpandedGains, Gains
from struck.model.survey import from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import TimbreTable
from struck.recordings.fields.grids import combinations
from struck.recordings.fields.outgoing import ORDER
from struck.recordings.fields.single_point import SinglePoint

Array = NDArray[np.float64]


def unexpanded(gains: Gains) -> Gains:
    """Return gains as they were recorded or computed, before their products became modes."""
    return gains.products if isinstance(gains, ExpandedGains) else gains


def recorded_contacts(gains: Gains) -> Array | None:
    """Return the contacts (P, D) that were recorded; None of gains that were computed.

    Of a round body struck all around, each height once: the azimuth makes no difference.
    """
    whole = unexpanded(gains)
    if isinstance(whole, SinglePoint):
        return np.zeros((1, 0))
    if isinstance(whole, TimbreTable):
        return combinations(whole.contacts.axes)
    if not isinstance(whole, TimbreField):
        return None
    part = whole.contact_part
    places = part.lowest + part.contacts * part.spans
    if not whole.listener_part.turned:
        return places
    return np.column_stack([places, np.zeros(len(places))])


def recorded_listeners(gains: Gains) -> Array | None:
    """Return the listeners (Q, 3) that were recorded, m; None of gains that were computed.

    A `TimbreField` keeps waves, not who heard them outside: 45 directions that tell all its waves
    apart, at the distance of the nearest listener and at twice that, which tell how they fall.
    Listeners inside the body follow as they were.
    """
    whole = unexpanded(gains)
    if isinstance(whole, SinglePoint):
        return whole.centre + np.eye(3)[:1]
    if isinstance(whole, TimbreTable):
        return _gridded(whole)
    if not isinstance(whole, TimbreField):
        return None
    nearest, inside = 2 * whole.listener_part.waves.limit, whole.listener_part.inside.places
    return whole.centre + np.concatenate([_all_around(nearest), _all_around(2 * nearest), inside])


def _gridded(table: TimbreTable) -> Array:
    """Return the place of each listener of a table, the first of those that stand for it."""
    nodes = combinations(table.listeners.axes)
    places = from_spherical(*nodes.T) if table.system == "spherical" else nodes
    _, first = np.unique(table.listeners.sources, return_index=True)
    return (places[first] + table.centre) * table.size


def _all_around(distance: float) -> Array:
    """Return places (n, 3) that tell all waves up to `ORDER` apart.

    Gauss-Legendre nodes in the cosine of the polar angle, equal steps in azimuth (E. G. Williams,
    Fourier Acoustics, Academic Press, 1999, section 6.3).
    """
    heights, _ = np.polynomial.legendre.leggauss(ORDER + 1)
    azimuths = np.arange(2 * ORDER + 1) * (2 * np.pi / (2 * ORDER + 1))
    polar, azimuth = np.meshgrid(np.arccos(heights), azimuths, indexing="ij")
    return from_spherical(distance, azimuth.ravel(), polar.ravel())
