"""Places of a person's own bodies in the room: on stands, in rows, by their bounding boxes.

x points right, y away from the person and z up. Bodies of a row have their fronts in one line, so
that none hides its neighbour, and each row stands high enough to be seen above the row before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from struck.explorer.objects import Place, Thing, rotation_matrix
from struck.model.arrays import Array
from struck.model.model import ModalModel

# Lengths are in m and chosen by judgement.
STAND = 0.6  # height of the stands of the first row
_MARGIN = 0.04  # of a stand around its body
_NARROWEST = 0.16  # width of a stand
_GAP = 0.12  # between two stands at least
_WIDE_GAP = 0.1  # of the widest stand: the gap between large bodies
_MULTI_ROW_COUNT = 8  # bodies: fewer are placed in one row
_ASPECT = 2.5  # columns to rows, about
_RISE = 0.15  # of a line of sight from the home position, height to depth
_THIN_RATIO = 150.0  # length to thickness beyond which a wire is drawn thicker
# Box of the object drawn for a recording.
TOKEN_BOX = np.array([[-0.08, -0.02, 0.0], [0.08, 0.02, 0.16]])


def stand(models: Sequence[ModalModel], names: Sequence[str]) -> list[Thing]:
    """Return bodies as objects of the room, none inside another and none hidden."""
    rotations = [_rotation(model) for model in models]
    swellings = [_swelling(model) for model in models]
    boxes = [_box(*parts) for parts in zip(models, rotations, swellings, strict=True)]
    positions = _positions(np.array(boxes).reshape(-1, 2, 3))
    return [
        Thing(
            name=f"given_{number + 1}",
            title=name,
            text=_text(model),
            kind="file",
            make=lambda _progress, model=model: model,
            position=position,
            rotation=rotation,
            swelling=swelling,
        )
        for number, (model, name, position, rotation, swelling) in enumerate(
            zip(models, names, positions, rotations, swellings, strict=True)
        )
    ]


def _rotation(model: ModalModel) -> Array:
    """Return the rotation that turns a body's upward axis up (3, 3)."""
    return (
        rotation_matrix(x=90)
        if model.geometry is not None and model.geometry.up == "y"
        else rotation_matrix()
    )


def _swelling(model: ModalModel) -> Place:
    """Return the factors by which a wire is drawn thicker than it is, along its axes."""
    if model.geometry is None:
        return (1.0, 1.0, 1.0)
    size = np.ptp(model.geometry.bounds, axis=0)
    min_size = size.max() / _THIN_RATIO
    is_thin = size < min_size
    factors = np.where(is_thin, min_size / np.maximum(size, 1e-3 * min_size), 1.0)
    x, y, z = factors.tolist() if is_thin.sum() == 2 else (1.0, 1.0, 1.0)
    return (x, y, z)


def _box(model: ModalModel, rotation: Array, swelling: Place) -> Array:
    """Return the lowest and the highest corner of a body as it is drawn about its origin (2, 3)."""
    if model.geometry is None:
        return TOKEN_BOX
    corners = (model.geometry.bounds * swelling) @ rotation.T
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _positions(boxes: Array) -> list[Place]:
    """Return where the origins of bodies are, by their boxes (B, 2, 3), from left to right."""
    count = len(boxes)
    columns = count if count < _MULTI_ROW_COUNT else math.ceil(math.sqrt(_ASPECT * count))
    rows = math.ceil(count / columns) if count else 0
    columns = math.ceil(count / rows) if rows else 0  # as many in each row
    size = np.ptp(boxes, axis=1)
    stands = np.maximum(size[:, :2] + 2 * _MARGIN, _NARROWEST)
    positions: list[Place] = []
    front, base = 0.0, STAND
    for first in range(0, count, columns or 1):
        row = slice(first, first + columns)
        widths, depths = stands[row].T
        gap = max(_GAP, _WIDE_GAP * float(widths.max()))
        left = -(widths.sum() + gap * (len(widths) - 1)) / 2
        for box, width in zip(boxes[row], widths, strict=True):
            x, y = left + width / 2 - box[:, 0].mean(), front - box[0, 1]
            positions.append((float(x), float(y), float(base - box[0, 2])))
            left += width + gap
        # The next row is seen over the highest body of this one.
        depth = float(depths.max()) + gap
        front += depth
        base += max(0.0, float(size[row, 2].max()) - _RISE * gap)
    return positions


def _text(model: ModalModel) -> str:
    """Return a sentence about the origin of a model."""
    method = model.provenance.method
    if not model.recorded:
        return method or "A model."
    origin = f" ({method})" if method else ""
    return f"A recording{origin}: wherever it is struck, it sounds as where it was recorded."
