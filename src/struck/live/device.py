"""PortAudio (V19), as little of it as a stream with a compiled callback needs.

The callback is given as an address, of code that needs no interpreter, so no lock of Python can
ever keep the loudspeaker waiting.
"""

from __future__ import annotations

import ctypes
from ctypes import byref, c_void_p
from typing import Any, Self

from struck.live import binding
from struck.live.devices import Device, choose, listed
from struck.live.stream import Stream

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
        self.library: ctypes.CDLL = binding.load_library()
        with binding.silenced():
            code = self.library.Pa_Initialize()
        binding.check(self.library, code, "PortAudio cannot start")
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
        binding.check(
            self.library,
            code,
            f"{chosen.name} ({chosen.host}) refuses {channels} channels{recorded} at "
            f"{sample_rate:g} Hz in blocks of {block}",
            f"; there is\n{listed(there)}\nand {binding.TO_FILE}",
        )
        return Stream(self, handle, chosen)


def _asked(device: int, channels: int, latency: float) -> Any:  # noqa: ANN401 - ctypes' reference
    """Return what is wanted of one direction of a stream; None where nothing is."""
    if not channels:
        return None
    return byref(binding.Parameters(device, channels, binding.FLOAT32, latency, None))
