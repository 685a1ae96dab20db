"""Rendering a model of one recorded place, which every listener hears alike."""

from __future__ import annotations

import numpy as np
import pytest

from struck.ears.listeners import Binaural, Listener, Mono, Stereo
from struck.excitation.scrape import Scrape
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


def test_every_listener_hears_it_scraped() -> None:
    scrape = Scrape(path=[(0.0,), (0.1,)], speed=0.2, load=1.0, seconds=0.2)
    near, far = (
        render(model(), scrape, seconds=0.3, listener=Mono(position=(0, distance, 0))).samples[0]
        for distance in (1.0, 2.0)
    )
    assert np.abs(far).max() == pytest.approx(np.abs(near).max() / 2, rel=1e-3)
