from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile

from struck.errors import OptionError
from struck.report import scene2002
from struck.report.obrien2002 import SCENES, constants

pytest.importorskip("mujoco")

# Table 1: the base frequency, Hz, and its decay, 1/s, where both are of one mode (the others are
# misprints, which docs/explanation/notes_on_the_papers.md lists).
DECAYS = {
    "chime": (587.4, 0.681),
    "bowl 1": (551.3, 15.6),
    "bunny, ceramic": (855.9, 19.46),
    "plastic shelf": (488.9, 29.7),
    "aluminium shelf": (691.5, 0.944),
    "the end": (247.7, 15.2),
}


@pytest.mark.parametrize("name", DECAYS)
def test_constants_give_the_decays_that_the_table_prints(name: str) -> None:
    frequency, decay = DECAYS[name]
    found = constants(name).damping.decays(np.array([frequency]))
    assert found[0] == pytest.approx(decay, rel=5e-3)


def test_other_scenes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="give one of chimes, bowl"):
        scene2002("bunnies", tmp_path)


def lowest(path: Path, least: float, most: float) -> float:
    """Return the frequency of the strongest partial of a band of a sound, Hz."""
    samples, rate = soundfile.read(path)
    mono = samples.sum(axis=1) * np.hanning(len(samples))
    levels = np.abs(np.fft.rfft(mono, 8 * len(mono)))
    frequencies = np.fft.rfftfreq(8 * len(mono), 1 / rate)
    band = (frequencies > least) & (frequencies < most)
    return float(frequencies[band][np.argmax(levels[band])])


@pytest.mark.prove
@pytest.mark.parametrize("name", SCENES)
def test_each_scene_is_made_and_heard(tmp_path: Path, name: str) -> None:
    sounds = scene2002(name, tmp_path, accuracy="preview")
    assert len(sounds) == (2 if name == "bowl" else 1)
    for path in sounds:
        samples, rate = soundfile.read(path)
        assert rate == 48_000
        assert 0.5 < np.abs(samples).max() <= 1
        # It is quiet before anything touches, and dies away.
        tail = samples[-rate // 4 :]
        assert np.sqrt(np.mean(tail**2)) < 0.1 * np.abs(samples).max()
    assert (tmp_path / f"{name}.xml").read_text(encoding="utf-8").startswith("<mujoco>")
    for ending in (".npz", ".glb", ".png"):
        assert (tmp_path / f"{name}{ending}").stat().st_size > 500
