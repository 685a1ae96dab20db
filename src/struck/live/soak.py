"""Playing without hands: strikes at random, scrapes, and a thread that is in the way."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence

import numpy as np

from struck.excitation.scrape import Scrape
from struck.live.keys import places_by_key
from struck.live.player import Player
from struck.model.contact import Place
from struck.model.model import ModalModel

_SPEEDS = 0.05, 0.5  # of a striker, m/s
_LATEST = 0.1  # s: strikes that are due for longer are not made up for


class Robot:
    """Strikes bodies so many times a second, at random places, and scrapes some of them.

    Parameters
    ----------
    player : Player
        What it plays on.
    models : sequence of ModalModel
        The player's bodies.
    strikes : float
        A second.
    scrapes : int
        Bodies that are scraped, there and back, without end.
    seed : int
        Of all that is random.
    """

    def __init__(
        self,
        player: Player,
        models: Sequence[ModalModel],
        *,
        strikes: float,
        scrapes: int,
        seed: int = 0,
    ) -> None:
        self._player = player
        self._random = np.random.default_rng(seed)
        self._places = [list(places_by_key(model).values()) for model in models]
        self._pause = 1 / strikes if strikes else float("inf")
        self.strikes = 0
        for number in range(scrapes):
            self._scrape(models, number % len(models))
        self._due = time.monotonic() + self._pause

    def go_on(self) -> None:
        """Strike as often as is due."""
        now = time.monotonic()
        self._due = max(self._due, now - _LATEST)
        while self._due <= now:
            self._strike()
            self._due += self._pause

    def _strike(self) -> None:
        body = int(self._random.integers(len(self._places)))
        places = self._places[body]
        at: Place = places[int(self._random.integers(len(places)))]
        speed = float(self._random.uniform(*_SPEEDS))
        self._player.strike(at=at, striker="wood", speed=speed, body=body)
        self.strikes += 1

    def _scrape(self, models: Sequence[ModalModel], body: int) -> None:
        mesh = models[body].geometry
        if mesh is None:
            return
        far = np.argmax(np.linalg.norm(mesh.points - mesh.points[0], axis=1))
        self._player.start(
            Scrape(path=["vertex:0", f"vertex:{far}"], speed=0.2, load=2.0, repeat="back"),
            body=body,
        )


def repeated(models: Sequence[ModalModel], modes: int) -> list[ModalModel]:
    """Return the models again and again, until they have so many modes in all."""
    bodies, count = list(models), sum(len(model.frequencies) for model in models)
    while count < modes:
        bodies.append(models[len(bodies) % len(models)])
        count += len(bodies[-1].frequencies)
    return bodies


@contextlib.contextmanager
def busy_thread(*, wanted: bool = True) -> Iterator[None]:
    """Let a thread compute in pure Python meanwhile: the worst neighbour there is."""
    done = threading.Event()

    def compute() -> None:
        number = 0
        while not done.is_set():
            for _ in range(100_000):
                number = (number * 1_103_515_245 + 12_345) % 2_147_483_648

    thread = threading.Thread(target=compute, name="struck busy", daemon=True)
    if wanted:
        thread.start()
    try:
        yield
    finally:
        done.set()
        if wanted:
            thread.join()
