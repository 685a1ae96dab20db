"""Parts of a mesh file, as they stand in it, before any judgement of them as bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A named part of a file: raw vertices (V, 3) and triangles (F, 3)."""

    name: str
    points: NDArray[np.float64]
    faces: NDArray[np.int64]
