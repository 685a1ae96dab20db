"""A box of walls against hand-made mirrors, textbook rooms and pyroomacoustics."""

from __future__ import annotations

import importlib.util
import math
import sys

import numpy as np
import pytest
import scipy.signal

from struck.ears.room import BANDS, WALLS, Room, pyroomacoustics, wall_materials
from struck.errors import MissingDependencyError, OptionError
from struck.model.material import AIR

RATE = 48_000.0
C = AIR.sound_speed
SOURCE, LISTENER = np.array([1.0, 1.2, 0.9]), np.array([3.1, 2.3, 1.6])


def mirrored(point: np.ndarray, room: Room, wall: str) -> np.ndarray:
    """Reflect a point at the plane of a wall."""
    axis, side = "xyz".index(wall[0]), int(wall[1])
    plane = room.corner[axis] + side * room.size[axis]
    image = point.copy()
    image[axis] = 2 * plane - point[axis]
    return image


def require_pyroomacoustics() -> None:
    if importlib.util.find_spec("pyroomacoustics") is None:
        pytest.skip("pyroomacoustics is not installed")
    pyroomacoustics()


@pytest.mark.parametrize("order", [0, 1, 2, 3, 6])
def test_there_are_as_many_images_as_lattice_points_in_an_octahedron(order: int) -> None:
    centred_octahedral = (2 * order + 1) * (2 * order**2 + 2 * order + 3) // 3  # 1, 7, 25, 63, ...
    images = Room(size=(5, 4, 3), order=order).images()
    assert len(images) == centred_octahedral
    places = images.at(SOURCE)
    assert len(np.unique(places.round(9), axis=0)) == centred_octahedral
    assert np.all(np.diff(images.reflections) >= 0)
    np.testing.assert_array_equal(places[0], SOURCE)


@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.0), (-2.0, 0.5, -1.0)])
def test_images_are_mirrors_of_mirrors(corner: tuple[float, float, float]) -> None:
    """Every chain of walls, mirrored one after the other, ends at an image with just those walls.

    Chains that meet the same planes in another order end at the same place.
    """
    room = Room(size=(5, 4, 3), order=3, corner=corner)
    source = SOURCE + corner
    images = room.images()
    wanted = {
        (tuple(p.round(9) + 0.0), tuple(n))
        for p, n in zip(images.at(source), images.counts, strict=True)
    }
    found = {(tuple(source.round(9) + 0.0), (0,) * 6)}
    chains = [(source, np.zeros(6, int))]
    for _ in range(3):
        chains = [
            (mirrored(point, room, wall), count + np.eye(6, dtype=int)[k])
            for point, count in chains
            for k, wall in enumerate(WALLS)
        ]
        found |= {(tuple(p.round(9) + 0.0), tuple(n)) for p, n in chains}
    # A wall twice running is no reflection: it leads back. What is left has walls in turn.
    proper = {(p, n) for p, n in found if all(abs(n[a] - n[a + 1]) <= 1 for a in (0, 2, 4))}
    assert wanted <= proper
    assert {p for p, _ in wanted} == {p for p, _ in found}


def test_first_arrivals_of_a_room_done_by_hand() -> None:
    """3 m along and 2 m high: the echo from the floor runs 5 m, as 3, 4, 5."""
    room = Room(size=(10, 10, 10), order=1)
    source, listener = np.array([2.0, 3.0, 2.0]), np.array([5.0, 3.0, 2.0])
    distances = np.linalg.norm(room.images().at(source) - listener, axis=1)
    walls = dict(zip([0, *np.argmax(room.images().counts[1:], axis=1) + 1], distances, strict=True))
    assert walls[0] == 3.0
    assert walls[1 + WALLS.index("z0")] == 5.0  # 3 along, 2 + 2 down and up
    assert walls[1 + WALLS.index("x0")] == 7.0  # 2 + 5 straight back
    assert walls[1 + WALLS.index("x1")] == 13.0  # 8 + 5
    assert walls[1 + WALLS.index("y0")] == pytest.approx(math.hypot(3, 6), rel=1e-15)
    assert walls[1 + WALLS.index("z1")] == pytest.approx(math.hypot(3, 16), rel=1e-15)


def test_images_move_with_the_source() -> None:
    images = Room(size=(5, 4, 3), corner=(1, 1, 1)).images()
    path = np.random.default_rng(1).uniform(1, 4, (7, 2, 3))
    moved = images.at(path)
    assert moved.shape == (7, 2, 25, 3)
    np.testing.assert_array_equal(moved[3, 1], images.at(path[3, 1]))


def test_filters_are_the_products_of_reflection_factors() -> None:
    names = {
        "x0": "brick",
        "x1": 0.36,
        "y0": "glass",
        "y1": "wood",
        "z0": "carpet",
        "z1": "plaster",
    }
    room = Room(size=(5, 4, 3), walls=names, order=2)
    counts, responses = room.images().counts, room.responses(RATE)
    assert responses.dtype == np.float32
    assert responses.shape == (25, 64)
    np.testing.assert_array_equal(responses[0], np.eye(64)[0].astype(np.float32))
    for count, response in zip(counts, responses, strict=True):
        expected = np.zeros(7)
        for wall, times in zip(WALLS, count, strict=True):
            material = names[wall]
            absorbed = (
                wall_materials()[material]["absorption"] if isinstance(material, str) else 0.36
            )
            expected += times * 10 * np.log10(1 - np.array(absorbed))
        _, found = scipy.signal.freqz(response, worN=BANDS, fs=RATE)
        np.testing.assert_allclose(20 * np.log10(abs(found)), expected, atol=0.25)


def test_equal_absorption_is_a_factor_without_delay() -> None:
    room = Room(size=(5, 4, 3), walls=0.36, order=3)
    factors = 0.8 ** room.images().reflections
    expected = factors[:, None] * np.eye(64)[0]
    np.testing.assert_allclose(room.responses(RATE), expected, atol=1e-6)


def test_filters_have_minimum_phase() -> None:
    """All zeros lie inside the unit circle: no filter of this magnitude comes earlier."""
    responses = Room(size=(5, 4, 3), walls="curtain").responses(RATE)
    for response in np.unique(responses, axis=0)[1:]:
        assert np.abs(np.roots(response.astype(float))).max() < 1.0


def test_a_wall_that_takes_all_is_silent() -> None:
    responses = Room(size=(5, 4, 3), walls=1.0).responses(RATE)
    assert np.abs(responses[1:]).max() < 1.01e-5


def test_reverberation_time_of_a_textbook_room() -> None:
    """10 m x 10 m x 10 m with 10 %: 0.161 V / A = 0.161 * 1000 / 60 = 2.68 s after Sabine.

    Eyring's is shorter by 0.1 / -ln(0.9).
    """
    room = Room(size=(10, 10, 10), walls=0.1)
    np.testing.assert_allclose(room.reverberation_time("sabine"), 2.68, rtol=2e-3)
    np.testing.assert_allclose(room.reverberation_time(), 2.68 * 0.1 / -math.log(0.9), rtol=2e-3)


def test_absorption_is_weighed_by_area() -> None:
    """Carpet on 20 m^2 of floor, brick elsewhere (74 m^2): A = 20 * 0.31 + 74 * 0.04 at 1 kHz."""
    walls = dict.fromkeys(WALLS, "brick") | {"z0": "carpet"}
    times = Room(size=(5, 4, 3), walls=walls).reverberation_time("sabine")
    assert times[3] == pytest.approx(0.161 * 60 / (20 * 0.31 + 74 * 0.04), rel=2e-3)


def test_images_and_reverberation_are_one_decay() -> None:
    """From 20 to 50 ms, over many places, images are as strong as the tail: within 0.5 dB."""
    room = Room(size=(5.3, 4.1, 3.2), walls=0.15, order=16)
    images = room.images()
    places = np.random.default_rng(2).uniform(0.5, 2.7, (40, 2, 3))
    first, last = 0.02, 0.05
    heard = 0.0
    for source, listener in places:
        distances = np.linalg.norm(images.at(source) - listener, axis=1)
        inside = (distances > first * C) & (distances < last * C)
        heard += np.sum(0.85 ** images.reflections[inside] / distances[inside] ** 2) / len(places)
    reverberation = room.expected_reverberation(seed=3)
    tail = reverberation.tail(RATE, 1, start=first)[0].astype(float)
    expected = np.sum(tail[: round((last - first) * RATE)] ** 2)
    assert abs(10 * np.log10(heard / expected)) < 0.5


def test_mixing_time_is_that_of_the_mean_free_path() -> None:
    """A cube of edge a has a mean free path of 2 a / 3."""
    assert Room(size=(3, 3, 3), order=2).mixing_time() == pytest.approx(3 * 2.0 / C)


@pytest.mark.parametrize("walls", [0.2, "brick"])
def test_whole_responses_of_pyroomacoustics_agree(walls: float | str) -> None:
    """Own images, placed by sinc, against pyroomacoustics: spectrum 200 Hz to 8 kHz."""
    require_pyroomacoustics()
    room = Room(size=(5.3, 4.1, 3.2), walls=walls, order=2, corner=(-1.0, 0.0, 0.0))
    theirs = room.full_responses(SOURCE, [LISTENER, LISTENER - 0.5], RATE, order=2)
    assert theirs.dtype == np.float32
    for listener, response in zip([LISTENER, LISTENER - 0.5], theirs, strict=True):
        own = placed(room, listener, len(response))
        difference = band_limited(own - response)
        assert np.linalg.norm(difference) < 0.02 * np.linalg.norm(band_limited(response))


@pytest.mark.parametrize("wall", ["carpet", "wood", "curtain"])
def test_one_echo_of_pyroomacoustics_agrees(wall: str) -> None:
    """The floor alone: same arrival, same strength in each octave.

    Their filters are symmetric in time and ours are not, so whole waveforms differ here.
    """
    require_pyroomacoustics()
    silent = dict.fromkeys(WALLS, 1.0)
    rooms = [Room(size=(5.3, 4.1, 3.2), walls=silent | {"z0": share}) for share in (wall, 1.0)]
    both, direct = (r.full_responses(SOURCE, LISTENER, RATE, order=1)[0] for r in rooms)
    echo = both[: len(direct)] - direct[: len(both)]
    distance = np.linalg.norm(mirrored(SOURCE, rooms[0], "z0") - LISTENER)
    assert abs(np.argmax(np.abs(echo)) - RATE * distance / C) < 1
    _, theirs = scipy.signal.freqz(echo * distance, worN=BANDS[1:], fs=RATE)
    floor = np.flatnonzero(rooms[0].images().counts[:7, WALLS.index("z0")])[0]
    _, ours = scipy.signal.freqz(rooms[0].responses(RATE)[floor], worN=BANDS[1:], fs=RATE)
    np.testing.assert_allclose(20 * np.log10(abs(ours / theirs)), 0.0, atol=0.5)


def placed(room: Room, listener: np.ndarray, length: int) -> np.ndarray:
    frequencies = np.fft.rfftfreq(2 * length, 1 / RATE)
    spectrum = np.zeros(len(frequencies), complex)
    distances = np.linalg.norm(room.images().at(SOURCE) - listener, axis=1)
    for distance, response in zip(distances, room.responses(RATE), strict=True):
        travel = np.exp(-2j * np.pi * frequencies * distance / C) / distance
        spectrum += travel * np.fft.rfft(response.astype(float), 2 * length)
    return np.fft.irfft(spectrum)[:length]


def band_limited(signal: np.ndarray) -> np.ndarray:
    band = scipy.signal.butter(4, (200, 8000), "bandpass", fs=RATE, output="sos")
    return scipy.signal.sosfilt(band, signal)


def test_a_missing_library_is_told_with_the_way_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyroomacoustics", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "struck\[room\]"'):
        Room(size=(5, 4, 3)).full_responses(SOURCE, LISTENER, RATE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (5, 0, 3)}, "three lengths above 0"),
        ({"size": (5, 4)}, "three lengths above 0"),
        ({"size": (5, 4, math.nan)}, "three lengths above 0"),
        ({"walls": "brik"}, "did you mean brick"),
        ({"walls": 1.2}, "absorbs 1.2 of the energy: give 0 to 1"),
        ({"walls": {"x0": 0.1}}, "walls are given for x0: give x0, x1"),
        ({"order": -1}, "give 0, 1, 2"),
        ({"order": 1.5}, "order is 1.5: Room takes a whole number"),
        ({"corner": (0, 0, math.inf)}, "three coordinates"),
    ],
)
def test_impossible_rooms_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Room(**{"size": (5, 4, 3), **options})  # type: ignore[arg-type]


def test_a_place_outside_is_refused_with_the_bounds() -> None:
    room = Room(size=(5, 4, 3), corner=(0, 0, -1))
    room.require_inside([[0, 0, -1], [5, 4, 2]], "body")  # walls belong to the room
    with pytest.raises(OptionError, match=r"listener at 1, 4.5, 0 m .* to 5, 4, 2 m"):
        room.require_inside([[1, 1, 1], [1, 4.5, 0]], "listener")
    with pytest.raises(OptionError, match="source at"):
        room.full_responses((0, 0, 3), LISTENER, RATE)
    with pytest.raises(OptionError, match=r"44100.5 Hz: give a whole one"):
        room.full_responses(SOURCE, LISTENER, 44_100.5)
    with pytest.raises(OptionError, match=r"listener at .*nan"):
        room.require_inside([math.nan, 1, 1], "listener")


def test_other_bad_arguments() -> None:
    room = Room(size=(5, 4, 3))
    with pytest.raises(OptionError, match=r"sample rate is 0\.0 Hz"):
        room.responses(0)
    with pytest.raises(OptionError, match="0 taps"):
        room.responses(RATE, 0)
    with pytest.raises(OptionError, match="give one of eyring, sabine"):
        room.reverberation_time("norris")
    assert np.isinf(Room(size=(5, 4, 3), walls=0.0).reverberation_time()).all()
    assert not Room(size=(5, 4, 3), walls=1.0).reverberation_time().any()


def test_every_wall_has_seven_bands_and_a_source() -> None:
    assert len(wall_materials()) >= 8
    for entry in wall_materials().values():
        assert len(entry["absorption"]) == len(BANDS)
        assert all(0 < share < 1 for share in entry["absorption"])
        assert "Vorlaender 2008" in entry["source"]


@pytest.mark.skipif(
    importlib.util.find_spec("pyroomacoustics") is None, reason="pyroomacoustics is not installed"
)
def test_tables_are_those_that_pyroomacoustics_collected() -> None:
    require_pyroomacoustics()
    from pyroomacoustics.parameters import materials_data

    known = {}
    for group in materials_data["absorption"].values():
        known |= {name: entry["coeffs"] for name, entry in group.items()}
    for entry in wall_materials().values():
        name = entry["source"].rsplit("(", 1)[1].rstrip(")").partition(",")[0]
        assert entry["absorption"] == known[name]


def test_no_audio_device_is_opened_on_the_way() -> None:
    require_pyroomacoustics()
    assert "sounddevice" not in sys.modules
