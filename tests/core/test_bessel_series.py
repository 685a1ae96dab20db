"""Chebyshev series of Bessel functions in C, in plain NumPy, and as numba compiled them."""

from __future__ import annotations

import numpy as np
import pytest

from struck.errors import OptionError
from struck.shapes import bessel_series
from struck.shapes.bessel_series import (
    pair,
    series,
    series_slope,
    tabulate_irregular,
    tabulate_regular,
)
from tests.core.agreement import EXACT, apart, golden

ARGUMENTS = np.random.default_rng(1).uniform(0, 4, 12)
STEPS = (0.8, 1.0)


def test_as_before() -> None:
    kept = golden("bessel_series")
    for step in STEPS:
        table = tabulate_regular(step, 11, 4)
        assert apart(table[:, ::6], kept[f"table {step}"]) <= EXACT
        assert apart(series(ARGUMENTS, table), kept[f"series {step}"]) <= EXACT
        assert apart(series_slope(ARGUMENTS, table), kept[f"slope {step}"]) <= EXACT
    assert apart(pair(ARGUMENTS.reshape(4, 3), tabulate_irregular(4)), kept["pair"]) <= EXACT


@pytest.mark.parametrize("count", [1, 2, 37])
def test_as_in_plain_numpy(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    random = np.random.default_rng(2)
    table, arguments = random.standard_normal((5, 13, count)), random.uniform(0, 5, (20, 3))
    two = random.standard_normal((5, 13, 2))
    arguments[0] = 0.0, 1.0, np.nextafter(5.0, 0)

    def all_three() -> list[np.ndarray]:
        flat = arguments.ravel()
        return [series(flat, table), series_slope(flat, table), pair(arguments, two)]

    compiled = all_three()
    monkeypatch.setattr(bessel_series, "entry", lambda _: None)
    for found, plain in zip(compiled, all_three(), strict=True):
        assert apart(found, plain) <= EXACT


@pytest.mark.parametrize("argument", [-0.1, 5.0, np.nan])
def test_arguments_beyond_the_table_are_refused(argument: float) -> None:
    with pytest.raises(OptionError, match="5 cells"):
        series(np.array([0.5, argument]), np.zeros((5, 13, 2)))
