"""A stream to an audio device: started, stopped, closed, and never waited for in vain."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from ctypes import c_void_p
from typing import Protocol

from struck.errors import DeviceError
from struck.live import binding
from struck.live.devices import Device

_LONGEST_LATENCY = 60.0  # s
_PATIENCE = 3.0  # s; PortAudio may wait for minutes for a sound server that has died


class Opener(Protocol):
    """What a stream needs of the `PortAudio` that opened it."""

    library: ctypes.CDLL
    answers: bool


class Stream:
    """An open stream; `PortAudio.open` makes it.

    Attributes
    ----------
    device : Device
        Where it plays or records.
    """

    def __init__(self, portaudio: Opener, handle: c_void_p, device: Device) -> None:
        self.device = device
        self._portaudio = portaudio
        self._library = portaudio.library
        self._handle: c_void_p | None = handle

    def start(self) -> None:
        """Let the callback be called."""
        self._do("Pa_StartStream", "start")

    def stop(self) -> None:
        """Return when all that the callback has written is played.

        Raises
        ------
        DeviceError
            Where the stream is closed, or the device does not answer.
        """
        self._do("Pa_StopStream", "stop")

    def close(self) -> bool:
        """Close it, running or not; more than once does no harm.

        Returns
        -------
        bool
            False where the device no longer answers: PortAudio is then left as it is, and the
            callback and its data must live on.
        """
        if self._handle is None:
            return True
        handle, self._handle = self._handle, None
        if self._portaudio.answers and _patiently(self._library.Pa_CloseStream, handle) is None:
            self._portaudio.answers = False
        return self._portaudio.answers

    @property
    def active(self) -> bool:
        """Whether the callback is being called: not once it returned COMPLETE or the device went.

        Raises
        ------
        DeviceError
            Where the stream is closed.
        """
        return self._library.Pa_IsStreamActive(self._opened()) == 1

    @property
    def load(self) -> float:
        """The share of its time that the callback takes, 0 to 1."""
        return 0.0 if self._handle is None else self._library.Pa_GetStreamCpuLoad(self._handle)

    @property
    def latency(self) -> float:
        """From the callback to the air, as the device states it, s; 0 once closed or unknown."""
        latency = self._information("outputLatency")
        # JACK says -1 as a count without a sign while it does not know: a day.
        return latency if latency < _LONGEST_LATENCY else 0.0

    @property
    def input_latency(self) -> float:
        """From the air to the callback, as the device states it, s; 0 without input."""
        return self._information("inputLatency")

    @property
    def sample_rate(self) -> float:
        """The true one, Hz; 0 once closed."""
        return self._information("sampleRate")

    def _information(self, field: str) -> float:
        known = None if self._handle is None else self._library.Pa_GetStreamInfo(self._handle)
        return getattr(known.contents, field) if known else 0.0

    def _opened(self) -> c_void_p:
        if self._handle is None:
            raise DeviceError(f"the stream on {self.device.name} is closed: open another")
        return self._handle

    def _do(self, function: str, action: str) -> int:
        handle = self._opened()
        trouble = f"{self.device.name} ({self.device.host}) cannot {action}"
        code = _patiently(getattr(self._library, function), handle)
        if code is None:
            self._portaudio.answers = False
            raise DeviceError(
                f"{trouble}: no answer for {_PATIENCE:g} s; is its sound server still there? "
                f"Start again with another device; {binding.TO_FILE}"
            )
        return binding.check(self._library, code, trouble, f"; {binding.TO_FILE}")


def keep(used: object) -> None:
    """Let what a stream was given live on, where PortAudio may still call and read it."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(used))


def _patiently(function: Callable[[c_void_p], int], handle: c_void_p) -> int | None:
    """Return what a function of PortAudio returns; None where it does not return in time."""
    codes: list[int] = []
    call = threading.Thread(target=lambda: codes.append(function(handle)), daemon=True)
    call.start()
    call.join(_PATIENCE)
    return codes[0] if codes else None
