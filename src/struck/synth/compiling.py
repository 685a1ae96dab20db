"""How loops are compiled, and when machine code that numba kept may be used again.

numba keeps the code of a function as long as the file it stands in stays the same, whatever
becomes of the functions and constants that it uses from elsewhere. So the names under which code
is kept carry a fingerprint of this whole package.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


_FINGERPRINT = _fingerprint()


def jitted(function: Function) -> Function:
    """Compile a function when it is first called; it needs no Python then and holds no lock.

    Sums may be taken in any order, but NaN stays NaN.
    """
    function.__qualname__ = f"{function.__qualname__}_{_FINGERPRINT}"
    compile_it: Any = numba.njit(
        fastmath={"reassoc", "contract", "arcp", "nsz"},
        nogil=True,
        error_model="numpy",
        cache=True,
    )
    return compile_it(function)


def from_source(name: str, source: str, known: dict[str, Any]) -> Callable[..., Any]:
    """Compile the function of this name that a source makes of what is `known`.

    It is said to come from this file, as numba keeps only code of functions that stand in one.
    """
    names = dict(known, __name__=__name__)
    exec(compile(source, __file__, "exec"), names)  # noqa: S102 - the templates are ours
    return jitted(names[name])
