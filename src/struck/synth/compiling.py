"""The compiler of the loops over samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from struck.model.compiling import Compiler

_COMPILER = Compiler.of_packages(__file__, keeps_parts=True)  # for each number of outputs
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within


def from_source(name: str, source: str, known: dict[str, Any]) -> Callable[..., Any]:
    """Compile the function of this name that a source makes of what is `known`.

    It is said to come from this file, as numba keeps only code of functions that stand in one.
    """
    names = dict(known, __name__=__name__)
    exec(compile(source, __file__, "exec"), names)  # noqa: S102 - the templates are ours
    return jitted(names[name])
