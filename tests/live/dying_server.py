"""Play, let the sound server die, and close: this process cannot use PortAudio afterwards."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import pytest

from struck.errors import DeviceError
from tests.live.servers import dummy_server
from tests.live.test_device import Player, PortAudio


def main() -> None:
    player = Player()
    slot = player.records.reserve()
    assert slot is not None
    player.fill(*slot)
    player.records.publish()
    with (
        tempfile.TemporaryDirectory() as folder,
        dummy_server("struck-dying", Path(folder)) as server,
        PortAudio() as portaudio,
    ):
        stream = player.open(portaudio)
        stream.start()
        time.sleep(0.3)
        say("playing" if stream.active else "mute")
        server.process.terminate()
        server.process.wait()
        time.sleep(0.3)
        say("still playing" if stream.active else "silent")
        with pytest.raises(DeviceError, match="no answer"):
            stream.stop()
        say("closed" if stream.close() else "abandoned")


def say(word: str) -> None:
    sys.stdout.write(word + "\n")


if __name__ == "__main__":
    main()
