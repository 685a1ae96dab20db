"""PortAudio: devices, errors, and a compiled callback that never waits for Python."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import DeviceError, MissingDependencyError
from struck.live import callback_memory, limiter
from struck.live import device as binding
from struck.live.callback_memory import CALLS, LATE, OPEN, UNDERFLOWS, Shared, arena
from struck.live.device import Device, PortAudio, Stream, choose
from struck.live.player import Feeder
from struck.live.ring import FIRST_OUTPUTS, NEW_OUTPUTS, ON, Layout, Ring
from struck.synth.poles import Poles
from struck.synth.resonators import Stepped
from tests.live.servers import BLOCK, RATE, Server, judge
from tests.live.watchdog import stalls

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
MODES = 4_000


@ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
def take_too_long(*_: object) -> None:
    """Make no sound in the time of two blocks."""
    time.sleep(2 * BLOCK / RATE)


class Player:
    """All that plays: memory, callback, feeder."""

    def __init__(self, modes: int = 1, process: int | None = None) -> None:
        poles = -1.0 + 2j * np.pi * np.linspace(50.0, 15_000.0, modes)
        bank = Stepped(
            [Poles(values=poles)], points=1, block=BLOCK, voices=1, sample_rate=RATE, quiet=0.0
        )
        self.memory = bank.memory
        self._layout = Layout.of(bank.memory, 1)
        self.records = Ring(capacity=4, integers=self._layout.integers, reals=self._layout.reals)
        self._kept = bank, arena(bank, volume=1e-4)
        self.shared = Shared(
            records=self.records, limited=limiter.limiter(sample_rate=RATE, channels=2),
            arena=self._kept[1], process=process, channels=2, block=BLOCK,
        )  # fmt: skip
        self.feeder = Feeder(self.records, self.fill, seconds=BLOCK / RATE)

    def fill(self, integers: Integers, reals: Array) -> None:
        """Push all modes by one sample, heard alike."""
        record = self._layout.record(integers, reals)
        record.volume[0] = 1e-4
        record.bodies[0] = NEW_OUTPUTS | FIRST_OUTPUTS
        record.voices[0] = ON, 0, 1
        record.forces[0], record.drives[0], record.outputs[0, 0] = 0.0, 1.0, 1.0
        record.forces[0, 0] = 1e-3

    def open(self, portaudio: PortAudio, **options: Any) -> Stream:  # noqa: ANN401 - of `open`
        return portaudio.open(
            callback_memory.play(), self.shared.address,
            **{"sample_rate": RATE, "block": BLOCK, "channels": 2, **options},
        )  # fmt: skip

    def play(self, stream: Stream, seconds: float) -> float:
        """Return the load while it played; fade out at the end."""
        self.feeder.start()
        stream.start()
        time.sleep(seconds)
        assert stream.active
        load = stream.load
        self.shared.counters[OPEN] = 0
        give_up = time.monotonic() + 2
        while stream.active and time.monotonic() < give_up:
            time.sleep(BLOCK / RATE)
        assert not stream.active
        stream.stop()
        assert stream.close()
        self.feeder.stop()
        return load


@contextmanager
def busy_interpreter() -> Iterator[None]:
    over = threading.Event()

    def compute() -> None:
        total = 0
        while not over.is_set():
            for number in range(1000):
                total += number * number

    thread = threading.Thread(target=compute)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def device(number: int, name: str, *, default: bool = False) -> Device:
    return Device(
        number=number, name=name, host="ALSA", outputs=2, inputs=0, sample_rate=44100.0,
        output_latency=0.01, input_latency=0.01, default=default,
    )  # fmt: skip


DEVICES = [device(0, "Speakers", default=True), device(3, "USB left"), device(4, "USB right")]


@pytest.mark.parametrize(("wanted", "number"), [(None, 0), (3, 3), ("RIGHT", 4), ("speak", 0)])
def test_a_device_is_chosen_by_number_or_part_of_its_name(
    wanted: int | str | None, number: int
) -> None:
    assert choose(DEVICES, wanted).number == number


@pytest.mark.parametrize(
    ("wanted", "words"),
    [(7, "no audio device is number 7"), ("bass", "like 'bass'"), ("usb", "2 audio devices")],
)
def test_an_unclear_device_is_refused_with_a_list(wanted: int | str, words: str) -> None:
    with pytest.raises(DeviceError, match=words) as caught:
        choose(DEVICES, wanted)
    assert "0: Speakers (ALSA, 2 channels, 44100 Hz, default)" in str(caught.value)
    assert "4: USB right" in str(caught.value)


def test_without_a_device_the_way_to_a_file_is_shown() -> None:
    with pytest.raises(DeviceError, match=r"no audio device can play.*struck render"):
        choose([])


def test_without_portaudio_the_way_to_install_it_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(binding, "find_library", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(MissingDependencyError, match="apt install libportaudio2") as caught:
        PortAudio()
    assert "struck[live]" in str(caught.value)
    assert "struck render" in str(caught.value)


def test_the_library_that_sounddevice_carries_is_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "portaudio-binaries"
    folder.mkdir()
    for name in ("README.md", "libportaudio64bit-asio.dll", "libportaudio64bit.dll"):
        (folder / name).touch()
    package = ModuleSpec("_sounddevice_data", None, is_package=True)
    package.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(binding, "find_library", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: package)
    assert list(binding._candidates()) == [str(folder / "libportaudio64bit.dll")]


def test_only_the_probing_is_silenced(capfd: pytest.CaptureFixture[str]) -> None:
    with binding.silence_output():
        os.write(2, b"ALSA lib: noise\n")
    os.write(2, b"news\n")
    assert capfd.readouterr().err == "news\n"


def test_a_server_is_listed_with_its_rate_and_channels(jack: Server) -> None:
    assert jack.process.poll() is None
    with PortAudio() as portaudio:
        found = portaudio.device()
        assert portaudio.devices() == [found]
    assert "JACK" in found.host
    assert (found.outputs, found.sample_rate, found.default) == (2, RATE, True)


@pytest.mark.usefixtures("jack")
@pytest.mark.parametrize("wrong", [{"sample_rate": 96000.0}, {"channels": 64}, {"inputs": 64}])
def test_a_refused_stream_names_the_reason_and_what_there_is(wrong: dict[str, float]) -> None:
    player = Player()
    with PortAudio() as portaudio, pytest.raises(DeviceError, match="refuses") as caught:
        player.open(portaudio, **wrong)
    assert "0: system (JACK" in str(caught.value)
    assert "Invalid" in str(caught.value)


@pytest.mark.usefixtures("jack")
def test_a_stream_states_its_latency_and_says_when_it_is_closed() -> None:
    player = Player()
    with PortAudio() as portaudio:
        stream = player.open(portaudio, inputs=2)
        assert 0 <= stream.latency < 0.1
        player.play(stream, 0.2)
        assert stream.close()
        assert (stream.load, stream.latency) == (0, 0)
        with pytest.raises(DeviceError, match="closed"):
            stream.start()
    assert player.shared.counters[CALLS] >= 0.1 * RATE / BLOCK


@pytest.mark.prove
def test_beside_a_busy_interpreter_nothing_underflows(
    jack: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    # A shared machine now and then stops everybody, the server's clock too. A callback that had to
    # wait for Python would underflow hundreds of times in each of the windows.
    for _ in range(2):
        player = Player(modes=MODES)
        late = jack.late()
        with stalls() as stalled, PortAudio() as portaudio, busy_interpreter():
            load = player.play(player.open(portaudio), 5)
        calls, underflows, missed = player.shared.counters[[CALLS, UNDERFLOWS, LATE]].tolist()
        with capsys.disabled():
            sys.stdout.write(
                f"{calls} calls, {underflows} underflows ({jack.late() - late} times the server's "
                f"clock was late), {missed} late records, load {load:.1%}\n"
            )
        if not underflows:
            break
    assert 0 < load < 0.8
    assert np.isfinite(player.memory.modes).all()
    judge(underflows, calls, stalled)
    assert missed < 0.01 * calls
    assert calls == pytest.approx(5 * RATE / BLOCK, rel=0.02)


def test_a_callback_that_takes_too_long_is_counted(jack: Server) -> None:
    player = Player(process=ctypes.cast(take_too_long, ctypes.c_void_p).value)
    with PortAudio() as portaudio:
        stream = player.open(portaudio)
        player.play(stream, 0.2)
    assert player.shared.counters[UNDERFLOWS] > 0
    assert "was not finished" in jack.log.read_text()


@pytest.mark.prove
@pytest.mark.usefixtures("jack")
def test_a_server_that_dies_is_noticed_and_not_waited_for() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.live.dying_server"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stdout.split() == ["playing", "silent", "abandoned"]
