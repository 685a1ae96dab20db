"""The compiler of what plays live: of its own package and of those that its code is made of."""

from __future__ import annotations

from struck.compiling import Compiler
from struck.ears import kernels
from struck.synth import process

_COMPILER = Compiler.of_packages(__file__, kernels.__file__, process.__file__)
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within
callback = _COMPILER.callback
