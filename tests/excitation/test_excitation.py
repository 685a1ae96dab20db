"""Strikes, plucks and force tracks as samples: strength, spectra, blocks, bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from struck.errors import FileFormatError, OptionError
from struck.excitation.excitation import Excitation
from struck.excitation.force_track import ForceTrack
from struck.excitation.hertz import Striker
from struck.excitation.pluck import Pluck
from struck.excitation.pulses import LEAD
from struck.excitation.strike import Strike
from struck.files.wav import Recording, encode
from tests.excitation.bodies import SIZE, plate
from tests.excitation.pulse_laws import transform

RATE = 48000.0
PLACE = (0.05, 0.03, SIZE[2] / 2)


def force(
    excitation: Excitation, length: int = 8192, block: int = 128, start: int = -64
) -> np.ndarray:
    pushing = excitation.begin(plate(20), RATE, start=start)
    blocks = []
    for _ in range(length // block):
        push = pushing.advance(block)
        blocks.append(np.zeros(block) if push is None else push.force)
    assert pushing.finished
    return np.concatenate(blocks)


def spectrum(signal: np.ndarray, frequencies: np.ndarray, start: int = -64) -> np.ndarray:
    times = (start + np.arange(len(signal))) / RATE
    return np.exp(-2j * np.pi * np.outer(frequencies, times)) @ signal / RATE


TONE = np.sin(2 * np.pi * 1000 * np.arange(2205) / 44100) * np.hanning(2205)


@pytest.mark.parametrize(
    "excitation",
    [
        Strike(at=PLACE, impulse=0.02, duration=1.3e-3, time=0.0101, shape="gaussian"),
        Strike(at=PLACE, striker="felt", transient=0.2, time=0.003),
        Pluck(at=PLACE, force=3.0, rise=0.02),
        ForceTrack(at=PLACE, force=TONE, sample_rate=44100, time=0.01),
    ],
)
def test_force_does_not_depend_on_the_blocks(excitation: Excitation) -> None:
    whole = force(excitation, block=4096)
    assert np.abs(whole).max() > 0
    for block in (1, 16, 128):
        assert np.array_equal(force(excitation, block=block), whole)


def test_there_is_no_push_where_there_is_no_force() -> None:
    pushing = Strike(at=PLACE, impulse=0.02, time=0.01).begin(plate(20), RATE)
    pushes = [pushing.advance(17) for _ in range(60)]
    with_force = [number for number, push in enumerate(pushes) if push is not None]
    assert with_force == [(480 - LEAD) // 17, (480 + LEAD) // 17]


def test_a_strike_holds_its_impulse_and_its_shape() -> None:
    strike = Strike(at=PLACE, impulse=0.02, duration=1e-3, time=0.0101234, shape="hertz")
    signal = force(strike)
    assert signal.sum() / RATE == pytest.approx(0.02, rel=1e-4)
    frequencies = np.linspace(0, 4000, 50)
    expected = 0.02 * np.abs(transform("hertz", frequencies, 1e-3))
    assert np.abs(spectrum(signal, frequencies)) == pytest.approx(expected, abs=2e-5)


def test_energy_is_half_the_mass_times_the_speed_squared() -> None:
    head = Striker.named("felt")
    by_energy = Strike(at=PLACE, striker="felt", energy=0.5 * head.mass * 1.7**2)
    by_speed = Strike(at=PLACE, striker="felt", speed=1.7)
    assert force(by_energy) == pytest.approx(force(by_speed), rel=1e-9)
    wood = Striker.named("wood")
    bare = Strike(at=PLACE, energy=0.5 * wood.mass * 0.5**2)
    assert force(bare) == pytest.approx(force(Strike(at=PLACE)), rel=1e-9)


def test_the_transient_has_the_level_asked_for_at_all_frequencies() -> None:
    options = {"at": PLACE, "impulse": 0.02, "duration": 4e-3, "time": 0.01}
    plain = force(Strike(**options))
    frequencies = np.linspace(500, 20000, 40)
    bursts = [
        force(Strike(**options, transient=0.1, seed=seed), block=1024) - plain
        for seed in range(100)
    ]
    power = np.square(np.abs(spectrum(np.transpose(bursts), frequencies))).mean(axis=1)
    assert np.sqrt(power.mean()) == pytest.approx(0.1 * 0.02, rel=0.03)
    assert np.sqrt(power) == pytest.approx(np.full(40, 0.1 * 0.02), rel=0.3)


def test_the_transient_repeats_by_its_seed() -> None:
    one, same, other = (
        force(Strike(at=PLACE, impulse=0.1, transient=0.5, seed=seed)) for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_a_patch_drives_less_than_a_point() -> None:
    point, disc = (
        Strike(at=PLACE, impulse=0.1, patch=patch).begin(plate(20), RATE).advance(128).drive
        for patch in (0.0, 0.03)
    )
    assert np.all(np.abs(disc) < np.abs(point))


def test_a_plucked_string_falls_by_one_over_n_more_than_a_struck_one() -> None:
    # Modes of an ideal string answer an impulse with amplitudes as 1/n (1998, section 6).
    numbers = np.arange(1, 41)
    frequencies = 200.0 * numbers
    plucked = force(Pluck(at=PLACE, force=3.0, rise=0.05))
    struck = force(Strike(at=PLACE, impulse=0.02))
    amplitudes = [np.abs(spectrum(signal, frequencies)) / numbers for signal in (struck, plucked)]
    assert amplitudes[0] == pytest.approx(amplitudes[0][0] / numbers, rel=0.001)
    assert amplitudes[1] == pytest.approx(amplitudes[1][0] / numbers**2, rel=0.02)
    # Newton: the step F has the spectrum F / (2 pi f).
    assert amplitudes[1][9] * 10 == pytest.approx(3.0 / (2 * np.pi * 2000), rel=0.01)


def test_a_pluck_lets_go_between_samples() -> None:
    frequencies = np.array([3000.0, 9000.0, 15000.0])
    early, late = (
        spectrum(force(Pluck(at=PLACE, rise=0.05, time=time)), frequencies)
        for time in (0.0, 0.3 / RATE)
    )
    turn = np.angle(late / early)
    assert turn == pytest.approx(-2 * np.pi * frequencies * 0.3 / RATE, abs=0.01)


def test_a_track_keeps_its_tone_at_another_rate() -> None:
    track = ForceTrack(at=PLACE, force=TONE, sample_rate=44100, gain=2.5, time=0.01)
    times = np.arange(-64, 8192 - 64) / RATE - 0.01
    shape = np.interp(times, np.arange(2205) / 44100, np.hanning(2205), 0, 0)
    expected = 2.5 * np.sin(2 * np.pi * 1000 * times) * shape
    assert np.abs(force(track) - expected).max() < 2e-3


def test_a_track_reads_a_file(tmp_path: Path) -> None:
    file = tmp_path / "tap.wav"
    file.write_bytes(encode(Recording(samples=TONE[None].astype(np.float32), sample_rate=48000)))
    track = ForceTrack(at=PLACE, force=file, gain=3.0)
    assert force(track)[64 : 64 + 2205] == pytest.approx(3.0 * TONE, abs=1e-6)
    stereo = np.stack([TONE, TONE]).astype(np.float32)
    file.write_bytes(encode(Recording(samples=stereo, sample_rate=48000)))
    with pytest.raises(FileFormatError, match="2 channels"):
        ForceTrack(at=PLACE, force=file)
    with pytest.raises(FileFormatError, match="is missing, there is no file"):
        ForceTrack(at=PLACE, force=tmp_path / "none.wav")


@pytest.mark.parametrize(
    ("kind", "arguments", "message"),
    [
        (Strike, {"energy": -1.0}, r"energy is -1\.0"),
        (Strike, {"energy": 1.0, "impulse": 1.0}, "give one of them"),
        (Strike, {"shape": "square"}, "give one of half-sine"),
        (Strike, {"patch": -1e-3}, "patch is"),
        (Strike, {"transient": np.nan}, "transient is nan"),
        (Strike, {"seed": -1}, "seed is -1"),
        (Pluck, {"force": 0.0}, r"force is 0\.0"),
        (Pluck, {"force": np.nan}, "force is nan"),
        (Pluck, {"rise": 0.0}, r"rise is 0\.0"),
        (Pluck, {"time": -1.0}, "time is"),
        (ForceTrack, {"force": [1.0, np.nan], "sample_rate": 100}, "1 of 2 forces"),
        (ForceTrack, {"force": [], "sample_rate": 100}, "give a row"),
        (ForceTrack, {"force": [1.0]}, "sample_rate is missing"),
        (ForceTrack, {"force": [1.0], "sample_rate": 0.0}, r"sample_rate is 0\.0"),
        (ForceTrack, {"force": [1.0], "sample_rate": 100, "gain": np.inf}, "gain is inf"),
        (ForceTrack, {"force": "tap.wav", "sample_rate": 100}, "leave it out"),
    ],
)
def test_impossible_pushes_are_refused(
    kind: type, arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        kind(**arguments)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan])
def test_impossible_rates_are_refused(rate: float) -> None:
    with pytest.raises(OptionError, match="sample_rate is"):
        Strike(at=PLACE, impulse=1.0).begin(plate(20), rate)
