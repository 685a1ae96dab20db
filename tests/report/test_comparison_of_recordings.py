"""Models beside sounds, sound files, model files, and models that were recorded themselves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import InternalFriction, ModalModel, Rayleigh, Sound, Strike
from struck.errors import FileFormatError, OptionError, RecordingError
from struck.files.sampled_field import SampledField
from struck.model.timbre_table import SinglePoint
from struck.recordings.takes import Take
from struck.report.comparison import Side, compare
from struck.shapes import Bar
from tests.model.vases import HEIGHTS, Vase, listeners

Array = NDArray[np.float64]

RATE = 48000
BAR = Bar(length=0.3, width=0.03, thickness=0.005)
TOP = {"direction": (0, 0, -1), "impulse": 0.01}
ONE, TWO = (Strike(at=(x, 0.0, 0.0025), **TOP) for x in (0.02, 0.11))


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    """A free bar whose modes die away within a second."""
    steel = replace(struck.Material.named("steel"), damping=Rayleigh(mass=12.0, stiffness=1e-8))
    return struck.analyze(BAR, steel, band=(100, 20_000), recoil=False)


@pytest.fixture(scope="module")
def vase() -> Vase:
    return Vase.drawn(np.random.default_rng(5))


def field_of(vase: Vase) -> SampledField:
    return SampledField(
        frequencies=vase.frequencies,
        decays=vase.decays,
        contacts=HEIGHTS,
        listeners=listeners(),
        gains=vase.gains(HEIGHTS[:, 0], listeners()),
        centre=np.zeros(3),
        symmetry="axial",
        coordinates=("height (vase heights)",),
    )


def point_of(vase: Vase) -> ModalModel:
    outputs = np.linspace(1, 2, len(vase.frequencies)) + 0j
    model = field_of(vase).model()
    gains = SinglePoint(outputs=outputs)
    return replace(model, gains=gains, coordinates=(), places={"recorded": np.zeros(0)})


def at_height(height: float) -> Strike:
    return Strike(at=(height,), impulse=1.0)


def struck_twice(bar: ModalModel, seconds: float = 2.0) -> Sound:
    """Return the sound of a soft hit at `ONE` and a hard one at `TWO`, after a lead-in."""
    hits = [replace(ONE, time=0.3, impulse=0.003), replace(TWO, time=1.1)]
    return struck.render(bar, hits, seconds=seconds, sample_rate=RATE)


@pytest.mark.prove
def test_levels_are_those_of_the_loudest_hit(bar: ModalModel) -> None:
    found = compare(bar, struck_twice(bar), strike=TWO)
    assert len(found.pairs) == len(bar.frequencies)
    loud = found.other.levels[found.pairing.fitted] > -60
    assert found.level_differences[loud] == pytest.approx(0, abs=0.05)
    assert found.level_offset == pytest.approx(0, abs=0.05)
    assert any("2 hits" in line for line in found.summary())
    elsewhere = compare(bar, struck_twice(bar), strike=ONE)
    assert np.abs(elsewhere.level_differences).max() > 6


@pytest.mark.prove
def test_the_loudest_hit_is_heard_alone(bar: ModalModel) -> None:
    sound = struck_twice(bar)
    hits = [replace(ONE, time=0.3), replace(TWO, time=1.1, impulse=0.003)]
    early = struck.render(bar, hits, seconds=2.0, sample_rate=RATE)
    last, first = (Side.of_take(Take.of(each)).sound(9.0) for each in (sound, early))
    assert last.duration == pytest.approx(2.0 - 1.1 + 0.02, abs=0.002)
    assert np.array_equal(last.samples, sound.samples[:, -last.samples.shape[1] :])
    assert first.duration == pytest.approx(1.1 - 0.3, abs=0.002)


def test_levels_of_what_dies_at_once_count_as_of_the_same_moment(bar: ModalModel) -> None:
    """A loss tangent of 0.01 takes 0.1 to 5 dB a millisecond from these modes."""
    dull = bar.damped(InternalFriction(loss_tangent=0.01))
    sound = struck.render(dull, replace(TWO, time=0.3), seconds=0.7, sample_rate=RATE)
    heard = Side.of_take(Take.of(sound))
    assert heard.begins > 2e-4
    found = compare(dull, sound, strike=TWO)
    loud = found.other.levels[found.pairing.fitted] > -60
    assert np.count_nonzero(loud) > 5
    assert np.ptp(dull.decays[found.pairing.computed[loud]]) * heard.begins > 0.2  # 2 dB
    assert found.level_differences[loud] == pytest.approx(0, abs=0.1)


def test_a_wrong_contact_takes_no_mode_for_a_stranger(bar: ModalModel) -> None:
    """In the middle every second mode has a node: a recording that has them is the same body's."""
    middle = Strike(at=(0.15, 0.0, 0.0025), **TOP)
    sound = struck.render(bar, replace(ONE, time=0.3), seconds=1.5, sample_rate=RATE)
    found = compare(bar, sound, strike=middle)
    assert len(found.pairs) == len(bar.frequencies)
    assert not len(found.extra)


def test_a_click_of_the_body_as_a_whole_is_no_stranger(bar: ModalModel) -> None:
    clicking = struck.analyze(BAR, bar.material, band=(100, 20_000))
    wood = Strike(at=(0.02, 0.0, 0.0025), striker="wood")
    sound = struck.render(clicking, replace(wood, time=0.35), seconds=2.0, sample_rate=RATE)
    chance = np.random.default_rng(0)
    noise = 1e-3 * sound.peak * chance.standard_normal(sound.samples.shape)
    found = compare(
        clicking, replace(sound, samples=sound.samples + np.float32(noise)), strike=wood
    )
    assert len(found.pairs) >= 11
    assert not len(found.extra)


@pytest.mark.prove
def test_takes_and_files_are_as_good_as_sounds(bar: ModalModel, tmp_path: Path) -> None:
    sound = struck.render(bar, replace(ONE, time=0.3), seconds=1.2, sample_rate=RATE)
    sound.save(tmp_path / "bar.wav")
    struck.save(bar, tmp_path / "bar.struck")
    whole = compare(bar, sound, strike=ONE)
    for other in (Take.of(sound), tmp_path / "bar.wav", str(tmp_path / "bar.wav")):
        found = compare(bar, other, strike=ONE)
        assert found.cents == pytest.approx(whole.cents, abs=1e-3)
        assert found.level_differences == pytest.approx(whole.level_differences, abs=1e-3)
    same = compare(bar, tmp_path / "bar.struck", strike=ONE, against=TWO)
    assert not same.cents.any()
    assert same.other.computed


def test_what_is_no_blow_is_refused_or_said(bar: ModalModel, tmp_path: Path) -> None:
    times = np.arange(-1600, 3200) / 16_000
    noise = np.random.default_rng(3).standard_normal(len(times))
    cymbal = noise * np.where(times < 0, 0, np.exp(-8 * times))
    said = compare(bar, Sound(samples=cymbal, sample_rate=16_000), strike=ONE)
    assert any("noise-like" in line for line in said.summary())
    silent = Sound(samples=np.zeros(RATE), sample_rate=RATE)
    with pytest.raises(RecordingError, match="silent"):
        compare(bar, silent)
    (tmp_path / "bar.wav").write_text("a bar")
    with pytest.raises(FileFormatError):
        compare(bar, tmp_path / "bar.wav")
    with pytest.raises(FileFormatError):
        compare(bar, tmp_path / "nowhere.struck")
    with pytest.raises(OptionError, match="against="):
        compare(bar, silent, against=ONE)
    with pytest.raises(OptionError, match="recording="):
        compare(bar, silent, recording=silent)


@pytest.mark.parametrize("way", ["field", "table"])
def test_levels_of_a_recorded_model_go_with_its_contact_part(vase: Vase, way: str) -> None:
    model = field_of(vase).model(way)
    found = compare(model, model, strike=at_height(1.0), against=at_height(0.5))
    heights = np.abs(vase.drives(np.array([1.0, 0.5])))
    awake = (heights > 1e-3).all(axis=0)
    expected = 20 * np.log10(heights[1, awake] / heights[0, awake])
    known = np.isin(found.pairing.computed, np.flatnonzero(awake))
    apart = found.level_differences[known] - expected
    assert np.ptp(apart) < 1e-3  # all modes but for one offset, as levels are relative
    assert not found.cents.any()
    assert found.explained


def test_a_recorded_model_beside_its_sound(vase: Vase) -> None:
    model = field_of(vase).model()
    sound = struck.render(model, replace(at_height(0.0), time=0.2), seconds=1, sample_rate=RATE)
    found = compare(model, sound, strike=at_height(0.0))
    assert len(found.pairs) >= 23
    assert np.abs(found.cents).max() < 1e-3
    assert found.level_differences == pytest.approx(0, abs=0.01)  # a sample of its onset
    assert not len(found.missing)
    assert not len(found.extra)


def test_models_of_recordings_miss_only_what_should_be_heard(vase: Vase) -> None:
    """A recorded model holds no mode that was not heard; a computed one may."""
    model, point = field_of(vase).model(), point_of(vase)
    fewer = replace(
        point,
        frequencies=point.frequencies[1:],
        natural_frequencies=point.natural_frequencies[1:],
        decays=point.decays[1:],
        gains=SinglePoint(outputs=point.gains.toward([[1.0, 0.0, 0.0]])[0, 0, 1:]),
    )
    found = compare(point, fewer)
    assert (found.missing.tolist(), found.extra.tolist()) == ([0], [])
    assert (compare(fewer, point).missing.tolist(), compare(fewer, point).extra.tolist()) == (
        [],
        [0],
    )
    asleep = np.abs(vase.drives(np.array([1.0]))[0]) < 1e-6
    assert asleep.any()
    rest = replace(
        point,
        **{
            name: getattr(point, name)[~asleep]
            for name in ("frequencies", "natural_frequencies", "decays")
        },
        gains=SinglePoint(outputs=np.ones(np.count_nonzero(~asleep)) + 0j),
    )
    assert not len(compare(model, rest, strike=at_height(1.0), against=Strike()).missing)


def test_a_field_is_struck_where_it_was_recorded_best(vase: Vase) -> None:
    field = field_of(vase).model()
    best = Strike(at=field.places["recorded"])
    told = compare(field, point_of(vase), strike=best, against=Strike())
    assert compare(field, point_of(vase)).level_offset == told.level_offset


@pytest.mark.prove
def test_a_fitted_model_is_beside_its_own_recording_as_it_was_fitted(bar: ModalModel) -> None:
    """A soft blow takes modes of its own, which a recording of another blow need not have."""
    soft, other = (
        struck.render(bar, replace(ONE, time=0.3, duration=long), seconds=1.5, sample_rate=RATE)
        for long in (0.004, 0.0005)
    )
    model = struck.fit(soft, cache=False)
    found = compare(model, soft)
    assert len(found.pairs) == len(model.frequencies)
    assert not len(found.missing)
    assert not len(found.extra)
    assert found.decay_ratios == pytest.approx(1, abs=1e-6)
    every = struck.fit(soft, modes=None, cache=False)
    assert len(compare(every, soft).pairs) == len(every.frequencies)
    blow = np.flatnonzero(~model.of_object)
    assert len(blow)
    assert not np.isin(blow, compare(model, other).missing).any()
