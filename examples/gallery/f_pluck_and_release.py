"""
Pluck and release
=================

Pull a string aside at one point, or release it from any shape: `Pluck` and `Release`.
"""

import numpy as np

import struck
from struck import Pluck, Release
from struck.shapes import String

shape = String(length=0.65, radius=0.0004, tension=80.0)
string = struck.analyze(shape, "steel", band=(20, 8000))
print(f"lowest mode {string.frequencies[0]:.1f} Hz")
struck.show(string)

# %%
struck.render(string, Pluck(at=(0.1,), force=2.0), seconds=1.5)

# %%
# At the middle every second mode is missing.
struck.render(string, Pluck(at=(0.325,), force=2.0), seconds=1.5)


# %%
# Release the string from the shape of its lowest mode: nearly a sine.
def arc(x: np.ndarray) -> np.ndarray:
    """Return the displacement, m."""
    return 1e-3 * np.sin(np.pi * x[:, 0] / 0.65)


struck.render(string, Release(displacement=arc), seconds=1.5)
