"""Bodies in space against the physics of moving sources."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears.hearing import Hearing
from struck.ears.listeners import Binaural, Course3, Listener, Mono, Stereo, Trajectory
from struck.ears.propagation import Emitter
from struck.ears.room import Room
from struck.errors import ContactError, OptionError
from struck.model.material import AIR

Array = NDArray[np.float64]
RATE = 48000
HERE = (0.0, 0.0, 0.0)
AHEAD = (1.0, 0.0, 0.0)


def body(place: Course3, **options: float) -> Emitter:
    return Emitter(centre=Trajectory.of("position", place), **options)


def heard(
    emitter: Emitter,
    listener: Listener,
    samples: Array,
    *,
    block: int = 128,
    room: Room | None = None,
) -> Array:
    """Return what comes of samples at 1 m (ears, n)."""
    hearing = Hearing([emitter], listener, sample_rate=RATE, room=room)
    count = len(samples) + hearing.lead
    padded = np.pad(samples, (0, -(-count // block) * block - len(samples)))
    blocks = [
        hearing.next_block(np.tile(padded[k : k + block], (hearing.lines, 1)))
        for k in range(0, len(padded), block)
    ]
    return np.concatenate(blocks, axis=1)[:, hearing.lead : count]


def tone(seconds: float, frequency: float = 1000.0) -> Array:
    return np.sin(2 * np.pi * frequency * np.arange(int(seconds * RATE)) / RATE)


def momentary_frequency(samples: Array) -> Array:
    """Return the frequency between each two samples, Hz, of what is nearly a sine."""
    from scipy.signal import hilbert

    return np.diff(np.unwrap(np.angle(hilbert(samples)))) * RATE / (2 * np.pi)


@pytest.mark.parametrize("distance", [0.3, 1.0, 7.77, 120.0])
@pytest.mark.parametrize("block", [32, 128, 1000])
def test_sound_arrives_after_r_over_c_and_falls_as_one_over_r(distance: float, block: int) -> None:
    sine = tone(0.6)
    samples = heard(body((distance, 0, 0)), Mono(position=HERE), sine, block=block)[0]
    late = distance / AIR.sound_speed
    times = np.arange(len(sine)) / RATE
    settled = times > late + 0.001
    wanted = np.sin(2 * np.pi * 1000 * (times - late)) / distance
    np.testing.assert_allclose(samples[settled], wanted[settled], atol=1e-4 / distance)
    assert not samples[times < late - 0.001].any()


def passing(speed: float, aside: float, middle: float) -> Callable[[float], tuple[float, ...]]:
    return lambda time: (speed * (time - middle), aside, 0.0)


def arrival(place: Callable[[float], tuple[float, ...]], times: Array) -> Array:
    """Return how long what arrives at the origin was on its way, s, by fixed points."""
    late = np.zeros_like(times)
    for _ in range(60):
        places = np.array([place(time) for time in times - late])
        late = np.linalg.norm(places, axis=1) / AIR.sound_speed
    return late


def test_a_source_that_passes_at_20_metres_a_second_shifts_as_doppler_says() -> None:
    place = passing(20.0, 2.0, 1.0)
    samples = heard(body(place), Mono(position=HERE), tone(2.0))[0]
    measured = momentary_frequency(samples)[9600:-2400:240]
    times = ((np.arange(len(samples) - 1) + 0.5) / RATE)[9600:-2400:240]
    step = 1e-5
    change = (arrival(place, times + step) - arrival(place, times - step)) / (2 * step)
    np.testing.assert_allclose(measured, 1000 * (1 - change), rtol=0.002)
    assert measured[0] > 1055
    assert measured[-1] < 950


def test_a_listener_that_moves_away_hears_lower_by_v_over_c() -> None:
    runner = Mono(position=([0.0, 2.0], [(1, 0, 0), (41, 0, 0)]))
    samples = heard(body(HERE), runner, tone(1.5))[0]
    measured = momentary_frequency(samples)[RATE // 2 : RATE].mean()
    assert measured == pytest.approx(1000 * (1 - 20 / AIR.sound_speed), rel=1e-4)


@pytest.mark.parametrize(
    "listener",
    [
        Stereo(position=HERE, facing=AHEAD),
        Stereo(position=HERE, facing=AHEAD, head="woodworth"),
        Stereo(position=HERE, facing=AHEAD, head="simple1998"),
        pytest.param(Binaural(position=HERE, facing=AHEAD), marks=pytest.mark.prove),
    ],
    ids=["exact", "woodworth", "simple1998", "kemar"],
)
def test_a_circle_round_the_head_has_no_lines_but_those_of_the_motion(listener: Listener) -> None:
    def circle(time: float) -> tuple[float, float, float]:
        return 1.4 * np.cos(2 * np.pi * time), 1.4 * np.sin(2 * np.pi * time), 0.0

    turn = heard(body(circle), listener, tone(1.2))[:, RATE // 10 : RATE // 10 + RATE]
    levels = np.abs(np.fft.rfft(turn)) / RATE
    carrier = levels[:, 900:1101].max(axis=1)
    # A head's angular orders end about where k a does; the motion's lines lie a turn apart.
    elsewhere = np.r_[100:940, 1061:3000]
    assert (levels[:, elsewhere] <= 1e-3 * carrier[:, None]).all()


@pytest.mark.parametrize("listener", [Stereo(), Binaural()], ids=["ball", "kemar"])
def test_left_is_left_and_right_is_right_whichever_way_the_head_is_turned(
    listener: Stereo | Binaural,
) -> None:
    noise = np.random.default_rng(1).standard_normal(RATE // 4)
    for facing, place, loud in [
        ((1, 0, 0), (0, 2, 0), 0),
        ((1, 0, 0), (0, -2, 0), 1),
        ((-1, 0, 0), (0, 2, 0), 1),
        ((0, 1, 0), (2, 0, 0), 1),
        ((0, 0, 1), (0, 2, 0), 0),
    ]:
        up = (0, 0, 1) if facing[2] == 0 else (-1, 0, 0)
        turned = type(listener)(position=HERE, facing=facing, up=up)
        energies = np.square(heard(body(place), turned, noise)).sum(axis=1)
        assert energies[loud] > 2 * energies[1 - loud]


def test_a_body_with_a_timbre_field_gets_no_second_head() -> None:
    listener = Stereo(position=(0, 1, 0), facing=AHEAD, radius=0.1)
    sine = tone(0.2)
    samples = heard(body(HERE, field="ears"), listener, sine)
    times = np.arange(len(sine)) / RATE
    for ear, distance in enumerate((1.1, 0.9)):
        wanted = np.sin(2 * np.pi * 1000 * (times - distance / AIR.sound_speed))
        np.testing.assert_allclose(samples[ear, 480:], wanted[480:], atol=1e-4)


def test_walls_that_reflect_all_send_images() -> None:
    room = Room(size=(10.0, 10.0, 10.0), walls=0.0, order=1)
    click = np.zeros(4800)
    click[10] = 1
    listener = Mono(position=(5.0, 5.0, 5.0))
    samples = heard(body((7.0, 5.0, 5.0)), listener, click, room=room)[0]
    ways = [2.0, 8.0, 12.0, *[np.hypot(2.0, 10.0)] * 4]
    smooth = np.convolve(samples, np.ones(9), "same")
    for way in ways:
        arrived = smooth[int(10 + way / AIR.sound_speed * RATE) - 2 :][:5]
        count = ways.count(way)
        assert np.abs(arrived).max() == pytest.approx(count / way, rel=0.1)


def test_nobody_gets_inside_a_body() -> None:
    with pytest.raises(ContactError, match="m from the centre of body 0, inside"):
        Hearing([body((0.5, 0, 0), radius=0.6)], Mono(position=HERE), sample_rate=RATE)
    coming = body(([0.0, 1.0], [(3, 0, 0), (0, 0, 0)]), radius=0.6)
    with pytest.raises(ContactError, match="body 0, inside"):
        heard(coming, Mono(position=HERE), tone(1.2))


@pytest.mark.parametrize(
    ("listener", "message"),
    [
        (lambda: Stereo(position=HERE, facing=(0, 0, 1)), "facing lies along up"),
        (lambda: Stereo(position=HERE, facing=(0, 0, 0)), "facing is .0"),
        (lambda: Binaural(facing=([0, 1], [(0, 0, 0), (1, 0, 0)])), "facing is .* length"),
        (lambda: Stereo(position=HERE, facing=lambda _: (0, 0, 0)), "facing is"),
        (lambda: Binaural(hrtf="kemer"), "did you mean kemar. .*or the path of a .sofa file"),
        (lambda: Mono(position=(20_000.0, 0.0, 0.0)), "at most 10000 m"),
    ],
)
def test_directions_and_distances_that_cannot_be_are_refused(
    listener: Callable[[], Listener], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        Hearing([body((1, 0, 0))], listener(), sample_rate=RATE)


def test_a_place_outside_the_room_is_refused() -> None:
    room = Room(size=(4.0, 3.0, 2.5))
    with pytest.raises(OptionError, match="outside the room"):
        Hearing([body((1, 1, 1))], Mono(position=(0.0, 0.0, 3.0)), sample_rate=RATE, room=room)


def test_heads_that_cannot_be_are_refused() -> None:
    with pytest.raises(OptionError, match="head is 'round'"):
        Stereo(head="round")
    with pytest.raises(OptionError, match="radius is -1"):
        Binaural(radius=-1)
    with pytest.raises(OptionError, match="position is"):
        Mono(position=(1, 2))
