"""Bodies with computed timbre fields, heard from all around, by heads and in rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from struck import Binaural, Body, Mono, Room, Strike, render
from struck.ears import Stereo
from struck.ears.listeners import Listener
from struck.errors import ContactError, OptionError
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.radiation.directivity import RadiatingGains
from tests.radiation.sources import RADIUS, plain_ball, radiating_ball, some_sources
from tests.scene.test_mixing import RATE, delayed

Array = NDArray[np.float64]
SOFT = Strike(at=(RADIUS, 0, 0), impulse=1.0, shape="gaussian", duration=1e-3)
MODEL, SOURCES = radiating_ball()
AHEAD = (0, 1, 0)
RUNG = replace(MODEL, decays=np.full(len(MODEL.decays), 0.5))


def mirrored(model: ModalModel) -> ModalModel:
    """Return a body that sounds as its mirror image across x = 0."""
    other = replace(SOURCES, positions=SOURCES.positions * [-1, 1, 1])
    plain = plain_ball(model.natural_frequencies)
    gains = RadiatingGains.of(plain.gains, model.natural_frequencies, [other])
    return replace(model, gains=gains)


def test_a_strike_is_the_sum_of_what_modes_send_there() -> None:
    chance = np.random.default_rng(5)
    places = chance.normal(size=(20, 3))
    places *= (chance.uniform(0.1, 3.0, 20) / np.linalg.norm(places, axis=1))[:, None]
    for place in places:
        heard = render(
            Body(model=MODEL, excitations=SOFT),
            listener=Mono(position=tuple(place)),
            seconds=0.05,
            fade=0,
        ).samples[0]
        alone = render(MODEL, SOFT, listener=place, seconds=0.05, fade=0).samples[0].astype(float)
        wanted = delayed(alone, float(np.linalg.norm(place)) / AIR.sound_speed)
        apart = np.abs(heard - wanted)[:-200]  # a delay by the spectrum wraps round at the end
        assert apart.max() <= 1e-3 * np.abs(wanted).max()


def around(time: float) -> tuple[float, float, float]:
    """Walk about the body, 0.4 m from it, at 1 m/s."""
    return (0.4 * np.cos(2.5 * time), 0.4 * np.sin(2.5 * time), 0.1)


@pytest.mark.parametrize(
    "listener",
    [Mono(), Stereo(facing=(0, 1, 0)), Binaural(facing=(0, 1, 0)), Stereo(field="ears")],
    ids=["mono", "ball", "kemar", "bare ears"],
)
def test_a_walk_round_a_body_does_not_click(listener: Mono | Stereo | Binaural) -> None:
    first = RATE // 20
    walk = render(RUNG, SOFT, listener=replace(listener, position=around), seconds=0.4, fade=0)
    loudest = max(
        np.abs(np.diff(stood.samples[:, first:], 2)).max()
        for time in (0.05, 0.2, 0.35)
        for stood in [
            render(
                RUNG, SOFT, listener=replace(listener, position=around(time)), seconds=0.1, fade=0
            )
        ]
    )
    assert np.abs(np.diff(walk.samples[:, first:], 2)).max() <= 1.5 * loudest


def test_a_head_ahead_hears_low_sound_as_two_bare_ears_do() -> None:
    frequencies = np.array([50.0, 90.0, 120.0, 170.0, 230.0, 290.0])
    plain = plain_ball(frequencies)
    field = RadiatingGains.of(plain.gains, frequencies, [some_sources(frequencies)])
    low = replace(plain, gains=field)
    levels = []
    for listener in (Stereo(), Stereo(field="ears"), Binaural(), Binaural(field="ears")):
        seen: Listener = replace(listener, position=(1.5, 0, 0), facing=(-1, 0, 0))
        samples = render(low, SOFT, listener=seen, seconds=0.5, fade=0).samples
        spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.shape[1])))
        levels.append(spectrum[:, frequencies.astype(int) // 2])
    ball, kemar = (20 * np.log10(head / bare) for head, bare in (levels[:2], levels[2:]))
    assert np.abs(ball).max() < 1.0
    assert np.abs(kemar).max() < 1.0


def test_a_head_shades_what_comes_from_aside() -> None:
    aside = Binaural(position=(0, 1.0, 0), facing=(1, 0, 0))  # the body is on the right
    left, right = render(MODEL, SOFT, listener=aside, seconds=0.1, fade=0).samples
    assert np.square(right).sum() > 2 * np.square(left).sum()


def test_a_body_that_turns_is_heard_as_by_one_who_walks_round_it() -> None:
    turn = 3.0  # rad/s

    def rotation(time: float) -> Array:
        return np.array([np.cos(turn * time / 2), 0, 0, np.sin(turn * time / 2)])

    way = 0.6 / AIR.sound_speed

    def walk(time: float) -> Array:
        # He hears what was sent earlier, when the body was turned less.
        angle = -turn * max(time - way, 0.0)
        return 0.6 * np.array([np.cos(angle), np.sin(angle), 0])

    spinning = Body(model=RUNG, excitations=SOFT, rotation=rotation)
    turned = render(spinning, listener=Mono(position=(0.6, 0, 0)), seconds=0.3, fade=0).samples[0]
    walked = render(RUNG, SOFT, listener=Mono(position=walk), seconds=0.3, fade=0).samples[0]
    np.testing.assert_allclose(turned, walked, atol=1e-3 * np.abs(walked).max())


@pytest.mark.parametrize(
    "listener", [Mono(), Stereo(facing=AHEAD), Stereo(facing=AHEAD, field="ears")]
)
def test_a_wall_is_a_second_body_that_is_mirrored(listener: Mono | Stereo) -> None:
    walls = dict.fromkeys(("x1", "y0", "y1", "z0", "z1"), 1.0) | {"x0": 0.0}
    room = Room(size=(4.0, 4.0, 4.0), walls=walls, order=1)
    place, ear = np.array([0.5, 2.0, 2.0]), np.array([1.4, 2.6, 1.7])
    heard = replace(listener, position=tuple(ear))
    body = Body(model=MODEL, excitations=SOFT, position=tuple(place))
    image = Body(model=mirrored(MODEL), excitations=SOFT, position=tuple(place * [-1, 1, 1]))
    reflected = render(body, listener=heard, room=room, seconds=0.1, fade=0).samples
    both = render([body, image], listener=heard, seconds=0.1, fade=0).samples
    np.testing.assert_allclose(reflected, both, atol=1e-3 * np.abs(both).max())


def test_many_images_of_a_field_are_refused() -> None:
    room = Room(size=(4.0, 4.0, 4.0), order=5)
    body = Body(model=MODEL, excitations=SOFT, position=(1, 2, 2))
    with pytest.raises(
        OptionError, match=r"makes 231 images .* at most 129 of them: give an order= of 4"
    ):
        render(body, listener=Mono(position=(3, 2, 2)), room=room, seconds=0.1, fade=0)


def test_bodies_with_fields_add_up() -> None:
    bodies = [
        Body(model=MODEL, excitations=SOFT, position=(0, y, 0), rotation=(0, 0, 1, 0))
        for y in (0.0, 0.5)
    ]
    listener = Binaural(position=(1, 0.2, 0), facing=(-1, 0, 0))
    together = render(bodies, listener=listener, seconds=0.1, fade=0).samples
    apart = sum(render(each, listener=listener, seconds=0.1, fade=0).samples for each in bodies)
    np.testing.assert_allclose(together, apart, atol=2e-6 * np.abs(together).max())


def test_who_comes_too_near_is_told_how() -> None:
    walk = Mono(position=([0.0, 0.1], [(0.5, 0, 0), (0.065, 0, 0)]))
    with pytest.raises(ContactError, match="near=True"):
        render(RUNG, SOFT, listener=walk, seconds=0.2, fade=0)
    near = replace(RUNG, gains=radiating_ball(near=True)[0].gains)
    assert np.isfinite(render(near, SOFT, listener=walk, seconds=0.2, fade=0).samples).all()


def test_a_way_to_hear_fields_is_one_of_two() -> None:
    with pytest.raises(OptionError, match="field is 'nose': give one of head, ears, or None"):
        Stereo(field="nose")
