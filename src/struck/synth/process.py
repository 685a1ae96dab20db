"""One block of a whole scene, compiled for its outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

from struck.synth import blocks
from struck.synth.compiling import from_source, jitted_within
from struck.synth.kernels import (
    OUTPUTS,
    PUSHES,
    Kernel,
    kernel,
    name_of,
    samples_of,
)
from struck.synth.store import Array, Body, Drive, HeldAs, Index, Memory, Mode, Output, Voice, view

Process = Callable[[Array, Index], None]
_MOST = PUSHES[-1]


@cache
def process(rows: int, *, turned: bool, voices: int = _MOST) -> Process:
    """Return the function that makes one block of all bodies' sounds in their memory.

    It takes the real and the whole numbers of `struck.synth.store`, as two arrays cost less to hand
    to compiled code than their many parts.

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
    run = _run(group, most, turned=turned)
    name = f"process_{rows}_{most}{'_turned' if turned else ''}"
    samples = samples_of(1, group, turned=turned, ramped=False)
    source = _PROCESS.format(
        name=name, run=run.__name__, rows=rows, group=group, most=most, samples=samples
    )
    steps = (
        begin,
        end,
        few,
        lone,
        rest,
        steady,
        tail,
        run,
        *(getattr(blocks, each) for each in _STEPS),
    )
    known = {each.__name__: each for each in steps} | {"view": view}
    return from_source(name, source, known)


_STEPS = ("link", "direct", "settle", "measure", "unpack", "clear", "pack", "leap")
_PROCESS = """
def {name}(reals, wholes):
 memory = view(reals, wholes)
 link(memory)
 memory.sounds[:] = 0.0
 for body in range(memory.bodies.shape[0]):
  still = steady(memory, body)
  if not still and rest(memory, body):
   continue
  ramped = not still and begin(memory, body)
  first = memory.bodies[body, 0]; last = memory.bodies[body, 1]
  voice = memory.bodies[body, 5]
  # A body that few voices push stays as pairs from block to block.
  paired = still or ({rows} == {group} and few(memory, body, {most}))
  unit = still or (paired and not ramped and lone(memory, body, {samples}))
  held_as = memory.bodies[body, 6]
  if unit and held_as < 2:
   measure(memory, body, voice)
  elif not paired or (held_as == 2 and not unit):
   settle(memory, body)
  again = False
  while True:
   count = 0; v0 = v1 = v2 = v3 = memory.voices.shape[0] - 1
   while voice >= 0 and count < {most}:
    v0, v1, v2, v3 = voice, v0, v1, v2
    voice = memory.voices[voice, 3]; count += 1
   for row in range(0, {rows}, {group}):
    if again:
     clear(memory, first, last)
    elif not memory.bodies[body, 6]:
     unpack(memory, first, last)
    done = {run}(memory, body, row, v0, v1, v2, v3, count, ramped, unit)
    tail(memory, body, row, {group}, (v0, v1, v2, v3), count, done)
   if paired:
    memory.bodies[body, 6] = 2 if unit else 1
   elif count == 0 and not again:
    leap(memory, first, last)
   else:
    pack(memory, first, last, 1.0 if again else 0.0)
   again = True
   if voice < 0:
    break
  if still:
   direct(memory, body, v0)
  else:
   end(memory, body, ramped)
"""


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
    yield f"def {name}(memory, body, row, v0, v1, v2, v3, count, ramped, unit):"
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


@jitted_within
def steady(memory: Memory, body: int) -> bool:
    """Tell whether all is as in the last block, and that had one steady push."""
    bodies, voices, voice = memory.bodies, memory.voices, memory.bodies[body, Body.VOICE]
    if bodies[body, Body.HELD_AS] != HeldAs.UNIT_PAIRS or bodies[body, Body.MOVED] or voice < 0:
        return False
    still = voices[voice, Voice.ACTIVE] == 1 and not voices[voice, Voice.MOVED]
    return still and voices[voice, Voice.NEXT] < 0


@jitted_within
def rest(memory: Memory, body: int) -> bool:
    """Let a sleeping body sleep on, or wake it."""
    bodies = memory.bodies
    if bodies[body, Body.VOICE] < 0 and not bodies[body, Body.MOVED] and bodies[body, Body.ASLEEP]:
        bodies[body, Body.SLEPT] += memory.forces.shape[1]
        return True
    blocks.wake(memory, body)
    return False


@jitted_within
def begin(memory: Memory, body: int) -> bool:
    """Prepare all gains of a body; tell whether any of them moves."""
    moves = memory.bodies[body, Body.MOVED] != 0
    blocks.begin_outputs(memory, body)
    voice = memory.bodies[body, Body.VOICE]
    while voice >= 0:
        if memory.voices[voice, Voice.ACTIVE] > 1 or memory.voices[voice, Voice.MOVED]:
            moves = True
            blocks.feed(memory, body, voice, 0)
            blocks.begin_drive(memory, voice)
        voice = memory.voices[voice, Voice.NEXT]
    return moves


@jitted_within
def few(memory: Memory, body: int, most: int) -> bool:
    """Tell whether there are pushes, and no more than a kernel takes at once."""
    count, voice = 0, memory.bodies[body, Body.VOICE]
    while voice >= 0:
        count, voice = count + 1, memory.voices[voice, Voice.NEXT]
    return 0 < count <= most


@jitted_within
def lone(memory: Memory, body: int, samples: int) -> bool:
    """Tell whether one voice alone pushes, and kernels of so many samples leave nothing over."""
    voice = memory.bodies[body, Body.VOICE]
    return memory.voices[voice, Voice.NEXT] < 0 and memory.forces.shape[1] % samples == 0


@jitted_within
def end(memory: Memory, body: int, moved: int) -> None:
    """Arrive at all gains of a body, and let it sleep when it has become silent."""
    blocks.end_outputs(memory, body)
    voice = memory.bodies[body, Body.VOICE]
    if voice < 0:
        memory.bodies[body, Body.ASLEEP] = blocks.may_sleep(memory, body)
    while voice >= 0:
        blocks.end_drive(memory, voice)
        if moved:
            blocks.feed(memory, body, voice, 1)
        blocks.direct(memory, body, voice)
        voice = memory.voices[voice, Voice.NEXT]


@jitted_within
def tail(
    memory: Memory,
    body: int,
    row: int,
    rows: int,
    voices: tuple[int, ...],
    count: int,
    start: int,
) -> None:
    """Make the samples that are left over when a block is no multiple of what kernels take."""
    modes, outputs, drives = memory.modes, memory.outputs, memory.drives
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    for k in range(start, memory.forces.shape[1]):
        for n in range(first, last):
            latest = modes[Mode.LATEST, n]
            newest = (
                modes[Mode.FEEDBACK, n] * latest + modes[Mode.LOSS, n] * modes[Mode.PREVIOUS, n]
            )
            for p in range(count):
                voice = voices[p]
                slope = drives[Drive.SLOPE, voice, n - first] * (k + 1)
                newest += (drives[Drive.GAIN, voice, n - first] + slope) * memory.forces[voice, k]
            modes[Mode.PREVIOUS, n], modes[Mode.LATEST, n] = latest, newest
            for o in range(row, row + rows):
                weight = outputs[Output.WEIGHT, o, n] + outputs[Output.WEIGHT_SLOPE, o, n] * (k + 1)
                turned = outputs[Output.TURNED, o, n] + outputs[Output.TURNED_SLOPE, o, n] * (k + 1)
                memory.sounds[body, o, k] += weight * latest + turned * newest
