"""The picture of a sound map shows what the map holds."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.collections import TriMesh
from PIL import Image

from struck.perception.sound_map import SoundMap, sound_map
from struck.report.sound_map_picture import sound_map_picture
from tests.perception.bodies import hinged_bar


@pytest.fixture(scope="module")
def bar_map() -> SoundMap:
    return sound_map(hinged_bar(8, cells=40), 6.0, level=60)


def test_stored_contacts_on_the_side_shown_are_marked(bar_map: SoundMap) -> None:
    figure = sound_map_picture(bar_map)
    above = np.count_nonzero(bar_map.directions[:, 2] < -0.5)
    for axes in figure.axes[:2]:
        (dots,) = axes.lines
        assert len(dots.get_xdata()) == above
    assert f"{len(bar_map.contacts)} stored" in figure.get_suptitle()
    assert f"{bar_map.bound:.2f} dB" in figure.get_suptitle()


def test_colours_follow_brightness_and_silence_is_grey(bar_map: SoundMap) -> None:
    figure = sound_map_picture(bar_map, cells=False)
    (axes, bar) = figure.axes
    (shades,) = (each for each in axes.collections if isinstance(each, TriMesh))
    colours = np.unique(np.round(shades.get_facecolor()[:, :3], 2), axis=0)
    assert len(colours) > 20
    assert np.abs(colours - np.array([0.85, 0.85, 0.85])).sum(axis=1).min() < 0.02  # its sides
    assert "brightness" in bar.get_xlabel()


def test_the_picture_has_ink_on_white(bar_map: SoundMap) -> None:
    data = io.BytesIO()
    sound_map_picture(bar_map).savefig(data, format="png", dpi=60)
    pixels = np.asarray(Image.open(data).convert("RGB"), float)
    assert (pixels == 255).all(axis=2).mean() > 0.3
    assert (np.ptp(pixels, axis=2) > 60).mean() > 0.02
