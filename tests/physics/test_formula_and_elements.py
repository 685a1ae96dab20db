"""The same body by formula and by finite elements, two methods that share nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.model.gains import ShapeGains
from struck.shapes import Bar, CircularPlate, RectangularPlate
from struck.shapes.shape import Shape

Array = NDArray[np.float64]
FIRST = 10
FREQUENCY, CRITERION = 0.005, 0.99
# Modes nearer than this share a frequency, and only the space they span means anything.
TOGETHER = 2e-3

BODIES = {
    "free bar": (Bar(length=0.3, width=0.003, thickness=0.0015, ends="free"), 5300.0),
    "cantilever": (
        Bar(length=0.3, width=0.003, thickness=0.0015, ends=("clamped", "free")),
        4600.0,
    ),
    "clamped circular plate": (CircularPlate(radius=0.1, thickness=0.001, edge="clamped"), 1900.0),
    "free square plate": (
        RectangularPlate(length=0.2, width=0.2, thickness=0.001, edges="free"),
        800.0,
    ),
}
# The circular plate agrees so well at fine alone, where all are compared.
SAMPLE = ["free bar", "free square plate"]


def groups(frequencies: Array) -> list[NDArray[np.int64]]:
    """Return the modes in groups that share a frequency."""
    breaks = np.flatnonzero(np.diff(frequencies) > TOGETHER * frequencies[:-1]) + 1
    return np.split(np.arange(len(frequencies)), breaks)


def columns(gains: ShapeGains, modes: NDArray[np.int64]) -> Array:
    """Return mode shapes at the vertices, one a column, each of length one."""
    shapes = gains.shapes[:, :, modes].astype(float).reshape(-1, len(modes))
    return shapes / np.linalg.norm(shapes, axis=0)


def criterion(one: Array, space: Array) -> float:
    """Return the assurance criterion of a shape with the space that others span."""
    basis, _ = np.linalg.qr(space)
    return float(np.square(basis.T @ one).sum())


@pytest.mark.prove
@pytest.mark.parametrize("name", SAMPLE)
def test_formula_and_elements_agree(name: str) -> None:
    check(name, "standard")


@pytest.mark.prove
@pytest.mark.parametrize("name", BODIES)
def test_formula_and_elements_agree_at_fine(name: str) -> None:
    check(name, "fine")


def check(name: str, accuracy: str) -> None:
    shape, highest = BODIES[name]
    assert isinstance(shape, Shape)
    elements = struck.analyze(
        shape, "steel", method="fem", band=(5, 1.1 * highest), accuracy=accuracy
    )
    formula = struck.analyze(shape, "steel", band=(5, highest), radiation="heuristic1998")
    assert isinstance(elements.gains, ShapeGains)
    assert isinstance(formula.gains, ShapeGains)
    assert formula.gains.formula is not None
    wanted = formula.natural_frequencies[: FIRST + 1]
    assert len(wanted) > FIRST
    every = np.arange(len(elements.natural_frequencies))
    exact = formula.gains.formula.displacements(elements.gains.surface.points)
    for group in groups(wanted)[:-1]:
        for mode in group:
            one = exact[:, :, mode].ravel() / np.linalg.norm(exact[:, :, mode])
            near = every[np.abs(elements.natural_frequencies / wanted[mode] - 1) < FREQUENCY]
            assert len(near) >= len(group), f"{wanted[mode]:.2f} Hz"
            assert criterion(one, columns(elements.gains, near)) > CRITERION
