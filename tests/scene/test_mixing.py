"""Bodies in space, from what strikes them to what two ears get."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears.listeners import Binaural, Mono, Stereo
from struck.ears.reverberation import Reverberation
from struck.ears.room import Room
from struck.errors import ContactError, OptionError
from struck.excitation.excitation import Hold
from struck.excitation.scrape import Scrape
from struck.excitation.strike import Strike
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.scene.body import Body
from struck.scene.render import render
from tests.scene.test_render import BLOCK, TOP

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
    bare = render(BLOCK, STRIKE, listener=place, seconds=0.5, fade=0)
    heard = render(BLOCK, STRIKE, listener=Mono(position=place), seconds=0.5, fade=0)
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
    together = render(bodies, listener=listener, seconds=0.4, fade=0).samples
    apart = sum(render(each, listener=listener, seconds=0.4, fade=0).samples for each in bodies)
    np.testing.assert_allclose(together, apart, atol=2e-6 * np.abs(apart).max())


def test_a_listener_who_walks_past_hears_it_louder_when_near() -> None:
    walk = Mono(position=([0.0, 1.0], [(-3, 0.5, 0), (3, 0.5, 0)]))
    rung = replace(BLOCK, decays=np.full(len(BLOCK.decays), 0.5))
    samples = render(rung, STRIKE, listener=walk, seconds=1.0, fade=0).samples[0]
    level = np.sqrt(np.square(samples).reshape(10, -1).mean(axis=1))
    assert level.argmax() in {4, 5}
    assert level.max() > 3 * level[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sided(ShapeGains):
    """A timbre field: the left of the body hears everything, the right a share."""

    right: float

    @property
    def directional(self) -> bool:
        return True

    def toward(self, listeners: Array) -> NDArray[np.complex128]:
        left = np.where(np.atleast_2d(listeners)[:, 1] > 0, 1.0, self.right)
        return super().toward(listeners) * left[:, None, None]


def sided(gains: ShapeGains = BLOCK.gains, right: float = 0.1) -> ShapeGains:
    return Sided(**{name: getattr(gains, name) for name in gains.__dataclass_fields__}, right=right)


@pytest.mark.prove
def test_a_timbre_field_is_heard_by_two_ears_and_by_no_head() -> None:
    soft = replace(STRIKE, shape="gaussian")
    model = replace(BLOCK, gains=sided())
    listener = Binaural(position=(0.5, 0, 0), facing=(-1, 0, 0), radius=0.09, field="ears")
    left, right = render(model, soft, listener=listener, seconds=0.3, fade=0).samples
    # Who looks at the body from +x has his left ear at -y.
    np.testing.assert_allclose(10 * left, right, atol=2e-3 * np.abs(right).max())
    way = float(np.hypot(0.5, 0.09))
    alone = render(BLOCK, soft, listener=(0.5, 0.09, 0), seconds=0.3, fade=0).samples[0]
    wanted = delayed(alone.astype(float), way / AIR.sound_speed)
    np.testing.assert_allclose(right, wanted, atol=2e-3 * np.abs(wanted).max())


def test_a_walk_through_a_timbre_field_does_not_click() -> None:
    rung = replace(BLOCK, gains=sided(), decays=np.full(len(BLOCK.decays), 0.5))
    walk = Mono(position=([0.0, 0.6], [(0.5, 0.4, 0), (0.5, 0.2, 0)]))
    moved = render(rung, STRIKE, listener=walk, seconds=0.6, fade=0).samples[0, RATE // 10 :]
    rest = render(rung, STRIKE, listener=Mono(position=(0.5, 0.2, 0)), seconds=0.6, fade=0)
    still = rest.samples[0, RATE // 10 :]
    assert np.abs(np.diff(moved, 2)).max() <= 1.5 * np.abs(np.diff(still, 2)).max()


QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MIDDLE = np.array([0.05, 0.02, 0.01])
ASIDE = replace(BLOCK, centre=MIDDLE, gains=replace(BLOCK.gains, centre=MIDDLE))


@pytest.mark.parametrize("field", [False, True], ids=["plain", "field"])
def test_a_turned_body_away_from_its_origin_is_heard_where_it_is(*, field: bool) -> None:
    model = replace(ASIDE, gains=sided(ASIDE.gains)) if field else ASIDE
    soft = replace(STRIKE, shape="gaussian")
    origin, ear = np.array([0.3, -0.2, 0.1]), np.array([-1.1, 0.7, 0.4])
    turned = Body(model=model, excitations=soft, position=tuple(origin), rotation=QUARTER)
    heard = render(turned, listener=Mono(position=tuple(ear)), seconds=0.2, fade=0).samples[0]
    there = QUARTER.T @ (ear - origin)  # the same ear in the body's own coordinates
    alone = render(model, soft, listener=there, seconds=0.2, fade=0).samples[0].astype(float)
    wanted = delayed(alone, float(np.linalg.norm(there - MIDDLE)) / AIR.sound_speed)
    np.testing.assert_allclose(heard, wanted, atol=2e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("listener", [Stereo(position=(0, 0, 1.5)), Stereo(position=(0, 0, -2))])
def test_who_does_not_say_where_he_looks_looks_level(listener: Stereo) -> None:
    left, right = render(BLOCK, STRIKE, listener=listener, seconds=0.1, fade=0).samples
    np.testing.assert_allclose(left, right, atol=1e-3 * np.abs(left).max())


def test_who_stands_in_the_middle_of_all_looks_along_x() -> None:
    bodies = [Body(model=BLOCK, excitations=STRIKE, position=(0, y, 0)) for y in (-1, 1)]
    between = Stereo(position=(0, 0, 0))
    said = Stereo(position=(0, 0, 0), facing=(1, 0, 0))
    heard, wanted = (
        render(bodies, listener=listener, seconds=0.1, fade=0).samples
        for listener in (between, said)
    )
    np.testing.assert_array_equal(heard, wanted)


def test_a_timbre_field_that_is_none_reverberates_as_a_plain_body() -> None:
    late = Reverberation(seconds=0.8, volume=96.0)
    room = Room(size=(8, 4, 3), walls=0.99, order=0, reverberation=late)
    everywhere = replace(BLOCK, gains=sided(BLOCK.gains, right=1.0))
    for listener in (Mono(position=(5, 2, 1)), Stereo(position=(5, 2, 1), facing=(-1, 0, 0))):
        levels = []
        for model in (BLOCK, everywhere):
            body = Body(model=model, excitations=STRIKE, position=(1, 2, 1))
            wet = render(body, listener=listener, room=room, seconds=1.0, fade=0).samples
            dry = render(body, listener=listener, seconds=1.0, fade=0).samples
            levels.append(np.sqrt(np.square(wet - dry).mean()))
        assert levels[1] == pytest.approx(levels[0], rel=0.02)


@pytest.mark.prove
def test_a_room_is_as_loud_as_its_absorption_says() -> None:
    # Kuttruff, chapter 5: 16 pi / A of the energy at 1 m, of which the mixing time takes its share.
    dull = replace(BLOCK, decays=np.full(len(BLOCK.decays), 400.0))
    body = Body(model=dull, excitations=STRIKE, position=(1, 2, 1))
    ear = Mono(position=(5, 2, 1))
    dry = render(body, listener=ear, seconds=2.0, fade=0).samples
    energy = 16 * np.square(dry).sum()  # at 1 m, from 4 m
    late = []
    for seed in range(8):
        tail = Reverberation(seconds=0.8, volume=96.0, seed=seed)
        room = Room(size=(8, 4, 3), walls=0.99, order=0, reverberation=tail)
        wet = render(body, listener=ear, room=room, seconds=2.0, fade=0).samples
        late.append(np.square(wet - dry).sum())
    absorbing = 0.161 * 96.0 / 0.8
    share = np.exp(-room.mixing_time() * np.log(1e6) / 0.8)
    wanted = 16 * np.pi / absorbing * share * energy
    assert np.mean(late) == pytest.approx(wanted, rel=0.1)


@pytest.mark.prove
def test_a_room_sounds_longer_the_longer_it_reverberates() -> None:
    ear = Mono(position=(4, 2, 1.5))
    dull = replace(BLOCK, decays=np.full(len(BLOCK.decays), 60.0))
    body = Body(model=dull, excitations=STRIKE, position=(1, 1, 1))
    lasting = []
    for seconds in (0.3, 1.2):
        late = Reverberation(seconds=seconds, volume=60.0)
        room = Room(size=(5, 4, 3), reverberation=late)
        samples = render(body, listener=ear, room=room, seconds=1.5, fade=0).samples[0]
        lasting.append(np.square(samples[RATE:]).sum() / np.square(samples).sum())
    assert lasting[1] > 100 * lasting[0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: render([]), r"\[\] are no bodies"),
        (lambda: render([BLOCK]), "render takes a ModalModel"),
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
    with pytest.raises(ContactError, match="inside its surface"):
        render(BLOCK, STRIKE, listener=Mono(position=(0.01, 0, 0)))


def test_a_held_body_in_space_is_as_one_held_alone() -> None:
    actions = [STRIKE, Hold(grip=50.0)]
    free = render(BLOCK, STRIKE, listener=(1, 0, 0))
    alone = render(BLOCK, actions, listener=(1, 0, 0))
    assert alone.duration < 0.5 * free.duration
    heard = render(BLOCK, actions, listener=Mono(position=(1, 0, 0)), seconds=0.5, fade=0).samples[
        0
    ]
    fixed = render(BLOCK, actions, listener=(1, 0, 0), seconds=0.5, fade=0).samples[0].astype(float)
    wanted = delayed(fixed, 1 / AIR.sound_speed)
    np.testing.assert_allclose(heard, wanted, atol=2e-3 * np.abs(wanted).max())
