"""What is told of a model in a few lines."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import struck
from struck.model.gains import Gains, ShapeGains
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.radiation_efficiency import known_losses
from struck.model.survey import Survey, from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable
from struck.report.charts import overview
from struck.report.model_page import summary
from struck.shapes import Bar, RectangularPlate

HEIGHTS = np.array([[0.2], [0.5], [0.9]])
FREQUENCIES = np.array([200.0, 300.0])
AROUND = np.concatenate(
    [from_spherical(1.0, np.arange(4) * np.pi / 2, 1.2), from_spherical([0.1], 0.0, 1.2)]
)


def model(gains: Gains, **given: object) -> ModalModel:
    return ModalModel(
        frequencies=FREQUENCIES,
        natural_frequencies=FREQUENCIES,
        decays=np.ones(2),
        gains=gains,
        **{"complete_to": 0.0, "coordinates": ("height",), **given},
    )


def survey(second: float = 0.0, **given: object) -> Survey:
    """Gains of rank one, of which the second mode has another product `second` times as strong."""
    drives = np.array([[1.0, 1.0], [0.5, -0.5], [-0.2, 0.3]])
    outputs = np.array([1.0, 0.7, 0.5j, 0.8, 1.0])[:, None] * [1.0, 0.5]
    gains = drives[:, None] * outputs + 0j
    gains[:, :, 1] += second * np.outer([1.0, -1.0, 1.0], [1.0, -1.0, 1.0, -1.0, 0.0])
    return Survey.full(HEIGHTS, AROUND, gains, FREQUENCIES, **given)


def sound_decays(gains: Gains) -> np.ndarray:
    assert isinstance(gains, ShapeGains)
    return known_losses(gains).sound


def line(lines: list[str], begin: str) -> str:
    (found,) = (each for each in lines if each.startswith(begin))
    return found


def test_a_field_tells_where_it_was_struck_and_how_far_it_is_a_product() -> None:
    field = TimbreField.of(survey(0.3, calibrated=True), radius=0.3)
    lines = summary(model(field, places={"rim": np.array([0.9])}))
    assert lines[0] == "2 modes, others may be missing"
    assert line(lines, "gains") == "gains     Pa per N s"
    assert line(lines, "recorded") == (
        "recorded  a field of 3 contacts and 1 listener inside, height from 0.2 to 0.9"
    )
    assert line(lines, "places").endswith("rim")
    worst = float(field.rank_errors.max())
    assert worst > 0.2
    assert line(lines, "rank").endswith(f"to {100 * worst:.2g} % in all")
    noted = replace(field, notes=("record more",), rank_errors=np.full(2, np.nan))
    lines = summary(model(noted))
    assert line(lines, "note") == "note      record more"
    assert not any(each.startswith("rank") for each in lines)


def test_what_is_told_of_a_field_is_about_the_modes_of_the_object() -> None:
    field = TimbreField.of(survey(0.3))
    blow = Provenance(details={"blow": [1]})  # the mode that is no product
    errors = field.rank_errors
    assert errors[0] < 0.01 < errors[1]
    told = line(summary(model(field, provenance=blow)), "rank")
    assert told.endswith(f"to {100 * errors[0]:.2g} % in all")
    drowned = replace(survey(), errors=np.abs(survey().gains) * [0.01, 100.0])
    note, directions = TimbreField.of(drowned).notes
    assert note.startswith("1 of 2 modes were not measured")
    assert TimbreField.of(drowned, object_modes=np.array([True, False])).notes == (
        directions.replace("1 of 2", "1 of 1"),
    )
    (note,) = TimbreField.of(drowned, object_modes=np.array([False, True])).notes
    assert note.startswith("1 of 1 modes were not measured")


def test_a_field_that_is_struck_all_around_says_so() -> None:
    contacts = np.concatenate(
        [np.repeat(HEIGHTS, 4, axis=0), np.tile([[0.0], [1], [2], [4]], (3, 1))], 1
    )
    chance = np.random.default_rng(1)
    gains = chance.normal(size=(12, 4, 2)) + 0j
    around = Survey.full(contacts, AROUND[:4], gains, FREQUENCIES, symmetry="axial")
    field = TimbreField.of(around)
    told = line(summary(model(field, coordinates=("height", "azimuth (rad)"))), "recorded")
    assert told.endswith("height from 0.2 to 0.9, azimuth (rad) all around")


def test_a_table_tells_its_size() -> None:
    made = model(TimbreTable.of(survey()))
    told = "recorded  a table of 3 contacts with 5 listeners, height from 0.2 to 0.9"
    assert line(summary(made), "recorded") == told
    assert line(summary(made.expanded()), "recorded") == told


def test_a_single_point_tells_what_is_assumed() -> None:
    lines = summary(model(SinglePoint(outputs=np.ones(2) + 0j), coordinates=(), complete_to=5e3))
    assert lines[0] == "2 modes, none missing up to 5000 Hz"
    assert "1 m away" in line(lines, "recorded")
    assert line(lines, "gains") == "gains     relative"


def test_a_body_that_only_recoils_is_summed_up_and_drawn() -> None:
    die = struck.analyze(struck.solids.Block(size=(0.012,) * 3), "steel", accuracy="preview")
    lines = summary(die)
    assert lines[:2] == [
        "0 modes, none missing up to 20000 Hz",
        "recoil    of the body as a whole, over within some 0.15 ms",
    ]
    assert lines[-1].startswith("note      no mode lies below 20000 Hz: the lowest is at 119100 Hz")
    assert lines[-1].endswith("what is heard is its recoil")
    sound = struck.render(die, struck.Strike(striker="steel", speed=0.5))
    figure = overview(die, sound, title="A die")
    assert not figure.subfigs
    spectrum = figure.axes[1]
    assert spectrum.lines[0].get_ydata().max() == pytest.approx(0, abs=0.1)


def test_losses_to_the_air_are_those_of_a_plate_that_radiates_from_both_sides() -> None:
    """Far above coincidence a plate loses its speed at the rate rho c / (density thickness)."""
    plate = RectangularPlate(length=0.5, width=0.4, thickness=0.01)
    model = struck.analyze(plate, "steel", band=(20, 9000))
    high = model.frequencies > 5000  # coincidence is at 1.2 kHz
    assert np.median(sound_decays(model.gains)[high]) == pytest.approx(413.3 / 78.5, rel=0.1)
    (line,) = [each for each in summary(model) if each.startswith("air")]
    at, both, alone = map(
        float, re.findall(r"as ([\d.]+) Hz \(T60 ([\d.]+) s, without air ([\d.]+) s", line)[0]
    )
    mode = np.argmin(np.abs(model.frequencies - at))
    assert both == pytest.approx(model.t60[mode], rel=0.05)
    material = model.decays[mode] - model.air_decays[mode]
    assert alone == pytest.approx(np.log(1000) / material, rel=0.05)
    assert both <= alone / 2  # both are rounded
    (line,) = [each for each in summary(model) if each.startswith("gains")]
    assert re.search(r"efficiency .* to 1\.\d+, half below .*, 0\.5 from about \d+ Hz", line)
    without = struck.analyze(plate, "steel", band=(20, 9000), air=False)
    (line,) = [each for each in summary(without) if each.startswith("air")]
    assert line.startswith("air       T60 leaves out what the sound itself takes: ")
    lossless = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.29)
    endless = summary(struck.analyze(plate, lossless, band=(20, 2000)))
    assert any("without air endless)" in each for each in endless)
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.02), "abs")
    (line,) = [each for each in summary(bar) if each.startswith("air")]
    assert re.match(r"air       T60 contains the losses to the air, at most [\d.]+ %$", line)


def test_losses_to_the_air_of_a_body_of_many_metres_are_those_of_one_of_metres() -> None:
    long = RectangularPlate(length=20, width=20, thickness=0.4)
    short = RectangularPlate(length=0.5, width=0.5, thickness=0.01)
    rates = [
        sound_decays(struck.analyze(plate, "steel", band=(1, highest)).gains)
        for plate, highest in ((long, 75), (short, 3000))
    ]
    assert np.sort(rates[0]) * 40 == pytest.approx(np.sort(rates[1]), rel=1e-6)
