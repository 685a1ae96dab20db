"""Recording takes from the device, without one and with JACK's dummy driver."""

from __future__ import annotations

import ctypes
import io
from ctypes import c_int, c_ulong, c_void_p
from pathlib import Path

import numpy as np
import pytest

from struck.core import address
from struck.errors import DeviceError, RecordingError
from struck.live.device import COMPLETE, CONTINUE, INPUT_OVERFLOW
from struck.live.recorder import DeviceRecorder
from struck.recordings.capture import CapturedTake
from struck.recordings.capture_plan import Point
from tests.cli.test_record import struck_record
from tests.live.servers import RATE
from tests.live.watchdog import stalls

TAKE = CapturedTake(point=Point(name="a", contact=(), listeners=(), hits=1), hit=1, attempt=1)


def test_interleaved_blocks_are_kept_until_there_are_enough() -> None:
    samples = np.zeros((100, 3), np.float32)
    table = np.array([samples.ctypes.data, 100, 0, 3, 0])
    signature = ctypes.CFUNCTYPE(c_int, c_void_p, c_void_p, c_ulong, c_void_p, c_ulong, c_void_p)
    record = signature(address("recorder_take"))
    heard = np.random.default_rng(1).standard_normal((192, 3)).astype(np.float32)
    codes = [
        record(heard[k : k + 64].ctypes.data, None, 64, None, flags, table.ctypes.data)
        for k, flags in ((0, INPUT_OVERFLOW), (64, INPUT_OVERFLOW), (128, 0))
    ]
    assert codes == [CONTINUE, COMPLETE, COMPLETE]
    assert np.array_equal(samples, heard[:100])
    assert table[4] == 1  # what is lost before the first block does not matter


@pytest.mark.usefixtures("jack")
def test_two_channels_are_recorded_and_the_cue_comes_after_the_lead_in() -> None:
    cues = []
    with DeviceRecorder(channels=2) as device:
        sound = device.record(TAKE, 0.3, 0.1, lambda: cues.append("now"))
        again = device.record(TAKE, 0.1, 0.0, lambda: cues.append("again"))
    assert (sound.sample_rate, sound.samples.shape) == (RATE, (2, round(0.3 * RATE)))
    assert again.samples.shape == (2, round(0.1 * RATE))
    assert cues == ["now", "again"]


@pytest.mark.usefixtures("jack")
def test_a_hook_that_fails_closes_the_stream() -> None:
    def fail() -> None:
        raise RuntimeError("stuck")

    with DeviceRecorder() as device:
        with pytest.raises(RuntimeError, match="stuck"):
            device.record(TAKE, 0.2, 0.05, fail)
        assert device.record(TAKE, 0.1, 0.05, lambda: None).samples.shape == (1, RATE // 10)


@pytest.mark.usefixtures("jack")
def test_more_channels_than_there_are_and_strange_devices_are_refused() -> None:
    with DeviceRecorder(channels=64) as device, pytest.raises(DeviceError, match="64 recorded"):
        device.record(TAKE, 0.1, 0.05, lambda: None)
    with pytest.raises(DeviceError, match="no audio device is named like 'other'"):
        DeviceRecorder("other")


_TRIES = 4


@pytest.mark.usefixtures("jack")
def test_the_command_records_from_the_device_and_refuses_its_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        "seconds = 0.1\nlead_in = 0.05\npatience = 0.1\ntries = 2\ncontacts = [[1.0]]\n"
    )
    with stalls() as late_wakes:
        for _ in range(_TRIES):  # a machine that stands still loses samples: refused as such
            monkeypatch.setattr("sys.stdin", io.StringIO("\n\n"))
            with pytest.raises(RecordingError, match="refused 2 times") as refused:
                struck_record(plan, "--device", "system")
            told = capsys.readouterr().err
            if "lost samples" not in str(refused.value):
                break
    if "lost samples" in str(refused.value) and len(late_wakes) >= _TRIES:
        pytest.skip(f"{refused.value}; the machine stood still {len(late_wakes)} times")
    assert "channel 1 hears no hit" in str(refused.value)
    assert told.count("press Enter") == 2
    assert "strike now" in told
    assert not list((tmp_path / "plan_takes").iterdir())
    assert "JACK" in struck_record("--list-devices").text
