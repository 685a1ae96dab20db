"""WAV files as libsndfile and the standard library read and write them."""

from __future__ import annotations

import io
import struct
import wave

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from struck.errors import FileFormatError, OptionError
from struck.files import wav

SUBTYPES = {"float32": "FLOAT", "int24": "PCM_24", "int16": "PCM_16"}
STEPS = {"float32": 0.0, "int24": 2.0**-23, "int16": 2.0**-15}


def recording(channels: int = 2, length: int = 1001, comment: str = "") -> wav.Recording:
    samples = np.random.default_rng(1).uniform(-0.99, 0.99, (channels, length))
    return wav.Recording(samples=samples.astype(np.float32), sample_rate=44100, comment=comment)


@pytest.mark.parametrize("encoding", wav.ENCODINGS)
@pytest.mark.parametrize("channels", [1, 2, 3])
def test_libsndfile_reads_what_we_write(encoding: str, channels: int) -> None:
    written = recording(channels, comment="a comment of odd length.")
    data = io.BytesIO(wav.encode(written, encoding))
    with soundfile.SoundFile(data) as file:
        assert (file.samplerate, file.channels) == (44100, channels)
        assert (file.format, file.subtype) == ("WAV", SUBTYPES[encoding])
        assert file.comment == "a comment of odd length."
        samples = file.read(dtype="float64", always_2d=True).T
    np.testing.assert_allclose(samples, written.samples, atol=STEPS[encoding] / 2, rtol=0)


@pytest.mark.parametrize("encoding", wav.ENCODINGS)
@pytest.mark.parametrize("kind", ["WAV", "WAVEX"])
def test_we_read_what_libsndfile_writes(encoding: str, kind: str) -> None:
    samples = recording().samples
    data = io.BytesIO()
    with soundfile.SoundFile(data, "w", 22050, 2, subtype=SUBTYPES[encoding], format=kind) as file:
        file.comment = "hello"
        file.write(samples.T)
    read = wav.decode(data.getvalue())
    assert read.sample_rate == 22050
    assert read.comment == "hello"
    assert read.samples.dtype == np.float32
    np.testing.assert_allclose(read.samples, samples, atol=STEPS[encoding], rtol=0)


@pytest.mark.parametrize("encoding", ["int16", "int24"])
def test_full_scale_does_not_wrap_round(encoding: str) -> None:
    """Integers reach from -1 to one step below +1: +1.0 would come back as -1.0."""
    just = np.array([[-1.0, 1 - STEPS[encoding]]], dtype=np.float32)
    read = wav.decode(wav.encode(wav.Recording(samples=just, sample_rate=8000), encoding))
    np.testing.assert_array_equal(read.samples, just)
    full = wav.Recording(samples=np.ones((1, 1), dtype=np.float32), sample_rate=8000)
    with pytest.raises(OptionError, match=f"peak is 1 times full scale, which {encoding} would"):
        wav.encode(full, encoding)


@pytest.mark.parametrize("encoding", ["int16", "int24"])
def test_the_standard_library_reads_integers(encoding: str) -> None:
    written = recording(length=7)
    with wave.open(io.BytesIO(wav.encode(written, encoding))) as file:
        width = file.getsampwidth()
        assert (file.getframerate(), file.getnchannels(), file.getnframes()) == (44100, 2, 7)
        frames = file.readframes(7)
    first = int.from_bytes(frames[:width], "little", signed=True)
    assert first == round(float(written.samples[0, 0]) * 2 ** (8 * width - 1))


@pytest.mark.parametrize("encoding", wav.ENCODINGS)
def test_a_second_round_changes_nothing(encoding: str) -> None:
    once = wav.decode(wav.encode(recording(3, 33), encoding))
    twice = wav.decode(wav.encode(once, encoding))
    np.testing.assert_array_equal(once.samples, twice.samples)


def test_float_files_have_a_fact_chunk_and_whole_sizes() -> None:
    data = wav.encode(recording(1, 5), "float32")
    position = data.index(b"fact")
    assert struct.unpack_from("<II", data, position + 4) == (4, 5)
    assert struct.unpack_from("<I", data, 4)[0] == len(data) - 8


def test_odd_chunks_are_padded() -> None:
    data = wav.encode(recording(1, 5), "int24")
    assert len(data) % 2 == 0
    assert wav.decode(data).samples.shape == (1, 5)


def test_full_scale_is_kept_and_beyond_it_is_refused() -> None:
    lowest = wav.Recording(samples=np.array([[-1.0]], np.float32), sample_rate=8000)
    assert wav.decode(wav.encode(lowest, "int16")).samples[0, 0] == -1.0
    loud = wav.Recording(samples=np.array([[0.0, 1.5]], np.float32), sample_rate=8000)
    with pytest.raises(OptionError, match=r"peak is 1\.5 times full scale.*int16 would clip"):
        wav.encode(loud, "int16")
    assert wav.decode(wav.encode(loud, "float32")).samples[0, 1] == 1.5


def test_unknown_encodings_and_impossible_headers_are_refused() -> None:
    with pytest.raises(OptionError, match="'mp3': give one of float32, int24, int16"):
        wav.encode(recording(), "mp3")
    fast = wav.Recording(samples=np.zeros((1, 1), np.float32), sample_rate=2**31)
    with pytest.raises(OptionError, match="do not fit"):
        wav.encode(fast, "float32")


GOOD = wav.encode(recording(2, 50, "note"), "int24")


@pytest.mark.parametrize("length", range(len(GOOD)))
def test_truncated_files_are_refused(length: int) -> None:
    with pytest.raises(FileFormatError, match=r"^bell\.wav "):
        wav.decode(GOOD[:length], "bell.wav")


@pytest.mark.parametrize(
    ("offset", "content", "message"),
    [
        (0, b"OggS", "not a WAV file"),
        (8, b"AVI ", "not a WAV file"),
        (16, struct.pack("<I", 2**31), "cut short"),
        (20, struct.pack("<H", 85), "24-bit samples of format 85"),
        (22, struct.pack("<H", 0), "0 channels"),
        (24, struct.pack("<I", 0), "0 Hz"),
        (32, struct.pack("<H", 5), "frames of 5 bytes"),
        (34, struct.pack("<H", 13), "13-bit"),
    ],
)
def test_damaged_headers_are_refused(offset: int, content: bytes, message: str) -> None:
    damaged = GOOD[:offset] + content + GOOD[offset + len(content) :]
    with pytest.raises(FileFormatError, match=message):
        wav.decode(damaged)


def test_samples_that_are_not_finite_are_refused() -> None:
    bad = wav.Recording(samples=np.array([[np.nan]], np.float32), sample_rate=8000)
    with pytest.raises(FileFormatError, match="not finite"):
        wav.decode(wav.encode(bad, "float32"))


@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), max_size=8))
def test_hostile_bytes_give_samples_or_our_error(changes: list[tuple[int, int]]) -> None:
    data = bytearray(GOOD)
    for position, value in changes:
        data[position] = value
    try:
        read = wav.decode(bytes(data))
    except FileFormatError:
        return
    assert np.isfinite(read.samples).all()
