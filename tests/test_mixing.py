"""Bodies in space, from what strikes them to what two ears get."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.air import AIR
from struck.ears.listeners import Binaural, Mono, Stereo
from struck.ears.reverberation import Reverberation
from struck.ears.room import Room
from struck.errors import ContactError, OptionError
from struck.excitation.hold import Hold
from struck.excitation.scrape import Scrape
from struck.excitation.strike import Strike
from struck.gains import ShapeGains
from struck.rendering import render
from struck.scene.body import Body
from tests.test_rendering import BLOCK, TOP

Array = NDArray[np.float64]
RATE = 48000
STRIKE = Strike(at=TOP, impulse=0.02, striker="rubber")


def delayed(samples: Array, seconds: float) -> Array:
    """Return samples late by so much, by their spectrum."""
    count = 2 * len(samples)
    turns = np.exp(-2j * np.pi * np.fft.rfftfreq(count, 1 / RATE) * seconds)
    return np.fft.irfft(np.fft.rfft(samples, count) * turns)[: len(samples)]


@pytest.mark.parametrize("far", [1.0, 3.37])
def test_one_ear_hears_what_a_bare_position_does_after_the_travel_time(far: float) -> None:
    place = np.add(BLOCK.centre, (0.0, far, 0.0))
    bare = render(BLOCK, STRIKE, listener=place, seconds=0.5)
    heard = render(BLOCK, STRIKE, listener=Mono(position=place), seconds=0.5)
    wanted = delayed(bare.samples[0].astype(float), far / AIR.sound_speed)
    np.testing.assert_allclose(heard.samples[0], wanted, atol=1e-3 * np.abs(wanted).max())
    assert heard.calibrated == bare.calibrated


def test_a_sound_of_unsaid_length_waits_for_what_is_on_its_way() -> None:
    near, far = (
        render(BLOCK, STRIKE, listener=Mono(position=(x, 0, 0))).duration for x in (1.0, 101.0)
    )
    assert far - near == pytest.approx(100 / AIR.sound_speed, abs=1e-3)


def test_bodies_add_up_wherever_they_are() -> None:
    listener = Stereo(position=(0, 0, 0), facing=(1, 0, 0))
    bodies = [
        Body(model=BLOCK, excitations=STRIKE, position=(2, 1, 0)),
        Body(
            model=BLOCK,
            excitations=[Scrape(path=["top", "vertex:3"], speed=0.1, load=1.0, seconds=0.2)],
            position=([0.0, 1.0], [(1, -1, 0), (3, -1, 0)]),
        ),
    ]
    together = render(bodies, listener=listener, seconds=0.4).samples
    apart = sum(render(each, listener=listener, seconds=0.4).samples for each in bodies)
    np.testing.assert_allclose(together, apart, atol=2e-6 * np.abs(apart).max())


def test_a_listener_who_walks_past_hears_it_louder_when_near() -> None:
    walk = Mono(position=([0.0, 1.0], [(-3, 0.5, 0), (3, 0.5, 0)]))
    rung = replace(BLOCK, decays=np.full(len(BLOCK.decays), 0.5))
    samples = render(rung, STRIKE, listener=walk, seconds=1.0).samples[0]
    level = np.sqrt(np.square(samples).reshape(10, -1).mean(axis=1))
    assert level.argmax() in {4, 5}
    assert level.max() > 3 * level[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sided(ShapeGains):
    """A timbre field: the left of the scene hears everything, the right a tenth."""

    @property
    def directional(self) -> bool:
        return True

    def toward(self, listeners: Array) -> NDArray[np.complex128]:
        left = np.where(np.atleast_2d(listeners)[:, 1] > 0, 1.0, 0.1)
        return super().toward(listeners) * left[:, None, None]


def sided() -> ShapeGains:
    gains = BLOCK.gains
    return Sided(**{name: getattr(gains, name) for name in gains.__dataclass_fields__})


def test_a_timbre_field_is_heard_by_two_ears_and_by_no_head() -> None:
    soft = replace(STRIKE, shape="gaussian")
    model = replace(BLOCK, gains=sided())
    listener = Binaural(position=(0.5, 0, 0), facing=(-1, 0, 0), radius=0.09)
    left, right = render(model, soft, listener=listener, seconds=0.3).samples
    # Who looks at the body from +x has his left ear at -y.
    np.testing.assert_allclose(10 * left, right, atol=2e-3 * np.abs(right).max())
    way = float(np.hypot(0.5, 0.09))
    alone = render(BLOCK, soft, listener=(0.5, 0.09, 0), seconds=0.3).samples[0]
    wanted = delayed(alone.astype(float), way / AIR.sound_speed)
    np.testing.assert_allclose(right, wanted, atol=2e-3 * np.abs(wanted).max())


def test_a_walk_through_a_timbre_field_does_not_click() -> None:
    rung = replace(BLOCK, gains=sided(), decays=np.full(len(BLOCK.decays), 0.5))
    walk = Mono(position=([0.0, 0.6], [(0.5, 0.4, 0), (0.5, 0.2, 0)]))
    moved = render(rung, STRIKE, listener=walk, seconds=0.6).samples[0, RATE // 10 :]
    rest = render(rung, STRIKE, listener=Mono(position=(0.5, 0.2, 0)), seconds=0.6)
    still = rest.samples[0, RATE // 10 :]
    assert np.abs(np.diff(moved, 2)).max() <= 1.5 * np.abs(np.diff(still, 2)).max()


def test_a_turned_body_is_heard_from_its_other_side() -> None:
    model = replace(BLOCK, gains=sided())
    ear = Mono(position=(0, 1, 0))
    turned = [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]
    heard = [
        np.abs(
            render(
                Body(model=model, excitations=STRIKE, rotation=rotation),
                listener=ear,
                seconds=0.1,
            ).samples
        ).max()
        for rotation in (np.eye(3), turned)
    ]
    assert heard[0] == pytest.approx(10 * heard[1], rel=0.01)


def test_a_room_sounds_longer_the_longer_it_reverberates() -> None:
    ear = Mono(position=(4, 2, 1.5))
    dull = replace(BLOCK, decays=np.full(len(BLOCK.decays), 60.0))
    body = Body(model=dull, excitations=STRIKE, position=(1, 1, 1))
    lasting = []
    for seconds in (0.3, 1.2):
        late = Reverberation(seconds=seconds, volume=60.0)
        room = Room(size=(5, 4, 3), reverberation=late)
        samples = render(body, listener=ear, room=room, seconds=1.5).samples[0]
        lasting.append(np.square(samples[RATE:]).sum() / np.square(samples).sum())
    assert lasting[1] > 100 * lasting[0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: render([]), r"\[\] are no bodies"),
        (lambda: render([BLOCK]), "are no bodies: give a ModalModel"),
        (lambda: render(Body(model=BLOCK, excitations=STRIKE), STRIKE), "its own excitations"),
        (lambda: render(BLOCK, listener=Mono()), "nothing to render"),
        (lambda: Body(model=BLOCK, excitations=STRIKE, rotation=-np.eye(3)), "it mirrors"),
        (lambda: Body(model=BLOCK, excitations=STRIKE, rotation=np.ones((3, 3))), "orthonormal"),
        (lambda: Body(model=BLOCK, excitations="hit"), "is no excitation"),
        (lambda: render(BLOCK, STRIKE, listener=(3, 0, 0), room=Room(size=(2, 2, 2))), "outside"),
    ],
)
def test_what_cannot_be_heard_is_refused(call: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        call()


def test_a_listener_inside_a_body_is_refused() -> None:
    with pytest.raises(ContactError, match="inside its radius"):
        render(BLOCK, STRIKE, listener=Mono(position=(0.01, 0, 0)))


def test_a_held_body_in_space_decays_faster() -> None:
    ear = Mono(position=(1, 0, 0))
    free, held = (
        np.square(render(BLOCK, actions, listener=ear, seconds=0.5).samples[0, RATE // 4 :]).sum()
        for actions in ([STRIKE], [STRIKE, Hold(grip=50.0, seconds=1.0)])
    )
    assert held < free
