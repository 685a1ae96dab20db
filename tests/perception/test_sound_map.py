"""Sound maps keep what they promise, at any contact."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from struck.errors import ContactError, FileFormatError, OptionError
from struck.model.mesh import Surface
from struck.model.model import ModalModel
from struck.perception.sonic_distance import HeardModel, band_excess, erb_distance
from struck.perception.sound_map import SoundMap, sound_map
from tests.perception.bodies import chord, clamped_plate, hinged_bar, random_contacts

Array = np.ndarray


def apart(model: ModalModel, made: SoundMap, points: Array, directions: Array) -> Array:
    """Return how far what a map says of contacts is from what a model does, dB."""
    hearing = HeardModel.at(model, made.listener, made.level)
    true = hearing.intensities(points, directions)[:, 0]
    told = np.square(np.abs([made.at(point) for point in points])) * hearing.weights
    return erb_distance(band_excess(model.frequencies, true), band_excess(model.frequencies, told))


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    return hinged_bar(12, cells=60)


@pytest.fixture(scope="module")
def bar_map(bar: ModalModel) -> SoundMap:
    return sound_map(bar, 4.0, level=70)


def test_the_bound_holds_at_contacts_of_a_body_given_at_vertices(
    bar: ModalModel, bar_map: SoundMap
) -> None:
    found = apart(bar, bar_map, *random_contacts(bar.geometry, 50, seed=1))
    assert 1 < found.max() <= bar_map.bound <= 4


@pytest.mark.prove
@pytest.mark.parametrize("threshold", [8.0, pytest.param(5.0, marks=pytest.mark.prove)])
def test_the_bound_holds_at_contacts_of_a_body_in_closed_form(threshold: float) -> None:
    plate = clamped_plate(2500.0, spacing=0.06)
    made = sound_map(plate, threshold, level=60)
    found = apart(plate, made, *random_contacts(plate.geometry, 50, seed=2))
    assert 1 < found.max() <= made.bound <= threshold


def test_a_stored_contact_sounds_as_it_does(bar: ModalModel, bar_map: SoundMap) -> None:
    drives = bar.gains.at(bar_map.contacts, bar_map.directions)
    gains = (drives * bar.gains.toward(bar_map.listener[None])).sum(axis=1)
    assert bar_map.gains == pytest.approx(gains)  # with their signs
    assert np.any(gains.real < 0)
    assert np.any(gains.real > 0)
    number, factor = bar_map.stored(bar_map.contacts[0])
    assert bar_map.at(bar_map.contacts[0]) == pytest.approx(factor * bar_map.gains[number])
    energy = np.square(np.abs(bar_map.at(bar_map.contacts[0]))).sum()
    assert energy == pytest.approx(np.square(np.abs(gains[0])).sum(), rel=0.05)


def test_a_finer_threshold_stores_more_and_a_softer_level_fewer(
    bar: ModalModel, bar_map: SoundMap
) -> None:
    told: list[float] = []
    coarse = sound_map(bar, 8.0, level=70, progress=lambda _, done: told.append(done))
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] < 1
    soft = sound_map(bar, 4.0, level=40)
    assert len(coarse.contacts) < len(bar_map.contacts)
    assert len(soft.contacts) < len(bar_map.contacts)


def test_sounds_change_more_often_toward_the_ends_of_a_string(bar: ModalModel) -> None:
    # 1998, section 5: a string becomes dramatically brighter near its endpoints.
    made = sound_map(bar, 4.0, level=70)
    place = np.column_stack([np.linspace(0.004, 0.496, 800), np.full(800, 0.0047),
                             np.full(800, 0.0025)])  # fmt: skip
    owners = np.array([made.stored(point)[0] for point in place])
    changes = place[1:][owners[1:] != owners[:-1], 0]
    ends = np.count_nonzero((changes < 0.125) | (changes > 0.375))
    assert ends > 1.2 * np.count_nonzero((changes > 0.125) & (changes < 0.375))


def test_places_that_sound_alike_share_a_sound(bar_map: SoundMap) -> None:
    # The upper and lower side, and both halves, sound the same: the map takes note.
    assert bar_map.stored((0.1, 0.005, 0.0025))[0] in set(bar_map.owners)
    for x in (0.03, 0.11, 0.2):
        sounds = [
            np.abs(bar_map.at(place))
            for place in ((x, 0.006, 0.0025), (0.5 - x, 0.004, 0.0025), (x, 0.005, -0.0025))
        ]
        hearing = [
            band_excess(bar_map.frequencies, 1e7 * each**2 / (each**2).sum()) for each in sounds
        ]
        assert erb_distance(hearing[0], hearing[1]) < 2 * bar_map.bound
        assert erb_distance(hearing[0], hearing[2]) < 2 * bar_map.bound


def test_where_a_body_is_silent_its_map_is_too(bar_map: SoundMap) -> None:
    assert np.abs(bar_map.at((0.25, 0.0, 0.0))).max() == 0  # a push along its side
    assert np.isnan(bar_map.brightness).any()


def test_one_timbre_takes_one_contact() -> None:
    model = chord([400.0, 1000.0, 2500.0], [1.0, 0.5, 0.25], [-0.2, -0.1, -0.05])
    made = sound_map(model, 1.0, level=60)
    assert len(made.contacts) == 1
    points, directions = random_contacts(model.geometry, 50, seed=5)
    top = np.abs(directions[:, 2]) > 0.5
    assert apart(model, made, points[top], directions[top]).max() <= made.bound


def test_brightness_is_the_centroid_of_the_spectrum(bar: ModalModel, bar_map: SoundMap) -> None:
    for number in (0, len(bar_map.contacts) - 1):
        decays = bar.decays
        shares = np.abs(bar_map.gains[number]) ** 2 * (1 - np.exp(-0.4 * decays)) / (0.4 * decays)
        wanted = np.average(bar.frequencies, weights=shares)
        assert bar_map.stored_brightness[number] == pytest.approx(wanted)
    assert np.nanmin(bar_map.brightness) > bar.frequencies[0]
    assert np.nanmax(bar_map.brightness) < bar.frequencies[-1]


def test_parameters_come_back_from_a_file(bar_map: SoundMap, tmp_path: Path) -> None:
    bar_map.save(tmp_path / "bar.map")
    again = SoundMap.load(tmp_path / "bar.map")
    assert again.bound == bar_map.bound
    assert np.array_equal(again.gains, bar_map.gains)
    place = (0.123, 0.004, 0.0025)
    assert np.array_equal(again.at(place), bar_map.at(place))
    assert "contacts of 12 modes" in repr(again)


def test_files_that_are_no_maps_are_refused(bar_map: SoundMap, tmp_path: Path) -> None:
    path = tmp_path / "bar.map"
    with pytest.raises(FileFormatError, match="is missing, there is no file"):
        SoundMap.load(path)
    bar_map.save(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=r"bar\.map"):
        SoundMap.load(path)


def test_triangles_cover_the_surface_without_gaps(bar: ModalModel, bar_map: SoundMap) -> None:
    assert bar_map.surface.areas.sum() == pytest.approx(bar.geometry.areas.sum())
    points, _ = random_contacts(bar.geometry, 200, seed=6)
    distances, _, _ = Surface(bar_map.surface).closest(points)
    assert distances.max() < 1e-9


def test_bad_arguments_are_refused(
    bar: ModalModel, bar_map: SoundMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    for wrong in (0.0, -3.0, np.nan):
        with pytest.raises(OptionError, match="must exceed 0"):
            sound_map(bar, wrong)
    with pytest.raises(OptionError, match="2 listeners"):
        sound_map(bar, listener=[(1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    with pytest.raises(ContactError, match="off the body"):
        bar_map.at((0.1, 0.2, 0.3))
    module = import_module("struck.perception.sound_map")  # the package names a function so, too
    monkeypatch.setattr(module, "MOST_TRIANGLES", 600)
    with pytest.raises(OptionError, match="a larger one"):
        sound_map(bar, 0.5)


@pytest.mark.prove
def test_a_clamped_plate_takes_fewer_contacts_than_a_regular_grid_of_the_same_worst_error() -> None:
    plate = clamped_plate(16_000.0)
    made = sound_map(plate, 3.0)
    points, directions = random_contacts(plate.geometry, 1000, seed=7)
    found = apart(plate, made, points, directions)
    assert found.max() <= made.bound <= 3.0
    count = len(made.contacts)
    assert count < 100
    for side in (9, 17, 33):  # 1089 contacts on one side of the plate alone
        assert worst_of_a_grid(plate, side, straight=True) > 3.0
        assert worst_of_a_grid(plate, side, straight=False) > 3.0


def worst_of_a_grid(plate: ModalModel, side: int, *, straight: bool) -> float:
    """Return the worst of 2,000 contacts on top when side x side of them are stored.

    Played either by their signed gains, straight between the four around, or by the one in the
    middle of the cell, made as loud as it should be, which is how sound maps play.
    """
    hearing = HeardModel.at(plate)
    points, directions = random_contacts(plate.geometry, 6000, seed=8)
    top = np.flatnonzero(directions[:, 2] < -0.5)[:2000]
    points, directions = points[top], directions[top]
    true = hearing.amplitudes(points, directions)
    shares = points[:, :2] / [0.30, 0.22]
    if straight:
        corner = np.minimum(np.floor(shares * (side - 1)), side - 2)
        told = np.zeros_like(true)
        for step in ((0, 0), (0, 1), (1, 0), (1, 1)):
            node = corner + step
            share = np.prod(1 - np.abs(shares * (side - 1) - node), axis=1)
            place = np.column_stack([node / (side - 1) * [0.30, 0.22], points[:, 2]])
            told += share[:, None] * hearing.amplitudes(place, directions)
    else:
        middle = (np.floor(shares * side) + 0.5) / side
        place = np.column_stack([middle * [0.30, 0.22], points[:, 2]])
        told = hearing.amplitudes(place, directions)
        told *= (np.linalg.norm(true, axis=1) / np.linalg.norm(told, axis=1))[:, None]
    excess = [band_excess(plate.frequencies, np.square(each)) for each in (true, told)]
    return float(erb_distance(*excess).max())
