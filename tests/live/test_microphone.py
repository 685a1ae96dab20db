"""Recording from the device, without one and with JACK's dummy driver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.core import address
from struck.errors import DeviceError, OptionError
from struck.excitation.force_track import ForceTrack
from struck.live import recorder
from struck.live.device import Device, PortAudio
from tests.live.servers import RATE


@pytest.mark.usefixtures("jack")
def test_a_silent_device_records_silence() -> None:
    sound = recorder.microphone(0.2)
    assert (sound.sample_rate, sound.samples.shape) == (RATE, (1, round(0.2 * RATE)))
    assert not sound.samples.any()
    ForceTrack(force=sound.samples[0], sample_rate=sound.sample_rate)


@pytest.fixture
def deaf_and_mute(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the server's device seem to be a microphone alone, number 0."""
    whole = PortAudio._describe

    def describe(portaudio: PortAudio, number: int, usual: int) -> Device:
        return replace(whole(portaudio, number, usual), outputs=0)

    monkeypatch.setattr(PortAudio, "_describe", describe)


@pytest.mark.usefixtures("jack", "deaf_and_mute")
@pytest.mark.parametrize("device", [None, 0, "system"])
def test_a_microphone_that_cannot_play_records(device: int | str | None) -> None:
    assert recorder.microphone(0.1, device=device).samples.shape == (1, round(0.1 * RATE))
    with PortAudio() as portaudio:
        assert portaudio.devices() == []
        with pytest.raises(DeviceError, match="no audio device is named like 'other'") as caught:
            portaudio.recorder("other")
    assert "0: system (JACK Audio Connection Kit, 2 inputs, 48000 Hz, default)" in str(caught.value)


@pytest.mark.usefixtures("jack")
def test_a_microphone_is_opened_for_input_alone_on_the_default_input() -> None:
    with PortAudio() as portaudio:
        library, opened = portaudio.library, []
        whole = library.Pa_OpenStream

        def open_stream(*given: object) -> int:
            opened.append(given)
            return whole(*given)

        library.Pa_OpenStream = open_stream
        table = np.array([0, 0, 0, 1, 0])
        portaudio.open(
            address("recorder_take"),
            table.ctypes.data,
            sample_rate=RATE,
            block=256,
            channels=0,
            inputs=1,
        ).close()
        usual = library.Pa_GetDefaultInputDevice()
    [(_, source, output, *_)] = opened
    assert output is None
    assert (source._obj.device, source._obj.channelCount) == (usual, 1)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), 601.0])
def test_seconds_out_of_bounds_are_refused(seconds: float) -> None:
    with pytest.raises(OptionError, match=f"seconds is {seconds}"):
        recorder.microphone(seconds)
