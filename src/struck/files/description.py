"""Materials and provenance as JSON, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from struck.errors import FileFormatError
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh
from struck.model.material import Material
from struck.model.provenance import Provenance

_DAMPINGS: dict[str, Callable[..., Damping]] = {
    kind.__name__: kind for kind in (InternalFriction, Rayleigh, Measured)
}


def material_to_json(material: Material) -> dict[str, Any]:
    """Return a material as a JSON object.

    Raises
    ------
    FileFormatError
        When its damping is none of struck's own.
    """
    damping = material.damping
    kind = type(damping).__name__
    if not isinstance(damping, InternalFriction | Rayleigh | Measured) or kind not in _DAMPINGS:
        raise FileFormatError(
            f"its damping is {kind}, and files keep {', '.join(_DAMPINGS)} alone: use one of them"
        )
    return {**asdict(material), "damping": {"kind": kind, **asdict(damping)}}


def provenance_to_json(provenance: Provenance) -> dict[str, Any]:
    """Return a provenance as a JSON object."""
    return {
        "method": provenance.method,
        "references": list(provenance.references),
        "dropped": list(provenance.dropped),
        "details": dict(provenance.details),
    }


def plain(value: object) -> object:
    """Return numbers of NumPy as Python's own, for `json.dumps`.

    Raises
    ------
    TypeError
        On anything else that JSON cannot hold.
    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"provenance holds {value!r}, and JSON values are kept alone")


def material_from_json(text: Mapping[str, Any]) -> Material:
    """Return the material that a JSON object describes."""
    return Material(**{**text, "damping": _damping(text["damping"])})


def _damping(text: Mapping[str, Any]) -> Damping:
    if text["kind"] not in _DAMPINGS:
        raise FileFormatError(f"its damping is {text['kind']!r}, none of {', '.join(_DAMPINGS)}")
    numbers = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in text.items()
        if name != "kind"
    }
    return _DAMPINGS[text["kind"]](**numbers)


def provenance_from_json(text: Mapping[str, Any]) -> Provenance:
    """Return the provenance that a JSON object describes."""
    return Provenance(
        method=text["method"],
        references=tuple(text["references"]),
        dropped=tuple(text["dropped"]),
        details=text["details"],
    )
