"""A take of a manifest, and how a TOML table tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from struck.model.survey import from_spherical
from struck.recordings.manifests.toml_table import TomlTable, numbers

Place = tuple[float, ...]

RATES = (8_000, 192_000)
"""Of recordings, Hz."""
LONGEST = 600.0
"""Of a take, s."""
MOST_HITS = 1000
_LEVELS = (-400.0, 400.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A take of a manifest.

    Parameters
    ----------
    file : str
        Name of the recording, relative to the manifest.
    contact : tuple of numbers
        Coordinates u, or u and v, of what was struck; empty where that is not told.
    listeners : tuple of (x, y, z)
        Of each channel's microphone, body coordinates, m; empty where that is not told.
    hit : int
        Which of several hits of one place, from 1.
    sample_rate : int or None
        Hz.
    lead_in : float or None
        Ambient sound before the hit, s.
    peak : float or None
        Of the loudest channel, dB of full scale.
    above_noise : float or None
        Peak over the root mean square of the ambient sound, in the worst channel, dB.
    note : str
        Anything else.
    """

    file: str
    contact: Place = ()
    listeners: tuple[Place, ...] = ()
    hit: int = 1
    sample_rate: int | None = None
    lead_in: float | None = None
    peak: float | None = None
    above_noise: float | None = None
    note: str = ""


def toml_entry(table: TomlTable) -> Entry:
    """Return the take that a table tells."""
    rate = table.count("sample_rate", *RATES, default=0)
    entry = Entry(
        file=table.text("file"),
        contact=table.numbers("contact", 1, 2),
        listeners=toml_listeners(table),
        hit=table.count("hit", 1, MOST_HITS, default=1),
        sample_rate=rate or None,
        lead_in=table.maybe("lead_in", 0, LONGEST),
        peak=table.maybe("peak", *_LEVELS),
        above_noise=table.maybe("above_noise", *_LEVELS),
        note=table.text("note", default=""),
    )
    table.require_known()
    return entry


def toml_listeners(
    table: TomlTable, single: str = "listener", many: str = "listeners"
) -> tuple[Place, ...]:
    """Return the listeners that a table tells: one, or one for each channel; or none.

    Under the key `single` (x, y, z), m, under "spherical" (distance, azimuth, polar angle), m and
    rad, or under "spherical_degrees"; under the key `many` a list of (x, y, z).
    """
    one = table.numbers(single, 3)
    radians = table.numbers("spherical", 3)
    degrees = table.numbers("spherical_degrees", 3)
    several = table.list(many)
    if sum(map(bool, (one, radians, degrees, several))) > 1:
        raise table.error(
            f"its listeners are given twice: give one of {single}, spherical, spherical_degrees "
            f"and {many}"
        )
    if degrees:
        radians = (degrees[0], *map(math.radians, degrees[1:]))
    if radians:
        one = cartesian(radians)
    if one:
        return (one,)
    return tuple(numbers(each, table, f"one of {many}", 3) for each in several)


def cartesian(spherical: Place) -> Place:
    """Return x, y, z, m, of distance, azimuth and polar angle, m and rad, as `from_spherical`."""
    return tuple(from_spherical(*spherical)[0].tolist())
