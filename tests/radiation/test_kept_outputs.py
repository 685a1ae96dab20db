"""Outputs of a body that is resized or made of another material, without a new decomposition."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import struck
from struck.model.gains import ShapeGains
from struck.radiation import RadiatedPower
from struck.solids import Block, Tube
from tests.samples import sampled

BODIES = {"block": Block(size=(0.2, 0.1, 0.02)), "tube": Tube(length=0.3, radius=0.02, wall=0.004)}
SAME = 1e-12  # of the output of each mode


@pytest.fixture(scope="module", params=BODIES)
def body(request: pytest.FixtureRequest) -> struck.ModalModel:
    band = 20, 8000
    return struck.analyze(BODIES[request.param], "glass", accuracy="preview", band=band)


def shaped(model: struck.ModalModel) -> ShapeGains:
    assert isinstance(model.gains, ShapeGains)
    return model.gains


def recomputed(model: struck.ModalModel, size: float, pace: float, density: float) -> np.ndarray:
    """Return outputs by a law that has seen no surface, of the stored shapes on a new surface.

    The body is `size` times as large, rings `pace` times as high and is `density` times as dense.
    """
    gains = shaped(model)
    shapes = gains.shapes.astype(np.float64) * (density * size**3) ** -0.5
    frequencies = model.natural_frequencies * pace
    surface = gains.surface.scaled(size)
    outputs = RadiatedPower().coefficients(surface, shapes, frequencies, gains.centre * size)
    # Modes of one frequency share their power, however the solver turned them.
    groups = np.cumsum(np.diff(frequencies, prepend=frequencies[0]) > 1e-6 * frequencies)
    powers = np.bincount(groups, np.square(np.abs(outputs))) / np.bincount(groups)
    return np.sqrt(powers)[groups] * np.exp(1j * np.angle(outputs))


@pytest.mark.parametrize("size", sampled([0.5, 1.7], 1.7))
def test_a_resized_body_sounds_as_if_computed_again(body: struck.ModalModel, size: float) -> None:
    scaled = shaped(body.scaled(size)).outputs
    np.testing.assert_allclose(scaled, recomputed(body, size, 1 / size, 1.0), rtol=SAME)
    # At equal wave number times size, pressure goes with size^-1/2 for a unit modal velocity.
    np.testing.assert_allclose(scaled, shaped(body).outputs * size**-0.5, rtol=SAME)


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_a_size_and_back_changes_nothing(body: struck.ModalModel, size: float) -> None:
    there = body.scaled(size).scaled(1 / size)
    np.testing.assert_allclose(shaped(there).outputs, shaped(body).outputs, rtol=SAME)
    np.testing.assert_allclose(there.natural_frequencies, body.natural_frequencies, rtol=SAME)


def test_its_own_material_changes_nothing(body: struck.ModalModel) -> None:
    same = shaped(body.made_of("glass"))
    np.testing.assert_array_equal(same.shapes, shaped(body).shapes)
    np.testing.assert_array_equal(same.outputs, shaped(body).outputs)


def test_another_material_sounds_as_if_computed_again(body: struck.ModalModel) -> None:
    """Of a law that is new, and of one that has the surface's harmonics from before."""
    alike = replace(struck.Material.of("steel"), poisson_ratio=body.material.poisson_ratio)
    density = alike.density / body.material.density
    pace = float(np.sqrt(alike.youngs_modulus / body.material.youngs_modulus / density))
    made = body.made_of(alike)
    stored = replace(shaped(body), shapes=shaped(made).shapes)  # rounded again, as they are kept
    expected = recomputed(replace(body, gains=stored), 1.0, pace, 1.0)
    for again in (made, body.made_of(alike)):
        np.testing.assert_allclose(shaped(again).outputs, expected, rtol=SAME)


@pytest.mark.prove
def test_no_pair_of_equal_harmonics_is_cut() -> None:
    """The 64th and 65th of a can are a pair, of which rounding chose one: outputs went by it."""
    can = struck.analyze(
        Tube(length=0.3, radius=0.1, wall=0.004), "steel", accuracy="preview", band=(20, 1500)
    )
    outputs = shaped(can.scaled(0.4)).outputs
    again = recomputed(can, 0.4, 2.5, 1.0)
    np.testing.assert_allclose(again, outputs, rtol=0, atol=1e-9 * np.abs(outputs).max())


@pytest.mark.prove
@pytest.mark.timed
def test_another_size_or_material_takes_a_fraction_of_the_first_outputs() -> None:
    body = struck.analyze(
        Block(size=(0.3, 0.2, 0.008)), "steel", accuracy="preview", band=(20, 20_000)
    )
    gains = shaped(body)

    def first() -> None:
        recomputed(body, 1.0, 1.0, 1.0)

    def seconds(work: object) -> float:
        begun = time.process_time()
        work()
        return time.process_time() - begun

    works = (first, lambda: body.made_of("glass"), lambda: body.scaled(1.5))
    body.made_of("glass")
    rounds = [[seconds(work) for work in works] for _ in range(5)]
    new, made, scaled = np.min(rounds, axis=0)
    assert gains.count > 50
    assert made < 0.8 * new
    assert scaled < 0.2 * new
