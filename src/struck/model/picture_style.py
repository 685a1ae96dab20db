"""Default style of matplotlib for the pictures of struck.

A file ``matplotlibrc`` in the current folder, or of a user, would otherwise choose fonts, sizes and
whether text is set by LaTeX.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from struck.errors import FileFormatError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Given = ParamSpec("_Given")
_Made = TypeVar("_Made")

_ACTIVE = ContextVar("struck_default_style", default=False)
_LOCK = threading.RLock()  # the parameters of matplotlib belong to the whole process


@contextmanager
def default_style() -> Iterator[None]:
    """Set matplotlib's default parameters, and restore the user's at the end.

    Raises
    ------
    FileFormatError
        On a settings file that matplotlib cannot decode, or a backend that it does not know, which
        keep it from being imported.
    """
    if _ACTIVE.get():
        yield
        return
    try:
        import matplotlib as mpl
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "matplotlib cannot decode its settings in a file matplotlibrc, in the current folder "
            "or among yours: rename it, or start in another folder"
        ) from error
    except ValueError as error:  # of a variable MPLBACKEND
        reason = str(error).partition(";")[0]
        raise FileFormatError(
            f"matplotlib refuses the settings of its environment ({reason}): correct or unset the "
            "variable MPLBACKEND"
        ) from error
    # A backend, once chosen, is not to be exchanged, and no picture here needs one.
    defaults: dict[Any, Any] = {
        name: value for name, value in mpl.rcParamsDefault.items() if name != "backend"
    }
    with _LOCK, mpl.rc_context(defaults):
        token = _ACTIVE.set(True)
        try:
            yield
        finally:
            _ACTIVE.reset(token)


def in_default_style(draw: Callable[_Given, _Made]) -> Callable[_Given, _Made]:
    """Make a function draw, or save, in matplotlib's default style.

    A figure that it returns keeps that style for its ticks, which matplotlib makes later.
    """

    @wraps(draw)
    def styled(*given: _Given.args, **named: _Given.kwargs) -> _Made:
        with default_style():
            from matplotlib.figure import Figure

            made = draw(*given, **named)
            if isinstance(made, Figure):
                _make_ticks(made)
            return made

    return styled


def _make_ticks(figure: Figure) -> None:
    """Make the first tick of each axis, of which matplotlib copies the others."""
    for axes in figure.axes:
        for name in ("xaxis", "yaxis", "zaxis"):
            axis = getattr(axes, name, None)
            if axis is not None:
                axis.get_major_ticks(1)
                axis.get_minor_ticks(1)
