"""What went wrong in the feeder's thread, told to whoever plays."""

from __future__ import annotations

from struck.errors import OptionError, StruckError


class Troubles:
    """Keeps the last exception until somebody asks."""

    def __init__(self) -> None:
        self._last: Exception | None = None

    def note(self, trouble: Exception) -> None:
        """Keep an exception in place of an older one."""
        self._last = trouble

    def tell(self) -> None:
        """Raise what went wrong since this was last asked, if anything did.

        Raises
        ------
        StruckError
            As it was; an OptionError caused by whatever else went wrong.
        """
        trouble, self._last = self._last, None
        if trouble is None:
            return
        if isinstance(trouble, StruckError):
            raise trouble
        raise OptionError(
            f"an excitation was stopped: it raised {trouble!r}; look at the functions of time that "
            "it was given, and start it again"
        ) from trouble
