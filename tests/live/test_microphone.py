"""Recording from the device, without one and with JACK's dummy driver."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_float, c_int, c_ulong, c_void_p

import numpy as np
import pytest

from struck.errors import OptionError
from struck.excitation.track import ForceTrack
from struck.live import microphone
from struck.live.portaudio import COMPLETE, CONTINUE
from tests.live.servers import RATE


def test_blocks_are_kept_until_there_are_enough() -> None:
    samples = np.zeros(100)
    table = np.array([samples.ctypes.data, 100, 0])
    signature = ctypes.CFUNCTYPE(
        c_int, c_void_p, POINTER(c_float), c_ulong, c_void_p, c_ulong, c_void_p
    )
    callback = microphone._callback()
    record = signature(callback.address)
    heard = np.random.default_rng(1).standard_normal(192).astype(np.float32)
    played = np.ones(64, np.float32)
    codes = [
        record(
            heard[k : k + 64].ctypes.data,
            played.ctypes.data_as(POINTER(c_float)),
            64,
            None,
            0,
            table.ctypes.data,
        )
        for k in (0, 64, 128)
    ]
    assert codes == [CONTINUE, COMPLETE, COMPLETE]
    assert np.array_equal(samples, heard[:100])
    assert not played.any()


@pytest.mark.usefixtures("jack")
def test_a_silent_device_records_silence() -> None:
    sound = microphone.microphone(0.2)
    assert (sound.sample_rate, sound.samples.shape) == (RATE, (1, round(0.2 * RATE)))
    assert not sound.samples.any()
    ForceTrack(force=sound.samples[0], sample_rate=sound.sample_rate)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), 601.0])
def test_seconds_out_of_bounds_are_refused(seconds: float) -> None:
    with pytest.raises(OptionError, match=f"seconds is {seconds}"):
        microphone.microphone(seconds)
