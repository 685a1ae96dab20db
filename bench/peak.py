"""What the core can do at most: fused multiply-adds of doubles, and cycles.

Chains of multiply-adds that do not wait for each other stay in registers: written as vectors for
the compiler, so that nothing but the machine bounds them. A cycle is half of a shift and an
exclusive or that wait for each other.
"""

from __future__ import annotations

import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

from llvmlite import binding, ir
from numba import njit, uint64
from numba.core import cgutils, types
from numba.extending import intrinsic as _intrinsic

_TURNS, _UNROLLED = 20_000, 4
_DOUBLE = ir.DoubleType()
# Called, an intrinsic takes no context and gives a number: not what its definition says.
intrinsic: Any = _intrinsic


def _registers() -> tuple[int, int]:
    """Return doubles in a vector, and chains that its registers hold beside two constants."""
    features = binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 24
    return (4, 12) if platform.machine().lower() in {"x86_64", "amd64"} else (2, 24)


WIDTH, CHAINS = _registers()
MULTIPLY_ADDS = _TURNS * _UNROLLED * CHAINS * WIDTH
"""In a call of `multiply_adds`."""
CYCLES = 3 * 8 * _TURNS
"""In a call of `wait`."""


@intrinsic
def _chains(_context: Any, turns: Any) -> tuple[Any, Callable[..., Any]]:  # noqa: ANN401 - numba has no types
    """_chains(turns): the sum of all chains after so many turns."""
    kind = ir.VectorType(_DOUBLE, WIDTH)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        fused = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(kind, [kind] * 3), f"llvm.fmuladd.v{WIDTH}f64"
        )
        factor, addend = (ir.Constant(kind, [value] * WIDTH) for value in (0.999, 0.01))
        starts = [ir.Constant(kind, [float(chain)] * WIDTH) for chain in range(CHAINS)]
        sums = [cgutils.alloca_once_value(builder, start) for start in starts]
        with cgutils.for_range(builder, arguments[0]):
            for place in sums * _UNROLLED:
                builder.store(builder.call(fused, [builder.load(place), factor, addend]), place)
        total = builder.load(sums[0])
        for place in sums[1:]:
            total = builder.fadd(total, builder.load(place))
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return types.float64(turns), generate


@njit(nogil=True)
def multiply_adds() -> float:
    """Do `MULTIPLY_ADDS` of them."""
    return _chains(_TURNS)


@njit(nogil=True)
def _waited(turns: int) -> object:
    value = uint64(3)
    for _ in range(turns):
        for _ in range(8):
            value *= value
    return value


def wait() -> None:
    """Let `CYCLES` pass."""
    _waited(_TURNS)


def machine() -> str:
    """Return what the processor calls itself, and what the compiler takes it for."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    return f"{name} ({binding.get_host_cpu_name()}), vectors of {WIDTH} doubles"
