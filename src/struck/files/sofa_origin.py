"""Where gains in a SOFA file came from: papers, notes, and how sure a model was of its modes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError
from struck.files.sofa import LONGEST, Container, Variable
from struck.model.provenance import Provenance, bibliography
from struck.recordings.fields.origin import Origin

Array = NDArray[np.float64]

_SOURCE, _MODEL = "GainSource", "model"
_SPARE = 100  # bytes for a last line
_PLACE = "RecordedContact"
_ERRORS, _UNMEASURED = "ModeError", "ModeUnmeasured"


def origin_attributes(origin: Origin | None) -> dict[str, str]:
    """Return the texts that tell a model; none of gains that were measured."""
    if origin is None:
        return {}
    provenance = origin.provenance
    told = {
        _SOURCE: _MODEL,
        "Method": provenance.method,
        "References": provenance.cite(),
        "ReferenceKeys": " ".join(provenance.references),
        "Notes": _lines(provenance.dropped),
        "FieldNotes": _lines(origin.notes),
        _PLACE: "" if origin.place is None else " ".join(map(repr, origin.place.tolist())),
    }
    return {name: text for name, text in told.items() if text}


def origin_variables(origin: Origin | None, count: int) -> dict[str, Variable]:
    """Return the numbers that tell a model of so many modes."""
    variables: dict[str, Variable] = {}
    if origin is None:
        return variables
    if origin.errors is not None:
        told = {"LongName": "relative error of the frequency, NaN where unknown", "Units": "1"}
        variables[_ERRORS] = Variable(values=origin.errors, letters="N", attributes=told)
    if len(origin.unmeasured):
        values = np.isin(np.arange(count), origin.unmeasured).astype(np.float64)
        told = {"LongName": "1 where a mode was not measured well", "Units": "1"}
        variables[_UNMEASURED] = Variable(values=values, letters="N", attributes=told)
    return variables


def origin_of(file: Container, count: int) -> Origin | None:
    """Return the model of so many modes that gains came from; None where they were measured."""
    if file.text(_SOURCE) != _MODEL:
        return None
    errors = file.numbers(_ERRORS, (count,), gaps=True) if _ERRORS in file else None
    if errors is not None and (errors < 0).any():
        raise FileFormatError(f"its {_ERRORS} goes down to {np.nanmin(errors):g}: give at least 0")
    unmeasured = file.numbers(_UNMEASURED, (count,)) if _UNMEASURED in file else np.zeros(count)
    known = bibliography()
    return Origin(
        provenance=Provenance(
            method=file.text("Method"),
            references=tuple(key for key in file.text("ReferenceKeys").split() if key in known),
            dropped=tuple(file.text("Notes").splitlines()),
        ),
        errors=errors,
        unmeasured=np.flatnonzero(unmeasured),
        notes=tuple(file.text("FieldNotes").splitlines()),
        place=_place_of(file.text(_PLACE)),
    )


def _place_of(text: str) -> Array | None:
    if not text:
        return None
    try:
        place = np.array([float(each) for each in text.split()])
    except ValueError:
        place = np.full(1, np.nan)
    if not np.isfinite(place).all():
        raise FileFormatError(f"its {_PLACE} is {text[:80]!r}: give finite coordinates")
    return place


def _lines(sentences: Iterable[str]) -> str:
    """Return as many sentences as an attribute holds, a line each, and how many more there are."""
    lines = [" ".join(sentence.split()) for sentence in sentences]
    lengths = np.cumsum([len(line.encode()) + 1 for line in lines])
    kept = int(np.count_nonzero(lengths < LONGEST - _SPARE))
    more = [f"... and {len(lines) - kept} notes more"] if kept < len(lines) else []
    return "\n".join([*lines[:kept], *more])
