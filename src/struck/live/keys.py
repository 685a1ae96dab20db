"""Keys of a terminal as they are typed, and what they strike."""

from __future__ import annotations

import contextlib
import os
import string
import sys
import time
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from struck.model.contact import Place
from struck.model.model import ModalModel

QUIT, DEFAULT = "q", " "
_NUMBERS = "1234567890"
_LETTERS = "".join(letter for letter in string.ascii_lowercase if letter != QUIT)


class Keys(Protocol):
    """Where keys come from."""

    def pressed(self, seconds: float) -> str:
        """Return the next key; "" where there is none for so long."""
        ...


class NoKeys:
    """No terminal: nobody types."""

    def pressed(self, seconds: float) -> str:
        """Wait."""
        time.sleep(seconds)
        return ""


def places_by_key(model: ModalModel) -> dict[str, Place]:
    """Return what each key strikes: digits the named places, letters vertices all over."""
    places: dict[str, Place] = {DEFAULT: None}
    places |= dict(zip(_NUMBERS, model.places, strict=False))
    if model.geometry is not None:
        count = len(model.geometry.points)
        chosen = np.unique(np.linspace(0, count - 1, len(_LETTERS)).astype(int))
        names = (f"vertex:{number}" for number in chosen.tolist())
        places |= dict(zip(_LETTERS, names, strict=False))
    return places


@contextlib.contextmanager
def terminal_keys() -> Iterator[Keys]:
    """Yield the keys of the terminal, as they are typed; none where there is no terminal."""
    if sys.stdin is None or not sys.stdin.isatty():
        yield NoKeys()
    elif sys.platform == "win32":
        yield _Console()
    else:
        with _unbuffered() as keys:
            yield keys


if sys.platform == "win32":

    class _Console:
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
        before = termios.tcgetattr(number)
        tty.setcbreak(number, termios.TCSADRAIN)  # keeps what was typed before
        try:
            yield _Terminal()
        finally:
            termios.tcsetattr(number, termios.TCSADRAIN, before)
