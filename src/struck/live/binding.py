"""PortAudio (V19) as ctypes sees it: structures, prototypes, and where the library is found.

Names and layouts are those of `portaudio.h`.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import sys
from collections.abc import Iterator
from ctypes import POINTER, Structure, c_char_p, c_double, c_int, c_long, c_ulong, c_void_p
from ctypes.util import find_library
from pathlib import Path
from typing import Any

from struck.errors import DeviceError, MissingDependencyError

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


class Device(Structure):
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
    "Pa_GetDeviceInfo": (POINTER(Device), (c_int,)),
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
