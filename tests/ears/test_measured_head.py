"""A measured head against its own raw responses, taken from the SOFA file by h5py alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears.measured_head import (
    HrtfSet,
    MeasuredFilters,
    MeasuredHead,
    align,
    prepare,
    read_bundled,
)
from struck.ears.sphere import arrival_delay, distance_gain
from struck.errors import OptionError

Array = NDArray[np.float64]

DATA = Path(__file__).parent / "data"
RATE = 48000.0
LOW = np.arange(100.0, 1500.0, 10.0)
MIDDLE = np.arange(500.0, 8001.0, 10.0)


@pytest.fixture(scope="module")
def kemar() -> MeasuredFilters:
    return prepare(read_bundled("kemar"), RATE)


@pytest.fixture(scope="module")
def raw() -> tuple[Array, Array, Array]:
    with h5py.File(DATA / "kemar_subset.sofa") as file:
        azimuth, elevation = np.radians(file["SourcePosition"][:, :2].T)
        responses = file["Data.IR"][...]
    level = np.cos(elevation)
    x, y = level * np.cos(azimuth), level * np.sin(azimuth)
    return np.stack([x, y, np.sin(elevation)], axis=1), responses, np.degrees(azimuth)


def spectra(responses: Array, rate: float, frequencies: Array, delays: Array | float = 0) -> Array:
    times = np.arange(responses.shape[-1]) / rate
    late = np.exp(-2j * np.pi * frequencies * np.asarray(delays)[..., np.newaxis])
    return responses @ np.exp(-2j * np.pi * np.outer(times, frequencies)) * late


def interaural_delays(left_and_right: Array, frequencies: Array) -> Array:
    """Lags of the highest cross-correlation, s, a microsecond apart; positive: left leads."""
    lags = np.arange(-1000, 1001) * 1e-6
    cross = left_and_right[:, 1] * np.conj(left_and_right[:, 0])
    correlations = (cross @ np.exp(2j * np.pi * np.outer(frequencies, lags))).real
    return lags[np.argmax(correlations, axis=1)]


def heard(
    filters: MeasuredFilters,
    directions: Array,
    distance: float,
    frequencies: Array,
    rate: float = RATE,
) -> Array:
    delays, responses = filters.toward(directions, np.full(len(directions), distance))
    return spectra(responses, rate, frequencies, delays)


def decibels(values: Array) -> Array:
    return 20 * np.log10(np.abs(values))


def third_octaves(values: Array) -> Array:
    centres = 1000 * 2.0 ** (np.arange(-2, 9) / 3)
    bands = np.abs(np.log2(MIDDLE / centres[:, np.newaxis])) <= 1 / 6
    return 10 * np.log10(np.abs(values) ** 2 @ bands.T / bands.sum(axis=1))


def at(azimuth: float, elevation: float = 0.0) -> Array:
    a, e = np.radians([azimuth, elevation])
    return np.array([[np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]])


def test_the_bundle_is_the_file(raw: tuple[Array, Array, Array]) -> None:
    directions, responses, _ = raw
    bundle = read_bundled("kemar")
    rows = np.argmax(directions @ bundle.directions.T, axis=1)
    np.testing.assert_allclose(bundle.directions[rows], directions, atol=1e-12)
    assert np.array_equal(bundle.responses[rows], responses[:, :, 20:420])
    assert len(bundle.directions) == 710
    assert (bundle.sample_rate, bundle.distance) == (44100, 1.4)
    np.testing.assert_allclose(bundle.delays, 20 / 44100)
    assert np.array_equal(bundle.responses * 32768, np.round(bundle.responses * 32768))


def test_interaural_delays_are_the_sets_own(
    kemar: MeasuredFilters, raw: tuple[Array, Array, Array]
) -> None:
    directions, responses, azimuths = raw
    chosen = (np.abs(directions[:, 2]) < 1e-9) & (azimuths > 14) & (azimuths < 91)
    assert np.count_nonzero(chosen) == 6
    own = interaural_delays(spectra(responses[chosen], 44100, LOW), LOW)
    ours = interaural_delays(heard(kemar, directions[chosen], 1.4, LOW), LOW)
    assert np.min(own) > 80e-6
    np.testing.assert_allclose(ours, own, atol=20e-6)


def test_levels_are_the_sets_own(kemar: MeasuredFilters, raw: tuple[Array, Array, Array]) -> None:
    directions, responses, _ = raw
    own = spectra(responses, 44100, MIDDLE) * kemar.gain
    ours = heard(kemar, directions, 1.4, MIDDLE)
    assert np.median(np.abs(decibels(ours) - decibels(own))) < 0.5
    np.testing.assert_allclose(third_octaves(ours), third_octaves(own), atol=1)


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.prove)])
def test_levels_of_all_directions_are_the_sets_own(kemar: MeasuredFilters, every: int) -> None:
    bundle = read_bundled("kemar")
    own = spectra(bundle.responses[::every], 44100, MIDDLE) * kemar.gain
    ours = heard(kemar, bundle.directions[::every], 1.4, MIDDLE)
    off = np.abs(third_octaves(ours) - third_octaves(own))
    assert np.max(off) < 1
    assert np.median(np.abs(decibels(ours) - decibels(own))) < 0.5


@pytest.mark.prove
@pytest.mark.parametrize("rate", [16_000.0, pytest.param(RATE, marks=pytest.mark.prove)])
def test_directions_left_out_are_met_from_their_neighbours(rate: float) -> None:
    bundle = read_bundled("kemar")
    out = np.zeros(710, dtype=bool)
    out[np.random.default_rng(1).choice(710, 71, replace=False)] = True
    fewer = prepare(without(bundle, out), rate)
    frequencies = np.geomspace(200, min(10_000, 0.4 * rate), 300)
    ours = heard(fewer, bundle.directions[out], 1.4, frequencies, rate)
    own = spectra(bundle.responses[out], 44100, frequencies) * fewer.gain
    off = np.abs(decibels(ours) - decibels(own))
    assert np.median(off) < 1  # 2 is promised
    assert np.max(np.median(off, axis=-1)) < 2
    between = interaural_delays(ours, frequencies) - interaural_delays(own, frequencies)
    assert np.median(np.abs(between)) < 20e-6


def without(measured: HrtfSet, out: NDArray[np.bool_]) -> HrtfSet:
    return replace(
        measured,
        directions=measured.directions[~out],
        responses=measured.responses[~out],
        delays=measured.delays[~out],
    )


def test_left_is_left(kemar: MeasuredFilters) -> None:
    delays, responses = kemar.toward(at(90), np.array([1.4]))
    energy = np.sum(responses[0] ** 2, axis=-1)
    assert energy[0] > 10 * energy[1]
    assert delays[0, 0] < -150e-6 < 150e-6 < delays[0, 1]


def test_front_is_front(kemar: MeasuredFilters, raw: tuple[Array, Array, Array]) -> None:
    directions, responses, _ = raw
    ends = [int(np.argmax(directions[:, 0])), int(np.argmin(directions[:, 0]))]
    own = third_octaves(spectra(responses[ends], 44100, MIDDLE))
    ours = third_octaves(heard(kemar, directions[ends], 1.4, MIDDLE))
    assert np.max(np.abs(own[0] - own[1])) > 3
    np.testing.assert_allclose(ours[0] - ours[1], own[0] - own[1], atol=1)


@pytest.mark.parametrize(
    "rate",
    [
        pytest.param(32_000.0, marks=pytest.mark.prove),
        44_100.0,
        pytest.param(48_000.0, marks=pytest.mark.prove),
        pytest.param(96_000.0, marks=pytest.mark.prove),
    ],
)
def test_delays_and_levels_hold_at_any_rate(rate: float) -> None:
    # Pulses: two ears at y = +-0.08 m with nothing between, so that all is known.
    filters = MeasuredHead.read(DATA / "pulses_sofar.sofa").prepared(rate)
    directions = np.concatenate([at(a, e) for a in (0, 37, 90, 200) for e in (-50, 0, 20)])
    delays, responses = filters.toward(directions, np.full(12, 2.0))
    low = np.arange(500.0, 8000.0, 50.0)
    found = spectra(responses, rate, low, delays)
    expected = directions[:, 1] * 2 * 0.08 / 343
    np.testing.assert_allclose(interaural_delays(found, low), expected, atol=3e-6)
    assert np.ptp(decibels(found)) < 0.3
    assert filters.taps == round(448 / 48000 * rate)


def test_a_set_of_44100_is_right_in_delay_at_48000(raw: tuple[Array, Array, Array]) -> None:
    directions, responses, _ = raw
    filters = prepare(MeasuredHead.read(DATA / "kemar_subset.sofa").measured, RATE)
    found = heard(filters, directions, 1.4, LOW)
    own = spectra(responses, 44100, LOW)
    ours, theirs = (s[:, 1] * np.conj(s[:, 0]) for s in (found, own))
    left = np.angle(ours * np.conj(theirs)) / (2 * np.pi * LOW)
    assert np.median(np.abs(left)) < 10e-6  # a sample is 21
    np.testing.assert_allclose(
        interaural_delays(found, LOW), interaural_delays(own, LOW), atol=20e-6
    )


def test_sound_comes_to_the_nearer_ear_as_on_a_sphere(kemar: MeasuredFilters) -> None:
    directions = np.concatenate([at(a, e) for a in range(0, 181, 15) for e in (-30, 0, 45, 60)])
    delays, responses = kemar.toward(directions, np.full(len(directions), 1.4))
    sizes = np.abs(responses[:, 0])
    onsets = np.argmax(sizes > 0.1 * sizes.max(axis=1, keepdims=True), axis=1)
    angles = np.arccos(directions[:, 1])
    arrivals = delays[:, 0] + onsets / RATE
    np.testing.assert_allclose(arrivals, arrival_delay(angles, 1.4), atol=40e-6)


def test_low_frequencies_have_the_level_of_the_free_field(kemar: MeasuredFilters) -> None:
    low = np.arange(200.0, 501.0, 50.0)
    found = heard(kemar, read_bundled("kemar").directions, 1.4, low)
    assert abs(np.mean(10 * np.log10(np.mean(np.abs(found) ** 2, axis=(0, 1))))) < 1.5


def test_a_body_at_the_ear_is_louder_there_as_at_a_sphere(kemar: MeasuredFilters) -> None:
    # Interaural level difference of a rigid sphere at 500 Hz, by the series, in another program.
    at_25_cm, at_1_m = 10.1, 3.8
    frequency = np.array([500.0])

    def between(distance: float) -> float:
        left, right = decibels(heard(kemar, at(90), distance, frequency))[0, :, 0]
        return float(left - right)

    assert between(0.25) - between(1.0) == pytest.approx(at_25_cm - at_1_m, abs=0.3)


@pytest.mark.parametrize("distance", [0.11, 0.2, 0.6, 5.0])
def test_levels_change_with_distance_as_on_a_sphere(
    kemar: MeasuredFilters, distance: float
) -> None:
    frequencies = np.array([250.0, 1000.0, 2000.0, 4000.0, 8000.0])
    near = heard(kemar, at(50, 10), distance, frequencies)
    far = heard(kemar, at(50, 10), 1.4, frequencies)
    angle = np.arccos(at(50, 10)[0, 1])
    expected = distance_gain(frequencies, [angle, np.pi - angle], distance, 1.4).T
    np.testing.assert_allclose(decibels(near / far)[0], decibels(expected), atol=0.3)


def test_beyond_three_metres_next_to_nothing_changes(kemar: MeasuredFilters) -> None:
    delays, responses = kemar.toward(np.repeat(at(60), 3, axis=0), np.array([3.0, 10.0, 1000.0]))
    assert np.ptp(delays, axis=0).max() < 10e-6
    levels = decibels(spectra(responses, RATE, MIDDLE))
    assert np.ptp(levels, axis=0).max() < 0.7


@pytest.mark.prove
@pytest.mark.parametrize(
    "way",
    [
        "over both poles",
        "level",
        "tilted",
    ],
)
def test_nothing_jumps_when_a_source_turns(kemar: MeasuredFilters, way: str) -> None:
    tilted = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0][:2]
    axes = {"over both poles": np.eye(3)[[0, 2]], "level": np.eye(3)[:2], "tilted": tilted}
    first, second = axes[way]
    turn = np.linspace(0, 2 * np.pi, 4001)[:, np.newaxis]
    directions = np.cos(turn) * first + np.sin(turn) * second
    delays, responses = kemar.toward(directions, np.full(4001, 0.5))
    both = np.concatenate([delays * RATE, responses.reshape(4001, -1)], axis=1)
    steps = np.linalg.norm(np.diff(both, axis=0), axis=1)
    assert np.max(steps) < 0.02 * np.max(np.linalg.norm(responses, axis=(1, 2)))
    assert np.max(np.abs(np.diff(steps))) < 0.2 * np.max(steps)


def test_directions_never_measured_stay_within_what_was(kemar: MeasuredFilters) -> None:
    bundle = read_bundled("kemar")
    _, known = kemar.toward(bundle.directions, np.full(710, 1.4))
    below = np.concatenate([at(a, e) for a in range(0, 360, 7) for e in (-45, -60, -75, -90)])
    delays, guessed = kemar.toward(below, np.full(len(below), 1.4))
    energies, measured = np.sum(guessed**2, axis=-1), np.sum(known**2, axis=-1)
    assert np.min(measured) / 2 < np.min(energies) < np.max(energies) < np.max(measured) * 1.5
    assert np.max(np.abs(delays)) < 0.6e-3


def test_filters_are_kept_and_heads_are_named(kemar: MeasuredFilters) -> None:
    head = MeasuredHead.named("kemar")
    assert head.prepared(RATE) is kemar
    assert (head.name, head.references) == ("kemar", ("gardner1994",))
    with pytest.raises(OptionError, match="kemar"):
        MeasuredHead.named("nobody")
    with pytest.raises(OptionError, match="4000"):
        head.prepared(100)


def test_poles_measured_many_times_do_no_harm() -> None:
    azimuths = np.arange(0, 360, 30)
    directions = np.concatenate([at(a, e) for a in azimuths for e in (-60, -30, 0, 30, 60, 90)])
    filters = prepare(plain(directions), 16000.0)
    _, found = filters.toward(np.concatenate([at(0), at(180), at(0, 90)]), np.full(3, 1.5))
    levels = np.sum(found, axis=-1)[:, 0] / filters.gain
    np.testing.assert_allclose(levels, [1.5, 0.5, 1.0], atol=0.03)


def test_of_more_directions_than_nodes_the_nearest_are_kept() -> None:
    many = np.random.default_rng(4).normal(size=(500, 3))
    many /= np.linalg.norm(many, axis=1, keepdims=True)
    nodes = np.concatenate([np.eye(3), -np.eye(3)])
    kept = align(plain(many), 16000.0, nodes).directions
    nearest = many[np.argmax(nodes @ many.T, axis=1)]
    assert {tuple(row) for row in kept} == {tuple(row) for row in nearest}


def plain(directions: Array) -> HrtfSet:
    """Pulses of no delay, louder in front."""
    responses = np.zeros((len(directions), 2, 16))
    responses[:, :, 8] = 1 + 0.5 * directions[:, :1]
    return HrtfSet(
        name="plain",
        directions=directions,
        distance=1.5,
        responses=responses,
        delays=np.zeros((len(directions), 2)),
        sample_rate=16000.0,
    )
