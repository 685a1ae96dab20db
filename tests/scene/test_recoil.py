"""Recoil in what is rendered: small bodies sound, large ones change little, silence is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Body, Hold, ModalModel, Scrape, Strike
from struck.errors import NoModeError, OptionError
from struck.model.recoil import Recoil
from struck.scene.render import DrivenBody, _outputs
from struck.shapes import Bar, RoundSection
from struck.solids import Block
from tests.radiation.bodies import ball
from tests.radiation.test_added_mass import rigid

Array = NDArray[np.float64]
RATE = 48_000


@pytest.fixture(scope="module")
def die() -> ModalModel:
    return struck.analyze(Block(size=(0.012,) * 3), "steel", accuracy="preview", cache=False)


def level(samples: Array) -> float:
    """Return the peak in dB re 20 micropascal."""
    return float(20 * np.log10(np.abs(samples).max() / 20e-6))


def test_a_die_a_marble_and_a_key_sound(die: ModalModel) -> None:
    marble = rigid(ball(0.008, 3), 2500 * 4 / 3 * np.pi * 0.008**3)
    key = struck.analyze(Block(size=(0.055, 0.02, 0.002)), "brass", accuracy="preview", cache=False)
    assert not len(die.frequencies)
    assert len(key.frequencies)
    for body in (die, marble, key):
        sound = struck.render(body, Strike(striker="steel", speed=0.5), seconds=0.1)
        assert 70 < level(sound.samples[0]) < 120
        assert sound.calibrated


def test_a_body_without_modes_says_so(die: ModalModel) -> None:
    assert "no mode lies below 20000 Hz: the lowest is at 1" in die.provenance.dropped[0]
    assert "Chadwick" in die.cite()
    assert die.complete_to == 20_000
    for listener in (None, struck.Stereo(position=(0, 1, 0))):
        sound = struck.render(die, Strike(at="top"), listener=listener)
        assert "its recoil alone is heard" in sound.notes[0]
        assert 0.1 <= sound.duration < 0.2
        assert np.abs(sound.samples).max() > 0
    with pytest.raises(NoModeError, match=r"no mode lies below 20000 Hz.*check its units"):
        struck.analyze(Block(size=(0.012,) * 3), "steel", recoil=False)


def test_a_short_bar_in_closed_form_recoils_too() -> None:
    short = struck.analyze(Bar(length=0.02, width=0.01, thickness=0.01), "steel")
    assert "lowest mode is at" in short.provenance.dropped[0]
    assert short.recoil is not None
    assert struck.render(short, Strike(at=(0.01,))).samples.any()
    with pytest.raises(NoModeError, match="lowest mode is at"):
        struck.analyze(Bar(length=0.02, width=0.01, thickness=0.01), "steel", recoil=False)


@pytest.mark.parametrize(
    "options",
    [
        {"radiation": "obrien2002"},
        {"radiation": "heuristic1998"},
        {"method": "obrien2002", "band": (20.0, 8000.0)},
        {"fixed": ((-1, -1, -1), (-0.09, 1, 1))},
        {"recoil": False},
    ],
)
def test_held_bodies_and_the_papers_have_none(options: dict[str, object]) -> None:
    block = Block(size=(0.2, 0.03, 0.01), elements=(6, 1, 1))
    assert struck.analyze(block, "oak", **options).recoil is None
    assert struck.analyze(block, "oak").recoil is not None


def test_a_model_changes_with_its_recoil(die: ModalModel) -> None:
    grown, light = die.scaled(2.0), die.made_of("glass")
    fresh = struck.analyze(Block(size=(0.024,) * 3), "steel", accuracy="preview", cache=False)
    for name in ("axes", "levels", "corners", "dampings"):
        assert getattr(grown.recoil, name) == pytest.approx(getattr(fresh.recoil, name), rel=1e-6)
    assert light.recoil.levels * light.mass == pytest.approx(die.recoil.levels * die.mass)
    assert np.array_equal(light.recoil.corners, die.recoil.corners)
    assert die.damped(struck.Rayleigh(mass=1.0, stiffness=0.0)).recoil is die.recoil


CHIME = Bar(length=0.505, section=RoundSection(radius=0.0125, wall=0.001))


def test_a_chime_changes_in_its_first_milliseconds_alone() -> None:
    chime = struck.analyze(CHIME, "aluminium", damping="heard")
    strike = Strike(at=(0.01,), striker="wood", speed=1.0)
    whole, ringing = (
        struck.render(model, strike, seconds=0.5).samples[0]
        for model in (chime, replace(chime, recoil=None))
    )
    late = round(0.005 * RATE)
    for start in range(late, len(whole) - 960, 960):
        part = slice(start, start + 960)
        powers = [np.square(each[part]).sum() for each in (whole, ringing)]
        assert abs(10 * np.log10(powers[0] / powers[1])) < 0.5
    assert np.abs(whole - ringing)[:late].max() > 0.01 * np.abs(ringing).max()


def driven(model: ModalModel, actions: list, seconds: float) -> Array:
    """Return what resonators make of actions, at 1 m along x."""
    place = np.array([[1.0, 0.0, 0.0]])
    body = DrivenBody(
        model=model,
        outputs=_outputs(model, place, RATE),
        actions=actions,
        sample_rate=RATE,
    )
    return body.samples(seconds, min_seconds=0.0)[0]


@pytest.mark.parametrize("shape", ["half-sine", "hertz", "gaussian"])
def test_closed_form_and_resonators_agree(die: ModalModel, shape: str) -> None:
    strikes = [
        Strike(at="top", impulse=0.01, duration=4e-5, shape=shape, time=0.0101),
        Strike(at="+x", impulse=0.02, duration=0.0, shape=shape, time=0.02),
    ]
    engine = driven(die, strikes, 0.03)
    closed = struck.render(die, strikes, seconds=0.03, listener=(1, 0, 0)).samples[0]
    assert np.abs(engine - closed).max() < 1e-6 * np.abs(engine).max()


def test_a_steady_load_is_silent_and_hands_do_not_stop_recoil(die: ModalModel) -> None:
    load = struck.ForceTrack(at="top", force=np.full(4000, 10.0), sample_rate=RATE)
    pressed = driven(die, [load], 0.07)
    assert np.abs(pressed[600:3000]).max() < 1e-9
    blow = Strike(at="top", impulse=0.01, duration=1e-4)
    free, held = (driven(die, acts, 0.01) for acts in ([blow], [blow, Hold(at="top", grip=1e6)]))
    assert np.abs(free - held).max() < 1e-12  # blocks are cut otherwise


def test_a_scrape_is_heard_by_recoil_as_well(die: ModalModel) -> None:
    scrape = Scrape(path=[(0.0, -0.004, 0.006), (0.0, 0.004, 0.006)], speed=0.05, load=1.0)
    sound = struck.render(die, scrape, seconds=0.2)
    assert np.isfinite(sound.samples).all()
    assert sound.samples.any()
    moving = Body(
        model=die, excitations=Strike(at="top"), position=([0, 1], [(-5, 3, 1), (5, 3, 1)])
    )
    passed = struck.render([moving], listener=struck.Mono(position=(0, 0, 1)), seconds=0.2)
    assert passed.samples.any()


def test_a_fixed_body_does_not_recoil(die: ModalModel) -> None:
    bodies = [Body(model=die, excitations=Strike(at="top"), fixed=held) for held in (False, True)]
    free, fixed = (struck.render([body], seconds=0.05) for body in bodies)
    assert free.samples.any()
    assert not fixed.samples.any()
    assert "it is silent" in fixed.notes[0]


BALL = Recoil(axes=np.eye(3), levels=np.ones(3), corners=np.full(3, 1e3), dampings=np.full(3, 0.7))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": np.ones((3, 3))}, "orthonormal"),
        ({"axes": np.eye(2)}, "shape"),
        ({"levels": np.array([1.0, -1.0, 0.0])}, "least 0|at least"),
        ({"corners": np.array([1.0, 0.0, 1.0])}, "corners from 1e-9 Hz on"),
        ({"dampings": np.array([0.7, 0.7, 1.1])}, "dampings from 0.4 to 0.99"),
        ({"levels": np.array([1.0, np.nan, 0.0])}, "finite"),
    ],
)
def test_impossible_recoils_are_refused(change: dict[str, Array], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        replace(BALL, **change)


@pytest.mark.prove
@pytest.mark.parametrize("rate", [8000, 22_050, 44_100, 96_000, 192_000])
def test_recoil_is_right_up_to_a_quarter_of_any_rate(rate: int) -> None:
    chance = np.random.default_rng(rate)
    for _ in range(200):
        recoil = replace(
            BALL, corners=10 ** chance.uniform(1, 6, 3), dampings=chance.uniform(0.4, 0.99, 3)
        )
        answers = recoil.answers(rate, rate)
        frequencies = np.geomspace(50, rate / 4, 100)
        turns = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(answers.shape[1])) / rate)
        got, s = np.abs(turns @ answers.T), 2j * np.pi * frequencies[:, None]
        below = s / (2 * np.pi * recoil.corners)
        wanted = np.abs(s / (1 + 2 * recoil.dampings * below + below**2))
        assert np.abs(20 * np.log10(got / wanted)).max() < 0.25
