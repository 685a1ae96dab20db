"""Sound from the audio device's input: one channel of it, or takes of a measurement with a cue."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

import numpy as np

from struck.core import address
from struck.errors import DeviceError, OptionError
from struck.files.sound import Sound
from struck.live.device import TO_FILE, PortAudio, keep
from struck.model.arrays import Index, Single, checked
from struck.recordings.capture import CapturedTake

SETTLING_SECONDS = 0.3  # s of a take that are left out while the device settles
_BLOCK = 256
_MAX_SECONDS = 600.0  # s
_PATIENCE_SECONDS = 3.0  # s, by which a device may be late
_POLL_SECONDS = 0.005  # s, between two checks of the recorded frames
# Numbers of `recorder.c`: address of the samples, frames to record and done, channels, lost blocks.
_ADDRESS, _FRAME_COUNT, _FRAMES_DONE, _CHANNELS, _LOST_BLOCKS = range(5)


@checked
def microphone(
    seconds: float, *, device: int | str | None = None, sample_rate: float | None = None
) -> Sound:
    """Record one channel from an audio device.

    Parameters
    ----------
    seconds : float
        Duration, at most 600 s.
    device : int or str, optional
        Number of the input device, or a part of its name. Default: the default device.
    sample_rate : float, optional
        Sample rate, Hz. Default: that of the device.

    Returns
    -------
    Sound
        The recording, with 1.0 at full scale, as `ForceTrack` takes it.

    Raises
    ------
    OptionError
        If the duration is out of range.
    DeviceError
        If no device records, or it stops early.
    MissingDependencyError
        If PortAudio is not installed.
    """
    if not 0 < seconds <= _MAX_SECONDS:
        raise OptionError(
            f"seconds is {seconds}: it must lie above 0 and at most at {_MAX_SECONDS:g}"
        )
    with DeviceRecorder(device, sample_rate=sample_rate) as recorder:
        samples, _ = recorder.frames(seconds, f"look whether it still records; {TO_FILE}")
    return Sound(samples=samples.T, sample_rate=round(recorder.sample_rate))


@checked
class DeviceRecorder:
    """Recorder of takes from an audio device; use it in a ``with`` statement, or call `close`.

    Parameters
    ----------
    device : int or str, optional
        Number of the device, or a part of its name. Default: the default device.
    channels : int, default 1
        Number of inputs, from the first on.
    sample_rate : float, optional
        Sample rate, Hz. Default: that of the device.
    """

    def __init__(
        self,
        device: int | str | None = None,
        *,
        channels: int = 1,
        sample_rate: float | None = None,
    ) -> None:
        self._portaudio = PortAudio()
        try:
            self.device = self._portaudio.recorder(device)
        except DeviceError:
            self._portaudio.close()
            raise
        self.channels = channels
        self.sample_rate = sample_rate or self.device.sample_rate
        self._callback = address("recorder_take")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the audio device."""
        self._portaudio.close()

    def record(
        self, take: CapturedTake, seconds: float, lead_in: float, cue: Callable[[], None]
    ) -> Sound:
        """Record a take.

        Parameters
        ----------
        take : CapturedTake
            The take.
        seconds : float
            Duration, s.
        lead_in : float
            Time after which `cue` is called, s.
        cue : callable
            Called without arguments.

        Returns
        -------
        Sound
            The recording.
        """
        del take
        skipped_frames = round(SETTLING_SECONDS * self.sample_rate)
        samples, lost_count = self.frames(
            seconds,
            "look whether it is still connected; what is recorded stays, so start again to go on",
            skipped=skipped_frames,
            first=skipped_frames + round(lead_in * self.sample_rate),
            cue=cue,
        )
        note = (
            f"the device lost samples {lost_count} times: close other programs, or record fewer "
            "channels or at a lower rate"
        )
        return Sound(
            samples=samples.T,
            sample_rate=round(self.sample_rate),
            notes=(note,) if lost_count else (),
        )

    def frames(
        self,
        seconds: float,
        way_out: str,
        *,
        skipped: int = 0,
        first: int = 0,
        cue: Callable[[], None] = lambda: None,
    ) -> tuple[Single, int]:
        """Record frames.

        Parameters
        ----------
        seconds : float
            Duration without the skipped frames, s.
        way_out : str
            End of the error message if the device stops.
        skipped : int, default 0
            Number of frames to discard first.
        first : int, default 0
            Number of frames after which `cue` is called.
        cue : callable, optional
            Called without arguments.

        Returns
        -------
        tuple of array (n, channels), int
            Frames, and how often samples were lost.
        """
        count = skipped + max(1, round(seconds * self.sample_rate))
        samples = np.zeros((count, self.channels), np.float32)
        table = np.array([samples.ctypes.data, count, 0, self.channels, 0])
        stream = self._portaudio.open(
            self._callback,
            table.ctypes.data,
            sample_rate=self.sample_rate,
            block=_BLOCK,
            channels=0,
            inputs=self.channels,
            device=self.device.number,
        )
        try:
            stream.start()
            self._wait(table, first, way_out)
            cue()
            self._wait(table, count, way_out)
            stream.stop()
        finally:
            if not stream.close():
                keep((table, samples))
        return samples[skipped:], int(table[_LOST_BLOCKS])

    def _wait(self, table: Index, frames: int, way_out: str) -> None:
        left = frames - int(table[_FRAMES_DONE])
        give_up = time.monotonic() + left / self.sample_rate + _PATIENCE_SECONDS
        while table[_FRAMES_DONE] < frames:
            if time.monotonic() > give_up:
                raise DeviceError(
                    f"{self.device.name} gave {table[_FRAMES_DONE]} of {table[_FRAME_COUNT]} "
                    f"samples and then no more: {way_out}"
                )
            time.sleep(_POLL_SECONDS)
