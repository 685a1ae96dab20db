"""Recoil while it is played: the callback, driven by hand, against offline sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import ModalModel, Strike
from struck.errors import OptionError
from struck.excitation.pulses import LEAD
from struck.live.limiter import DELAY, limiter
from tests.live.hand import BLOCK, RATE, Make, ball, by_hand
from tests.radiation.bodies import ball as round_surface
from tests.radiation.test_added_mass import rigid

__all__ = ["by_hand"]
Array = NDArray[np.float64]
LATE = round(limiter(sample_rate=RATE, channels=2)[DELAY])
OPENED = 10


@pytest.fixture
def marble() -> ModalModel:
    return rigid(round_surface(0.008, 2), 0.005)


def test_a_played_marble_sounds_as_a_rendered_one(by_hand: Make, marble: ModalModel) -> None:
    player = by_hand(marble, volume=-20, listener=(1, 0, 0))
    player.hear(OPENED)
    blow = Strike(at="vertex:3", impulse=1e-3, duration=5e-5)
    player.strike(blow)
    heard = player.hear(10)[BLOCK + LEAD + LATE :] / player.gain
    expected = struck.render(marble, blow, seconds=0.02, fade=0, listener=(1, 0, 0)).samples[0]
    count = min(len(heard), len(expected))
    apart = np.abs(heard[:count] - expected[:count]).max()
    assert 20 * np.log10(apart / np.abs(expected).max()) < -60


def test_a_held_and_changed_body_keeps_its_recoil(by_hand: Make, marble: ModalModel) -> None:
    player = by_hand(marble, volume=-20, listener=(1, 0, 0))
    player.hear(OPENED)
    player.dampen("vertex:3", 1e3)
    player.change(rigid(round_surface(0.008, 2), 0.01))
    player.strike(at="vertex:3", impulse=1e-3)
    assert np.abs(player.hear(10)).max() > 0
    with pytest.raises(OptionError, match="one has recoil, the other none"):
        by_hand(ball()).change(_recoiling(ball(seed=1)))


def _recoiling(model: ModalModel) -> ModalModel:
    return replace(model, recoil=rigid(round_surface(0.1, 2), 1.0).recoil)


def test_modes_and_recoil_play_together_for_two_ears(by_hand: Make) -> None:
    model = _recoiling(ball())
    ears = struck.Binaural(position=(0, 1, 0))
    player = by_hand(model, volume=-20, listener=ears)
    player.hear(OPENED)
    player.strike(at="top", impulse=1e-2)
    assert np.isfinite(player.hear(40)).all()
    player = by_hand(model, volume=-20, listener=(1, 0, 0))
    player.hear(OPENED)
    player.strike(Strike(at="top", impulse=1e-3, duration=1e-3))
    heard = player.hear(40)[BLOCK + LEAD + LATE :] / player.gain
    blow = Strike(at="top", impulse=1e-3, duration=1e-3)
    expected = struck.render(model, blow, seconds=0.1, fade=0, listener=(1, 0, 0)).samples[0]
    count = min(len(heard), len(expected))
    apart = np.abs(heard[:count] - expected[:count]).max()
    assert 20 * np.log10(apart / np.abs(expected).max()) < -35  # of the modes, see test_player
