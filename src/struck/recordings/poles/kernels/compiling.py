"""The compiler of the fit's loops."""

from __future__ import annotations

from struck.model.compiling import Compiler

_COMPILER = Compiler.of_packages(__file__)
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within
