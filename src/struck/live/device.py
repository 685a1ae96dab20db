"""Audio devices and their streams: as much of PortAudio (V19) as a compiled callback needs.

The callback is given as an address, of code that needs no interpreter, so no lock of Python can
ever keep the loudspeaker waiting. (`sounddevice` calls back into Python, which a busy thread delays
by 5 ms, two blocks; its low-level handle would be one more package to install on Linux, where the
system's own PortAudio is enough.)
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int, c_long, c_ulong, c_void_p
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from struck.errors import DeviceError, MissingDependencyError, rounded
from struck.live.callback_memory import OPEN, Shared

# Structures and constants of `portaudio.h`.
INPUT_UNDERFLOW, INPUT_OVERFLOW = 1, 2  # a callback's flags
OUTPUT_UNDERFLOW, OUTPUT_OVERFLOW = 4, 8
CONTINUE, COMPLETE = 0, 1  # values that a callback returns
_FLOAT32 = 1  # sample format, interleaved
_UNANTICIPATED_HOST_ERROR = -9999
TO_FILE = "`struck render MODEL -o FILE.wav` needs no device"
_MAX_LATENCY = 10.0  # s; JACK's dummy driver states a day
_FADE_SECONDS = 1.0  # s, in which a stream ends after a request
_PATIENCE_SECONDS = 3.0  # s; PortAudio may wait for minutes for a sound server that has died


class _HostApi(Structure):
    _fields_ = (("version", c_int), ("type", c_int), ("name", c_char_p))  # more is not read


class _HostError(Structure):
    _fields_ = (("host", c_int), ("code", c_long), ("text", c_char_p))


class _DeviceInfo(Structure):
    _fields_ = (
        ("version", c_int),
        ("name", c_char_p),
        ("host", c_int),
        ("inputs", c_int),
        ("outputs", c_int),
        ("low_input_latency", c_double),
        ("low_output_latency", c_double),
        ("high_input_latency", c_double),
        ("high_output_latency", c_double),
        ("sample_rate", c_double),
    )


class _Parameters(Structure):
    _fields_ = (
        ("device", c_int),
        ("channelCount", c_int),
        ("format", c_ulong),
        ("latency", c_double),
        ("extra", c_void_p),
    )


class _StreamInfo(Structure):
    _fields_ = (("version", c_int), ("input", c_double), ("output", c_double))  # latencies, s


_RESULT_TYPES = {
    "Pa_GetErrorText": c_char_p,
    "Pa_GetLastHostErrorInfo": POINTER(_HostError),
    "Pa_GetDeviceInfo": POINTER(_DeviceInfo),
    "Pa_GetHostApiInfo": POINTER(_HostApi),
    "Pa_GetStreamInfo": POINTER(_StreamInfo),
    "Pa_GetStreamCpuLoad": c_double,
}  # all others return an int; a stream is passed as c_void_p
_PLACE, _SIDE = POINTER(c_void_p), POINTER(_Parameters)
_OPEN_STREAM = _PLACE, _SIDE, _SIDE, c_double, c_ulong, c_ulong, c_void_p, c_void_p


def load_library() -> ctypes.CDLL:
    """Return PortAudio of the system, or of the `sounddevice` package, with prototypes set."""
    for candidate in _candidates():
        try:
            library = ctypes.CDLL(candidate)
        except OSError:
            continue
        for name, kind in _RESULT_TYPES.items():
            getattr(library, name).restype = kind
        library.Pa_OpenStream.argtypes = _OPEN_STREAM
        return library
    raise MissingDependencyError(
        "playing needs PortAudio: `apt install libportaudio2` on Debian and Ubuntu (other Linux "
        "distributions call it portaudio), `pip install struck[live]` on Windows and macOS; "
        f"{TO_FILE}"
    )


def check(library: ctypes.CDLL, code: int, trouble: str, way_out: str = "") -> int:
    """Return a PortAudio function's code, or raise a DeviceError that gives its reason."""
    if code < 0:
        raise DeviceError(f"{trouble}: {_reason(library, code)}{way_out}")
    return code


def _reason(library: ctypes.CDLL, code: int) -> str:
    if code == _UNANTICIPATED_HOST_ERROR:
        host = library.Pa_GetLastHostErrorInfo().contents
        if host.text:
            return host.text.decode(errors="replace")
    return library.Pa_GetErrorText(code).decode(errors="replace")


def _candidates() -> Iterator[str]:
    system = find_library("portaudio")
    if system is not None:
        yield system
    package = importlib.util.find_spec("_sounddevice_data")
    for folder in (package and package.submodule_search_locations) or ():
        for path in sorted(Path(folder, "portaudio-binaries").glob("libportaudio*")):
            if "-asio" not in path.name:
                yield str(path)


@contextlib.contextmanager
def silence_output() -> Iterator[None]:
    """Discard the messages of ALSA and JACK on file descriptor 2 while they probe for devices."""
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        descriptor = os.dup(2)
    except OSError:  # there is no such descriptor, so nothing to silence
        yield
        return
    null_descriptor = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null_descriptor, 2)
        yield
    finally:
        os.dup2(descriptor, 2)
        os.close(null_descriptor)
        os.close(descriptor)


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """An audio device that can play, record or both.

    Parameters
    ----------
    number : int
        Number by PortAudio, valid until it is closed.
    name : str
        Name of the device.
    host : str
        Sound system of the device, such as "ALSA" or "Core Audio".
    outputs : int
        Number of output channels.
    inputs : int
        Number of input channels.
    sample_rate : float
        Default sample rate, Hz.
    output_latency : float
        Lowest recommended output latency, s.
    input_latency : float
        Lowest recommended input latency, s.
    default : bool
        Whether it is the default device for playing, or for recording.
    """

    number: int
    name: str
    host: str
    outputs: int
    inputs: int
    sample_rate: float
    output_latency: float
    input_latency: float
    default: bool

    def __str__(self) -> str:
        suffix = ", default" if self.default else ""
        channels = f"{self.outputs} channels" if self.outputs else f"{self.inputs} inputs"
        return (
            f"{self.number}: {self.name} ({self.host}, {channels}, "
            f"{self.sample_rate:.0f} Hz{suffix})"
        )


def choose(
    devices: list[Device], selector: int | str | None = None, *, what: str = "play"
) -> Device:
    """Return a device by number or part of its name (any case); None: the system's default."""
    if not devices:
        raise DeviceError(
            f"no audio device can {what}: connect one, or start a sound server; {TO_FILE}"
        )
    chosen = [device for device in devices if _matches(device, selector)]
    if len(chosen) != 1:
        problem = "no audio device is" if not chosen else f"{len(chosen)} audio devices are"
        raise DeviceError(
            f"{problem} {_describe_selector(selector)}: give the number of one of "
            f"{_list_devices(devices)}"
        )
    return chosen[0]


def _matches(device: Device, selector: int | str | None) -> bool:
    if selector is None:
        return device.default
    if isinstance(selector, int):
        return device.number == selector
    return selector.casefold() in device.name.casefold()


def _describe_selector(selector: int | str | None) -> str:
    if selector is None:
        return "the default"
    return f"number {selector}" if isinstance(selector, int) else f"named like {selector!r}"


def _list_devices(devices: list[Device]) -> str:
    """Return all devices in one line."""
    return "; ".join(map(str, devices))


class Stream:
    """An open stream on a device; `PortAudio.open` makes it."""

    def __init__(self, portaudio: PortAudio, handle: c_void_p, device: Device) -> None:
        self.device = device
        self._portaudio = portaudio
        self._library = portaudio.library
        self._handle: c_void_p | None = handle

    def start(self) -> None:
        """Start the stream: the device calls the callback from now on."""
        self._do("Pa_StartStream", "start")

    def stop(self) -> None:
        """Wait until all that the callback wrote is played."""
        self._do("Pa_StopStream", "stop")

    def close(self) -> bool:
        """Close the stream; return False, and `keep` its memory, if the device does not answer."""
        if self._handle is None:
            return True
        handle, self._handle = self._handle, None
        if (
            self._portaudio.answers
            and _call_patiently(self._library.Pa_CloseStream, handle) is None
        ):
            self._portaudio.answers = False
        return self._portaudio.answers

    @property
    def active(self) -> bool:
        """Whether the callback is called: not once it returned COMPLETE or the device went."""
        return self._library.Pa_IsStreamActive(self._require_open()) == 1

    @property
    def load(self) -> float:
        """Fraction of the time of a block that the callback takes, 0 to 1."""
        return 0.0 if self._handle is None else self._library.Pa_GetStreamCpuLoad(self._handle)

    @property
    def latency(self) -> float:
        """From the callback to the air, as the device states it, s; 0 once closed or unknown."""
        info = None if self._handle is None else self._library.Pa_GetStreamInfo(self._handle)
        latency = info.contents.output if info else 0.0
        return latency if latency < _MAX_LATENCY else 0.0

    def _require_open(self) -> c_void_p:
        if self._handle is None:
            raise DeviceError(f"the stream on {self.device.name} is closed: open another")
        return self._handle

    def _do(self, function: str, action: str) -> int:
        handle = self._require_open()
        trouble = f"{self.device.name} ({self.device.host}) cannot {action}"
        code = _call_patiently(getattr(self._library, function), handle)
        if code is None:
            self._portaudio.answers = False
            raise DeviceError(
                f"{trouble}: no answer for {_PATIENCE_SECONDS:g} s; is its sound server still "
                f"there? Start again with another device; {TO_FILE}"
            )
        return check(self._library, code, trouble, f"; {TO_FILE}")


def keep(reference: object) -> None:
    """Keep an object for ever, as PortAudio may still call and read it."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(reference))


def _call_patiently(function: Callable[[c_void_p], int], handle: c_void_p) -> int | None:
    """Return the code of a PortAudio function; None where it does not return in time."""
    codes: list[int] = []
    call = threading.Thread(target=lambda: codes.append(function(handle)), daemon=True)
    call.start()
    call.join(_PATIENCE_SECONDS)
    return codes[0] if codes else None


class PortAudio:
    """PortAudio until `close`; devices that are plugged in later are seen by the next one."""

    def __init__(self) -> None:
        self.library: ctypes.CDLL = load_library()
        with silence_output():
            code = self.library.Pa_Initialize()
        check(self.library, code, "PortAudio cannot start")
        self._initialised = True
        self.answers = True  # whether every call returned; ending it would wait for ever as well

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close PortAudio and all streams that are still open; more than once does no harm."""
        if self._initialised:
            self._initialised = False
            if self.answers:
                self.library.Pa_Terminate()

    def devices(self) -> list[Device]:
        """List all devices that can play.

        Returns
        -------
        list of Device
            The devices.
        """
        default_number = self.library.Pa_GetDefaultOutputDevice()
        return [device for device in self._find_devices(default_number) if device.outputs]

    def recorders(self) -> list[Device]:
        """List all devices that can record.

        Returns
        -------
        list of Device
            The devices.
        """
        default_number = self.library.Pa_GetDefaultInputDevice()
        return [device for device in self._find_devices(default_number) if device.inputs]

    def _find_devices(self, default_number: int) -> list[Device]:
        return [self._describe(n, default_number) for n in range(self.library.Pa_GetDeviceCount())]

    def _describe(self, number: int, default_number: int) -> Device:
        device = self.library.Pa_GetDeviceInfo(number).contents
        host = self.library.Pa_GetHostApiInfo(device.host).contents
        return Device(
            number=number,
            name=device.name.decode(errors="replace"),
            host=host.name.decode(errors="replace"),
            outputs=device.outputs,
            inputs=device.inputs,
            sample_rate=device.sample_rate,
            output_latency=device.low_output_latency,
            input_latency=device.low_input_latency,
            default=number == default_number,
        )

    def device(self, selector: int | str | None = None) -> Device:
        """Find a device that can play.

        Parameters
        ----------
        selector : int or str, optional
            Number of the device, or a part of its name. Default: the default device.

        Returns
        -------
        Device
            The device.
        """
        return choose(self.devices(), selector)

    def recorder(self, selector: int | str | None = None) -> Device:
        """Find a device that can record.

        Parameters
        ----------
        selector : int or str, optional
            Number of the device, or a part of its name. Default: the default device.

        Returns
        -------
        Device
            The device.
        """
        return choose(self.recorders(), selector, what="record")

    def open(
        self,
        callback: int,
        data: int,
        *,
        sample_rate: float,
        block: int,
        channels: int,
        inputs: int = 0,
        device: int | str | None = None,
    ) -> Stream:
        """Open a stream of interleaved float32 samples, which is not started.

        Parameters
        ----------
        callback : int
            Address of a `PaStreamCallback`, which must outlive the stream.
        data : int
            Address of its `userData`, which must outlive the stream.
        sample_rate : float
            Sample rate, Hz.
        block : int
            Samples per call.
        channels : int
            Number of output channels; 0 to record only.
        inputs : int, default 0
            Number of input channels of the same device.
        device : int or str, optional
            Number of the device, or a part of its name. Default: the default device.

        Returns
        -------
        Stream
            The stream.
        """
        chosen = self.device(device) if channels else self.recorder(device)
        devices = self.devices() if channels else self.recorders()
        handle = c_void_p()
        code = self.library.Pa_OpenStream(
            byref(handle),
            _make_parameters(chosen.number, inputs, chosen.input_latency),
            _make_parameters(chosen.number, channels, chosen.output_latency),
            sample_rate, block, 0, callback, data,
        )  # fmt: skip
        input_text = f" and {inputs} recorded" if inputs else ""
        check(
            self.library,
            code,
            f"{chosen.name} ({chosen.host}) refuses {channels} channels{input_text} at "
            f"{rounded(sample_rate)} Hz in blocks of {block}",
            f"; there is {_list_devices(devices)}; and {TO_FILE}",
        )
        return Stream(self, handle, chosen)


def _make_parameters(device: int, channels: int, latency: float) -> Any:  # noqa: ANN401 - ctypes' reference
    """Return PaStreamParameters of one direction of a stream; None where it has no channels."""
    if not channels:
        return None
    return byref(_Parameters(device, channels, _FLOAT32, latency, None))


class Outlet:
    """Where a player's sound leaves: an audio device from opening to closing."""

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
        self._shared: Shared | None = None

    def open(self, callback: int, shared: Shared, block: int) -> None:
        """Open the stream; DeviceError where the device refuses."""
        self._shared = shared
        self._stream = self._portaudio.open(
            callback,
            shared.address,
            sample_rate=self.sample_rate,
            block=block,
            channels=self.channels,
            device=self._number,
        )

    def start(self) -> None:
        """Start the stream: the device calls the callback from now on."""
        if self._stream is None:
            raise DeviceError(f"{self.name} is not open: call struck.play again")
        self._stream.start()

    @property
    def active(self) -> bool:
        """Whether the device is calling the callback."""
        return self._stream is not None and self._portaudio.answers and self._stream.active

    @property
    def load(self) -> float:
        """Fraction of the time of a block that the callback takes, 0 to 1."""
        return 0.0 if self._stream is None else self._stream.load

    @property
    def latency(self) -> float:
        """Time from the callback to the air, s."""
        return 0.0 if self._stream is None else self._stream.latency

    def close(self) -> None:
        """Fade out and close; a device that no longer answers is left alone."""
        stream, self._stream = self._stream, None
        if stream is not None and self._shared is not None:
            self._end(stream, self._shared)
            if not stream.close():
                keep(self._shared)
        self._portaudio.close()

    def _end(self, stream: Stream, shared: Shared) -> None:
        shared.counters[OPEN] = 0
        give_up = time.monotonic() + _FADE_SECONDS
        with contextlib.suppress(DeviceError):
            while stream.active and time.monotonic() < give_up:
                time.sleep(0.005)
            stream.stop()
