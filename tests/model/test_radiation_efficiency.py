"""Radiation efficiency against spheres and a plate in closed form, and third octaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Measured
from struck.errors import OptionError
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.model.radiation_efficiency import known_losses
from struck.model.third_octaves import ThirdOctaves
from struck.model.timbre_table import SinglePoint
from struck.radiation import by_name
from struck.report.model_page import summary
from struck.shapes import RectangularPlate
from tests.radiation.bodies import ball

RADIUS = 0.1
FREQUENCIES = np.array([100.0, 500.0, 1500.0, 4000.0])


def sphere(shapes: NDArray[np.float64], radiation: str = "power") -> ModalModel:
    """Return a sphere all of whose modes have one shape (V, 3), kg^-1/2."""
    surface = ball(RADIUS, 4)
    all_shapes = np.repeat(shapes[:, :, None], len(FREQUENCIES), axis=2)
    gains = ShapeGains.radiating(surface, all_shapes, FREQUENCIES, np.zeros(3), by_name(radiation))
    model = ModalModel(
        frequencies=FREQUENCIES,
        natural_frequencies=FREQUENCIES,
        decays=np.zeros(len(FREQUENCIES)),
        gains=gains,
        material=struck.Material.named("steel"),
        geometry=surface,
        air=gains.calibrated,
        complete_to=5000.0,
    )
    return model.damped(struck.InternalFriction(loss_tangent=0.001))


def test_pulsating_sphere() -> None:
    points = ball(RADIUS, 4).points
    power = sphere(3.0 * points / RADIUS).radiated_power()
    square = (2 * np.pi * FREQUENCIES / AIR.sound_speed * RADIUS) ** 2
    np.testing.assert_allclose(power.efficiencies, square / (1 + square), rtol=0.01)
    np.testing.assert_allclose(power.mean_squares, 9.0, rtol=0.01)
    area = 4 * np.pi * RADIUS**2
    assert power.area == pytest.approx(area, rel=0.01)
    np.testing.assert_allclose(
        power.resistances, AIR.impedance * area * power.efficiencies, rtol=0.01
    )


def test_oscillating_sphere() -> None:
    shapes = np.zeros_like(ball(RADIUS, 4).points)
    shapes[:, 2] = 1.0
    power = sphere(shapes).radiated_power()
    fourth = (2 * np.pi * FREQUENCIES / AIR.sound_speed * RADIUS) ** 4
    np.testing.assert_allclose(power.efficiencies, fourth / (4 + fourth), rtol=0.02)
    np.testing.assert_allclose(power.mean_squares, 1 / 3, rtol=0.01)


def test_plate_far_above_coincidence_has_an_efficiency_of_one() -> None:
    plate = RectangularPlate(length=0.5, width=0.4, thickness=0.01)
    power = struck.analyze(plate, "steel", band=(20, 9000), progress=None).radiated_power()
    high = power.frequencies > 5000  # coincidence is at 1.2 kHz
    assert np.median(power.efficiencies[high]) == pytest.approx(1.0, rel=0.15)
    assert np.all(power.efficiencies[power.frequencies < 400] < 0.05)
    assert np.all((power.fractions > 0) & (power.fractions < 1))


def test_table_of_third_octaves() -> None:
    power = sphere(ball(RADIUS, 4).points / RADIUS).radiated_power()
    columns = power.bands.columns
    assert columns["third octave (Hz)"][0] == 100
    assert columns["third octave (Hz)"][-1] == 4000
    assert columns["modes"].sum() == 4
    is_filled = columns["modes"] > 0
    np.testing.assert_allclose(columns["radiation efficiency"][is_filled], power.efficiencies)
    assert np.isnan(columns["radiation efficiency"][~is_filled]).all()
    lines = str(power).splitlines()
    assert lines[0].startswith("third octave (Hz)  modes  radiation efficiency")
    assert len(lines) == 1 + len(is_filled)
    assert "<td>-</td>" in power._repr_html_()


def test_bands_are_those_of_the_standard() -> None:
    """IEC 61260-1:2014, annex E: nominal frequencies, and edges at 10^(+-1/20) of the centres."""
    nominal = [20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800, 1000]
    nominal += [1250, 1600, 2000, 2500, 3150, 4000, 5000, 6300, 8000, 10000, 12500, 16000, 20000]
    bands = ThirdOctaves.of(np.array(nominal))
    np.testing.assert_allclose(bands.nominal_centres, nominal)
    np.testing.assert_array_equal(bands.counts, 1)
    np.testing.assert_allclose(bands.edges[17:19], [891.251, 1122.018], rtol=1e-6)
    assert ThirdOctaves.of(np.array([1122.0, 1122.1])).counts.tolist() == [1, 1]
    assert ThirdOctaves.of(np.zeros(0)).counts.tolist() == []


def test_models_without_power_are_refused() -> None:
    papers = sphere(ball(RADIUS, 4).points, "heuristic1998")
    with pytest.raises(OptionError, match="as its gains are relative: analyze a body"):
        papers.radiated_power()
    recorded = replace(
        papers, gains=SinglePoint(outputs=np.ones(4, np.complex128)), geometry=None, coordinates=()
    )
    with pytest.raises(OptionError, match="as its gains are of recordings"):
        recorded.radiated_power()


@pytest.mark.parametrize("is_in_law", [False, True])
def test_fractions_are_those_of_the_energy_whoever_counts_the_air(*, is_in_law: bool) -> None:
    plate = RectangularPlate(length=0.3, width=0.2, thickness=0.002)
    model = struck.analyze(plate, "aluminium", band=(20, 3000))
    if is_in_law:
        model = model.damped(Measured(frequencies=[20, 3000], rates=[1, 20], contains_air=True))
        assert not model.air_decays.any()
    energy = struck.energy(model, struck.Strike(impulse=0.01, duration=1e-4))
    expected = energy.sound / energy.entered
    fractions = model.radiated_power().fractions
    assert expected.max() > 0.1
    np.testing.assert_allclose(fractions, expected)
    lines = [line for line in summary(model) if line.startswith("air ")]
    assert "leaves out" not in lines[0]
    assert ("as the damping law does" in lines[0]) == is_in_law


def test_losses_of_older_files_are_those_of_their_outputs() -> None:
    gains = sphere(ball(RADIUS, 4).points / RADIUS).gains
    assert isinstance(gains, ShapeGains)
    assert gains.losses is not None
    old = known_losses(replace(gains, losses=None))
    np.testing.assert_allclose(old.sound, gains.losses.sound)
    assert known_losses(gains) is gains.losses


def test_uncertainty_of_the_sound_is_that_of_the_decay() -> None:
    model = sphere(ball(RADIUS, 4).points / RADIUS)
    assert isinstance(model.gains, ShapeGains)
    assert model.gains.losses is not None
    assert model.decay_bounds is not None
    low, high = model.decay_bounds
    factors = 10 ** (model.gains.losses.uncertainty / 10)
    sound = model.gains.losses.sound
    np.testing.assert_allclose(high, model.decays - sound + factors * sound)
    np.testing.assert_allclose(low, model.decays - sound + sound / factors)
    assert "T60 within (s)" in model._repr_html_()
    without = replace(model, air=False).damped(struck.InternalFriction(loss_tangent=0.001))
    assert without.decay_bounds is None
    assert "T60 within (s)" not in without._repr_html_()
