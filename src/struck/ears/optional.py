"""Libraries that ears use where they are installed."""

from __future__ import annotations

import sys
from types import ModuleType

from struck.errors import MissingDependencyError


def pyroomacoustics() -> ModuleType:
    """Return pyroomacoustics.

    Its import would import sounddevice, which opens PortAudio for as long as Python runs: from then
    on no device that comes or goes would be seen, by `struck.play` neither.

    Raises
    ------
    MissingDependencyError
        Where it is not installed.
    """
    known = sys.modules.get("sounddevice")
    hidden = "pyroomacoustics" not in sys.modules and known is None
    if hidden:
        sys.modules["sounddevice"] = None  # type: ignore[assignment] # as the import system has it
    try:
        import pyroomacoustics as found  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise MissingDependencyError(
            'full responses of a room are made by pyroomacoustics: pip install "struck[room]"'
        ) from error
    finally:
        if hidden:
            del sys.modules["sounddevice"]
    return found
