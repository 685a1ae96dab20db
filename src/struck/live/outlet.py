"""Where sound leaves: an audio device from opening to closing, whatever becomes of it."""

from __future__ import annotations

import contextlib
import time
from typing import Protocol

from struck.errors import DeviceError
from struck.live.binding import TO_FILE
from struck.live.callback import OPEN, Shared
from struck.live.device import PortAudio
from struck.live.stream import Stream, keep

_BELIEVED = 10.0  # s; JACK's dummy driver states a day
_FADED = 1.0  # s, in which a stream that was told to end has done so


class Outlet(Protocol):
    """What a player needs of where it plays."""

    name: str
    sample_rate: float
    channels: int

    def open(self, callback: object, shared: Shared, block: int) -> None:
        """Get ready to call a compiled callback (its `address`) for each block."""
        ...

    def start(self) -> None:
        """Begin to call it."""
        ...

    @property
    def active(self) -> bool:
        """Whether it is being called."""
        ...

    @property
    def load(self) -> float:
        """The share of its time that the callback takes, 0 to 1."""
        ...

    @property
    def latency(self) -> float:
        """From the callback to the air, s."""
        ...

    def close(self) -> None:
        """Fade out, and let nothing be called any more."""
        ...


class DeviceOutlet:
    """An audio device.

    Parameters
    ----------
    device : int, str or None
        Number, part of the name, or None for the system's own choice.
    sample_rate : float or None
        Hz; None: the device's own.

    Raises
    ------
    MissingDependencyError
        Where PortAudio is not installed.
    DeviceError
        Where there is no such device.
    """

    def __init__(self, device: int | str | None = None, sample_rate: float | None = None) -> None:
        self._portaudio = PortAudio()
        try:
            chosen = self._portaudio.device(device)
        except DeviceError:
            self._portaudio.close()
            raise
        self.name = chosen.name
        self.sample_rate = chosen.sample_rate if sample_rate is None else float(sample_rate)
        self.channels = min(2, chosen.outputs)
        self._number = chosen.number
        self._stream: Stream | None = None
        self._used: tuple[object, Shared] | None = None

    def open(self, callback: object, shared: Shared, block: int) -> None:
        """Open the stream; DeviceError where the device refuses."""
        self._used = callback, shared
        self._stream = self._portaudio.open(
            callback.address,  # type: ignore[attr-defined] # numba's class has no type
            shared.address,
            sample_rate=self.sample_rate,
            block=block,
            channels=self.channels,
            device=self._number,
        )

    def start(self) -> None:
        """Let the callback be called."""
        if self._stream is None:
            raise DeviceError(f"{self.name} is not open: play anew")
        self._stream.start()

    @property
    def active(self) -> bool:
        """Whether the callback is being called."""
        return self._stream is not None and self._portaudio.answers and self._stream.active

    @property
    def load(self) -> float:
        """The share of its time that the callback takes, 0 to 1."""
        return 0.0 if self._stream is None else self._stream.load

    @property
    def latency(self) -> float:
        """From the callback to the air, s."""
        stated = 0.0 if self._stream is None else self._stream.latency
        return stated if stated < _BELIEVED else 0.0

    def close(self) -> None:
        """Fade out and close; a device that no longer answers is left alone."""
        stream, self._stream = self._stream, None
        if stream is not None and self._used is not None:
            self._end(stream, self._used[1])
            if not stream.close():
                keep(self._used)
        self._portaudio.close()

    def _end(self, stream: Stream, shared: Shared) -> None:
        shared.counters[OPEN] = 0
        give_up = time.monotonic() + _FADED
        with contextlib.suppress(DeviceError):
            while stream.active and time.monotonic() < give_up:
                time.sleep(0.005)
            stream.stop()


def gone(name: str) -> DeviceError:
    """Return the error of a device that was there and is not any more."""
    return DeviceError(
        f"{name} no longer plays: it was stopped or unplugged, or its sound server ended; play "
        f"anew, on another device with device=; {TO_FILE}"
    )


def failed(name: str, failure: Exception) -> DeviceError:
    """Return the error of a player whose feeder failed, which is its cause."""
    error = DeviceError(
        f"{name} no longer plays: what fills its blocks failed with {failure!r}; play anew; "
        f"{TO_FILE}"
    )
    error.__cause__ = failure
    return error
