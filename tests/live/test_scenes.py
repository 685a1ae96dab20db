"""Scenes that are played: logs told in pieces, bodies that move, moments, against the render."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.ears.listeners import Mono, Stereo
from struck.excitation.excitation import Hold
from struck.excitation.pulses import LEAD
from struck.live.contact_stream import FORESIGHT
from struck.scene.body import Body, Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.events import events_of
from tests.live.hand import BLOCK, RATE, HandPlayer, Make, ball, by_hand
from tests.live.test_ears import both
from tests.live.test_player import LATE, OPENED, decibels

__all__ = ["by_hand"]
Array = NDArray[np.float64]
EAR = Mono(position=(0.0, -1.5, 0.5))
EARS = Stereo(position=(0.0, -1.5, 0.5), facing=(0.0, 1.0, 0.0))
STEP, ROUND = 1e-3, 0.1  # s, m


def two_balls() -> Scene:
    """Return a ball that moves over one that rests."""
    return Scene(bodies={"low": Body(model=ball()), "high": Body(model=ball(seed=1))})


def bouncing(seconds: float = 1.0) -> Contacts:
    """Return a log of the upper ball, which turns, goes aside and hits the lower one."""
    times = np.arange(0, seconds, STEP)
    place = np.stack([0.2 * times, 0 * times, 2 * ROUND + 0 * times], axis=1)
    angle = 1.5 * times
    turn = np.stack([np.cos(angle / 2), 0 * times, np.sin(angle / 2), 0 * times], axis=1)
    still = np.zeros((len(times), 3)), np.tile([1.0, 0, 0, 0], (len(times), 1))
    poses = Poses.together(
        times, np.stack([still[0], place], axis=1), np.stack([still[1], turn], axis=1)
    )
    hits = np.array([0.05, 0.11, 0.118, 0.3, 0.52, 0.7, 0.71])
    chance = np.random.default_rng(3)
    impulse = chance.uniform(0.01, 0.05, (len(hits), 3)) * [0.2, 0.2, 1.0]
    apart = [[0.2 * hit, 0.0, 2 * ROUND] for hit in hits]
    at = ROUND * np.array([each / np.linalg.norm(each) for each in apart])
    return Contacts(
        names=["low", "high"],
        time=hits,
        dt=STEP,
        body0=np.zeros(len(hits)),
        body1=np.ones(len(hits)),
        position=at,
        impulse=impulse,
        poses=poses,
    )


def piece(contacts: Contacts, begin: float, end: float) -> Contacts:
    """Return a part of a log."""
    poses = contacts.poses
    assert poses is not None
    kept = (poses.time >= begin) & (poses.time < end)
    some = {n: getattr(poses, n)[kept] for n in ("time", "body", "position", "rotation")}
    rows = np.flatnonzero((contacts.time >= begin) & (contacts.time < end))
    return replace(contacts.chosen(rows), poses=Poses(**some))


def told(player: HandPlayer, contacts: Contacts, seconds: float, length: float) -> Array:
    """Return what is heard from the log's time 0 on, told in pieces of `length` s."""
    heard, begin = [], 0.0
    while player.now < seconds:
        stream = player._stream
        assert stream is not None
        due = begin if stream.zero is None else begin - (player.now - stream.zero / RATE)
        if stream.zero is None or due < FORESIGHT + 0.03:
            player.follow(piece(contacts, begin, begin + length))
            begin += length
        else:
            heard.append(both(player, 1))
    assert stream.slipped == 0
    before = stream.zero + LEAD + LATE + player._host._ears.propagation.lead - OPENED * BLOCK
    return np.concatenate(heard, axis=1)[:, before:] / player.gain


def expected(scene: Scene, contacts: Contacts, listener: object) -> Array:
    """Return the render, through the same band-limited pulses as live."""
    excited = events_of(scene, contacts).on()
    never = Hold(at="top", grip=1e-9, time=50.0, seconds=1.0)
    bodies = [replace(b, excitations=(*b.actions, never)) for b in excited.bodies.values()]
    return struck.render(bodies, seconds=1.2, listener=listener).samples


@pytest.mark.parametrize("listener", [EAR, EARS], ids=["mono", "two ears"])
@pytest.mark.parametrize("length", [0.05, 0.09])
def test_a_log_told_in_pieces_sounds_as_the_render(
    by_hand: Make, listener: Mono | Stereo, length: float
) -> None:
    scene, contacts = two_balls(), bouncing()
    player = by_hand(scene, volume=-30, listener=listener)
    player.hear(OPENED)
    heard = told(player, contacts, 0.9, length)
    wanted = expected(scene, contacts, listener)
    count = min(heard.shape[1], wanted.shape[1], round(0.75 * RATE))
    for channel, row in enumerate(heard):
        assert decibels(row[:count], wanted[channel % len(wanted), :count]) < -60
    assert player.dropped == player.overdue == 0
