"""Materials from sound, and models corrected to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray

import struck
from struck import InternalFriction, Material, ModalModel, Rayleigh
from struck.errors import MaterialError, OptionError, RecordingError
from struck.model.air_losses import AirLosses
from struck.model.damping import Damping, Measured, contains_air
from struck.recordings.calibration.calibration import Calibration, calibrated, corrected
from struck.recordings.calibration.losses import losses
from struck.recordings.noise import Noise
from struck.recordings.poles.search import search
from struck.recordings.poles.uncertainty import standard_errors
from struck.recordings.segments import Segment
from struck.shapes import Bar, CircularPlate, RectangularPlate, String
from tests.recordings.calibration.plates import (
    STEEL,
    Modes,
    as_fitted,
    model_of,
    of_frequencies,
    ringing_plate,
)
from tests.recordings.scenes import LEAD, RATE, recorded

Array = NDArray[np.float64]

SIZE = (0.30, 0.20, 0.004)
OTHER = (0.20, 0.20, 0.003)
PLATE = RectangularPlate(length=SIZE[0], width=SIZE[1], thickness=SIZE[2])


@pytest.fixture(scope="module")
def plate() -> ModalModel:
    return model_of(PLATE)


def unknown(chance: Generator) -> Material:
    return replace(
        STEEL,
        youngs_modulus=200e9 * float(np.exp(chance.normal(0, 0.3))),
        poisson_ratio=float(chance.uniform(0.2, 0.45)),
    )


def off(found: Calibration, true: Material) -> tuple[float, float]:
    """Return the errors of E / density, relative, and of Poisson's ratio."""
    stiffness = true.youngs_modulus / true.density
    return found.specific_stiffness / stiffness - 1, found.poisson_ratio - true.poisson_ratio


def fitted_to(samples: Array) -> Modes:
    """Fit the modes of a take with a lead-in."""
    noise = Noise.heard_in(samples[:, :LEAD], RATE)
    segment = Segment.of(samples[:, LEAD:], RATE, noise)
    found = search([segment])
    errors = standard_errors([segment], found)
    return Modes(
        frequencies=found.frequencies,
        decays=found.decays,
        gains=found.gains[0],
        frequency_errors=errors.frequencies,
        decay_errors=errors.decays,
        truth=np.zeros(found.count, int),
    )


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.prove), 1])
def test_material_of_a_recorded_plate(plate: ModalModel, seed: int) -> None:
    """40 dB, a fifth of the modes missing and a fifth extra, nothing known but the shape."""
    chance = np.random.default_rng(seed)
    true = unknown(chance)
    modes = as_fitted(ringing_plate(SIZE, true), chance, cents=0, decay=0)
    take = recorded(modes.frequencies, modes.decays, modes.gains[None], 40, chance, seconds=1.5)
    found = calibrated(
        fitted_to(take.samples), plate, recompute=lambda material: model_of(PLATE, material)
    )
    stiffness, ratio = off(found, true)
    assert abs(stiffness) < 1e-4  # the aim is 1e-3
    assert abs(ratio) < 4e-4  # the aim is 4e-3
    told, ratios = found.interval(0.99)
    assert told[0] < true.youngs_modulus / true.density < told[1]
    assert ratios[0] < true.poisson_ratio < ratios[1]
    assert ringing_plate(OTHER, found.material()).frequencies == pytest.approx(
        ringing_plate(OTHER, true).frequencies, rel=4e-5
    )  # 0.07 cents; the aim is 4
    assert found.losses.name == "loss tangent and external"
    assert found.losses.law.decays(1000.0) == pytest.approx(np.pi + 1, rel=5e-3)


@pytest.mark.prove
@pytest.mark.parametrize("fits", [6, 12])
def test_confidence_covers_the_truth(fits: int) -> None:
    """Errors over standard errors, of fits with errors of 1 cent."""
    ratios = []
    for seed in range(fits):
        chance = np.random.default_rng(seed)
        true = unknown(chance)
        fitted = as_fitted(ringing_plate(SIZE, true, 3000.0), chance, cents=1.0)
        guess = replace(true, youngs_modulus=true.youngs_modulus * 1.1)
        found = calibrated(fitted, model_of(PLATE, guess, 3300.0))
        ratios.append(np.divide(off(found, true), found.standard_errors))
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
    assert np.mean(np.abs(ratios) < 2.1) > 0.85


@pytest.mark.prove
def test_unstated_errors_are_found_from_what_modes_leave(plate: ModalModel) -> None:
    chance = np.random.default_rng(5)
    fitted = as_fitted(ringing_plate(SIZE, STEEL), chance, cents=3)
    bare = replace(fitted, frequency_errors=0 * fitted.frequency_errors)
    told, blind = (calibrated(each, plate) for each in (fitted, bare))
    assert blind.standard_errors == pytest.approx(told.standard_errors, rel=0.4)
    assert 1200 / np.log(2) * blind.scatter == pytest.approx(3, rel=0.4)
    assert told.scatter < 0.5 * blind.scatter


def test_slopes_alone_reach_a_tenth_of_poissons_ratio(plate: ModalModel) -> None:
    true = replace(STEEL, poisson_ratio=0.34, youngs_modulus=70e9 * 7850 / 2700)
    found = calibrated(as_fitted(ringing_plate(SIZE, true), np.random.default_rng(1)), plate)
    stiffness, ratio = off(found, true)
    assert abs(stiffness) < 2e-3
    assert abs(ratio) < 6e-3
    assert np.all(np.abs([stiffness, ratio]) < 3 * np.array(found.standard_errors))


# lambda^2 of simply supported round plates, and how far rounded: Leissa and Narita, Journal of
# Sound and Vibration 70, 221 (1980), for 0.3; what Leissa 1969 prints for 0.3 is of 0.33.
PUBLISHED = {
    0.30: ([4.9351, 13.8982, 25.6133, 29.7200, 48.4789, 70.1170, 74.1561], [5e-5] * 7),
    0.33: ([4.977, 13.94, 25.65, 29.76, 48.51, 70.14, 74.20], [5e-4] + 6 * [5e-3]),
}


@pytest.mark.parametrize("ratio", PUBLISHED)
def test_poissons_ratio_of_published_tables(ratio: float) -> None:
    """A plate of 40 Hz for lambda = 1; the model is of another ratio and stiffness."""
    disk = CircularPlate(radius=0.1, thickness=0.002, edge="supported")
    squares, rounded = map(np.array, PUBLISHED[ratio])
    fitted = of_frequencies(40.0 * squares, STEEL)
    fitted = replace(fitted, frequency_errors=40.0 * rounded / np.sqrt(3))
    start = replace(STEEL, poisson_ratio=0.2)
    found = calibrated(
        fitted, model_of(disk, start), recompute=lambda material: model_of(disk, material)
    )
    assert len(found.pairing) == len(squares)
    assert found.poisson_ratio == pytest.approx(ratio, abs=0.002)
    low, high = found.interval()[1]
    assert low < ratio < high
    unit = 2 * np.pi * 40.0 * disk.radius**2
    told = 12 * (1 - ratio**2) * (unit / disk.thickness) ** 2
    assert found.specific_stiffness == pytest.approx(told, rel=2e-3)


def test_what_modes_do_not_tell_stays_as_assumed() -> None:
    """Bending of slender bars hardly depends on Poisson's ratio."""
    bar = Bar(length=0.4, width=0.03, thickness=0.003)
    true = replace(STEEL, youngs_modulus=110e9, poisson_ratio=0.34)
    model = model_of(bar, true, 6000.0)
    fitted = as_fitted(
        of_frequencies(model.natural_frequencies, true), np.random.default_rng(3), cents=5
    )
    found = calibrated(fitted, model_of(bar, STEEL))
    stiffness, ratio = off(found, true)
    assert found.standard_errors[1] == pytest.approx(0.1, rel=0.1)
    assert abs(ratio + 0.05) < 0.05
    assert abs(stiffness) < 3 * found.standard_errors[0] < 0.02


def errors_of(found: Calibration, model: ModalModel) -> Array:
    """Return the relative standard errors of another body's frequencies due to the material."""
    design = np.stack([np.full(len(model.frequencies), 0.5), model.poisson_slopes], axis=1)
    return np.sqrt(np.einsum("mi,ij,mj->m", design, found.covariance, design))


@pytest.mark.prove
def test_errors_of_size_and_of_another_body(plate: ModalModel) -> None:
    fitted = as_fitted(ringing_plate(SIZE, STEEL), np.random.default_rng(1), cents=1)
    exact, measured = calibrated(fitted, plate), calibrated(fitted, plate, size_error=0.01)
    assert measured.standard_errors[0] == pytest.approx(0.02, rel=0.01)
    assert measured.standard_errors[1] == exact.standard_errors[1]
    other = RectangularPlate(length=OTHER[0], width=OTHER[1], thickness=OTHER[2])
    errors = errors_of(measured, model_of(other, measured.material()))
    assert errors == pytest.approx(np.full(len(errors), 0.01), rel=0.02)
    assert 1200 / np.log(2) * errors_of(exact, model_of(other, exact.material())).max() < 1


def test_the_material_says_what_was_heard_and_what_assumed(plate: ModalModel) -> None:
    found = calibrated(as_fitted(ringing_plate(SIZE, STEEL), np.random.default_rng(1)), plate)
    heavy = found.material(density=8000.0)
    assert heavy.youngs_modulus / heavy.density == pytest.approx(found.specific_stiffness)
    assert "the density was assumed" in heavy.source
    assert model_of(PLATE, heavy).frequencies == pytest.approx(
        model_of(PLATE, found.material()).frequencies, rel=1e-12
    )
    assert any("if the density is 7850" in line for line in found.summary())


def test_what_cannot_be_told_is_refused(plate: ModalModel) -> None:
    fitted = as_fitted(ringing_plate(SIZE, STEEL), np.random.default_rng(1))
    string = String(length=0.65, radius=5e-4, tension=700.0)
    with pytest.raises(MaterialError, match="tension"):
        calibrated(fitted, model_of(string))
    with pytest.raises(MaterialError, match="own material is unknown"):
        calibrated(fitted, replace(plate, material=None))
    with pytest.raises(RecordingError, match="fewer than 3"):
        calibrated(fitted.chosen(np.arange(2)), plate)
    with pytest.raises(OptionError, match="size_error is -1"):
        calibrated(fitted, plate, size_error=-1)
    disk = model_of(CircularPlate(radius=0.12, thickness=0.003), highest=5000.0)
    with pytest.raises(RecordingError, match="no more than with random ones"):
        calibrated(as_fitted(ringing_plate(SIZE, STEEL, 5000.0), np.random.default_rng(0)), disk)


LAWS: dict[str, Damping] = {
    "loss tangent": InternalFriction(loss_tangent=2e-3),
    "loss tangent and external": InternalFriction(loss_tangent=1e-3, external=3.0),
    "Rayleigh": Rayleigh(mass=4.0, stiffness=3e-8),
}


@pytest.mark.parametrize("seeds", [2, pytest.param(4, marks=pytest.mark.prove)])
@pytest.mark.parametrize("name", LAWS)
def test_laws_of_damping_are_told_apart(name: str, seeds: int) -> None:
    """From 40 modes with errors of 5 %, two of them wrong by a factor of three."""
    ratios = []
    for seed in range(seeds):
        chance = np.random.default_rng(seed)
        frequencies = np.exp(chance.uniform(np.log(150), np.log(8000), 40))
        decays = LAWS[name].decays(frequencies) * np.exp(chance.normal(0, 0.05, 40))
        decays[:2] *= 3
        found = losses(frequencies, decays)
        assert found.name == name
        assert found.scatter == pytest.approx(0.05, rel=0.5)
        for label, error in found.standard_errors.items():
            ratios.append((found.coefficients[label] - getattr(LAWS[name], label)) / error)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_decays_that_follow_no_law_are_a_curve() -> None:
    """As of a plate that radiates most where waves in it and in air run side by side."""
    chance = np.random.default_rng(0)
    frequencies = np.exp(chance.uniform(np.log(150), np.log(8000), 60))

    def radiating(tones: Array) -> Array:
        return 1 + 20 * np.exp(-(np.log(tones / 2500) ** 2) / 0.5)

    found = losses(frequencies, radiating(frequencies) * np.exp(chance.normal(0, 0.05, 60)))
    assert isinstance(found.law, Measured)
    assert found.scores[found.name] < 0.4 * min(found.scores[name] for name in LAWS)
    middle = np.geomspace(300, 6000, 50)
    assert found.law.decays(middle) == pytest.approx(radiating(middle), rel=0.25)


def test_few_decays_and_none() -> None:
    found = losses([1000.0], [5.0])
    assert found.name == "loss tangent"
    assert found.law.decays(1000.0) == pytest.approx(5.0)
    with pytest.raises(RecordingError, match="no fitted mode decays"):
        losses([1000.0], [0.0])


def test_a_corrected_model_rings_as_recorded(plate: ModalModel) -> None:
    chance = np.random.default_rng(4)
    true = replace(STEEL, youngs_modulus=230e9, damping=Rayleigh(mass=4.0, stiffness=3e-8))
    modes = ringing_plate(SIZE, true, 8500.0)
    fitted = as_fitted(modes, chance, cents=2)
    model = corrected(plate, fitted)
    assert model.frequencies == pytest.approx(modes.frequencies[: len(model.frequencies)], rel=3e-3)
    rows, columns = np.nonzero(
        np.isclose(model.frequencies[:, None], fitted.frequencies, rtol=1e-12)
    )
    assert len(rows) >= 0.75 * len(plate.frequencies)
    assert model.decays[rows] == pytest.approx(fitted.decays[columns])
    told = str(model.provenance.details["corrected"])
    assert told.startswith(f"{len(rows)} of {len(plate.frequencies)} modes ring as recorded")
    assert np.all(np.diff(model.natural_frequencies) >= 0)
    assert model.complete_to <= plate.complete_to
    again = model.scaled(2.0).scaled(0.5)
    assert again.decays == pytest.approx(model.decays, rel=1e-9)


def test_the_twin_of_a_recorded_mode_goes_with_it() -> None:
    disk = model_of(CircularPlate(radius=0.12, thickness=0.003))
    natural = disk.natural_frequencies
    first = np.r_[True, np.diff(natural) > 1e-6 * natural[1:]]
    chance = np.random.default_rng(0)
    real = np.sort(natural[first] * np.exp(chance.normal(0.02, 1e-3, first.sum())))
    model = corrected(disk, of_frequencies(real, STEEL))
    assert np.unique(model.natural_frequencies).tolist() == pytest.approx(real.tolist())
    assert len(model.natural_frequencies) == len(natural)


def test_nothing_to_correct_is_refused(plate: ModalModel) -> None:
    alone = of_frequencies(np.array([31.0]), STEEL)
    with pytest.raises(RecordingError, match="none of 1 fitted modes"):
        corrected(plate, alone)


# What the air takes.


def with_air(model: ModalModel, material: Material) -> ModalModel:
    """Return the model of another material, whose decays contain its losses to the air."""
    changed = model.made_of(material)
    assert changed.air_decays.min() >= 0
    assert changed.air_decays.max() > 0
    return changed


@pytest.fixture(scope="module")
def sheet() -> ModalModel:
    shape = RectangularPlate(length=0.2, width=0.15, thickness=0.003, edges="free")
    return struck.analyze(shape, "aluminium", band=(20.0, 6000.0), progress=None)


def heard_from(model: ModalModel, chance: Generator, decay: float = 0.01) -> Modes:
    """Return modes with the decays of a model and errors."""
    count, errors = len(model.decays), decay * model.decays
    return Modes(
        frequencies=model.frequencies,
        decays=model.decays + errors * chance.normal(size=count),
        gains=np.ones(count, complex),
        frequency_errors=1e-5 * model.frequencies,
        decay_errors=errors,
        truth=np.arange(count),
    )


def test_the_material_gives_the_recorded_decays_again(sheet: ModalModel) -> None:
    true = replace(STEEL, density=2500.0, youngs_modulus=65e9)
    body = with_air(sheet, true)
    found = calibrated(heard_from(body, np.random.default_rng(1)), sheet)
    same = found.of_density(2500.0)
    assert found.material().density == 2700.0
    assert same.losses.law.decays(1000.0) == pytest.approx(np.pi + 1, rel=0.05)
    again = sheet.made_of(same.material())
    assert again.decays == pytest.approx(body.decays, rel=0.05)
    fractions = body.air_decays / body.decays
    assert same.air_fractions == pytest.approx(fractions[same.pairing.computed], abs=0.05)
    assert any(line.startswith("air       takes") for line in same.summary())


@pytest.mark.parametrize(
    "kind",
    [
        "without air",
        pytest.param("relative", marks=pytest.mark.prove),
        pytest.param("as heard", marks=pytest.mark.prove),
    ],
)
def test_what_the_model_does_not_know_of_the_air(sheet: ModalModel, kind: str) -> None:
    """Without it the law contains it, and no body of the material has it twice."""
    heard = heard_from(with_air(sheet, STEEL), np.random.default_rng(2))
    model = {
        "without air": replace(sheet, air=False),
        "relative": replace(sheet, air=False, gains=replace(sheet.gains, losses=None)),
        "as heard": sheet.damped(Measured(frequencies=(100.0,), rates=(5.0,))),
    }[kind]
    found = calibrated(heard, model)
    law, again = found.material().damping, sheet.made_of(found.material())
    if kind == "as heard":  # the guess has no effect: its law is replaced
        assert not contains_air(law)
        assert again.air_decays.max() > 0
        return
    assert contains_air(law)
    assert not again.air_decays.any()
    assert np.isnan(found.air_fractions).all()
    assert any("the damping contains them" in line for line in found.summary())


@pytest.mark.prove
def test_damping_is_never_negative(sheet: ModalModel) -> None:
    """Decays of a body of which the air takes less than it can."""
    body = sheet.damped(InternalFriction(loss_tangent=1e-5))
    heard = heard_from(body, np.random.default_rng(3))
    quiet = replace(heard, decays=heard.decays / 20, decay_errors=heard.decay_errors / 20)
    found = calibrated(quiet, sheet)
    assert (found.losses.law.decays(np.geomspace(50, 8000, 20)) >= 0).all()
    assert np.isinf(found.damping_errors).all()
    told = "\n".join(found.summary())
    assert "unknown for 26 of 26 modes: the air alone explains their decay" in told
    assert "would decay faster than recorded" in told
    assert "check the size, the wall" in told


@pytest.mark.prove
@pytest.mark.parametrize("level", [0.3, 10.0])
def test_stated_errors_hold_the_damping(level: float) -> None:
    """Air of 0.3 or 10 times the material's, wrong by 6 dB at 95 %, in common and each mode's."""
    law, ratios = InternalFriction(loss_tangent=1e-3), []
    for seed in range(6):
        chance = np.random.default_rng(seed)
        frequencies = np.sort(np.exp(chance.uniform(np.log(300), np.log(8000), 14)))
        damping = law.decays(frequencies)
        air = level * damping * np.exp(chance.normal(0, 1, 14))
        scale = 6 * np.log(10) / 10 / 1.96
        estimate = air * np.exp(scale * (0.84 * chance.normal() + 0.55 * chance.normal(size=14)))
        decays = damping * np.exp(0.03 * chance.normal(size=14)) + air
        told = AirLosses(sound=estimate, surface=0 * air, uncertainty=np.full(14, 6.0))
        found = losses(frequencies, decays, 0.01 * decays, air=told)
        errors = found.errors(frequencies) * found.law.decays(frequencies)
        ratios.append(np.median(np.abs(found.law.decays(frequencies) - damping) / errors))
    assert np.max(ratios) < 2.5
    assert 0.2 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_a_corrected_model_keeps_decays_with_the_air(sheet: ModalModel) -> None:
    heard = heard_from(with_air(sheet, replace(STEEL, density=2700.0)), np.random.default_rng(4))
    few = heard.chosen(np.arange(0, len(heard.decays), 2))
    model = corrected(sheet, few)
    found = np.isclose(model.frequencies[:, None], few.frequencies, rtol=1e-12)
    rows, columns = np.nonzero(found)
    assert len(rows) == len(few.decays)
    assert model.decays[rows] == pytest.approx(few.decays[columns])
    assert not model.air_decays.any()
    assert model.material is not None
    assert contains_air(model.material.damping)
    assert np.median(model.decays / heard.decays) == pytest.approx(1, rel=0.1)
