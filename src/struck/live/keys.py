"""Players of bodies: keys of a terminal as they are typed, or a robot that strikes at random."""

from __future__ import annotations

import contextlib
import os
import queue
import stat
import string
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from struck.excitation.scrape import Scrape
from struck.live.player import Player
from struck.model.arrays import Array
from struck.model.contact import Place
from struck.model.model import ModalModel

QUIT, DEFAULT = "q", " "
_STRIKER_SPEEDS = 0.05, 0.5  # of a robot's striker, m/s
_MAX_DELAY = 0.1  # s: a robot's strikes that are later than this are dropped
_NUMBERS = "1234567890"
_LETTERS = "".join(letter for letter in string.ascii_lowercase if letter != QUIT)


class Keys(Protocol):
    """A source of typed keys: a terminal, a pipe or a file, or none."""

    def pressed(self, seconds: float) -> str:
        """Return the next key; "" if there is none within `seconds`."""
        ...

    @property
    def ended(self) -> bool:
        """Whether no key can come any more: the end of a pipe or a file."""
        ...


class NoKeys:
    """Keys without a terminal: none is ever pressed."""

    def pressed(self, seconds: float) -> str:
        """Wait for a key; without a terminal none comes."""
        time.sleep(seconds)
        return ""

    @property
    def ended(self) -> bool:
        """Whether there were keys that have ended: there were none."""
        return False


class PipedKeys:
    """Keys from a pipe or a file, one after the other."""

    def __init__(self, number: int) -> None:
        self._typed: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._ended = False
        # A thread waits for them, as `select` knows no pipes on Windows.
        reader = threading.Thread(
            target=self._read, args=(number,), name="struck keys", daemon=True
        )
        reader.start()

    def _read(self, number: int) -> None:
        with contextlib.suppress(OSError):
            while key := os.read(number, 1):
                self._typed.put(key)
        self._typed.put(b"")

    def pressed(self, seconds: float) -> str:
        """Return the next key; "" if there is none within `seconds`, or at the end."""
        try:
            key = self._typed.get(timeout=seconds)
        except queue.Empty:
            return ""
        self._ended = not key
        return key.decode(errors="ignore")

    @property
    def ended(self) -> bool:
        """Whether the end of the input was reached."""
        return self._ended


def places_by_key(model: ModalModel) -> dict[str, Place]:
    """Return the place that each key strikes: digits named places, letters vertices all over."""
    places: dict[str, Place] = {DEFAULT: None}
    places |= dict(zip(_NUMBERS, model.places, strict=False))
    if model.geometry is not None and not model.recorded:
        count = len(model.geometry.points)
        chosen = np.unique(np.linspace(0, count - 1, len(_LETTERS)).astype(int))
        names = (f"vertex:{number}" for number in chosen.tolist())
        places |= dict(zip(_LETTERS, names, strict=False))
    return places


@contextlib.contextmanager
def terminal_keys() -> Iterator[Keys]:
    """Yield the keys of the terminal, as they are typed, or of a pipe or a file.

    No key comes from the null device, or where nothing is connected.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        number = _find_pipe()
        yield NoKeys() if number is None else PipedKeys(number)
    elif sys.platform == "win32":
        yield _Console()
    else:
        with _unbuffered() as keys:
            yield keys


def _find_pipe() -> int | None:
    """Return the number of the standard input where it is a pipe, a socket or a file."""
    try:
        number = sys.stdin.fileno()
        mode = os.fstat(number).st_mode
    except (OSError, ValueError, AttributeError):  # closed, or replaced by something of Python
        return None
    kinds = (stat.S_ISFIFO, stat.S_ISREG, stat.S_ISSOCK)
    return number if any(is_kind(mode) for is_kind in kinds) else None


if sys.platform == "win32":

    class _Console:
        ended = False

        def pressed(self, seconds: float) -> str:
            import msvcrt

            give_up = time.monotonic() + seconds
            while not msvcrt.kbhit():
                if time.monotonic() >= give_up:
                    return ""
                time.sleep(0.001)
            return msvcrt.getwch()

else:

    class _Terminal:
        ended = False

        def pressed(self, seconds: float) -> str:
            import select

            ready, _, _ = select.select([sys.stdin], [], [], seconds)
            # Past the buffer of `sys.stdin`, whose content `select` does not know of.
            return os.read(sys.stdin.fileno(), 1).decode(errors="ignore") if ready else ""

    @contextlib.contextmanager
    def _unbuffered() -> Iterator[Keys]:
        import termios
        import tty

        number = sys.stdin.fileno()
        settings = termios.tcgetattr(number)
        tty.setcbreak(number, termios.TCSADRAIN)  # keeps keys typed earlier
        try:
            yield _Terminal()
        finally:
            termios.tcsetattr(number, termios.TCSADRAIN, settings)


class Robot:
    """Strikes bodies at random places, a number of times per second, and scrapes some of them."""

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
        self.plays = bool(strikes or scrapes)
        self.strikes = 0
        for number in range(scrapes):
            self._scrape(models, number % len(models))
        self._next_time = time.monotonic() + self._pause

    def go_on(self) -> None:
        """Strike as often as is due by the robot's clock."""
        now = time.monotonic()
        self._next_time = max(self._next_time, now - _MAX_DELAY)
        while self._next_time <= now:
            self._strike()
            self._next_time += self._pause

    def _strike(self) -> None:
        body = int(self._random.integers(len(self._places)))
        places = self._places[body]
        at: Place = places[int(self._random.integers(len(places)))]
        speed = float(self._random.uniform(*_STRIKER_SPEEDS))
        self._player.strike(at=at, striker="wood", speed=speed, body=body)
        self.strikes += 1

    def _scrape(self, models: Sequence[ModalModel], body: int) -> None:
        ends = _find_ends(models[body])
        if ends:
            scrape = Scrape(path=ends, speed=0.2, load=2.0, repeat="back")
            self._player.start(scrape, body=body)


def _find_ends(model: ModalModel) -> list[str] | list[Array]:
    """Return both ends of a scrape along a body; [] if lengths on it are unknown."""
    mesh, bounds = model.geometry, model.gains.bounds
    if mesh is not None and not model.recorded:
        far_vertex = np.argmax(np.linalg.norm(mesh.points - mesh.points[0], axis=1))
        return ["vertex:0", f"vertex:{far_vertex}"]
    if model.chart is None or bounds is None:
        return []
    return [np.where(np.isfinite(end), end, 0.0) for end in bounds]


def repeat_models(models: Sequence[ModalModel], modes: int) -> list[ModalModel]:
    """Return the models again and again, until they have this many modes in all."""
    bodies, count = list(models), sum(len(model.frequencies) for model in models)
    while count < modes:
        bodies.append(models[len(bodies) % len(models)])
        count += len(bodies[-1].frequencies)
    return bodies


@contextlib.contextmanager
def busy_thread(*, is_busy: bool = True) -> Iterator[None]:
    """Run a thread that computes in pure Python: the worst neighbour of a feeder."""
    stop_event = threading.Event()

    def compute() -> None:
        number = 0
        while not stop_event.is_set():
            for _ in range(100_000):
                number = (number * 1_103_515_245 + 12_345) % 2_147_483_648

    thread = threading.Thread(target=compute, name="struck busy", daemon=True)
    if is_busy:
        thread.start()
    try:
        yield
    finally:
        stop_event.set()
        if is_busy:
            thread.join()
