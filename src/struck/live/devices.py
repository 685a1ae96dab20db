"""Audio devices, and which one is meant."""

from __future__ import annotations

from dataclasses import dataclass

from struck.errors import DeviceError
from struck.live.binding import TO_FILE


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
        raise DeviceError(f"{how} {_asked(wanted)}: give the number of one of\n{listed(devices)}")
    return chosen[0]


def _matches(device: Device, wanted: int | str | None) -> bool:
    if wanted is None:
        return device.default
    if isinstance(wanted, int):
        return device.number == wanted
    return wanted.casefold() in device.name.casefold()


def _asked(wanted: int | str | None) -> str:
    if wanted is None:
        return "the default"
    return f"number {wanted}" if isinstance(wanted, int) else f"named like {wanted!r}"


def listed(devices: list[Device]) -> str:
    """Return a line for each device."""
    return "\n".join(f"  {device}" for device in devices)
