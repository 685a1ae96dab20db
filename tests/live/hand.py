"""A player without an audio device: the callback is called by hand, block after block."""

from __future__ import annotations

import atexit
import ctypes
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from struck.analysis.analysis import model_of_modes
from struck.live import player
from struck.live.callback_memory import Shared
from struck.live.player import Feeder, Player
from struck.model.material import Material
from struck.model.model import ModalModel

RATE, BLOCK, CEILING = 48000.0, 128, 0.89
STEEL = Material(density=7850.0, youngs_modulus=210e9, poisson_ratio=0.3)


class HandFed(Feeder):
    """Fills when told to, not in a thread of its own."""

    running = True

    def start(self) -> None:
        self.fill_up()

    def fill_up(self) -> None:
        self._top_up()

    def stop(self) -> None:
        pass


class Hand:
    """An outlet that calls when told to."""

    name, sample_rate, channels, load, latency = "a hand", RATE, 2, 0.0, 0.0
    active = True

    def open(self, callback: int, shared: Shared, block: int) -> None:
        whole, word, place = ctypes.c_int, ctypes.c_ulong, ctypes.c_void_p
        self._call = ctypes.CFUNCTYPE(whole, place, place, word, place, word, place)(callback)
        self.shared, self._block = shared, block

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass

    def play(self) -> NDArray[np.float32]:
        """Return a block (channels, block) as the loudspeaker hears it."""
        frames = np.full((self._block, self.channels), np.nan, dtype=np.float32)
        self._call(None, frames.ctypes.data, self._block, None, 0, self.shared.address)
        return frames.T


class HandPlayer(Player):
    """A player whose blocks are made one by one.

    Time stands still: all commands come at the first sample of their block. What is said is heard
    one block later, as another is ready before it.
    """

    def __init__(self, models: Sequence[ModalModel], **options: Any) -> None:  # noqa: ANN401 - of `Player`
        self.hand = Hand()
        outlet: Any = self.hand
        super().__init__(models, outlet=outlet, **options)
        self._host.queue._clock = lambda: 0.0
        self._host.queue._last_run = 0.0

    def hear(
        self, blocks: int, between: Callable[[int], None] | None = None
    ) -> NDArray[np.float32]:
        """Return so many blocks (n,) of the first channel; `between` is called before each."""
        heard = []
        for number in range(blocks):
            if between is not None:
                between(number)
            self._feeder.fill_up()
            heard.append(self.hand.play()[0].copy())
        return np.concatenate(heard)

    def hear_both(self, blocks: int) -> NDArray[np.float32]:
        """Return so many blocks (2, n) of both channels."""
        heard = []
        for _ in range(blocks):
            self._feeder.fill_up()
            heard.append(self.hand.play().copy())
        return np.concatenate(heard, axis=1)

    def hear_late(self, blocks: int) -> NDArray[np.float32]:
        """Return so many blocks that no records come for, after those that wait."""
        return np.concatenate([self.hand.play()[0].copy() for _ in range(blocks)])

    @property
    def gain(self) -> float:
        """Of full scale for a Pa."""
        return self._host.gain

    @property
    def bank(self) -> Any:  # noqa: ANN401 - short
        """The modes."""
        return self._host.bank


Make = Callable[..., HandPlayer]


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch) -> Make:
    """Return what makes players that have begun."""
    monkeypatch.setattr(player, "Feeder", HandFed)

    def make(models: ModalModel | Sequence[ModalModel], **options: Any) -> HandPlayer:  # noqa: ANN401 - of `Player`
        bodies = [models] if isinstance(models, ModalModel) else models
        player = HandPlayer(bodies, **options)
        player.begin()
        return player

    return make


@cache
def ball(modes: int = 40, *, seed: int = 0, radius: float = 0.1) -> ModalModel:
    """Return a ball with smooth random shapes and places "top" and "side", the same each time."""
    solid = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    chance = np.random.default_rng(seed)
    points = np.asarray(solid.vertices)
    waves = chance.normal(size=(3, 3, modes)) * 20
    shapes = np.sin(np.einsum("vd,dkm->vkm", points, waves) + chance.uniform(0, 6, (3, modes)))
    return model_of_modes(
        points,
        solid.faces,
        np.sort(chance.uniform(300, 15000, modes)),
        shapes,
        material=STEEL,
        mass=1.0,
        centre=np.zeros(3),
        inertia=np.eye(3) * 0.004,
        places={"top": np.array([0, 0, radius]), "side": np.array([radius, 0, 0])},
        air=False,  # no ball has these shapes
    )


atexit.register(ball.cache_clear)  # else what they find contacts with is reported as leaked
