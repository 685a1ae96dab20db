"""Pictures of radiation and of the energy balance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Rectangle

import struck
from struck import Strike
from struck.errors import OptionError
from struck.shapes import Bar

BAR = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", progress=None)


def test_radiation_of_each_mode(tmp_path: Path) -> None:
    figure = struck.show(BAR, tmp_path / "radiation.png", energy=True)
    above, below = figure.axes
    power = BAR.radiated_power()
    np.testing.assert_allclose(np.asarray(above.lines[0].get_ydata()), power.efficiencies)
    np.testing.assert_allclose(np.asarray(below.lines[0].get_ydata()), 100 * power.fractions)
    assert (tmp_path / "radiation.png").stat().st_size > 10_000


def test_balance_in_third_octaves() -> None:
    energy = struck.energy(BAR, Strike(at="end", striker="wood"))
    (axes,) = struck.show(BAR, energy=energy).axes
    heights = sum(bar.get_bbox().height for bar in axes.patches if isinstance(bar, Rectangle))
    unit = {"energy (mJ)": 1e-3, "energy (\N{MICRO SIGN}J)": 1e-6}[axes.get_ylabel()]
    assert heights * unit == pytest.approx(energy.total["entered"])


def test_one_picture_at_a_time_and_none_of_relative_gains() -> None:
    with pytest.raises(OptionError, match="modes and energy are two pictures"):
        struck.show(BAR, modes=2, energy=True)
    relative = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel",
                              radiation="obrien2002", progress=None)  # fmt: skip
    with pytest.raises(OptionError, match="gains are relative"):
        struck.show(relative, energy=True)
