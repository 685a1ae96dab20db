"""Short names for NumPy arrays in annotations; shapes and units stand beside each use."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]
AnyComplex = NDArray[np.complexfloating]
Single = NDArray[np.float32]
AnyArray = NDArray[Any]
