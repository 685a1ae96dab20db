"""Compilation of loops by numba, and when its cached machine code may be used again.

numba keeps the code of a function as long as the file it stands in stays the same, whatever
becomes of the functions and constants that it uses from elsewhere. So the names under which code
is kept carry a fingerprint of all packages that it is made of.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_SUMS = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be taken in any order, but NaN stays NaN."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """Compiles the functions of a package."""

    fingerprint: str  # of all its files, and of those of the packages compiled with them
    # also keep functions that only compiled code calls: slower the first time
    keeps_parts: bool = False

    @classmethod
    def of_packages(cls, *files: str, keeps_parts: bool = False) -> Compiler:
        """Take the fingerprint of the packages that these files stand in."""
        digest = hashlib.sha256()
        for file in files:
            for path in sorted(Path(file).parent.glob("*.py")):
                digest.update(path.read_bytes())
        return cls(digest.hexdigest()[:12], keeps_parts)

    def jitted(self, function: Function) -> Function:
        """Compile a function when it is first called; it then runs without Python and its lock."""
        return self._compiled(function, cache=True)

    def jitted_within(self, function: Function) -> Function:
        """Compile a function that only compiled code calls, without an entry from Python."""
        without = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return self._compiled(function, cache=self.keeps_parts, **without)

    def callback(self, signature: Any) -> Callable[[Callable[..., Any]], Any]:  # noqa: ANN401 - numba has no types
        """Compile a function now, to be called by its `address`."""

        def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - numba has no types
            return numba.cfunc(signature, error_model="numpy", cache=True)(self._named(function))

        return compiled

    def _compiled(self, function: Function, **options: bool) -> Function:
        njit: Any = numba.njit
        settings = {"fastmath": _SUMS, "nogil": True, "error_model": "numpy"}
        return njit(**settings, **options)(self._named(function))

    def _named(self, function: Function) -> Function:
        function.__qualname__ = f"{function.__qualname__}_{self.fingerprint}"
        return function
