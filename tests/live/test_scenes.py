"""Scenes that are played: logs told in pieces, bodies that move, moments, against the render."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.ears.listeners import Mono, Stereo
from struck.ears.propagation import STRETCH
from struck.errors import DeviceError, OptionError, SimulationError
from struck.excitation.excitation import Hold
from struck.excitation.pulses import LEAD
from struck.excitation.strike import Strike
from struck.live.contact_stream import FORESIGHT
from struck.scene.body import Body, RigidBody, Scene
from struck.scene.contacts import Contacts, Poses
from struck.scene.engines.simulation import Simulation
from struck.scene.events import events_of
from tests.live.hand import BLOCK, RATE, HandPlayer, Make, ball, by_hand
from tests.live.test_ears import both
from tests.live.test_player import LATE, OPENED, decibels
from tests.samples import sampled

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
    never = Hold(at="top", grip=0.0)
    sounding = [body for body in excited.bodies.values() if not body.silent]
    bodies = [replace(b, excitations=(*b.actions, never)) for b in sounding]
    return struck.render(bodies, seconds=1.2, fade=0, listener=listener).samples


@pytest.mark.parametrize("listener", [EAR, EARS], ids=["mono", "two ears"])
@pytest.mark.parametrize("length", sampled([0.05, 0.09], 0.05))
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


def rubbing(seconds: float = 0.8) -> Contacts:
    """Return a log of the upper ball that slides over the lower one, which stands still."""
    times = np.arange(0, seconds, STEP)
    angle = 0.5 + 0.0 * times
    along = 0.1 * (times - seconds / 2)
    at = ROUND * np.stack([np.sin(along / ROUND), 0 * along, np.cos(along / ROUND)], axis=1)
    high = 2 * at
    turn = np.tile([np.cos(angle[0]), np.sin(angle[0]), 0.0, 0.0], (len(times), 1))
    still = np.tile([1.0, 0, 0, 0], (len(times), 1))
    poses = Poses.together(
        times, np.stack([0 * high, high], axis=1), np.stack([still, turn], axis=1)
    )
    return Contacts(
        names=["low", "high"],
        time=times,
        dt=STEP,
        body0=np.zeros(len(times)),
        body1=np.ones(len(times)),
        position=at,
        impulse=5.0 * STEP * at / ROUND,
        velocity=np.gradient(high, STEP, axis=0),
        poses=poses,
    )


def test_what_slides_is_as_loud_as_in_the_render_and_does_not_click(by_hand: Make) -> None:
    scene, contacts = two_balls(), rubbing()
    events = events_of(scene, contacts)
    assert len(events.sustained) == 1
    player = by_hand(scene, volume=-30, listener=EAR)
    player.hear(OPENED)
    heard = told(player, contacts, 0.75, 0.05)[0]
    wanted = struck.render(scene, contacts, seconds=1.0, fade=0, listener=EAR).samples[0]
    middle = slice(round(0.2 * RATE), round(0.6 * RATE))
    apart = np.std(heard[middle]) / np.std(wanted[middle])
    assert abs(20 * np.log10(apart)) < 1.0
    bends = [np.abs(np.diff(each[middle], 2)).max() for each in (heard, wanted)]
    assert bends[0] < 1.5 * bends[1]
    assert player.dropped == player.overdue == 0


def silent(player: HandPlayer) -> None:
    """Let the lines of sound fill, so that the first sound finds them as offline."""
    player.hear(OPENED)


def aligned(moment: float) -> float:
    """Return a moment near another for which ways are looked up at the same times as offline.

    In between they go on smoothly, so that bends of a table come elsewhere (to -45 dB here).
    """
    return (round(moment * RATE / STRETCH) * STRETCH - LEAD) / RATE


def begin_of(player: HandPlayer, moment: float) -> int:
    """Return the sample of what is heard next at which a moment's sound leaves its body."""
    ears = player._host._ears
    lead = LEAD + LATE + (0 if ears is None else ears.propagation.lead)
    return round(moment * RATE) + lead - OPENED * BLOCK


@pytest.mark.parametrize("listener", [EAR, EARS], ids=["mono", "two ears"])
def test_a_body_that_is_moved_is_heard_as_in_the_render(
    by_hand: Make, listener: Mono | Stereo
) -> None:
    times = np.array([0.0, 0.05, 0.12, 0.3, 0.6])
    places = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0.1, 0], [1.0, 0.2, 0.1], [0.5, 0.4, 0]])
    turns = np.stack([np.cos(times), 0 * times, np.sin(times), 0 * times], axis=1)
    blow = Strike(at="top", impulse=1e-2, duration=1e-3, shape="gaussian", time=0.02)
    model = replace(ball(), centre=np.array([0.02, 0.0, 0.01]))
    body = Body(model=model, excitations=blow, position=(times, places), rotation=(times, turns))
    wanted = struck.render(body, seconds=0.5, fade=0, listener=listener).samples
    player = by_hand(Scene(bodies={"it": Body(model=model)}), volume=-30, listener=listener)
    silent(player)
    start = aligned(player.now + 0.05)
    for later, place, turn in zip(times, places, turns, strict=True):
        player.move("it", place, turn, moment=start + later)
    player.strike(blow, body="it", moment=start)
    heard = both(player, 210)[:, begin_of(player, start) :] / player.gain
    count = min(heard.shape[1], wanted.shape[1])
    assert count > 0.4 * RATE
    for channel, row in enumerate(heard):
        assert decibels(row[:count], wanted[channel % len(wanted), :count]) < -60


def test_a_listener_goes_at_its_moment_as_in_the_render(by_hand: Make) -> None:
    times, blow = np.array([0.0, 0.1, 0.3]), Strike(at="top", impulse=1e-2, duration=1e-3)
    places = np.array([[0.0, -1.5, 0.5], [0.0, -1.2, 0.5], [0.8, -1.0, 0.5]])
    blow = replace(blow, shape="gaussian")
    walk = Mono(position=(times, places))
    wanted = struck.render(ball(), blow, seconds=0.4, fade=0, listener=walk).samples[0]
    player = by_hand(ball(), volume=-30, listener=Mono(position=tuple(places[0])))
    silent(player)
    start = aligned(player.now + 0.05)
    for later, place in zip(times, places, strict=True):
        player.listen(Mono(position=tuple(place)), moment=start + later)
    player.strike(blow, moment=start)
    heard = both(player, 180)[0, begin_of(player, start) :] / player.gain
    count = min(len(heard), len(wanted))
    assert decibels(heard[:count], wanted[:count]) < -60


def test_strikes_and_touches_come_at_their_sample(by_hand: Make) -> None:
    blow = Strike(at="top", impulse=1e-2, duration=1e-3, shape="gaussian")
    heard = []
    for late in (0, 1, 77):
        player = by_hand(ball(), volume=-30, listener=(1, 0, 0))
        silent(player)
        moment = (round((player.now + 0.02) * RATE) + late) / RATE
        player.strike(blow, moment=moment)
        times = moment + np.arange(8) / 100
        for number, at in enumerate(times):
            player.touch("side", 1.0 + number % 3, 0.05, moment=at)
        heard.append(player.hear(40)[late:][:4000])
        assert player.touch_log.times == pytest.approx(times)
        assert player.overdue == 0
    for other in heard[1:]:
        assert decibels(other, heard[0]) < -90


def test_a_moment_that_is_over_is_done_at_once_and_counted(by_hand: Make) -> None:
    player = by_hand(ball(), volume=-30)
    silent(player)
    player.strike(moment=0.0)
    assert np.abs(player.hear(10)).max() > 1e-3
    assert player.overdue == 1
    with pytest.raises(OptionError, match="player's clock"):
        player.strike(moment=-1.0)
    with pytest.raises(OptionError, match="player's clock"):
        player.move(0, (0, 0, 1), moment=np.nan) if player._host._ears else player.touch(
            "top", 1.0, moment=np.nan
        )


def test_a_body_that_leaps_and_passes_the_listener_does_not_click(by_hand: Make) -> None:
    model = replace(ball(), decays=np.full(40, 1.0))
    bends = []
    for leap in (False, True):
        player = by_hand(model, volume=-30, listener=EARS)
        silent(player)
        player.strike(Strike(at="top", impulse=1e-3, duration=1e-3, shape="gaussian"))
        player.hear(30)
        if leap:
            player.move(0, (0.0, -1.3, 0.5))  # over the listener
        heard = both(player, 40)
        bends.append(np.abs(np.diff(heard, 2, axis=1)).max() / np.abs(heard).max())
        assert np.isfinite(heard).all()
    assert bends[1] < 3 * bends[0]
    player.strike()


def test_names_and_players_that_do_not_fit_are_refused(by_hand: Make) -> None:
    player = by_hand(two_balls(), listener=EAR)
    for say in (player.strike, lambda **of: player.move(position=(0, 0, 0), **of)):
        with pytest.raises(OptionError, match=r"'mug'.*'low', 'high'"):
            say(body="mug")
    with pytest.raises(OptionError, match="0 to 1"):
        player.dampen("top", 1.0, body=2)
    other = replace(bouncing(), names=["low", "mug"])
    with pytest.raises(OptionError, match=r"'mug'.*give the scene a Body"):
        player.follow(other)
    player.follow(bouncing())
    with pytest.raises(OptionError, match="give the same each time"):
        player.follow(replace(bouncing(), names=["high", "low"]))
    bare = by_hand(ball(), listener=(1, 0, 0))
    with pytest.raises(OptionError, match="listener=Mono"):
        bare.move(0, (0, 0, 1))
    with pytest.raises(OptionError, match="has no scene"):
        bare.follow(bouncing())
    floor = Scene(bodies={"floor": Body(model=RigidBody())}, notes=("'floor' is silent: so",))
    with pytest.raises(OptionError, match="nothing to play: 'floor' is silent"):
        by_hand(floor)
    with pytest.raises(OptionError, match=r"give them to player\.start"):
        by_hand(Scene(bodies={"it": Body(model=ball(), excitations=Strike())}))
    player.stop()
    for say in (player.strike, lambda: player.move(0, (0, 0, 0)), lambda: player.follow(other)):
        with pytest.raises(DeviceError):
            say()


BALL = (
    '<mujoco><option timestep=".001"/><worldbody><geom name="floor" type="plane" size="2 2 .1"/>'
    '<body name="ball" pos="0 0 .15"><freejoint/><geom size=".1" mass="1"/></body>'
    "</worldbody></mujoco>"
)


def bouncing_ball(folder: Path) -> Simulation:
    pytest.importorskip("mujoco")
    path = folder / "ball.xml"
    path.write_text(BALL)
    return Simulation(path, models={"ball": ball()}, restitution=0.6, cache=False)


def beside(player: HandPlayer, seconds: float) -> Array:
    """Return what is heard while the simulation keeps up."""
    run, stream, heard = player._run, player._stream, []
    assert run is not None
    assert stream is not None
    run.start()
    give_up = time.monotonic() + 20
    while player.now < seconds and time.monotonic() < give_up:
        known = run._engine.time if stream.zero is None else stream._planned_end
        if run.running and known < player.now - stream.zero / RATE + 0.02:
            time.sleep(0.001)
        else:
            heard.append(both(player, 1))
    return np.concatenate(heard, axis=1)


def test_a_simulation_is_heard_as_its_render(by_hand: Make, tmp_path: Path) -> None:
    simulation = bouncing_ball(tmp_path)
    scene, contacts = simulation.run(0.8)
    player = by_hand(simulation.scene, volume=-70, listener=EAR)
    silent(player)
    player.simulate(simulation)
    heard = beside(player, 0.9) / player.gain
    player.stop()
    wanted = expected(scene, contacts, EAR)[0]
    begin = begin_of(player, player._stream.zero / RATE)
    count = round(0.6 * RATE)
    found, rests = heard[0, begin:], slice(round(0.45 * RATE), count)
    assert decibels(found[:count], wanted[:count]) < -50  # bends of the way, see `aligned`
    assert decibels(found[rests], wanted[rests]) < -100
    assert player.slipped == player.dropped == player.overdue == 0
    assert player.simulation_load > 0


def test_a_simulation_that_explodes_is_told_and_fades(by_hand: Make, tmp_path: Path) -> None:
    def explode(_: object, data: Any) -> None:  # noqa: ANN401 - MuJoCo's
        if data.time > 0.3:
            data.qvel[2] += 20.0

    simulation = bouncing_ball(tmp_path)
    player = by_hand(simulation.scene, volume=-70, listener=EAR)
    silent(player)
    player.simulate(simulation, explode)
    heard = beside(player, 3.0)
    assert not player.simulating
    with pytest.raises(SimulationError, match=r"exploded at 0\.3"):
        player.strike()
    player.strike(body="ball")  # said once
    loudest = np.abs(heard[:, : round(0.3 * RATE)]).max()
    assert 0 < np.abs(heard).max() <= 1.001 * loudest
    assert np.abs(heard[:, -4800:]).max() < 0.1 * loudest


def test_a_control_that_fails_is_told(by_hand: Make, tmp_path: Path) -> None:
    def fail(_: object, data: Any) -> None:  # noqa: ANN401 - MuJoCo's
        if data.time > 0.2:
            raise KeyError("wind")

    simulation = bouncing_ball(tmp_path)
    player = by_hand(simulation.scene, listener=EAR)
    player.simulate(simulation, fail)
    with pytest.raises(OptionError, match="has a simulation already"):
        player.simulate(simulation)
    beside(player, 0.8)
    with pytest.raises(SimulationError, match=r"control=, raised KeyError\('wind'\)"):
        player.strike()
