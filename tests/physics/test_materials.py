"""Another material without another decomposition, against a fresh one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import struck
from struck import Material
from struck.solids import Block, Tube, VolumeMesh
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from tests.physics.bodies import ball

STEEL, GLASS = Material.named("steel"), Material.named("glass")


def _shell() -> VolumeMesh:
    return fill_body(FilledBody(mesh=ball(0.05), wall=0.004), "preview").mesh


BODIES = {
    "tube": (Tube(length=0.2, radius=0.02, wall=0.004, elements=(12, 14, 1)), 16_000.0),
    "bar": (Block(size=(0.3, 0.03, 0.005), elements=(24, 3, 1)), 12_000.0),
    "plate": (Block(size=(0.3, 0.3, 0.005), elements=(12, 12, 1)), 3_000.0),
    "hollow sphere": (_shell, 20_000.0),
    "solid sphere": (lambda: fill_body(FilledBody(mesh=ball(0.05)), "preview").mesh, 45_000.0),
}


# The tube's modes are of all kinds.
each_body = pytest.mark.parametrize(
    "name",
    ["bar", *(pytest.param(n, marks=pytest.mark.prove) for n in BODIES if n != "bar")],
)


@cache
def computed(name: str, material: Material) -> struck.ModalModel:
    """Return a body of a material, computed of it; once, for several tests ask."""
    body, highest = BODIES[name]
    return struck.analyze(body() if callable(body) else body, material, band=(20, highest))


def both(name: str, material: Material) -> tuple[struck.ModalModel, struck.ModalModel]:
    """Return a body of steel made of another material, and one computed of it."""
    return computed(name, STEEL).made_of(material), computed(name, material)


@pytest.mark.prove
@pytest.mark.parametrize("name", ["bar", "hollow sphere"])
def test_same_poisson_ratio_is_exact(name: str) -> None:
    other = Material(density=2000.0, youngs_modulus=30e9, poisson_ratio=STEEL.poisson_ratio)
    made, fresh = both(name, other)
    count = min(len(made.frequencies), len(fresh.frequencies))
    assert made.natural_frequencies[:count] == pytest.approx(
        fresh.natural_frequencies[:count], rel=1e-9
    )
    assert made.mass == pytest.approx(fresh.mass, rel=1e-12)
    contact = fresh.contact("+x")
    drives = [m.gains.at(contact.point[None], contact.direction[None])[0, 0] for m in (made, fresh)]
    if name == "bar":  # no two modes share a frequency
        assert drives[0][:count] == pytest.approx(drives[1][:count], rel=1e-3, abs=1e-4)


@pytest.mark.prove
@each_body
def test_steel_to_glass_is_within_its_stated_error(name: str) -> None:
    made, fresh = both(name, GLASS)
    known = made.natural_frequencies < made.complete_to
    count = int(known.sum())
    assert count >= 8
    assert made.natural_frequencies[:count] == pytest.approx(
        fresh.natural_frequencies[:count], rel=6e-3
    )
    differences = np.abs(made.natural_frequencies / fresh.natural_frequencies[: len(known)] - 1)
    assert np.mean(differences[:count] <= made.errors[:count]) >= 0.9


@each_body
def test_the_reported_end_of_the_band_is_true(name: str) -> None:
    """Below complete_to there are as many modes as a fresh decomposition finds."""
    made, fresh = both(name, GLASS)
    end = made.complete_to
    assert end < fresh.complete_to * 1.2
    expected = np.count_nonzero(fresh.natural_frequencies < end)
    near = np.abs(fresh.natural_frequencies / end - 1) < 0.006
    found = np.count_nonzero(made.natural_frequencies < end)
    assert abs(found - expected) <= np.count_nonzero(near)


@pytest.mark.prove
def test_frequencies_of_a_pure_state_are_exact() -> None:
    """Torsion goes with sqrt(G), stretching of a bar with sqrt(E), at any Poisson's ratio."""
    tube, highest = BODIES["tube"]
    made, fresh = both("tube", GLASS)
    speed = np.sqrt(GLASS.shear_modulus / GLASS.density)
    torsion = speed / (2 * tube.length)
    assert torsion < highest
    assert np.abs(fresh.natural_frequencies / torsion - 1).min() < 1e-4
    assert np.abs(made.natural_frequencies / torsion - 1).min() < 1e-4
