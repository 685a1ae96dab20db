"""Readings of a texture in C and in plain NumPy."""

from __future__ import annotations

import numpy as np

from struck.excitation import texture
from struck.excitation.texture import Layers
from tests.core.agreement import apart

SPACINGS = np.array([0.5, 0.031, 0.002])


def test_as_in_plain_numpy() -> None:
    random = np.random.default_rng(1)
    layers = Layers.of(SPACINGS, np.ones(3), 7)
    walk = np.cumsum(random.normal(0, 1e-3, (1000, 3)), axis=0)
    weights = random.uniform(-1, 1, (18, 3))
    weights[3:5, 1] = 0.0
    for first, count in ((0, 1000), (63, 900), (17, 1), (5, 40)):
        out, plain = np.full(count, 0.5), np.full(count, 0.5)
        texture.add_heights(layers, weights, first, walk[:count], out)
        texture.add_heights_plainly(layers, weights, first, walk[:count], plain)
        assert np.abs(out - 0.5).max() > 0
        assert apart(out, plain) < 1e-11


def test_what_has_no_place_has_no_height() -> None:
    layers = Layers.of(SPACINGS, np.ones(3), 7)
    places = np.zeros((5, 3))
    places[:4, 1] = np.nan, np.inf, -np.inf, 1e300
    out = np.zeros(5)
    texture.add_heights(layers, np.ones((2, 3)), 0, places, out)
    assert np.all(out[:4] == 0)
    assert out[4] != 0
    plain = np.zeros(5)
    texture.add_heights_plainly(layers, np.ones((2, 3)), 0, places, plain)
    assert np.array_equal(plain[:4], out[:4])
