"""A player's machinery: memory, callback, feeder and device, from beginning to end."""

from __future__ import annotations

import atexit
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from struck.ears.listeners import Listener
from struck.live import callback, limiter
from struck.live.commands import Desk
from struck.live.feeder import Feeder
from struck.live.outlet import Outlet, failed, gone
from struck.live.sounding import PEAK, sound
from struck.model.model import ModalModel

Array = NDArray[np.float64]

_STALLED = 2.0  # s without a call of the callback: the device is gone


class Running:
    """What runs beneath a `Player`, and what it shows of itself.

    Parameters
    ----------
    models : sequence of ModalModel
        The bodies.
    outlet : Outlet
        Where sound leaves.
    listener : array (3,) or Listener
        Where all bodies are heard, m, or with which ears.
    block, voices : int
        Samples for each call of the device; excitations at once.
    volume : float
        dB.
    ahead : int
        Blocks of forces kept ready.
    """

    def __init__(
        self,
        models: Sequence[ModalModel],
        *,
        outlet: Outlet,
        listener: Array | Listener,
        block: int,
        volume: float,
        voices: int,
        ahead: int,
    ) -> None:
        rate = outlet.sample_rate
        self._outlet, self._block = outlet, block
        self._desk = Desk(
            models,
            listener=listener,
            sample_rate=rate,
            block=block,
            volume=volume,
            voices=voices,
            ahead=ahead,
        )
        self._limited = limiter.limiter(sample_rate=rate, channels=outlet.channels)
        self._shared = callback.Shared(
            records=self._desk.records,
            limited=self._limited,
            arena=self._desk.arena,
            process=sound,
            channels=outlet.channels,
            block=block,
        )
        self._ahead = ahead
        self._feeder = Feeder(
            self._desk.records, self._desk.fill, seconds=block / rate, ahead=ahead
        )
        self._stopped = False
        outlet.open(callback.compiled(), self._shared, block)

    def begin(self) -> None:
        """Let it be heard; `struck.play` has done that. Where it fails, nothing of it stays."""
        try:
            self._feeder.start()
            atexit.register(self.stop)
            self._outlet.start()
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Fade out and close the device; more than once does no harm."""
        if self._stopped:
            return
        self._stopped = True
        atexit.unregister(self.stop)
        try:
            self._outlet.close()
        finally:
            self._feeder.stop()

    @property
    def active(self) -> bool:
        """Whether it is heard: not once it was stopped or the device went."""
        if self._stopped or not self._feeder.running or not self._outlet.active:
            return False
        return self._desk.idle < _STALLED

    @property
    def sample_rate(self) -> float:
        """Hz."""
        return self._outlet.sample_rate

    @property
    def latency(self) -> float:
        """From a wish to the air at most, s: waiting blocks, look-ahead of the limiter, device."""
        ahead = ((self._ahead + 1) * self._block + self._limited[limiter.DELAY]) / self.sample_rate
        return ahead + self._outlet.latency

    @property
    def load(self) -> float:
        """The share of its time that the audio callback takes, in percent."""
        return 100 * self._outlet.load

    @property
    def underflows(self) -> int:
        """How often the device ran out of samples."""
        return int(self._shared.counters[callback.UNDERFLOWS])

    @property
    def late(self) -> int:
        """Blocks for which no forces had come in time: loads were held."""
        return int(self._shared.counters[callback.LATE])

    @property
    def dropped(self) -> int:
        """Strikes, excitations and updates left out, as there was no voice or no room."""
        return self._desk.dropped

    @property
    def peak(self) -> float:
        """The loudest sample so far before the limiter; 1.0 is full scale."""
        return float(self._desk.arena[PEAK])

    def _require_playing(self) -> None:
        if not self.active:
            failure = self._feeder.failure
            raise failed(self._outlet.name, failure) if failure else gone(self._outlet.name)
        self._desk.raise_trouble()
