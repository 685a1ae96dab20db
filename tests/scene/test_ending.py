"""Ends of sounds: fades where they are cut off, and notes on levels and contact times."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.cli import main
from struck.errors import OptionError
from struck.files.sound import FULL_SCALE
from struck.model.model import ModalModel
from struck.scene import Scene
from struck.scene.stems import save_stems
from struck.shapes import Bar

BAR = Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
FADE = 0.01


@pytest.fixture(scope="module")
def steel() -> ModalModel:
    return struck.analyze(BAR, "steel")


@pytest.fixture(scope="module")
def dead() -> ModalModel:
    """Return a bar that falls by 60 dB within 0.1 s."""
    return struck.analyze(BAR, "steel").damped(struck.Rayleigh(mass=140, stiffness=0))


def under(part: NDArray[np.float64], level: float) -> float:
    """Return the largest sample of a part over a level, dB."""
    return float(20 * np.log10(max(np.abs(part).max(), 1e-30) / level))


TOUCHES = {
    "strike": struck.Strike(at=(0.02,)),
    "soft": struck.Strike(at=(0.02,), striker="felt"),
    "scrape": struck.Scrape(path=[(0.02,), (0.28,)], speed=0.05, load=1.0),
}
EARS = {"ear": None, "two": struck.Stereo(position=(0, 1, 0))}


@pytest.mark.parametrize(
    ("touch", "ears", "rate"), [*itertools.product(TOUCHES, EARS, (48_000, 22_050))]
)
def test_a_sound_that_is_cut_off_fades_out(
    steel: ModalModel, touch: str, ears: str, rate: int
) -> None:
    given = {"seconds": 0.2, "sample_rate": rate, "listener": EARS[ears]}
    sound = struck.render(steel, TOUCHES[touch], **given)
    bare = struck.render(steel, TOUCHES[touch], **given, fade=0)
    first, last = sound.samples.shape[1] - round(FADE * rate), round(0.001 * rate)
    assert np.array_equal(sound.samples[:, :first], bare.samples[:, :first])
    level = float(np.sqrt((bare.samples[:, first - round(FADE * rate) : first] ** 2).mean()))
    assert under(sound.samples[:, -1:], level) < -60
    assert under(sound.samples[:, -last:], level) < -30
    assert under(bare.samples[:, -last:], level) > -20


def test_a_sound_that_has_decayed_is_the_same_to_the_bit(dead: ModalModel) -> None:
    for seconds in (None, 0.5):
        strike = struck.Strike(at=(0.02,))
        sound = struck.render(dead, strike, seconds=seconds)
        bare = struck.render(dead, strike, seconds=seconds, fade=0)
        assert sound.samples.tobytes() == bare.samples.tobytes()
        assert sound.notes == bare.notes


def test_the_length_of_the_fade_is_as_given(steel: ModalModel) -> None:
    bare = struck.render(steel, seconds=0.2, excitations=struck.Strike(), fade=0).samples
    for fade in (0.002, 0.05, 0.2):
        sound = struck.render(steel, struck.Strike(), seconds=0.2, fade=fade).samples
        changed = np.flatnonzero((sound != bare).any(axis=0))
        assert (bare.shape[1] - changed[0]) / 48_000 == pytest.approx(fade, rel=0.05)
        assert not sound[:, -1].any()


@pytest.mark.parametrize(
    ("fade", "message"),
    [
        (-0.01, "fade is -0.01 s"),
        (np.nan, "fade is nan s"),
        (np.inf, "fade is inf s"),
        (0.3, "fade is 0.3 s and the sound lasts 0.2 s"),
    ],
)
def test_impossible_fades_are_refused(steel: ModalModel, fade: float, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        struck.render(steel, struck.Strike(), seconds=0.2, fade=fade)


def test_sounds_shorter_than_a_fade_are_rendered(steel: ModalModel) -> None:
    sound = struck.render(steel, struck.Strike(), seconds=0.005)
    assert sound.samples.shape[1] == 240
    assert not sound.samples[:, -1].any()


def test_stems_add_up_to_the_sound_of_all(
    steel: ModalModel, dead: ModalModel, tmp_path: Path
) -> None:
    """A stem that has decayed or that is soft fades as the whole does."""
    bodies = {
        "long": struck.Body(model=steel, excitations=struck.Strike(at=(0.02,))),
        "short": struck.Body(model=dead, excitations=struck.Strike(at=(0.02,))),
    }
    for seconds, fade in ((0.3, None), (0.3, 0), (0.05, 0.02)):
        heard = {"seconds": seconds, "fade": fade}
        total = struck.render(list(bodies.values()), **heard)
        factor = total.save(tmp_path / "all.wav")
        stems = save_stems(Scene(bodies=bodies), tmp_path / "all.wav", factor=factor, **heard)
        added = np.sum([struck.Sound.load(path).samples for path in stems], axis=0)
        scale = factor * FULL_SCALE
        assert np.abs(added - scale * total.samples).max() < 1e-6 * scale * total.peak


LEVELS = [(1e-7, True), (1e-2, False)]


@pytest.mark.parametrize(("impulse", "soft"), LEVELS)
def test_what_nobody_hears_is_noted_with_its_level(
    steel: ModalModel, impulse: float, *, soft: bool
) -> None:
    sound = struck.render(steel, struck.Strike(at=(0.02,), impulse=impulse), seconds=0.3)
    level = 20 * np.log10(sound.peak / np.sqrt(2) / 20e-6)
    notes = [note for note in sound.notes if "too soft to be heard" in note]
    assert (level < 20) == soft
    assert len(notes) == soft
    if soft:
        assert f"{level:.0f} dB SPL" in notes[0]


def test_the_limit_is_a_tone_of_20_decibels(steel: ModalModel) -> None:
    strike = {"at": (0.02,), "duration": 1e-4}
    peak = struck.render(steel, struck.Strike(**strike, impulse=1e-3), seconds=0.3).peak
    for factor, soft in ((0.99, True), (1.01, False)):
        impulse = 1e-3 * 2.8e-4 / peak * factor
        notes = struck.render(steel, struck.Strike(**strike, impulse=impulse), seconds=0.3).notes
        assert any("dB SPL" in note for note in notes) == soft


@pytest.mark.parametrize(
    ("strike", "seconds", "hint"),
    [
        ({"duration": 3.0}, None, "did you mean seconds=3"),
        ({"duration": 3.0}, 1.0, "did you mean duration=0.003"),
        ({"striker": "fingertip", "speed": 1e-6}, 1.0, "give a higher speed="),
        ({"duration": 0.1}, 1.0, ""),
        ({"striker": "felt", "speed": 0.5}, 1.0, ""),
    ],
)
def test_contact_times_that_no_blow_has_are_questioned(
    steel: ModalModel, strike: dict[str, float], seconds: float | None, hint: str
) -> None:
    notes = struck.render(steel, struck.Strike(at=(0.02,), **strike), seconds=seconds).notes
    asked = [note for note in notes if "a strike pushes for" in note]
    assert len(asked) == bool(hint)
    assert all(hint in note for note in asked)


def test_a_questioned_contact_time_names_its_body(steel: ModalModel) -> None:
    strikes = {"short": struck.Strike(at=(0.02,)), "long": struck.Strike(at=(0.02,), duration=3.0)}
    bodies = [struck.Body(model=steel, excitations=strike) for strike in strikes.values()]
    notes = struck.render(bodies, seconds=0.1, listener=(0, 2, 0)).notes
    (note,) = [note for note in notes if "pushes for" in note]
    assert note.startswith("body 1: a strike pushes for 3 s, and blows last at most 0.1 s: did you")


def test_the_shell_fades_and_asks_in_its_own_words(
    steel: ModalModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    struck.save(steel, tmp_path / "bar.struck")
    words = ["render", str(tmp_path / "bar.struck"), "--strike", "0.02"]
    out = ["-o", str(tmp_path / "bar.wav")]
    assert main([*words, "--duration", "3", *out]) == 0
    told = capsys.readouterr().out
    assert "did you mean --seconds 3" in told
    assert "dB SPL" in told
    assert main([*words, "--striker", "fingertip", "--speed", "0.01", *out]) == 0
    assert "dB SPL" in capsys.readouterr().out
    assert main([*words, "--seconds", "0.3", "--fade", "0", *out]) == 0
    assert struck.Sound.load(tmp_path / "bar.wav").samples[0, -1]
    assert main([*words, "--seconds", "0.3", *out]) == 0
    assert not struck.Sound.load(tmp_path / "bar.wav").samples[0, -1]
    assert main([*words, "--seconds", "0.3", "--fade", "1", *out]) == 2
    assert "--fade is 1 s and the sound lasts 0.3 s" in capsys.readouterr().err
