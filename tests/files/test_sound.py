"""Sounds: levels, files, spectra."""

from __future__ import annotations

import base64
import io
import os
import re
import signal as signals
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
from scipy import signal

import struck
from struck.errors import FileFormatError, OptionError
from struck.files import guard, sound_formats, wav
from struck.files.guard import Guard
from struck.files.messages import ReadingLimits
from struck.files.sound import Sound
from struck.files.sound_formats import answer

RATE = 16000
TIMES = np.arange(RATE) / RATE


def tone(amplitude: float = 0.3, *, calibrated: bool = True) -> Sound:
    samples = amplitude * np.stack([np.sin(2000 * np.pi * TIMES), np.cos(500 * np.pi * TIMES)])
    return Sound(samples=samples.astype(np.float32), sample_rate=RATE, calibrated=calibrated)


def test_a_sound_knows_its_length_and_peak_and_cannot_be_changed() -> None:
    sound = tone()
    assert (sound.channels, sound.duration) == (2, 1.0)
    assert sound.peak == pytest.approx(0.3)
    with pytest.raises(ValueError, match="read-only"):
        sound.samples[0, 0] = 1


def test_one_channel_may_come_flat() -> None:
    assert Sound(samples=np.zeros(5, np.float32), sample_rate=RATE).samples.shape == (1, 5)


@pytest.mark.parametrize("encoding", wav.ENCODINGS)
def test_peak_level_is_one_decibel_below_full_scale(tmp_path: Path, encoding: str) -> None:
    factor = tone().save(tmp_path / "tone.wav", encoding=encoding)
    samples, rate = soundfile.read(tmp_path / "tone.wav")
    assert rate == RATE
    assert 20 * np.log10(np.abs(samples).max()) == pytest.approx(-1, abs=1e-3)
    assert factor == pytest.approx(10**-0.05 / 0.3)
    assert f"{factor!r}" in soundfile.SoundFile(tmp_path / "tone.wav").comment


def test_absolute_level_writes_20_pascal_as_one(tmp_path: Path) -> None:
    assert tone(0.5).save(tmp_path / "tone.wav", level="absolute") == 1 / 20
    samples, _ = soundfile.read(tmp_path / "tone.wav")
    assert np.abs(samples).max() == pytest.approx(0.5 / 20, rel=1e-6)


def test_a_relative_sound_has_no_absolute_level(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"relative.*level='peak'"):
        tone(calibrated=False).save(tmp_path / "tone.wav", level="absolute")
    assert not list(tmp_path.iterdir())


def test_integers_beyond_full_scale_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"peak is 1\.5 times full scale.*float32"):
        tone(30.0).save(tmp_path / "tone.wav", level="absolute", encoding="int24")
    assert not list(tmp_path.iterdir())


def test_silence_stays_silence(tmp_path: Path) -> None:
    silence = Sound(samples=np.zeros((1, 10), np.float32), sample_rate=RATE)
    assert silence.save(tmp_path / "silence.wav") == 1.0
    assert not soundfile.read(tmp_path / "silence.wav")[0].any()


@pytest.mark.parametrize(
    ("level", "unit"), [("peak", "Pa"), ("absolute", "Pa"), ("peak", "relative")]
)
def test_own_files_come_back_in_their_unit(tmp_path: Path, level: str, unit: str) -> None:
    sound = tone(calibrated=unit == "Pa")
    sound.save(tmp_path / "tone.wav", level=level)
    back = Sound.load(tmp_path / "tone.wav")
    assert (back.sample_rate, back.calibrated) == (RATE, sound.calibrated)
    np.testing.assert_allclose(back.samples, sound.samples, rtol=3e-7)


@pytest.mark.parametrize("comment", ["made elsewhere", "times nan", "times -1", "times x"])
def test_foreign_files_come_in_full_scale(tmp_path: Path, comment: str) -> None:
    if comment.startswith("times"):
        comment = f"struck: samples are pressure (Pa) {comment}"
    with soundfile.SoundFile(tmp_path / "tone.wav", "w", RATE, 1, subtype="PCM_16") as file:
        file.comment = comment
        file.write(np.array([0.25, -0.5]))
    back = Sound.load(tmp_path / "tone.wav")
    assert not back.calibrated
    assert back.samples.tolist() == [[0.25, -0.5]]


def test_what_cannot_be_read_or_written_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"none\.wav is missing, there is no file"):
        Sound.load(tmp_path / "none.wav")
    with pytest.raises(FileFormatError, match=r"^(?!.*free some.*).*does not exist; make it"):
        tone().save(tmp_path / "no folder" / "tone.wav")
    with pytest.raises(OptionError, match="level is 'loud'"):
        tone().save(tmp_path / "tone.wav", level="loud")


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [
        (np.array([[0.0, np.nan]]), RATE, "1 of 2 samples are not finite"),
        (np.array([[1e300]]), RATE, "not finite"),
        (np.zeros((1, 1, 1)), RATE, "shape"),
        (np.zeros((1, 0)), RATE, "at least one sample"),
        (np.zeros(3), 0, "sample_rate is 0"),
        (np.zeros(3), 44100.5, r"sample_rate is 44100\.5"),
        (np.zeros(3), np.nan, "sample_rate is nan"),
    ],
)
def test_impossible_sounds_are_refused(samples: np.ndarray, rate: float, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Sound(samples=samples, sample_rate=rate)


def test_pages_play_a_sound() -> None:
    sound = Sound(samples=tone().samples, sample_rate=RATE, notes=("3 < 4 modes",))
    page = sound._repr_html_()
    assert "3 &lt; 4 modes" in page
    data = re.search(r'<audio controls src="data:audio/wav;base64,([^"]+)"', page)[1]
    with soundfile.SoundFile(io.BytesIO(base64.b64decode(data))) as file:
        assert (file.subtype, file.samplerate, file.frames) == ("PCM_16", RATE, RATE)
        assert np.abs(file.read()).max() == pytest.approx(10**-0.05, abs=1e-4)


def test_spectrum_is_the_fourier_transform_of_the_pressure() -> None:
    # exp(-d t) transforms to 1 / (d + 2 pi i f).
    fine = np.arange(40 * RATE) / (40 * RATE)
    sound = Sound(samples=np.exp(-30 * fine)[None], sample_rate=40 * RATE)
    frequencies, values = sound.spectrum()
    low = slice(0, 500)
    expected = 1 / np.hypot(30, 2 * np.pi * frequencies[low])
    np.testing.assert_allclose(values[0, low], expected, rtol=1e-3)


def test_spectrum_keeps_the_energy() -> None:
    noise = np.random.default_rng(1).normal(size=(1, 1001))
    sound = Sound(samples=noise, sample_rate=RATE)
    frequencies, values = sound.spectrum()
    energy = np.square(sound.samples.astype(float)).sum() / RATE
    doubled = 2 * np.square(values[0]).sum() - values[0, 0] ** 2
    assert doubled * frequencies[1] == pytest.approx(energy, rel=1e-6)


def test_spectrogram_shows_amplitudes_where_and_when_they_are() -> None:
    samples = np.where(TIMES < 0.5, 0.3 * np.sin(2000 * np.pi * TIMES), 0)
    times, frequencies, amplitudes = Sound(samples=samples, sample_rate=RATE).spectrogram()
    assert amplitudes.shape == (1, len(frequencies), len(times))
    early = amplitudes[0, :, np.searchsorted(times, 0.25)]
    assert frequencies[early.argmax()] == pytest.approx(1000)
    assert early.max() == pytest.approx(0.3, rel=1e-4)
    assert amplitudes[0, :, times > 0.525].max() < 1e-3 * 0.3
    half = amplitudes[0, frequencies == 1000, np.searchsorted(times, 0.5)]
    assert half == pytest.approx(0.15, rel=0.02)


def test_spectrogram_is_that_of_scipy() -> None:
    noise = np.random.default_rng(1).normal(size=2000).astype(np.float32)
    _, frequencies, amplitudes = Sound(samples=noise, sample_rate=RATE).spectrogram(
        window=0.016, step=0.004
    )
    hann = signal.windows.hann(256, sym=False)
    other = signal.ShortTimeFFT(hann, 64, RATE, scale_to="magnitude")
    np.testing.assert_allclose(other.f, frequencies)
    expected = 2 * np.abs(other.stft(noise.astype(float), p0=0, p1=amplitudes.shape[2]))
    np.testing.assert_allclose(amplitudes[0], expected, atol=1e-12)


@pytest.mark.parametrize("arguments", [{"window": 0.0}, {"step": np.nan}])
def test_spectrogram_needs_windows(arguments: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="at least one sample"):
        tone().spectrogram(**arguments)


@pytest.mark.parametrize("peak", [1e-30, 1e-38, 1e-44, 1e38])
def test_softest_and_loudest_samples_come_back(peak: float, tmp_path: Path) -> None:
    """The factor to full scale of a peak of 1e-44 is itself beyond 32 bits."""
    samples = np.float32([[0, peak, -peak, peak / 2]])
    Sound(samples=samples, sample_rate=8000).save(tmp_path / "a.wav")
    read = Sound.load(tmp_path / "a.wav").samples
    np.testing.assert_allclose(read, samples, rtol=1e-6, atol=1.5e-45)  # the least step
    assert np.abs(read).max() > 0


def test_samples_beyond_their_range_name_it() -> None:
    with pytest.raises(OptionError, match=r"2 of 3 samples .* range .*3.4e38.* or scale"):
        Sound(samples=np.array([[1.0, 1e39, np.nan]]), sample_rate=8000)


def test_sound_that_would_be_too_loud_says_what_to_give() -> None:
    bar = struck.analyze(struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    with (
        pytest.warns(struck.errors.ScaleWarning),
        pytest.raises(OptionError, match=r"would reach .* Pa, .* 3.4e38: .*smaller impulse"),
    ):
        struck.render(bar, struck.Strike(impulse=1e38), seconds=0.01)


def test_a_file_that_unpacks_to_more_than_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with soundfile.SoundFile(tmp_path / "silence.flac", "w", 48_000, 8, format="FLAC") as file:
        file.write(np.zeros((100_000, 8), np.float32))
    with pytest.raises(FileFormatError, match=r"more than 250,000 samples of its 8 channels"):
        answer(tmp_path / "silence.flac", ReadingLimits(answer=10**6), precision="float32")
    reader = Guard(ReadingLimits(answer=10**6))
    monkeypatch.setattr(guard, "_GUARD", reader)
    with pytest.raises(FileFormatError, match=r"silence\.flac: it holds more than 250,000"):
        Sound.load(tmp_path / "silence.flac")
    reader.close()


@pytest.mark.parametrize("frames", [b"\x0f\xff\xff\xff\xff", bytes(5)])
def test_numbers_of_samples_that_are_not_there_cost_nothing(tmp_path: Path, frames: bytes) -> None:
    soundfile.write(tmp_path / "a.flac", np.full((1000, 1), 0.1), 48_000)
    data = bytearray((tmp_path / "a.flac").read_bytes())
    data[21] = (data[21] & 0xF0) | frames[0]
    data[22:26] = frames[1:]
    (tmp_path / "a.flac").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.flac cannot be read as a sound"):
        Sound.load(tmp_path / "a.flac")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for one process")
@pytest.mark.parametrize("ending", [".flac", ".ogg", ".aiff", ".mp3"])
def test_ctrl_c_amid_the_encoding_comes_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    """Cffi drops what is raised in the callbacks by which soundfile writes."""
    buffers = []

    class Interrupting(io.BytesIO):
        def write(self, data: object, /) -> int:
            if self not in buffers:
                buffers.append(self)
                os.kill(os.getpid(), signals.SIGINT)
            return super().write(data)

    monkeypatch.setattr(sound_formats, "io", SimpleNamespace(BytesIO=Interrupting))
    with pytest.raises(KeyboardInterrupt):
        tone().save(tmp_path / f"a{ending}")
    assert len(buffers) == 1
    assert not list(tmp_path.iterdir())
