"""Stated errors of modes against true ones, where the frequencies are known."""

from __future__ import annotations

from contextlib import nullcontext
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy import optimize, special

import struck
from struck.errors import RepairWarning
from tests.physics.known import BODIES, GIVEN, STEEL, Known
from tests.physics.ritz_solid import Family, Section, solid_frequencies

Array = NDArray[np.float64]
# A true error is known to a tenth where it is so many times what the frequency is certain to.
_KNOWN = 10


@cache
def analyzed(known: Known, accuracy: str | None) -> struck.ModalModel:
    """Return the model, warned of what is said of the body and of nothing else."""
    said = pytest.warns(RepairWarning, match=known.said) if known.said else nullcontext()
    with said:
        return struck.analyze(
            known.source(),
            known.material,
            wall=known.wall,
            band=(0.0, known.highest),
            accuracy=accuracy,
            cache=False,
        )


def check(known: Known, accuracy: str | None) -> None:
    model = analyzed(known, accuracy)
    expected = known.frequencies()[: len(model.natural_frequencies)]
    true = np.abs(model.natural_frequencies / expected - 1)
    bounded = (true <= model.errors) | (true <= known.certain)
    assert np.mean(bounded) >= 0.9
    large = true > _KNOWN * known.certain
    assert not large.any() or np.median(model.errors[large] / true[large]) <= 5


@pytest.mark.prove
def test_errors_of_a_sphere() -> None:
    check(BODIES["sphere"], "preview")


@pytest.mark.prove
@pytest.mark.parametrize("body", GIVEN)
def test_errors_of_all_given_elements(body: str) -> None:
    check(GIVEN[body], None)  # they are the accuracy


@pytest.mark.prove
@pytest.mark.parametrize("body", BODIES)
def test_errors_of_all_bodies(body: str) -> None:
    check(BODIES[body], "standard")


@pytest.mark.prove
@pytest.mark.parametrize("body", ["sphere", "cube of hexahedra", "chime", "bar of hexahedra"])
def test_errors_at_fine(body: str) -> None:
    check(BODIES[body], "fine")


AIMED = {"preview": 0.03, "standard": 0.005, "fine": 0.001}
OWN = [name for name in BODIES if name.endswith("of hexahedra")]


@pytest.mark.parametrize(
    ("body", "accuracy"),
    [
        pytest.param(
            body,
            accuracy,
            marks=[] if (body, accuracy) == ("disc of hexahedra", "preview") else pytest.mark.prove,
        )
        for body in OWN
        for accuracy in AIMED
    ],
)
def test_solids_are_as_exact_as_their_accuracy_says(body: str, accuracy: str) -> None:
    known = BODIES[body]
    found = analyzed(known, accuracy).natural_frequencies
    true = np.abs(found / known.frequencies()[: len(found)] - 1)
    assert np.quantile(np.maximum(true - known.certain, 0), 0.9) <= AIMED[accuracy]


def needle(length: float, radius: float, material: struck.Material, count: int) -> Array:
    """Return frequencies of a slender free cone, Hz (Kirchhoff 1879), by Bessel functions.

    The deflection is a sum of J2(2 sqrt(k y)) / y and I2(2 sqrt(k y)) / y at y from the point.
    """

    def at_the_base(root: float) -> float:  # no moment, no force
        ratio = special.iv(4, root) / special.iv(3, root)
        return special.jv(4, root) - ratio * special.jv(3, root)

    starts = np.arange(7.0, 7.0 + np.pi * (count + 1), 0.1)
    signs = np.sign([at_the_base(start) for start in starts])
    turns = np.flatnonzero(signs[1:] != signs[:-1])[:count]
    roots = np.array([optimize.brentq(at_the_base, starts[i], starts[i + 1]) for i in turns])
    speed = np.sqrt(material.youngs_modulus / material.density)
    return roots**2 * radius * speed / (16 * np.pi * length**2)


@pytest.mark.prove
@pytest.mark.parametrize("accuracy", ["preview", "standard"])
def test_a_needle_is_told_to_lack_its_point(accuracy: str) -> None:
    cone = trimesh.creation.cone(radius=0.008, height=0.2, sections=32)
    steel = struck.Material.named("steel")
    body = struck.Mesh(points=np.array(cone.vertices), faces=np.array(cone.faces))
    model = struck.analyze(body, steel, band=(20, 5500), accuracy=accuracy, cache=False)
    pairs = np.repeat(needle(0.2, 0.008, steel, 4), 2)
    true = np.abs(model.natural_frequencies / pairs[: len(model.errors)] - 1)
    assert np.all(true <= model.errors)
    assert np.median(model.errors / true) <= 6


@pytest.mark.prove
@pytest.mark.parametrize(("height", "degrees"), [(0.01, (16, 3)), (0.1, (14, 5))])
def test_plates_are_known_as_well_as_is_said(height: float, degrees: tuple[int, int]) -> None:
    found = []
    for more in (0, 2):
        layers = tuple(np.pi * k / height / 2 for k in (1, 3))
        section = Section.rectangle(1, 1, Family(degree=degrees[0] + more, decays=layers))
        found.append(solid_frequencies(section, height, degrees[1] + more, STEEL)[:38])
    below = found[1] < (900.0 if height < 0.1 else 3000.0)
    assert found[0][below] == pytest.approx(found[1][below], rel=1e-5)
