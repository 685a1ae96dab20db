"""What touches a body while it is played, and what is noted of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.tool import Tool, Update
from struck.excitation.touch_log import TouchLog

Array = NDArray[np.float64]

MOST_NOTED = 60_000
"""Updates of each touch that are kept: ten minutes at 100 Hz."""
_COLUMNS = 9


class Notes:
    """The last updates of a touch.

    Parameters
    ----------
    tool : Tool
        What touches.
    """

    def __init__(self, tool: Tool) -> None:
        self._tool = tool
        self._rows: Array = np.full((MOST_NOTED, _COLUMNS), 0.0)
        self._count = 0

    def add(self, time: float, word: Update) -> None:
        """Note an update that takes effect at a time, s; in place of the oldest where need be."""
        row = self._rows[self._count % MOST_NOTED]
        row[0] = time
        row[1:4], row[4:7] = word.contact.point, word.contact.direction
        row[7:] = word.force, word.speed
        self._count += 1

    def log(self) -> TouchLog:
        """Return them as an excitation; OptionError where there was no touch."""
        if not self._count:
            raise OptionError("nothing was touched yet: there is no log")
        rows = np.roll(self._rows, -(self._count % MOST_NOTED), axis=0)
        rows = rows if self._count > MOST_NOTED else self._rows[: self._count]
        return TouchLog(
            times=rows[:, 0],
            points=rows[:, 1:4],
            directions=rows[:, 4:7],
            forces=rows[:, 7],
            speeds=rows[:, 8],
            tool=self._tool,
        )
