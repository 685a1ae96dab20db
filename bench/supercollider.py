"""A bank of resonators as SuperCollider's server reads it, without its language.

(SuperCollider documentation: Synth Definition File Format; Server Command Reference; Non-Realtime
Synthesis.)
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_AUDIO_RATE = 2


def score(frequencies: Array, t60: Array, seconds: int) -> bytes:
    """Return a score: at 0 the instrument and a note of it, after so many seconds the end."""
    events = [
        (0, _message("/d_recv", _instrument(frequencies, t60))),
        (0, _message("/s_new", "bank", 1000, 0, 0)),
        (seconds, _message("/c_set", 0, 0)),
    ]
    bundles = (b"#bundle\0" + struct.pack(">IIi", at, 0, len(m)) + m for at, m in events)
    return b"".join(struct.pack(">i", len(bundle)) + bundle for bundle in bundles)


def _message(address: str, *arguments: str | int | bytes) -> bytes:
    kinds, data = ",", b""
    for each in arguments:
        if isinstance(each, str):
            kinds, data = kinds + "s", data + _filled(each.encode() + b"\0")
        elif isinstance(each, int):
            kinds, data = kinds + "i", data + struct.pack(">i", each)
        else:
            kinds, data = kinds + "b", data + struct.pack(">i", len(each)) + _filled(each)
    return _filled(address.encode() + b"\0") + _filled(kinds.encode() + b"\0") + data


def _filled(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % 4)


def _instrument(frequencies: Array, t60: Array) -> bytes:
    """Return Out.ar(0, Klank.ar(`[frequencies, amplitudes, T60], WhiteNoise.ar))."""
    amplitudes = np.full(len(frequencies), 1 / len(frequencies))
    rows = np.stack([frequencies, amplitudes, t60], axis=1).ravel()
    constants = np.concatenate([[0.0, 1.0], rows]).astype(">f4")
    zero, one, *modes = (struct.pack(">ii", -1, n) for n in range(len(constants)))
    units = [
        _unit("WhiteNoise", [], 1),
        _unit("Klank", [struct.pack(">ii", 0, 0), one, zero, one, *modes], 1),
        _unit("Out", [zero, struct.pack(">ii", 1, 0)], 0),
    ]
    head = b"SCgf" + struct.pack(">ih", 2, 1) + b"\4bank" + struct.pack(">i", len(constants))
    tail = struct.pack(">iii", 0, 0, len(units)) + b"".join(units) + struct.pack(">h", 0)
    return head + constants.tobytes() + tail


def _unit(name: str, inputs: list[bytes], outputs: int) -> bytes:
    head = bytes([len(name)]) + name.encode()
    sizes = struct.pack(">biih", _AUDIO_RATE, len(inputs), outputs, 0)
    return head + sizes + b"".join(inputs) + bytes([_AUDIO_RATE]) * outputs
