"""Which kernel makes the samples: chosen block by block among those for a scene's outputs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from numba import types

from struck.synth.addresses import address_of, call_for_integer, result_of
from struck.synth.compiling import from_source, jitted_within
from struck.synth.memory import NUMBERS, Drive, Memory, Mode, Output, Run, view
from struck.synth.sample_loop import OUTPUTS, PUSHES, Kernel, kernel, name_of, samples_of

_MOST = PUSHES[-1]


def runner(rows: int, *, turned: bool, voices: int = _MOST) -> tuple[int, int, int, int]:
    """Return what `Memory.run` is to hold.

    Parameters
    ----------
    rows : int
        Outputs of each body, as `rows_for` tells.
    turned : bool
        Whether outputs are complex.
    voices : int
        How many there are; for fewer there are fewer kernels to compile.
    """
    group, most = min(rows, OUTPUTS[-1]), next((n for n in PUSHES if n >= voices), _MOST)
    samples = samples_of(1, group, turned=turned, ramped=False)
    memory, whole = result_of(view, NUMBERS), types.int64
    arguments = (memory, whole, whole, types.UniTuple(whole, 4), whole, types.b1, types.b1)
    return address_of(_run(group, most, turned=turned), arguments), group, most, samples


@jitted_within
def run(
    memory: Memory,
    body: int,
    row: int,
    voices: tuple[int, int, int, int],
    count: int,
    ramped: bool,  # noqa: FBT001 - compiled: positional
    unit: bool,  # noqa: FBT001 - compiled: positional
) -> int:
    """Let so many voices push a body's outputs from a row on; return how many samples are made.

    Parameters
    ----------
    memory : Memory
        With what `runner` returns.
    body, row : int
        Which outputs.
    voices, count : tuple of int and int
        Who pushes, the first of them.
    ramped, unit : bool
        Whether gains move, and whether the state is in units of the push's gain.
    """
    arguments = (memory, body, row, voices, count, ramped, unit)
    return call_for_integer(memory.run[Run.ADDRESS], arguments)


@cache  # what is called by its address is kept for as long as Python runs
def _run(rows: int, most: int, *, turned: bool) -> Kernel:
    """Return the function that lets the right kernel make whole frames, and tells where it ends."""
    name = f"run_{rows}_{most}{'_turned' if turned else ''}"
    known = {
        name_of(pushes, rows, turned=turned, ramped=ramped): kernel(
            pushes, rows, turned=turned, ramped=ramped
        )
        for pushes in _up_to(most)
        for ramped in (False, True)
    }
    alone = {"turned": turned, "ramped": False, "unit": True}
    known[name_of(1, rows, **alone)] = kernel(1, rows, **alone)
    return from_source(name, "\n".join(_run_source(name, rows, most, turned=turned)), known)


def _run_source(name: str, rows: int, most: int, *, turned: bool) -> Iterator[str]:
    yield f"def {name}(memory, body, row, voices, count, ramped, unit):"
    yield " v0, v1, v2, v3 = voices"
    yield " modes = memory.modes; out = memory.outputs; drives = memory.drives"
    yield " sounds = memory.sounds; forces = memory.forces; block = forces.shape[1]"
    yield " first = memory.bodies[body, 0]; last = memory.bodies[body, 1]; count_of = last - first"
    forms = [(1, False, True)]
    forms += [(pushes, ramped, False) for pushes in _up_to(most) for ramped in (True, False)]
    for pushes, ramped, unit in forms:
        options = {"turned": turned, "ramped": ramped, "unit": unit}
        samples = samples_of(pushes, rows, turned=turned, ramped=ramped)
        rows_of = ", ".join(_arguments(pushes, rows, **options))
        yield f" if count <= {pushes} and ramped == {ramped} and unit == {unit}:"
        yield f"  {name_of(pushes, rows, **options)}(block // {samples}, {rows_of})"
        yield f"  return block // {samples} * {samples}"
    yield " return 0"


def _up_to(most: int) -> Iterator[int]:
    return (pushes for pushes in PUSHES if pushes <= most)


def _arguments(pushes: int, rows: int, *, turned: bool, ramped: bool, unit: bool) -> Iterator[str]:
    """Yield what a kernel takes, in its order."""
    for each in (Mode.FEEDBACK, Mode.LOSS, Mode.LATEST, Mode.PREVIOUS):
        yield f"modes[{each.value}, first:last]"
    layers = [(Drive.GAIN, Output.WEIGHT, Output.TURNED)]
    if ramped:
        layers.append((Drive.SLOPE, Output.WEIGHT_SLOPE, Output.TURNED_SLOPE))
    if unit:
        layers = [(Drive.GAIN, Output.UNIT_WEIGHT, Output.UNIT_TURNED)]
    for drive, weight, turn in layers:
        driven = () if unit else range(pushes)
        yield from (f"drives[{drive.value}, v{p}, :count_of]" for p in driven)
        for layer in (weight, turn) if turned else (weight,):
            yield from (f"out[{layer.value}, row + {o}, first:last]" for o in range(rows))
    yield from (f"forces[v{p}]" for p in range(pushes))
    yield from (f"sounds[body, row + {o}]" for o in range(rows))
