"""Two ears while bodies are played, against the offline render and against clicks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.ears.listeners import Listener, Mono, Stereo
from struck.errors import ContactError, OptionError
from struck.excitation.pulses import LEAD
from struck.excitation.strike import Strike
from struck.live.ears import FARTHEST
from struck.model.gains import ShapeGains
from tests.live.hand import BLOCK, HandPlayer, Make, ball, by_hand
from tests.live.test_player import LATE, OPENED, decibels
from tests.scene.test_mixing import sided

__all__ = ["by_hand"]

Array = NDArray[np.float64]
LEFT = Stereo(position=(0.0, 1.0, 0.0), facing=(0.6, -0.8, 0.0))
AHEAD = Mono(position=(2.0, 0.0, 0.0))
BLOW = Strike(at="top", impulse=1e-3, duration=1e-3, shape="gaussian")


def both(player: HandPlayer, blocks: int, between: Callable[[int], None] = lambda _: None) -> Array:
    """Return what both channels play (2, n)."""
    heard = []
    for number in range(blocks):
        between(number)
        player._feeder.fill_up()
        heard.append(player.hand.play().copy())
    return np.concatenate(heard, axis=1).astype(np.float64)


@pytest.mark.parametrize("listener", [LEFT, AHEAD], ids=["ball", "mono"])
def test_ears_hear_what_the_render_does(by_hand: Make, listener: Listener) -> None:
    model = ball()
    player = by_hand(model, volume=-20, listener=listener)
    player.hear(OPENED)
    player.strike(BLOW)
    waiting = BLOCK + LEAD + LATE + player._host._ears.propagation.lead
    heard = both(player, 60)[:, waiting:] / player.gain
    expected = struck.render(model, BLOW, seconds=0.12, listener=listener).samples
    for channel, row in enumerate(heard):
        wanted = expected[channel % len(expected)]
        count = min(len(row), len(wanted))
        assert decibels(row[:count], wanted[:count]) < -60


def test_one_channel_gets_the_mean_of_both_ears(
    by_hand: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = []
    for channels in (2, 1):
        monkeypatch.setattr("tests.live.hand.Hand.channels", channels)
        player = by_hand(ball(), volume=-30, listener=LEFT)
        player.hear(OPENED)
        player.strike(BLOW)
        rows.append(both(player, 20).mean(axis=0))
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-6 * np.abs(rows[0]).max())


def ringing(by_hand: Make) -> HandPlayer:
    player = by_hand(replace(ball(), decays=np.full(40, 1.0)), volume=-30, listener=LEFT)
    player.hear(OPENED)
    player.strike(BLOW)
    player.hear(20)
    return player


def bend(samples: Array) -> float:
    return float(np.abs(np.diff(samples, 2, axis=1)).max())


def test_a_listener_who_walks_and_turns_does_not_click(by_hand: Make) -> None:
    def go(player: HandPlayer, block: int) -> None:
        turn = block / 40
        player.listener = Stereo(
            position=(0.3 * np.sin(turn), 1.0, 0.2), facing=(np.cos(turn), np.sin(turn), 0)
        )

    still = bend(both(ringing(by_hand), 200))
    player = ringing(by_hand)
    assert bend(both(player, 200, lambda block: go(player, block))) <= 1.5 * still


def test_a_listener_who_turned_hears_as_one_who_stood_there(by_hand: Make) -> None:
    there = Stereo(position=(1.0, 0.0, 0.0), facing=(0.0, -1.0, 0.0))
    player = ringing(by_hand)
    player.listener = there
    assert player.listener is there
    turned = both(player, 100)[:, 40 * BLOCK :]
    left, right = np.sqrt(np.square(turned).mean(axis=1))
    assert right > 1.2 * left


def test_blocks_without_news_go_on_without_a_click(by_hand: Make) -> None:
    still = bend(both(ringing(by_hand), 60))
    player = ringing(by_hand)
    heard = [both(player, 20)]
    for late in (1, 3, 2):
        heard.append(
            np.stack([player.hand.play().copy() for _ in range(late + 1)], axis=1)
            .reshape(2, -1)
            .astype(float)
        )
        heard.append(both(player, 11))
    assert bend(np.concatenate(heard, axis=1)) <= 1.1 * still
    assert player.late == 6


@pytest.mark.parametrize(
    ("listener", "error", "message"),
    [
        ((1.0, 0.0, 0.0), OptionError, "keeps to ears"),
        (AHEAD, OptionError, "the player has 2 ears, the new listener 1"),
        (Stereo(position=(0.05, 0.0, 0.0)), ContactError, "inside"),
        (Stereo(position=(FARTHEST + 1, 0.0, 0.0)), OptionError, "at most 340 m"),
        (Stereo(position=([0, 1], [(1, 0, 0), (2, 0, 0)])), OptionError, "that stay"),
    ],
)
def test_listeners_that_cannot_be_are_refused(
    by_hand: Make, listener: object, error: type[Exception], message: str
) -> None:
    player = by_hand(ball(), listener=LEFT)
    with pytest.raises(error, match=message):
        player.listener = listener
    assert player.listener is LEFT


def test_a_bare_position_stays_one(by_hand: Make) -> None:
    player = by_hand(ball(), listener=(1, 0, 0))
    with pytest.raises(OptionError, match="keeps to ears"):
        player.listener = LEFT


def test_a_timbre_field_is_not_played_for_two_ears(by_hand: Make) -> None:
    body = ball()
    assert isinstance(body.gains, ShapeGains)
    model = replace(body, gains=sided(body.gains))
    with pytest.raises(OptionError, match="a body with a timbre field is played"):
        by_hand(model, listener=LEFT)
