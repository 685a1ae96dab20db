"""A stretch of sound from the audio device's input: taps or a bow on a table as a force."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numba import cfunc, types
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from struck.errors import DeviceError, OptionError
from struck.files.sound import Sound
from struck.live.binding import TO_FILE
from struck.live.callback import SIGNATURE
from struck.live.device import COMPLETE, CONTINUE, PortAudio
from struck.live.stream import keep
from struck.synth.addresses import reals_at

_BLOCK = 256
_LONGEST = 600.0
# Places in what the callback is given: where samples go, how many, how many there are.
_TO, _WANTED, _DONE = range(3)
# What the device may take longer than the sound lasts, s.
_PATIENCE = 3.0


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
        callback = _callback()  # which must outlive the stream, as must the arrays
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
            _wait(table, seconds + _PATIENCE)
            stream.stop()
        finally:
            if not stream.close():
                keep((callback, table, samples))
    return Sound(
        samples=samples[None].astype(np.float32), sample_rate=round(rate), calibrated=False
    )


def _wait(table: NDArray[np.int64], seconds: float) -> None:
    give_up = time.monotonic() + seconds
    while table[_DONE] < table[_WANTED]:
        if time.monotonic() > give_up:
            raise DeviceError(
                f"the device gave {table[_DONE]} of {table[_WANTED]} samples and then no more: "
                f"look whether it still records; {TO_FILE}"
            )
        time.sleep(0.01)


def _callback() -> Any:  # noqa: ANN401 - numba's class has no type
    @cfunc(SIGNATURE, error_model="numpy")
    def record(heard, _played, frames, _times, _flags, data):  # noqa: ANN001, ANN202, PLR0917, RUF100 - SIGNATURE types it
        table = carray(data, (3,), np.int64)
        samples = reals_at(table[_TO], table[_WANTED])
        count = min(types.int64(frames), table[_WANTED] - table[_DONE])
        source = carray(heard, (frames,), np.float32)
        for n in range(count):
            samples[table[_DONE] + n] = source[n]
        table[_DONE] += count
        return COMPLETE if table[_DONE] == table[_WANTED] else CONTINUE

    return record
