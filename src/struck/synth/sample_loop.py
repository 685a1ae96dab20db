"""The only loops over samples: a bank of two-pole resonators, written once and specialised.

A mode is c[k] = z c[k-1] + drive F[k] / rate, heard as Im[a c[k]]. With v[k] = Im[z c[k]] that is

    v[k] = 2 Re z v[k-1] - |z|^2 v[k-2] + gain F[k],   gain = drive Im z / rate,
    Im[a c[k]] = weight v[k-1] + turned v[k],          turned = Im a / Im z,
                                                       weight = Re a - turned Re z,

so a real output takes four operations a sample and a complex one five. Under one steady push the
pair is kept in units of the gain, v / gain: that push then needs no product of its own, and a real
output takes three. Each kernel takes several samples at a time and loops over the modes inside,
with one sum for each sample and output in registers: the loop over modes is what the compiler turns
into vectors, and a state crosses memory once for all these samples. Gains may change linearly from
sample to sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from struck.synth.compiler import Compiler

_COMPILER = Compiler.of_packages(__file__, keeps_parts=True)  # for each number of outputs
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within


def from_source(name: str, source: str, known: dict[str, Any]) -> Callable[..., Any]:
    """Compile the function of this name that a source defines, given the names it uses."""
    # It is said to come from this file, as numba keeps only code of functions in a file.
    names = dict(known, __name__=__name__)
    exec(compile(source, __file__, "exec"), names)  # noqa: S102 - the templates are ours
    return jitted(names[name])


Kernel = Callable[..., Any]
PUSHES = (0, 1, 2, 4)  # pushes that a kernel may take
OUTPUTS = (1, 2, 4, 8)  # outputs that a kernel may have
_REGISTERS = 32


def name_of(pushes: int, outputs: int, *, turned: bool, ramped: bool, unit: bool = False) -> str:
    """Return the name of a specialised kernel."""
    options = {"turned": turned, "ramped": ramped, "unit": unit}
    return "_".join([f"kernel_{pushes}_{outputs}", *(name for name, on in options.items() if on)])


def samples_of(pushes: int, outputs: int, *, turned: bool, ramped: bool) -> int:
    """Return how many samples a kernel takes at a time: as many sums as registers hold."""
    gains = pushes + outputs * (2 if turned else 1)
    kept = 2 * gains if ramped else 0
    for samples in (8, 4):
        sums = samples * outputs
        if sums <= _REGISTERS // 2 and sums + kept + samples * pushes // 2 <= _REGISTERS:
            return samples
    return 2


@cache
def kernel(pushes: int, outputs: int, *, turned: bool, ramped: bool, unit: bool = False) -> Kernel:
    """Return the compiled loop f(frames, feedback, loss, latest, previous, ...).

    Then come (gain, [its slope,] force) for each push, unless states are in units of the gain, and
    (weight, [slope, turned, slope,] samples) for each output, complex where `turned`, moving where
    `ramped`. It adds to samples and moves states on by frames times `samples_of`.
    """
    name = name_of(pushes, outputs, turned=turned, ramped=ramped, unit=unit)
    source = "\n".join(_source(name, pushes, outputs, turned=turned, ramped=ramped, unit=unit))
    return from_source(name, source, {})


def _source(
    name: str, pushes: int, outputs: int, *, turned: bool, ramped: bool, unit: bool
) -> Iterator[str]:
    samples = samples_of(pushes, outputs, turned=turned, ramped=ramped)
    gains = [] if unit else [f"gain{p}" for p in range(pushes)]
    weights = [f"weight{o}" for o in range(outputs)]
    if turned:
        weights += [f"turned{o}" for o in range(outputs)]
    changing = [*gains, *weights]
    slopes = [f"slope_{each}" for each in changing] if ramped else []
    forces = [f"force{p}" for p in range(pushes)]
    sounds = [f"sound{o}" for o in range(outputs)]
    rows = ", ".join(["", *changing, *slopes, *forces, *sounds])
    yield f"def {name}(frames, feedback, loss, latest, previous{rows}):"
    yield f" for first in range(0, frames * {samples}, {samples}):"
    for k in range(samples):
        yield from (f"  sum{o}_{k} = 0.0" for o in range(outputs))
        yield from (f"  f{p}_{k} = force{p}[first + {k}]" for p in range(pushes))
    yield "  for n in range(feedback.shape[0]):"
    yield "   a = latest[n]; b = previous[n]; p1 = feedback[n]; p2 = loss[n]"
    start = " + slope_{0}[n] * (first + 1)" if ramped else ""
    yield from (f"   x_{each} = {each}[n]" + start.format(each) for each in changing)
    if ramped:
        yield from (f"   s_{each} = slope_{each}[n]" for each in changing)
    for k in range(samples):
        new, old = ("b", "a") if k % 2 == 0 else ("a", "b")
        if ramped and k:
            yield from (f"   x_{each} += s_{each}" for each in changing)
        yield from (f"   sum{o}_{k} += x_weight{o} * {old}" for o in range(outputs))
        pushed = "".join(f" + {'' if unit else f'x_gain{p} * '}f{p}_{k}" for p in range(pushes))
        yield f"   {new} = p1 * {old} + (p2 * {new}{pushed})"
        if turned:
            yield from (f"   sum{o}_{k} += x_turned{o} * {new}" for o in range(outputs))
    yield "   latest[n] = a; previous[n] = b"
    for k in range(samples):
        yield from (f"  sound{o}[first + {k}] += sum{o}_{k}" for o in range(outputs))
