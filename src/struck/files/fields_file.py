"""Gains of recordings in model files: timbre fields, tables and single places."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, rounded
from struck.files.container import (
    Arrays,
    Kind,
    Tensor,
    Tensors,
    Text,
    from_pairs,
    near,
    numbers,
)
from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.model.timbre_field import LENGTHS, ContactPart, Inside, ListenerPart, TimbreField
from struck.model.timbre_table import Grid, GridAxis, SinglePoint, TimbreTable
from struck.model.waves import AXIAL, SphericalWaves

# Timbre fields


def _keep_field(field: TimbreField) -> tuple[dict[str, Any], Arrays]:
    contact, listener = field.contact_part, field.listener_part
    text = {
        "centre": _list(field.centre),
        "radius": float(field.radius),
        "lowest": _list(contact.lowest),
        "spans": _list(contact.spans),
        "lengths": list(LENGTHS),
        "limit": float(listener.waves.limit),
        "reach": float(listener.inside.reach),
        "mirrored": bool(listener.mirrored),
        "turned": bool(listener.turned),
        "notes": list(field.notes),
        "calibrated": bool(field.is_calibrated),
        "deconvolved": bool(field.is_deconvolved),
    }
    return text, {}


def _make_field(text: Text, tensors: Tensors, _: Mesh | None) -> TimbreField:
    modes = len(tensors["field_levelled"])
    return TimbreField(
        contact_part=_contact_part(text, tensors),
        listener_part=_listener_part(text, tensors),
        centre=near(text["centre"], "centre"),
        radius=float(text["radius"]),
        rank_errors=tensors["field_rank_errors"],
        unmeasured=_below(tensors["field_unmeasured"], modes, "field_unmeasured", "modes"),
        notes=tuple(text["notes"]),
        is_calibrated=text["calibrated"],
        is_deconvolved=text.get("deconvolved", False),
    )


def _contact_part(text: Text, tensors: Tensors) -> ContactPart:
    lengths, contacts = text["lengths"], tensors["field_contacts"]
    if lengths != list(LENGTHS):
        raise FileFormatError(
            f"its drives are likenesses over {lengths}, not {list(LENGTHS)}: update "
            "struck, or fit the recordings again"
        )
    dimensions = (1,) if text["turned"] else (1, 2)
    if contacts.shape[1] not in dimensions or not len(contacts):
        raise FileFormatError(
            f"its tensor 'field_contacts' is {contacts.shape}: give contacts with "
            f"{' or '.join(map(str, dimensions))} coordinates"
        )
    if contacts.min() < 0 or contacts.max() > 1:
        raise FileFormatError(
            f"its tensor 'field_contacts' goes from {rounded(contacts.min())} to "
            f"{rounded(contacts.max())}: give fractions of the ranges, from 0 to 1"
        )
    spans = numbers(text["spans"], (contacts.shape[1],))
    return ContactPart(
        lowest=numbers(text["lowest"], spans.shape),
        spans=spans,
        contacts=contacts,
        factors=tensors["field_factors"],
    )


def _listener_part(text: Text, tensors: Tensors) -> ListenerPart:
    levelled = _below(tensors["field_levelled"], 2, "field_levelled", "answers")
    powers, harmonics = tensors["field_parts"].shape[:2]
    if not 0 < powers <= AXIAL + 1 or harmonics != powers**2:
        raise FileFormatError(
            f"tensor 'field_parts' has {powers} powers and {harmonics} harmonics: it needs 1 to "
            f"{AXIAL + 1}, and their square; save the model again"
        )
    return ListenerPart(
        waves=SphericalWaves(
            parts=from_pairs(tensors["field_parts"]),
            limit=float(text["limit"]),
            levelled=levelled.astype(np.bool_),
        ),
        inside=Inside(
            places=near(tensors["field_inside"], "tensor 'field_inside'"),
            corrections=from_pairs(tensors["field_corrections"]),
            reach=float(text["reach"]),
        ),
        mirrored=text["mirrored"],
        turned=text["turned"],
    )


# Tables and single places


def _keep_table(table: TimbreTable) -> tuple[dict[str, Any], Arrays]:
    def axes(grid: Grid) -> list[dict[str, Any]]:
        return [{"nodes": _list(axis.nodes), "period": float(axis.period)} for axis in grid.axes]

    text = {
        "centre": _list(table.centre),
        "size": float(table.size),
        "system": table.system,
        "mirrored": bool(table.mirrored),
        "contacts": axes(table.contacts),
        "listeners": axes(table.listeners),
        "calibrated": bool(table.is_calibrated),
        "deconvolved": bool(table.is_deconvolved),
    }
    return text, {}


def _make_table(text: Text, tensors: Tensors, _: Mesh | None) -> TimbreTable:
    gains = from_pairs(tensors["field_gains"])
    return TimbreTable(
        contacts=_grid(text, tensors, "contact", gains.shape[0], (1, 2)),
        listeners=_grid(text, tensors, "listener", gains.shape[1], (3,)),
        gains=gains,
        system=text["system"],
        mirrored=text["mirrored"],
        centre=near(text["centre"], "centre"),
        size=float(text["size"]),
        is_calibrated=text["calibrated"],
        is_deconvolved=text.get("deconvolved", False),
    )


def _grid(
    text: Text, tensors: Tensors, side: str, count: int, axis_counts: tuple[int, ...]
) -> Grid:
    name = f"field_{side}_sources"
    axes, sources = tuple(_axis(item) for item in text[f"{side}s"]), tensors[name]
    nodes = math.prod(len(axis.nodes) for axis in axes)
    if len(axes) not in axis_counts or len(sources) != nodes:
        raise FileFormatError(
            f"its {side}s have {len(axes)} axes with {nodes} combinations of nodes, and {name!r} "
            f"has {len(sources)}: give {' or '.join(map(str, axis_counts))} axes and a source for "
            "each combination"
        )
    return Grid(axes=axes, sources=_below(sources, count, name, f"{side}s"), count=count)


def _axis(text: Mapping[str, Any]) -> GridAxis:
    nodes, period = np.array(text["nodes"], np.float64), float(text["period"])
    room = period or math.inf
    if np.any(np.diff(nodes) <= 0) or nodes[-1] - nodes[0] >= room:
        raise FileFormatError(
            f"the {len(nodes)} nodes of an axis, from {rounded(nodes[0])} to {rounded(nodes[-1])}, "
            f"do not ascend within its period of {rounded(period)}: give each once"
        )
    return GridAxis(nodes=nodes, period=period)


def _make_point(text: Text, tensors: Tensors, _: Mesh | None) -> SinglePoint:
    return SinglePoint(
        outputs=from_pairs(tensors["field_outputs"]),
        centre=near(text["centre"], "centre"),
        is_calibrated=text["calibrated"],
        is_deconvolved=text.get("deconvolved", False),
    )


def _list(array: Array) -> list[Any]:
    return np.asarray(array, dtype=np.float64).tolist()


def _below(array: NDArray[np.uint32], count: int, name: str, things: str) -> Index:
    """Return whole numbers as indices below `count`; FileFormatError on larger ones."""
    if array.size and array.max() >= count:
        raise FileFormatError(f"its tensor {name!r} goes up to {array.max()}: of {count} {things}")
    return array.astype(np.int64)


# By class. Lengths by letter: M modes, P contacts, Q listeners, D coordinates, I listeners inside
# the body, N modes that were not measured, A and B combinations of nodes, K powers of the distance
# and L = K^2 harmonics.
FIELDS: dict[str, Kind] = {
    "TimbreField": Kind(
        made=TimbreField,
        layout={
            "field_contacts": Tensor("float64", ("P", "D"), "contact_part.contacts"),
            "field_factors": Tensor("float64", (len(LENGTHS), "P", "M"), "contact_part.factors"),
            "field_parts": Tensor("float64", ("K", "L", "M", 2), "listener_part.waves.parts"),
            "field_levelled": Tensor("uint32", ("M",), "listener_part.waves.levelled"),
            "field_inside": Tensor("float64", ("I", 3), "listener_part.inside.places"),
            "field_corrections": Tensor(
                "float64", ("I", "M", 2), "listener_part.inside.corrections"
            ),
            "field_rank_errors": Tensor("float64", ("M",), "rank_errors", gaps=True),
            "field_unmeasured": Tensor("uint32", ("N",), "unmeasured"),
        },
        keep=_keep_field,
        make=_make_field,
    ),
    "TimbreTable": Kind(
        made=TimbreTable,
        layout={
            "field_gains": Tensor("float64", ("P", "Q", "M", 2), "gains"),
            "field_contact_sources": Tensor("uint32", ("A",), "contacts.sources"),
            "field_listener_sources": Tensor("uint32", ("B",), "listeners.sources"),
        },
        keep=_keep_table,
        make=_make_table,
    ),
    "SinglePoint": Kind(
        made=SinglePoint,
        layout={"field_outputs": Tensor("float64", ("M", 2), "outputs")},
        keep=lambda point: (
            {
                "centre": _list(point.centre),
                "calibrated": bool(point.is_calibrated),
                "deconvolved": bool(point.is_deconvolved),
            },
            {},
        ),
        make=_make_point,
    ),
}
