"""Where a body, its contacts and its listeners are in a SOFA file, and what a file tells of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError
from struck.files.sofa import Container, Variable, metres
from struck.model.sampled_field import WAYS, SampledField
from struck.model.survey import SYMMETRIES

Array = NDArray[np.float64]

_PASCAL, _RELATIVE = "Pa/(N s)", "relative"
_AXES = ("ContactU", "ContactV")
_UNKNOWN = "unknown"
_SURFACE = (
    " ContactU and ContactV are coordinates on the surface; EmitterPosition repeats them as "
    "(u, v, 0), as their places in space are not known."
)


def attributes_of(field: SampledField, comment: str, *names: str) -> dict[str, str]:
    """Return what a file tells of a field: a comment, and title, author and licence."""
    title, author, licence = (name or "not stated" for name in names)
    axes = field.contacts.shape[1]
    return {
        "Title": title,
        "AuthorContact": author,
        "Organization": author,
        "License": licence,
        "Comment": comment + (_SURFACE if axes in {1, 2} else ""),
        "GainUnit": _PASCAL if field.calibrated else _RELATIVE,
        "Symmetry": field.symmetry,
        "Interpolation": field.way,
        **({} if axes else {"ContactPlaces": _UNKNOWN}),
    }


def geometry_of(field: SampledField) -> dict[str, Variable]:
    """Return the variables of places: measurements are listeners, emitters contacts."""
    count, axes = field.contacts.shape
    emitters = np.zeros((count, 3))
    emitters[:, :axes] = field.contacts
    origin = np.zeros((1, 3))
    places = {
        "ListenerPosition": metres(field.listeners, "MC"),
        "ReceiverPosition": metres(origin, "RC"),
        "SourcePosition": metres(origin, "IC"),
        "EmitterPosition": metres(emitters, "EC"),
        "SoundCentre": metres(field.centre[np.newaxis], "IC"),
    }
    if field.radius:
        told = {"LongName": "of a ball about SoundCentre that holds the body", "Units": "metre"}
        radius = np.array([field.radius])
        places["BodyRadius"] = Variable(values=radius, letters="I", attributes=told)
    if axes > 2:
        return places
    named = zip(_AXES, field.contacts.T, field.coordinates or ("u", "v"), strict=False)
    for axis, values, name in named:
        places[axis] = Variable(values=values, letters="E", attributes={"LongName": name})
    return places


def listeners_of(file: Container) -> Array:
    """Return one listener for each measurement (M, 3), m."""
    receivers = file.places("ReceiverPosition")
    if len(receivers) != 1:
        raise FileFormatError(
            f"it has {len(receivers)} receivers, and 1 for each listener is read: split them into "
            "measurements"
        )
    if receivers.any() and "ListenerView" in file:
        raise FileFormatError(
            "its receiver is off the listener, who looks somewhere: give ListenerPosition as the "
            "place of the microphone"
        )
    return file.places("ListenerPosition") + receivers


def contacts_of(file: Container) -> tuple[Array, tuple[str, ...]]:
    """Return contacts (E, D) and the names of their coordinates; x, y, z where no others are."""
    axes = [axis for axis in _AXES if axis in file]
    if axes:
        count = file.shape("EmitterPosition")[:1]
        values = [file.numbers(axis, count) for axis in axes]
        return np.stack(values, axis=1), tuple(file.text("LongName", axis) for axis in axes)
    if file.text("ContactPlaces") == _UNKNOWN:
        return np.zeros((file.shape("EmitterPosition")[0], 0)), ()
    sources = file.places("SourcePosition")
    if len(sources) != 1 or "SourceView" in file:
        raise FileFormatError(
            f"its source has {len(sources)} places, or a view, and a body that stands still is "
            "read: give one SourcePosition, and EmitterPosition along the axes of the room"
        )
    return file.places("EmitterPosition") + sources, ("x (m)", "y (m)", "z (m)")


def centre_of(file: Container) -> Array:
    """Return where the sound seems to come from (3,), m: the source where nothing else is told."""
    name = "SoundCentre" if "SoundCentre" in file else "SourcePosition"
    places = file.places(name)
    if len(places) != 1:
        raise FileFormatError(f"its {name} has {len(places)} places, and 1 is read: give one")
    return places[0]


def radius_of(file: Container) -> float:
    """Return the radius of a ball about the centre that holds the body, m; 0 where not known."""
    if "BodyRadius" not in file:
        return 0.0
    radius = float(file.numbers("BodyRadius", (1,))[0])
    if radius < 0:
        raise FileFormatError(f"its BodyRadius is {radius:g}: give at least 0 m")
    return radius


def symmetry_of(file: Container) -> str:
    """Return the symmetry of the body."""
    symmetry = file.text("Symmetry") or "none"
    if symmetry not in SYMMETRIES:
        raise FileFormatError(f"its Symmetry is {symmetry!r}: give one of {', '.join(SYMMETRIES)}")
    return symmetry


def way_of(file: Container) -> str:
    """Return how its model interpolates."""
    way = file.text("Interpolation") or WAYS[0]
    if way not in WAYS:
        raise FileFormatError(f"its Interpolation is {way!r}: give one of {', '.join(WAYS)}")
    return way


def is_calibrated(file: Container) -> bool:
    """Tell whether its unit is Pa/(N s)."""
    return file.text("GainUnit") == _PASCAL
