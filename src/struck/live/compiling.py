"""The compiler of what plays live: of its own package and of those that its code is made of."""

from __future__ import annotations

from struck.ears import delay_kernels
from struck.model.compiling import Compiler
from struck.synth import process

_COMPILER = Compiler.of_packages(__file__, delay_kernels.__file__, process.__file__)
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within
callback = _COMPILER.callback
