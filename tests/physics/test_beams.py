"""Bars against the theories of beams: free, and clamped by `fixed`."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck import Material
from struck.solids import Block
from tests.physics.beams import Bar
from tests.physics.reference import CLAMPED_FREE, FREE_FREE

STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
BAR = Bar(length=0.4, width=0.02, thickness=0.008, material=STEEL)
BLOCK = Block(size=(0.4, 0.02, 0.008), elements=(24, 2, 2))


def bending(model: struck.ModalModel) -> np.ndarray:
    """Return the frequencies of modes that move the middle line along z only."""
    points = model.geometry.points
    # Along the middle of one face; torsion and bending the other way leave it at rest.
    line = (np.abs(points[:, 1]) < 1e-9) & (points[:, 2] > 0.0039)
    moved = np.square(model.gains.shapes[line]).sum(axis=0)
    return model.natural_frequencies[moved[2] > 10 * (moved[0] + moved[1])]


def test_free_bar_bends_as_timoshenko_says() -> None:
    model = struck.analyze(BLOCK, STEEL, band=(20, 2600))
    expected = [BAR.timoshenko(beta, clamped=False) for beta in FREE_FREE]
    assert bending(model)[:3] == pytest.approx(expected, rel=1e-3)


def test_clamped_bar_bends_as_timoshenko_says() -> None:
    model = struck.analyze(
        BLOCK, STEEL, band=(10, 900), fixed=lambda points: points[:, 0] < -0.1999
    )
    expected = [BAR.timoshenko(beta, clamped=True) for beta in CLAMPED_FREE[:2]]
    # The clamp also holds the section from contracting, which stiffens the bar by a trifle.
    assert bending(model)[:2] == pytest.approx(expected, rel=5e-3)
    assert (bending(model)[:2] > expected).all()


@pytest.mark.prove
def test_a_slender_bar_tends_to_euler_and_bernoulli() -> None:
    ratios = []
    for thickness in (0.008, 0.004, 0.002):
        bar = Bar(length=0.4, width=0.02, thickness=thickness, material=STEEL)
        block = Block(size=(0.4, 0.02, thickness), elements=(24, 2, 1))
        model = struck.analyze(block, STEEL, band=(10, 400))
        ratios.append(model.natural_frequencies[0] / bar.euler_bernoulli(FREE_FREE[0]))
    assert np.abs(np.array(ratios) - 1).tolist() == sorted(np.abs(np.array(ratios) - 1))[::-1]
    assert ratios[-1] == pytest.approx(1, abs=5e-4)
