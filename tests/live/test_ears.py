"""Two ears while bodies are played, against the offline render and against clicks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.ears.listeners import Binaural, Listener, Mono, Stereo
from struck.errors import ContactError, OptionError
from struck.excitation.pulses import LEAD
from struck.excitation.strike import Strike
from struck.live.ears import MAX_DISTANCE
from struck.model.damping import InternalFriction
from struck.model.gains import ShapeGains
from struck.scene.body import Body, Scene
from tests.live.hand import BLOCK, HandPlayer, Make, ball, by_hand
from tests.live.test_player import LATE, OPENED, decibels
from tests.radiation.sources import RADIUS, radiating_ball
from tests.samples import sampled
from tests.scene.test_mixing import sided

__all__ = ["by_hand"]

Array = NDArray[np.float64]
LEFT = Stereo(position=(0.0, 1.0, 0.0), facing=(0.6, -0.8, 0.0))
AHEAD = Mono(position=(2.0, 0.0, 0.0))
BLOW = Strike(at="top", impulse=1e-3, duration=0.6e-3, shape="gaussian")


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
    expected = struck.render(model, BLOW, seconds=0.12, fade=0, listener=listener).samples
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
        (AHEAD, OptionError, "the player has 2 ears and field=None, the new listener 1"),
        (Stereo(position=(0.05, 0.0, 0.0)), ContactError, "inside"),
        (Stereo(position=(MAX_DISTANCE + 1, 0.0, 0.0)), OptionError, "at most 340 m"),
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


FIELD, _ = radiating_ball()
RUNG = replace(FIELD, decays=np.full(len(FIELD.decays), 0.5))
SOFT = Strike(at=(RADIUS, 0, 0), impulse=1e-3, duration=1e-3, shape="gaussian")
FIELD_EARS = {
    "mono": AHEAD,
    "ball": LEFT,
    "kemar": Binaural(position=(0.3, 0.4, 0.1), facing=(1, 0, 0)),
    "bare ears": replace(LEFT, field="ears"),
}


@pytest.mark.parametrize("name", sampled(FIELD_EARS, "ball", "bare ears", "mono"))
def test_a_field_is_played_as_it_is_rendered(by_hand: Make, name: str) -> None:
    listener, turned = FIELD_EARS[name], (0.8, 0, 0, 0.6)
    plain = Body(model=ball(), position=(0, 0, -3.0))
    field = Body(model=FIELD, rotation=turned)
    scene = Scene(bodies={"plain": plain, "field": field})
    player = by_hand(scene, volume=-20, listener=listener, ahead=2)
    player.hear(OPENED)
    player.strike(SOFT, body="field")
    player.strike(BLOW, body="plain")
    waiting = BLOCK + LEAD + LATE + player._host._ears.propagation.lead
    heard = both(player, 60)[:, waiting:] / player.gain
    bodies = [replace(plain, excitations=BLOW), replace(field, excitations=SOFT)]
    expected = struck.render(bodies, seconds=0.12, fade=0, listener=listener).samples
    for channel, row in enumerate(heard):
        wanted = expected[channel % len(expected)]
        count = min(len(row), len(wanted))
        measured = listener.filters(48000, brief=True).taps != listener.filters(48000).taps
        assert decibels(row[:count], wanted[:count]) < (-20 if measured else -60)


@pytest.mark.parametrize("name", FIELD_EARS)
def test_a_walk_through_a_field_does_not_click(by_hand: Make, name: str) -> None:
    def at(angle: float) -> Listener:
        position = (0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.1)
        return replace(FIELD_EARS[name], position=position)

    def go(number: int) -> None:
        player.listener = at(0.3 + 0.008 * number)  # 1.2 m/s

    bends = []
    for angle in (0.3, 0.7, 1.1):
        player = by_hand(RUNG, volume=-30, listener=at(angle))
        player.hear(OPENED)
        player.strike(SOFT)
        player.hear(20)
        bends.append(bend(both(player, 20) / player.gain))
    player = by_hand(RUNG, volume=-30, listener=at(0.3))
    player.hear(OPENED)
    player.strike(SOFT)
    player.hear(20)
    assert bend(both(player, 100, go) / player.gain) <= 1.5 * max(bends)


def test_a_body_that_turns_turns_its_field(by_hand: Make) -> None:
    turned = by_hand(RUNG, volume=-30, listener=AHEAD)
    turned.move(0, rotation=(0.8, 0, 0, 0.6))
    turned.hear(OPENED)
    turned.strike(SOFT)
    begun = by_hand(
        Scene(bodies={"it": Body(model=RUNG, rotation=(0.8, 0, 0, 0.6))}),
        volume=-30,
        listener=AHEAD,
        ahead=2,
    )
    begun.hear(OPENED)
    begun.strike(SOFT)
    heard, wanted = (each.hear(40) / each.gain for each in (turned, begun))
    np.testing.assert_allclose(heard, wanted, atol=1e-4 * np.abs(wanted).max())


def test_a_body_takes_another_field_and_goes_on_where_it_is_not_known(by_hand: Make) -> None:
    player = by_hand(RUNG, volume=-30, listener=Mono(position=(0.5, 0, 0)))
    player.hear(OPENED)
    player.strike(SOFT)
    far = player.hear(20)
    player.listener = Mono(position=(1.1 * RADIUS, 0, 0))
    near = player.hear(30)
    assert np.isfinite(near).all()
    player.change(RUNG.damped(InternalFriction(loss_tangent=1e-5)))
    player.listener = Mono(position=(0.5, 0, 0))
    back = player.hear(40)[-2000:]
    assert np.abs(back).max() == pytest.approx(np.abs(far[-2000:]).max(), rel=0.3)


def test_a_player_keeps_its_way_to_hear_fields(by_hand: Make) -> None:
    player = by_hand(FIELD, listener=LEFT)
    with pytest.raises(OptionError, match="field=None, the new listener 2 and 'ears'"):
        player.listener = replace(LEFT, field="ears")


def test_recorded_fields_are_played_for_two_bare_ears(by_hand: Make) -> None:
    body = ball()
    assert isinstance(body.gains, ShapeGains)
    model = replace(body, gains=sided(body.gains))
    seen = Stereo(position=(0.5, 0, 0), facing=(-1, 0, 0), field="ears")
    player = by_hand(model, volume=-30, listener=seen)
    player.hear(OPENED)
    player.strike(BLOW)
    left, right = both(player, 40)
    assert np.square(right).sum() == pytest.approx(100 * np.square(left).sum(), rel=1e-3)
