"""Bodies that are pushed block after block, against closed forms."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from struck.analysis.analysis import analyze
from struck.errors import OptionError
from struck.excitation import texture
from struck.excitation.excitation import Hold
from struck.excitation.force_track import ForceTrack
from struck.excitation.pluck import Pluck
from struck.excitation.scrape import Scrape
from struck.excitation.strike import Strike
from struck.model.gains import Gains
from struck.scene.body import Action
from struck.scene.render import DrivenBody, render
from struck.shapes import CircularMembrane
from struck.synth import resonators
from tests.scene.test_render import BLOCK, FREQUENCIES, TOP, block

SCRAPE = Scrape(path=[TOP, (-0.05, 0.01, 0.05)], speed=0.2, load=1.0, radius=1e-3)
GAUSSIAN = Strike(at=TOP, impulse=0.01, shape="gaussian")
ELSEWHERE = (-0.03, -0.02, 0.05)


def heard(actions: Action | Sequence[Action], seconds: float = 0.5) -> np.ndarray:
    return render(BLOCK, actions, seconds=seconds, fade=0).samples[0].astype(float)


def decibels(error: np.ndarray, signal: np.ndarray) -> float:
    return 20 * float(np.log10(np.abs(error).max() / np.abs(signal).max()))


def test_scrapes_too_fast_for_samples_are_told() -> None:
    fast = replace(SCRAPE, speed=30.0)
    sound = render(BLOCK, [fast, SCRAPE, replace(fast, time=0.4)], seconds=0.2)
    assert any(note.startswith("scrapes and rolls that are not heard: 1;") for note in sound.notes)
    assert not render(BLOCK, SCRAPE, seconds=0.2).notes
    assert not heard(fast, 0.2).any()


@pytest.mark.parametrize("striker", ["felt", "wood", "steel"])
def test_strikes_through_resonators_are_the_closed_form(striker: str) -> None:
    strike = Strike(at=TOP, striker=striker, speed=1.0, time=0.0103)
    closed, stepped = heard(strike), heard([strike, Hold(at=TOP, grip=0.0)])
    after = round(0.05 * 48000)
    assert decibels((closed - stepped)[after:], closed[after:]) <= -55
    low = round(16000 * 0.5)
    error, whole = np.fft.rfft(closed - stepped)[:low], np.fft.rfft(closed)[:low]
    assert np.linalg.norm(error) <= 10 ** (-50 / 20) * np.linalg.norm(whole)


def test_a_pluck_leaves_each_mode_with_what_a_step_of_force_does() -> None:
    force, rise = 2.0, 0.2
    sound = heard(Pluck(at=TOP, force=force, rise=rise), seconds=0.6)
    gains = (BLOCK.gains.at(*place(TOP)) * BLOCK.gains.toward(np.array([[1.0, 0, 0]])))[0, 0]
    poles = -BLOCK.decays + 2j * np.pi * BLOCK.frequencies
    times = np.arange(len(sound)) / 48000 - rise
    ringing = np.imag(np.exp(np.outer(times, poles)) @ (-gains * force / poles))
    later = times > 0.01
    # Putting the load on is heard, as said, by the modes below some 2 / rise alone.
    assert decibels((sound - ringing)[later], ringing[later]) <= -40


def place(at: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    contact = BLOCK.contact(at)
    return contact.point[None], contact.direction[None]


def test_a_held_body_decays_as_fast_as_its_grip_says() -> None:
    hold = Hold(at=TOP, grip=30.0, time=0.1)
    strike = Strike(at=TOP, impulse=0.01)
    free, held = heard([strike, replace(hold, grip=0.0)]), heard([strike, hold])
    assert np.array_equal(free[:4700], held[:4700])
    shapes = np.array([BLOCK.gains.at(place(TOP)[0], axis[None])[0, 0] for axis in np.eye(3)])
    raised = 30.0 / 2 * np.square(shapes).sum(axis=0)
    times = np.arange(len(free)) / 48000
    for mode in np.argsort(raised)[-2:]:
        window = np.hanning(4800) * np.exp(-2j * np.pi * FREQUENCIES[mode] * times[:4800])
        levels = [
            abs(each[start : start + 4800] @ window)
            for each in (free, held)
            for start in (6000, 9000)
        ]
        more = np.log(levels[2] / levels[3]) - np.log(levels[0] / levels[1])
        assert more == pytest.approx(raised[mode] * 3000 / 48000, rel=0.05)


def test_a_hand_lets_go() -> None:
    strike = Strike(at=TOP, impulse=0.01)
    short = heard([strike, Hold(at=TOP, grip=100.0, time=0.1, seconds=0.05)])
    long = heard([strike, Hold(at=TOP, grip=100.0, time=0.1)])
    assert np.abs(short[-4800:]).max() > 3 * np.abs(long[-4800:]).max()


def test_a_hand_after_the_end_changes_nothing_and_is_told() -> None:
    strike = Strike(at=TOP, impulse=0.01)
    alone = render(BLOCK, strike, seconds=0.1)
    both = render(BLOCK, [strike, Hold(at=TOP, time=0.1)], seconds=0.1)
    np.testing.assert_array_equal(both.samples, alone.samples)
    told = "1 of 2 excitations (hold) begin after the end at 0.1 s of the sound and are left out"
    assert any(note.startswith(told) for note in both.notes)


def test_strikes_that_move_no_mode_are_told_and_patches_end_with_the_body() -> None:
    drum = CircularMembrane(radius=0.15, thickness=5e-4, tension=1000.0)
    drum = analyze(drum, "nylon", band=(20, 1500))
    across = Strike(at=(0.05, 0, 0), direction=(1.0, 0.0, 0.0))
    for still in (across, Strike(at=(0.15, 0, 0))):
        (note,) = (each for each in render(drum, still, seconds=0.1).notes if "no mode" in each)
        assert note.startswith("1 of 1 strikes, as that at (0.")
    for seen in (Strike(at=(0.05, 0, 0)), Strike()):
        assert not any("no mode" in note for note in render(drum, seen, seconds=0.1).notes)
    with pytest.raises(OptionError, match=r"patch is 5.0 m: give at most 0.3 m"):
        render(drum, replace(across, patch=5.0), seconds=0.1)


def test_what_happens_together_adds_up() -> None:
    strike = Strike(at=ELSEWHERE, impulse=0.01, time=0.1)
    track = ForceTrack(at=TOP, force=np.sin(np.arange(4800) / 7), sample_rate=48000)
    both, apart = heard([SCRAPE, strike, track]), [heard(each) for each in (SCRAPE, strike, track)]
    assert decibels(both - sum(apart), both) <= -120


def test_sounds_of_unsaid_length_end_when_all_has_died_away() -> None:
    sound = render(BLOCK, SCRAPE)
    pushed = 0.07 / 0.2
    assert sound.samples.shape[1] / 48000 > pushed + 0.5
    assert np.abs(sound.samples[0, -100:]).max() < 2e-3 * np.abs(sound.samples).max()
    assert render(BLOCK, [SCRAPE, Strike(at=TOP, time=9.0)]).samples.shape[1] > 9.5 * 48000


def test_pushes_without_end_need_a_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("struck.scene.render.LONGEST_UNSAID", 2.0)
    endless = replace(SCRAPE, repeat="back")
    with pytest.raises(OptionError, match=r"not ended after 2 s.*seconds="):
        render(BLOCK, endless)
    assert len(heard(endless, seconds=1.0)) == 48000


class Products(Gains):
    """The gains of the block in three parts, as a measured field would have."""

    calibrated = True
    rank = 3
    _SHARES = np.array([0.2, 0.5, 0.3])

    def changed(self, *_: object) -> Gains:
        raise NotImplementedError

    def at(self, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
        return BLOCK.gains.at(points, directions) * self._SHARES[:, None]

    def toward(self, listeners: np.ndarray) -> np.ndarray:
        return np.repeat(BLOCK.gains.toward(listeners), 3, axis=1)


def test_expanded_gains_sound_the_same() -> None:
    model = replace(BLOCK, gains=Products()).expanded()
    assert len(model.frequencies) == 3 * len(FREQUENCIES)
    assert BLOCK.expanded() is BLOCK
    random = np.random.default_rng(3)
    force = random.standard_normal(3000)
    contact = BLOCK.contact(TOP)
    sounds = []
    for each in (BLOCK, model):
        track = Given(force, each.gains.at(contact.point[None], contact.direction[None])[0, 0])
        outputs = each.gains.toward(np.array([[1.0, 0, 0]]))[:, 0]
        driven = DrivenBody(model=each, outputs=outputs, actions=[track], sample_rate=48000)
        sounds.append(driven.samples(0.2, min_seconds=0.0)[0])
    assert decibels(sounds[0] - sounds[1], sounds[0]) <= -200


class Given:
    """A force at a place whose drive is given."""

    def __init__(self, force: np.ndarray, drive: np.ndarray) -> None:
        self._force, self._drive = force, drive

    def begin(self, model: object, sample_rate: float, *, start: int = 0) -> object:
        del model, sample_rate
        from struck.excitation.excitation import Burst
        from struck.excitation.pulses import Samples

        return Burst(Samples(first=0, force=self._force), self._drive, start=start)


def test_without_the_core_it_sounds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the last bit of single precision here and there."""
    with_core = heard([SCRAPE, Hold(at=TOP, time=0.2)])
    for module in (resonators, texture):
        monkeypatch.setattr(module, "entry", lambda _: None)
    assert decibels(heard([SCRAPE, Hold(at=TOP, time=0.2)]) - with_core, with_core) <= -150


def test_a_hand_may_hold_a_body_of_thousands_of_modes() -> None:
    many = block(np.linspace(200.0, 20000.0, 3150))
    held = render(many, [Strike(at=TOP, impulse=0.01), Hold(grip=3e4)], seconds=0.02)
    assert np.isfinite(held.samples).all()


@pytest.mark.prove
@pytest.mark.parametrize(
    ("strike", "few", "seconds"),
    [
        pytest.param(Strike(at=TOP, impulse=0.01), 800, (1.0, 1.0), id="closed form"),
        pytest.param(GAUSSIAN, 60, (0.6, 4.8), id="Gaussian"),
        pytest.param(
            replace(GAUSSIAN, transient=True),
            60,
            (0.6, 4.8),
            id="transient",
            marks=pytest.mark.prove,
        ),
        pytest.param(
            replace(GAUSSIAN, patch=1e-3), 60, (0.6, 4.8), id="patch", marks=pytest.mark.prove
        ),
    ],
)
def test_strikes_cost_as_many_times_as_there_are(
    strike: Strike, few: int, seconds: tuple[float, float]
) -> None:
    """Eight times as many, as dense or in a sound as much longer; quadratic cost is 25 or more."""

    def seconds_of(count: int, length: float) -> float:
        strikes = [replace(strike, time=length * i / count) for i in range(count)]
        begun = time.process_time()
        render(BLOCK, strikes, seconds=length)
        return time.process_time() - begun

    render(BLOCK, strike, seconds=0.1)  # imports and tables
    few_and_many = list(zip((few, 8 * few), seconds, strict=True))
    # Once in three turns: whatever shares the core may double the time of one of the two.
    assert any(
        many <= 16 * one
        for one, many in ([seconds_of(*each) for each in few_and_many] for _ in range(3))
    )
