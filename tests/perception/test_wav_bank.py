"""A bank of WAV files plays what its map says, read by nothing but its manifest."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from struck.errors import FileFormatError, OptionError
from struck.files.sound import Sound
from struck.model.mesh import Mesh, Surface
from struck.model.model import ModalModel
from struck.perception.sound_map import SoundMap, sound_map
from struck.perception.wav_bank import write_bank
from tests.perception.bodies import hinged_bar

RATE = 8000
TIMES = np.arange(400) / RATE


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    return hinged_bar(8, cells=40)


@pytest.fixture(scope="module")
def bar_map(bar: ModalModel) -> SoundMap:
    return sound_map(bar, 6.0, level=60)


def ringing(model: ModalModel, gains: np.ndarray) -> np.ndarray:
    """Return the formula of a unit impulse's answer, sample by sample."""
    poles = -model.decays + 2j * np.pi * model.frequencies
    return (gains[:, None] * np.exp(poles[:, None] * TIMES)).sum(axis=0).imag


def rendered(model: ModalModel, made: SoundMap, at: np.ndarray, direction: np.ndarray) -> Sound:
    drive = model.gains.at(at[None], direction[None])[0]
    gains = (drive * model.gains.toward(made.listener[None])[0]).sum(axis=0)
    return Sound(samples=ringing(model, gains), sample_rate=RATE)


def test_any_contact_can_be_played_from_the_manifest(
    bar: ModalModel, bar_map: SoundMap, tmp_path: Path
) -> None:
    path = write_bank(bar_map, tmp_path / "bank", lambda at, push: rendered(bar, bar_map, at, push))
    told = json.loads(path.read_text())
    files = sorted(each["file"] for each in told["contacts"])
    assert files == sorted(each.name for each in path.parent.glob("*.wav"))
    surface = told["surface"]
    mesh = Mesh(points=np.array(surface["points"]), faces=np.array(surface["triangles"]))
    for place in ((0.07, 0.004, 0.0025), (0.31, 0.006, 0.0025), (0.11, 0.002, -0.0025)):
        faces, shares = Surface(mesh).barycentric(np.array([place]))
        factor = shares[0] @ np.array(surface["factors"][faces[0]])
        file = told["contacts"][surface["contacts"][faces[0]]]["file"]
        samples, rate = soundfile.read(path.parent / file)
        assert rate == told["sample_rate"] == RATE
        wanted = ringing(bar, bar_map.at(place))
        step = 2**-23 / told["factor"]
        played = samples * factor / told["factor"]
        assert np.abs(played - wanted).max() < 2 * step * factor + 2e-6 * np.abs(wanted).max()


def test_all_files_have_one_scale_and_the_loudest_fills_it(
    bar: ModalModel, bar_map: SoundMap, tmp_path: Path
) -> None:
    path = write_bank(bar_map, tmp_path, lambda at, push: rendered(bar, bar_map, at, push))
    peaks = [np.abs(soundfile.read(each)[0]).max() for each in path.parent.glob("*.wav")]
    assert 20 * np.log10(max(peaks)) == pytest.approx(-1, abs=1e-3)
    assert min(peaks) < 0.95 * max(peaks)


def test_a_bank_that_cannot_be_whole_has_no_manifest(bar_map: SoundMap, tmp_path: Path) -> None:
    silence = Sound(samples=np.zeros(8), sample_rate=RATE)
    with pytest.raises(OptionError, match="are silent"):
        write_bank(bar_map, tmp_path / "a", lambda *_: silence)
    sounds = iter(
        Sound(samples=np.ones(8), sample_rate=RATE + number)
        for number in range(len(bar_map.contacts))
    )
    with pytest.raises(OptionError, match="render all alike"):
        write_bank(bar_map, tmp_path / "a", lambda *_: next(sounds))
    loud = Sound(samples=np.ones(8), sample_rate=RATE)
    with pytest.raises(OptionError, match="mp3"):
        write_bank(bar_map, tmp_path / "a", lambda *_: loud, encoding="mp3")
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(FileFormatError, match="another name"):
        write_bank(bar_map, tmp_path / "file", lambda *_: loud)
