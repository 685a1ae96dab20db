"""Rendering a model of one recorded place, which every listener hears alike."""

from __future__ import annotations

import numpy as np
import pytest

from struck.ears.listeners import Binaural, Listener, Mono, Stereo
from struck.errors import ContactError
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.strike import Strike
from struck.scene.render import render
from tests.model.test_single_point import RATE, model


@pytest.mark.parametrize(
    ("listener", "channels"),
    [
        (None, 1),
        (Mono(position=(0, 1, 0)), 1),
        (Stereo(position=(0, 1.5, 0)), 2),
        (Binaural(position=(0, 1.5, 0)), 2),
    ],
)
def test_every_listener_hears_it(listener: Listener | None, channels: int) -> None:
    sound = render(model(), Strike(), seconds=1, listener=listener)
    assert sound.samples.shape == (channels, RATE)
    assert np.isfinite(sound.samples).all()
    for channel in sound.samples:
        spectrum = np.abs(np.fft.rfft(channel))
        assert spectrum.argmax() == 440


def test_recorded_bodies_know_no_way_to_scrape_or_roll() -> None:
    scrape = Scrape(path=["recorded", "recorded"], speed=0.1, load=1.0)
    roll = Roll(path=[(0.1,), (0.2,)], speed=0.1, radius=0.01, mass=0.02)
    for touch in (scrape, roll):
        with pytest.raises(ContactError, match="knows places that were struck and no way between"):
            render(model(), touch, seconds=0.1)
