"""PortAudio (V19), as little of it as a stream with a compiled callback needs.

The callback is given as an address, of code that needs no interpreter, so no lock of Python can
ever keep the loudspeaker waiting.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import sys
import threading
from collections.abc import Callable, Iterator
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int, c_long, c_ulong, c_void_p
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from struck.errors import DeviceError, MissingDependencyError

# PortAudio (V19) as ctypes sees it: structures, prototypes, and where the library is found.
#
# Names and layouts are those of `portaudio.h`.

FLOAT32 = 1  # a sample format; interleaved
UNANTICIPATED_HOST_ERROR = -9999
TO_FILE = "`struck render MODEL -o FILE.wav` needs no device"


class HostApi(Structure):
    """PaHostApiInfo."""

    _fields_ = (
        ("structVersion", c_int),
        ("type", c_int),
        ("name", c_char_p),
        ("deviceCount", c_int),
        ("defaultInputDevice", c_int),
        ("defaultOutputDevice", c_int),
    )


class HostError(Structure):
    """PaHostErrorInfo."""

    _fields_ = (("hostApiType", c_int), ("errorCode", c_long), ("errorText", c_char_p))


class DeviceInfo(Structure):
    """PaDeviceInfo."""

    _fields_ = (
        ("structVersion", c_int),
        ("name", c_char_p),
        ("hostApi", c_int),
        ("maxInputChannels", c_int),
        ("maxOutputChannels", c_int),
        ("defaultLowInputLatency", c_double),
        ("defaultLowOutputLatency", c_double),
        ("defaultHighInputLatency", c_double),
        ("defaultHighOutputLatency", c_double),
        ("defaultSampleRate", c_double),
    )


class Parameters(Structure):
    """PaStreamParameters."""

    _fields_ = (
        ("device", c_int),
        ("channelCount", c_int),
        ("sampleFormat", c_ulong),
        ("suggestedLatency", c_double),
        ("hostApiSpecificStreamInfo", c_void_p),
    )


class StreamInformation(Structure):
    """PaStreamInfo."""

    _fields_ = (
        ("structVersion", c_int),
        ("inputLatency", c_double),
        ("outputLatency", c_double),
        ("sampleRate", c_double),
    )


_PROTOTYPES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "Pa_Initialize": (c_int, ()),
    "Pa_Terminate": (c_int, ()),
    "Pa_GetErrorText": (c_char_p, (c_int,)),
    "Pa_GetLastHostErrorInfo": (POINTER(HostError), ()),
    "Pa_GetDeviceCount": (c_int, ()),
    "Pa_GetDefaultInputDevice": (c_int, ()),
    "Pa_GetDefaultOutputDevice": (c_int, ()),
    "Pa_GetDeviceInfo": (POINTER(DeviceInfo), (c_int,)),
    "Pa_GetHostApiInfo": (POINTER(HostApi), (c_int,)),
    "Pa_OpenStream": (
        c_int,
        (
            POINTER(c_void_p),
            POINTER(Parameters),
            POINTER(Parameters),
            c_double,
            c_ulong,
            c_ulong,
            c_void_p,
            c_void_p,
        ),
    ),
    "Pa_StartStream": (c_int, (c_void_p,)),
    "Pa_StopStream": (c_int, (c_void_p,)),
    "Pa_AbortStream": (c_int, (c_void_p,)),
    "Pa_CloseStream": (c_int, (c_void_p,)),
    "Pa_IsStreamActive": (c_int, (c_void_p,)),
    "Pa_GetStreamInfo": (POINTER(StreamInformation), (c_void_p,)),
    "Pa_GetStreamCpuLoad": (c_double, (c_void_p,)),
}


def load_library() -> ctypes.CDLL:
    """Return PortAudio, of the system or else of the `sounddevice` package, ready to be called.

    Raises
    ------
    MissingDependencyError
        Where there is neither.
    """
    for candidate in _candidates():
        try:
            library = ctypes.CDLL(candidate)
        except OSError:
            continue
        for name, (result, arguments) in _PROTOTYPES.items():
            getattr(library, name).restype = result
            getattr(library, name).argtypes = arguments
        return library
    raise MissingDependencyError(
        "playing needs PortAudio: `apt install libportaudio2` on Debian and Ubuntu (other Linux "
        "distributions call it portaudio), `pip install struck[live]` on Windows and macOS; "
        f"{TO_FILE}"
    )


def check(library: ctypes.CDLL, code: int, trouble: str, way_out: str = "") -> int:
    """Return what a function of PortAudio returned.

    Raises
    ------
    DeviceError
        Where that is an error code: the trouble, PortAudio's reason and the way out.
    """
    if code < 0:
        raise DeviceError(f"{trouble}: {_reason(library, code)}{way_out}")
    return code


def _reason(library: ctypes.CDLL, code: int) -> str:
    if code == UNANTICIPATED_HOST_ERROR:
        host = library.Pa_GetLastHostErrorInfo().contents
        if host.errorText:
            return host.errorText.decode(errors="replace")
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
def silenced() -> Iterator[None]:
    """Keep file descriptor 2 quiet: ALSA and JACK report there whatever they look for in vain."""
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # there is no such descriptor, so nothing to silence
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


# Audio devices, and which one is meant.


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """An audio device that can play, record or both.

    Parameters
    ----------
    number : int
        As PortAudio counts; valid until it is closed.
    name, host : str
        Its name, and that of the system through which it is reached ("ALSA", "Core Audio" ...).
    outputs, inputs : int
        Channels.
    sample_rate : float
        By default, Hz.
    output_latency, input_latency : float
        The lowest that the device recommends, s.
    default : bool
        Whether the system plays (or records, where that is asked for) here unless told otherwise.
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
        usual = ", default" if self.default else ""
        channels = f"{self.outputs} channels" if self.outputs else f"{self.inputs} inputs"
        return (
            f"{self.number}: {self.name} ({self.host}, {channels}, "
            f"{self.sample_rate:.0f} Hz{usual})"
        )


def choose(devices: list[Device], wanted: int | str | None = None, *, what: str = "play") -> Device:
    """Return a device by its number or part of its name (any case); left out: the default one.

    Raises
    ------
    DeviceError
        Where no device can do `what` is asked, none matches, or several do; it lists what there is.
    """
    if not devices:
        raise DeviceError(
            f"no audio device can {what}: connect one, or start a sound server; {TO_FILE}"
        )
    chosen = [device for device in devices if _matches(device, wanted)]
    if len(chosen) != 1:
        how = "no audio device is" if not chosen else f"{len(chosen)} audio devices are"
        raise DeviceError(
            f"{how} {_devices_asked(wanted)}: give the number of one of\n{listed(devices)}"
        )
    return chosen[0]


def _matches(device: Device, wanted: int | str | None) -> bool:
    if wanted is None:
        return device.default
    if isinstance(wanted, int):
        return device.number == wanted
    return wanted.casefold() in device.name.casefold()


def _devices_asked(wanted: int | str | None) -> str:
    if wanted is None:
        return "the default"
    return f"number {wanted}" if isinstance(wanted, int) else f"named like {wanted!r}"


def listed(devices: list[Device]) -> str:
    """Return a line for each device."""
    return "\n".join(f"  {device}" for device in devices)


# A stream to an audio device: started, stopped, closed, and never waited for in vain.

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
                f"Start again with another device; {TO_FILE}"
            )
        return check(self._library, code, trouble, f"; {TO_FILE}")


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


# Status flags that a callback is given, and what it may return.
INPUT_UNDERFLOW, INPUT_OVERFLOW, OUTPUT_UNDERFLOW, OUTPUT_OVERFLOW = 1, 2, 4, 8
CONTINUE, COMPLETE = 0, 1


class PortAudio:
    """PortAudio, from the moment it looked for devices until `close`.

    What is plugged in later is seen by the next one. Use it as a context, or `close` it.

    Attributes
    ----------
    library : CDLL
        Its functions.
    answers : bool
        Whether every call has returned. After one that did not, PortAudio is left alone: ending it
        would wait as well.

    Raises
    ------
    MissingDependencyError
        Where PortAudio is not installed.
    DeviceError
        Where it cannot start.
    """

    def __init__(self) -> None:
        self.library: ctypes.CDLL = load_library()
        with silenced():
            code = self.library.Pa_Initialize()
        check(self.library, code, "PortAudio cannot start")
        self._initialised = True
        self.answers = True

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
        """Return all devices that can play."""
        usual = self.library.Pa_GetDefaultOutputDevice()
        return [device for device in self._found(usual) if device.outputs]

    def recorders(self) -> list[Device]:
        """Return all devices that can record."""
        usual = self.library.Pa_GetDefaultInputDevice()
        return [device for device in self._found(usual) if device.inputs]

    def _found(self, usual: int) -> list[Device]:
        return [self._describe(n, usual) for n in range(self.library.Pa_GetDeviceCount())]

    def _describe(self, number: int, usual: int) -> Device:
        device = self.library.Pa_GetDeviceInfo(number).contents
        host = self.library.Pa_GetHostApiInfo(device.hostApi).contents
        return Device(
            number=number,
            name=device.name.decode(errors="replace"),
            host=host.name.decode(errors="replace"),
            outputs=device.maxOutputChannels,
            inputs=device.maxInputChannels,
            sample_rate=device.defaultSampleRate,
            output_latency=device.defaultLowOutputLatency,
            input_latency=device.defaultLowInputLatency,
            default=number == usual,
        )

    def device(self, wanted: int | str | None = None) -> Device:
        """Return a device by its number or part of its name (any case); left out: the default one.

        Raises
        ------
        DeviceError
            Where no device can play, none matches, or several do; it lists what there is.
        """
        return choose(self.devices(), wanted)

    def recorder(self, wanted: int | str | None = None) -> Device:
        """Return a device that records, as `device` does one that plays."""
        return choose(self.recorders(), wanted, what="record")

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
        """Open a stream of interleaved float32 samples; it does not run yet.

        Parameters
        ----------
        callback, data : int
            Addresses of a `PaStreamCallback` and of what it is given as `userData`. Both must
            outlive the stream.
        sample_rate : float
            Hz.
        block : int
            Frames at each call of the callback.
        channels, inputs : int
            Played, and recorded on the same device. Without any that are played, nothing is: the
            callback is then given nowhere to write to.
        device : int or str, optional
            As for `device`, or for `recorder` where nothing is played.

        Raises
        ------
        DeviceError
            Where there is no such device, or it refuses the stream; it lists what there is.
        """
        chosen = self.device(device) if channels else self.recorder(device)
        there = self.devices() if channels else self.recorders()
        handle = c_void_p()
        code = self.library.Pa_OpenStream(
            byref(handle),
            _asked(chosen.number, inputs, chosen.input_latency),
            _asked(chosen.number, channels, chosen.output_latency),
            sample_rate, block, 0, callback, data,
        )  # fmt: skip
        recorded = f" and {inputs} recorded" if inputs else ""
        check(
            self.library,
            code,
            f"{chosen.name} ({chosen.host}) refuses {channels} channels{recorded} at "
            f"{sample_rate:g} Hz in blocks of {block}",
            f"; there is\n{listed(there)}\nand {TO_FILE}",
        )
        return Stream(self, handle, chosen)


def _asked(device: int, channels: int, latency: float) -> Any:  # noqa: ANN401 - ctypes' reference
    """Return what is wanted of one direction of a stream; None where nothing is."""
    if not channels:
        return None
    return byref(Parameters(device, channels, FLOAT32, latency, None))
