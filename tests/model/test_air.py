from __future__ import annotations

import numpy as np
import pytest

from struck.model.air import AIR


def test_air_is_a_gas() -> None:
    laplace = np.sqrt(1.4 * 101325 / AIR.density)  # Laplace: adiabatic sound in an ideal gas
    assert AIR.sound_speed == pytest.approx(laplace, rel=1e-3)
