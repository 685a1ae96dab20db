"""Places of a person's own bodies: apart, and seen over each other, however large they are."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck.explorer.placement import _NARROWEST, STAND, _positions, stand
from struck.model.arrays import Array
from struck.shapes import Bar, String


def boxes_of(count: int, seed: int) -> Array:
    """Return boxes of edges from 1 cm to 3 m, about origins anywhere (count, 2, 3)."""
    rng = np.random.default_rng(seed)
    edges = 10 ** rng.uniform(-2, np.log10(3), (count, 3))
    low = rng.uniform(-1, 1, (count, 3))
    return np.stack([low, low + edges], axis=1)


@pytest.mark.parametrize("count", [1, 2, 4, 7, 8, 9, 25, 60])
def test_stands_do_not_meet_and_rows_are_seen_over_each_other(count: int) -> None:
    boxes = boxes_of(count, seed=count)
    placed = boxes + np.array(_positions(boxes))[:, None]
    # Each body with the least stand below it, down to the floor.
    middles, halves = placed.mean(axis=1), np.ptp(placed, axis=1) / 2
    halves[:, :2] = np.maximum(halves[:, :2], _NARROWEST / 2)
    apart = (
        np.abs(middles[:, None, :2] - middles[None, :, :2]) - halves[:, None, :2] - halves[:, :2]
    )
    np.fill_diagonal(apart[..., 0], np.inf)
    assert (apart > 0.05).any(axis=2).all()
    fronts = np.unique(placed[:, 0, 1].round(9))
    assert (len(fronts) == 1) == (count < 8)
    tops = [placed[np.isclose(placed[:, 0, 1], front), 1, 2].max() for front in fronts]
    bases = [placed[np.isclose(placed[:, 0, 1], front), 0, 2] for front in fronts]
    assert bases[0] == pytest.approx(STAND)
    for number in range(1, len(fronts)):
        gap = fronts[number] - placed[np.isclose(placed[:, 0, 1], fronts[number - 1]), 1, 1].max()
        assert gap > 0
        # A line of sight that rises 1 in 6 toward the person passes above the row in front.
        assert (bases[number] + gap / 6 >= tops[number - 1] - 1e-9).all()
    middle = placed.reshape(-1, 3)[:, 0]
    assert abs(middle.min() + middle.max()) < 0.5 * np.ptp(middle)


def test_upward_axes_wires_and_recordings() -> None:
    wire = struck.analyze(String(length=0.65, radius=4e-4, tension=80.0), "steel", band=(20, 500))
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", band=(20, 3000))
    lying = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 0.5]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    upright = struck.analysis.model_of_modes(
        lying,
        faces,
        [440.0],
        np.ones((4, 3, 1)),
        material=struck.Material.named("steel"),
        mass=1.0,
        centre=[0.2, 0.4, 0.1],
        inertia=np.eye(3),
        up="y",
    )
    string, plain, tall = stand([wire, bar, upright], ["string", "bar", "tall"])
    assert string.swelling[0] == 1.0
    # A wire is drawn as thick as 1 in 150 of its length, on both axes.
    drawn = np.ptp(wire.geometry.bounds, axis=0) * string.swelling
    np.testing.assert_allclose(drawn, [0.65, 0.65 / 150, 0.65 / 150], rtol=1e-6)
    assert plain.swelling == (1.0, 1.0, 1.0)
    np.testing.assert_allclose(tall.rotation @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    placed = lying @ np.asarray(tall.rotation).T + tall.position
    assert placed[:, 2].min() == pytest.approx(STAND)
    assert placed[:, 2].max() == pytest.approx(STAND + 2)
