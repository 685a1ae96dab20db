"""The audio device's input as a measurement needs it: several channels, and a cue on the way."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numba import cfunc, types
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from struck.errors import DeviceError, OptionError
from struck.files.sound import Sound
from struck.live.callback import SIGNATURE
from struck.live.device import COMPLETE, CONTINUE, INPUT_OVERFLOW, TO_FILE, PortAudio, keep
from struck.recordings.capture import CapturedTake
from struck.synth.memory import reals_at, singles_at

# A stretch of sound from the audio device's input: taps or a bow on a table as a force.

_BLOCK = 256
_LONGEST = 600.0
# Places in what the callback is given: where samples go, how many, how many there are.
_MICROPHONE_TO, _MICROPHONE_WANTED, _MICROPHONE_DONE = range(3)
# What the device may take longer than the sound lasts, s.
_MICROPHONE_PATIENCE = 3.0


def microphone(
    seconds: float, *, device: int | str | None = None, sample_rate: float | None = None
) -> Sound:
    """Record one channel from the audio device.

    Parameters
    ----------
    seconds : float
        How long, up to ten minutes.
    device : int or str, optional
        Number or part of the name of one that records; the default one unless given.
    sample_rate : float, optional
        Hz; the device's own unless given.

    Returns
    -------
    Sound
        Its samples, 1.0 at full scale, and their rate: what `ForceTrack` takes as a force.

    Raises
    ------
    OptionError
        On seconds outside their bounds.
    DeviceError
        When no device records, or it stops before its time.
    MissingDependencyError
        Without PortAudio.
    """
    if not 0 < seconds <= _LONGEST:
        raise OptionError(f"seconds is {seconds}: it must lie above 0 and at most at {_LONGEST:g}")
    with PortAudio() as portaudio:
        chosen = portaudio.recorder(device)
        rate = sample_rate or chosen.sample_rate
        samples = np.zeros(max(1, round(seconds * rate)))
        table = np.array([samples.ctypes.data, len(samples), 0])
        callback = _microphone_callback()  # which must outlive the stream, as must the arrays
        stream = portaudio.open(
            callback.address,
            table.ctypes.data,
            sample_rate=rate,
            block=_BLOCK,
            channels=0,
            inputs=1,
            device=chosen.number,
        )
        try:
            stream.start()
            _wait(table, seconds + _MICROPHONE_PATIENCE)
            stream.stop()
        finally:
            if not stream.close():
                keep((callback, table, samples))
    return Sound(
        samples=samples[None].astype(np.float32), sample_rate=round(rate), calibrated=False
    )


def _wait(table: NDArray[np.int64], seconds: float) -> None:
    give_up = time.monotonic() + seconds
    while table[_MICROPHONE_DONE] < table[_MICROPHONE_WANTED]:
        if time.monotonic() > give_up:
            raise DeviceError(
                f"the device gave {table[_MICROPHONE_DONE]} of {table[_MICROPHONE_WANTED]} samples "
                "and then no more: "
                f"look whether it still records; {TO_FILE}"
            )
        time.sleep(0.01)


def _microphone_callback() -> Any:  # noqa: ANN401 - numba's class has no type
    @cfunc(SIGNATURE, error_model="numpy")
    def record(heard, _played, frames, _times, _flags, data):  # noqa: ANN001, ANN202, PLR0917, RUF100 - SIGNATURE types it
        table = carray(data, (3,), np.int64)
        samples = reals_at(table[_MICROPHONE_TO], table[_MICROPHONE_WANTED])
        count = min(types.int64(frames), table[_MICROPHONE_WANTED] - table[_MICROPHONE_DONE])
        source = carray(heard, (frames,), np.float32)
        for n in range(count):
            samples[table[_MICROPHONE_DONE] + n] = source[n]
        table[_MICROPHONE_DONE] += count
        return COMPLETE if table[_MICROPHONE_DONE] == table[_MICROPHONE_WANTED] else CONTINUE

    return record


SETTLING = 0.3
"""What is left out while a device that was opened settles, s."""
# Places in what the callback is given: where samples go, frames wanted and done, channels, blocks
# that came after others were lost.
_TO, _WANTED, _DONE, _CHANNELS, _LOST = range(5)
_PLACES = 5
# What the device may take longer than the sound lasts, and between two looks at it, s.
_PATIENCE, _LOOK = 3.0, 0.005


class DeviceRecorder:
    """Records takes from an audio device; use it as a context, or `close` it.

    Parameters
    ----------
    device : int or str, optional
        Number or part of the name; the default one unless given.
    channels : int
        How many of its inputs, from the first on.
    sample_rate : float, optional
        Hz; the device's own unless given.

    Raises
    ------
    DeviceError
        When there is no such device.
    MissingDependencyError
        Without PortAudio.
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
        self._callback = _callback()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the device go."""
        self._portaudio.close()

    def record(
        self, take: CapturedTake, seconds: float, lead_in: float, cue: Callable[[], None]
    ) -> Sound:
        """Record so many seconds; call `cue` once `lead_in` seconds of them are recorded.

        Raises
        ------
        DeviceError
            When the device refuses, or stops before its time.
        """
        del take
        skipped = round(SETTLING * self.sample_rate)
        frames = skipped + max(1, round(seconds * self.sample_rate))
        samples = np.zeros((frames, self.channels), np.float32)
        table = np.array([samples.ctypes.data, frames, 0, self.channels, 0])
        self._run(table, samples, skipped + round(lead_in * self.sample_rate), cue)
        lost = (
            f"the device lost samples {table[_LOST]} times: close other programs, or record fewer "
            "channels or at a lower rate"
        )
        return Sound(
            samples=samples[skipped:].T,
            sample_rate=round(self.sample_rate),
            notes=(lost,) if table[_LOST] else (),
        )

    def _run(
        self,
        table: NDArray[np.int64],
        samples: NDArray[np.float32],
        first: int,
        cue: Callable[[], None],
    ) -> None:
        stream = self._portaudio.open(
            self._callback.address,
            table.ctypes.data,
            sample_rate=self.sample_rate,
            block=_BLOCK,
            channels=0,
            inputs=self.channels,
            device=self.device.number,
        )
        try:
            stream.start()
            self._wait(table, first)
            cue()
            self._wait(table, int(table[_WANTED]))
            stream.stop()
        finally:
            if not stream.close():
                keep((self._callback, table, samples))

    def _wait(self, table: NDArray[np.int64], frames: int) -> None:
        left = frames - int(table[_DONE])
        give_up = time.monotonic() + left / self.sample_rate + _PATIENCE
        while table[_DONE] < frames:
            if time.monotonic() > give_up:
                raise DeviceError(
                    f"{self.device.name} gave {table[_DONE]} of {table[_WANTED]} samples and then "
                    "no more: look whether it is still connected; what is recorded stays, so "
                    "start again to go on"
                )
            time.sleep(_LOOK)


def _callback() -> Any:  # noqa: ANN401 - numba's class has no type
    @cfunc(SIGNATURE, error_model="numpy")
    def record(heard, _played, frames, _times, flags, data):  # noqa: ANN001, ANN202, PLR0917, RUF100 - SIGNATURE types it
        table = carray(data, (_PLACES,), np.int64)
        channels = table[_CHANNELS]
        samples = singles_at(table[_TO], table[_WANTED] * channels)
        count = min(types.int64(frames), table[_WANTED] - table[_DONE])
        source = carray(heard, (types.int64(frames) * channels,), np.float32)
        first = table[_DONE] * channels
        for n in range(count * channels):
            samples[first + n] = source[n]
        if flags & INPUT_OVERFLOW and table[_DONE]:
            table[_LOST] += 1
        table[_DONE] += count
        return COMPLETE if table[_DONE] == table[_WANTED] else CONTINUE

    return record
