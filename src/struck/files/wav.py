"""WAV files, read and written as bytes: 32-bit float, 24- and 16-bit integer (RIFF, Microsoft)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, OptionError, require_choice, rounded

ENCODINGS = ("float32", "int24", "int16")

_INTEGER, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_BITS = {"float32": 32, "int24": 24, "int16": 16}
_ENCODING = {(_FLOAT, 32): "float32", (_INTEGER, 24): "int24", (_INTEGER, 16): "int16"}
_LARGEST_FILE = 2**32 - 1
_EXTENSIBLE_GUID = bytes.fromhex("000000001000800000aa00389b71")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Samples, rate and comment of a WAV file."""

    samples: NDArray[np.float32]  # (channels, n); 1.0 is full scale
    sample_rate: int  # Hz
    comment: str = ""  # ICMT field of its LIST/INFO chunk


def encode(recording: Recording, encoding: str = "float32") -> bytes:
    """Return the bytes of a WAV file; integers are rounded to the nearest, without dither."""
    require_choice("encoding", encoding, ENCODINGS)
    channels, length = recording.samples.shape
    size = channels * length * (_BITS[encoding] // 8)
    if size + len(recording.comment) + 128 > _LARGEST_FILE:
        raise OptionError(
            f"the samples take {size / 2**30:.1f} GiB, but a WAV file holds 4: save it in parts"
        )
    data, comment = _pack(recording.samples.T, encoding), recording.comment.encode("utf-8")
    chunks = (
        _format_chunk(channels, recording.sample_rate, encoding)
        + (_chunk(b"fact", struct.pack("<I", length)) if encoding == "float32" else b"")
        + (_chunk(b"LIST", b"INFO" + _chunk(b"ICMT", comment + b"\0")) if comment else b"")
        + _chunk(b"data", data)
    )
    return b"RIFF" + struct.pack("<I", len(chunks) + 4) + b"WAVE" + chunks


def decode(data: bytes, name: str = "the file") -> Recording:
    """Read the bytes of a WAV file, called `name` in errors."""
    if len(data) < 12 or data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise FileFormatError(f"{name} is not a WAV file: convert it to one")
    chunks = dict(_chunks(data, name))
    for chunk in (b"fmt ", b"data"):
        if chunk not in chunks:
            raise FileFormatError(f"{name} has no {chunk.decode()!r} chunk: it is cut short")
    encoding, channels, sample_rate = _read_format(chunks[b"fmt "], name)
    samples = _unpack(chunks[b"data"], encoding, channels, name)
    return Recording(
        samples=samples, sample_rate=sample_rate, comment=_read_comment(chunks.get(b"LIST", b""))
    )


def _chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)


def _format_chunk(channels: int, sample_rate: int, encoding: str) -> bytes:
    bits = _BITS[encoding]
    frame = channels * bits // 8
    if not 0 < channels < 2**16 or not 0 < sample_rate * frame < 2**32 or frame >= 2**16:
        raise OptionError(
            f"{channels} channels at {sample_rate} Hz do not fit a WAV file: its header holds "
            "frames of 65,535 bytes and 4 GiB a second"
        )
    tag = _FLOAT if encoding == "float32" else _INTEGER
    fields = struct.pack("<HHIIHH", tag, channels, sample_rate, sample_rate * frame, frame, bits)
    return _chunk(b"fmt ", fields + (b"\0\0" if tag == _FLOAT else b""))


def _pack(frames: NDArray[np.float32], encoding: str) -> bytes:
    if encoding == "float32":
        return frames.astype("<f4").tobytes()
    full_scale = 2 ** (_BITS[encoding] - 1)
    integers = np.rint(frames.astype(np.float64) * full_scale)
    if integers.size and not (-full_scale <= integers.min() and integers.max() < full_scale):
        peak = float(np.abs(frames).max())
        raise OptionError(
            f"the peak is {rounded(peak, 4)} times full scale, which {encoding} would clip: "
            "save with encoding='float32', or with level='peak'"
        )
    values = np.ascontiguousarray(integers.astype("<i4"))
    return values.view(np.uint8).reshape(-1, 4)[:, : _BITS[encoding] // 8].tobytes()


def _chunks(data: bytes, name: str) -> Iterator[tuple[bytes, bytes]]:
    position = 12
    while position + 8 <= len(data):
        kind, size = struct.unpack_from("<4sI", data, position)
        content = data[position + 8 : position + 8 + size]
        if len(content) < size:
            raise FileFormatError(
                f"{name} is cut short: its {kind.decode('latin-1')!r} chunk should have {size} "
                f"bytes and has {len(content)}; copy or record it again"
            )
        yield kind, content
        position += 8 + size + size % 2


def _read_format(content: bytes, name: str) -> tuple[str, int, int]:
    if len(content) < 16:
        raise FileFormatError(f"{name} is damaged: its format chunk has {len(content)} of 16 bytes")
    tag, channels, sample_rate, _, frame, bits = struct.unpack_from("<HHIIHH", content)
    if tag == _EXTENSIBLE and content[26:40] == _EXTENSIBLE_GUID:
        tag = struct.unpack_from("<H", content, 24)[0]
    if (tag, bits) not in _ENCODING:
        raise FileFormatError(
            f"{name} holds {bits}-bit samples of format {tag}: convert it to one of "
            f"{', '.join(ENCODINGS)}"
        )
    if not channels or not sample_rate or frame != channels * bits // 8:
        raise FileFormatError(
            f"{name} is damaged: {channels} channels of {bits} bits at {sample_rate} Hz in "
            f"frames of {frame} bytes"
        )
    return _ENCODING[tag, bits], channels, sample_rate


def _unpack(content: bytes, encoding: str, channels: int, name: str) -> NDArray[np.float32]:
    width = _BITS[encoding] // 8
    if len(content) % (width * channels):
        raise FileFormatError(
            f"{name} is cut short: {len(content)} bytes of samples are no whole number of frames "
            f"of {width * channels} bytes"
        )
    if encoding == "float32":
        values = np.frombuffer(content, "<f4").astype(np.float32)
    else:
        pieces = np.frombuffer(content, np.uint8).reshape(-1, width)
        wide = np.zeros((len(pieces), 4), np.uint8)
        wide[:, 4 - width :] = pieces
        values = (wide.view("<i4").ravel() / 2**31).astype(np.float32)
    if not np.isfinite(values).all():
        raise FileFormatError(f"{name} holds samples that are not finite: export it again")
    return np.ascontiguousarray(values.reshape(-1, channels).T)


def _read_comment(content: bytes) -> str:
    """Return the ICMT field of a LIST/INFO chunk, or an empty text."""
    position = 4
    while content[:4] == b"INFO" and position + 8 <= len(content):
        kind, size = struct.unpack_from("<4sI", content, position)
        if kind == b"ICMT":
            text = content[position + 8 : position + 8 + size]
            return text.split(b"\0")[0].decode("utf-8", errors="replace")
        position += 8 + size + size % 2
    return ""
