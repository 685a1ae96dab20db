"""
Play live
=========

`struck.play` plays on an audio device. A player also works without one: this script replaces the
device and requests one block after the other.
"""

import ctypes
import time

import numpy as np

import struck
from struck.live import Player
from struck.report.charts import spectrogram
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.25, width=0.03, thickness=0.006, ends="free"), "aluminium")
_ADDRESS, _ULONG = ctypes.c_void_p, ctypes.c_ulong


class Device:
    """A substitute for an audio device, which computes blocks on request."""

    name, sample_rate, channels = "by hand", 48_000.0, 2
    load, latency, active = 0.0, 0.0, True

    def open(self, callback, shared, block):
        """Store the address of the callback, as PortAudio does."""
        kind = ctypes.CFUNCTYPE(
            ctypes.c_int, _ADDRESS, _ADDRESS, _ULONG, _ADDRESS, _ULONG, _ADDRESS
        )
        self.call, self.shared, self.block = kind(callback), shared, block

    def start(self):
        """Begin."""

    def close(self):
        """End."""

    def play(self, seconds):
        """Return the output (n, 2) of some seconds."""
        blocks = np.zeros((round(seconds * self.sample_rate / self.block), self.block, 2), "f4")
        for each in blocks:
            time.sleep(self.block / self.sample_rate)  # duration of a block
            self.call(None, each.ctypes.data, self.block, None, 0, self.shared.address)
        return blocks.reshape(-1, 2)


device = Device()
blocks = []
with Player([bar], outlet=device) as player:
    player.begin()
    for speed in (0.2, 0.5, 1.0):
        player.strike(at="end", striker="wood", speed=speed)
        blocks.append(device.play(0.4))
    player.dampen("middle", 5.0)  # a hand damps the middle
    blocks.append(device.play(0.4))
sound = struck.Sound(samples=np.concatenate(blocks).T, sample_rate=48_000)
spectrogram(sound)

# %%
sound
