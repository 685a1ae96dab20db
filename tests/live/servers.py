"""A sound server without a sound card: JACK with its dummy driver, a server of our own."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path

import pytest

from struck.live.device import PortAudio

RATE, BLOCK = 48000, 128
_PATIENCE = 10  # s, until a server is up


@dataclass(frozen=True, slots=True, kw_only=True)
class Server:
    """A running sound server; PortAudio finds it while `JACK_DEFAULT_SERVER` holds its name."""

    process: subprocess.Popen[bytes]
    log: Path

    def late(self) -> int:
        """Return how often its own clock woke up late: the machine's doing, nobody's else."""
        return self.log.read_text().count("JackTimedDriver::Process XRun")


def judge(underflows: int, calls: int, stalls: Sequence[float] = ()) -> None:
    """Pass, fail, or skip where a machine that stops real-time threads leaves it open.

    `stalls`, ms, are the times for which it did, as a watchdog saw: none of those blocks could be
    made.
    """
    lost = sum(1 + 1e-3 * each * RATE / BLOCK for each in stalls)
    assert underflows <= max(0.02 * calls, lost), f"{underflows} underflows of {calls}"
    if underflows:
        pytest.skip(f"{underflows} underflows of {calls}: this machine stops real-time threads")


def missing() -> str:
    """Return what has to be installed; empty where nothing has to."""
    lacking = [] if shutil.which("jackd") else ["jackd2"]
    lacking += [] if find_library("portaudio") else ["libportaudio2"]
    return f"apt install {' '.join(lacking)}" if lacking else ""


@contextmanager
def dummy_server(name: str, folder: Path) -> Iterator[Server]:
    """Run a server of this name, to which PortAudio connects meanwhile."""
    log = folder / "log"
    command = ["jackd", "-n", name, "-t", "10000", "-d", "dummy", "-r", str(RATE), "-p", str(BLOCK)]
    with pytest.MonkeyPatch.context() as patch, log.open("wb") as written:
        patch.setenv("JACK_DEFAULT_SERVER", name)
        process = subprocess.Popen(command, stdout=written, stderr=subprocess.STDOUT)
        try:
            wait_until_it_answers(process)
            yield Server(process=process, log=log)
        finally:
            process.terminate()
            process.wait(_PATIENCE)


def wait_until_it_answers(process: subprocess.Popen[bytes]) -> None:
    give_up = time.monotonic() + _PATIENCE
    while time.monotonic() < give_up:
        with PortAudio() as portaudio:
            if any("JACK" in device.host for device in portaudio.devices()):
                return
        assert process.poll() is None, f"jackd ended with {process.returncode}"
        time.sleep(0.1)
    raise TimeoutError(f"jackd did not answer within {_PATIENCE} s")
