"""How far results lie apart, and results that were kept before the loops were C."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

EXACT = -200.0  # dB
SINGLE = -114.0  # dB: sums of float32, in another order


def apart(found: NDArray[np.floating], expected: NDArray[np.floating]) -> float:
    """Return the largest difference in dB of the largest expected value."""
    assert found.shape == expected.shape
    assert np.isfinite(found).all()
    difference = np.abs(np.float64(found) - expected).max()
    return float(20 * np.log10(max(difference, 1e-300) / np.abs(expected).max()))


def golden(name: str) -> dict[str, NDArray[np.floating]]:
    """Return the arrays of a kept result by their names."""
    with np.load(Path(__file__).parent / f"golden/{name}.npz") as kept:
        return dict(kept)
