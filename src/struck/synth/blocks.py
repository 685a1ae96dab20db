"""One block of all bodies, from their memory alone: what an audio callback runs.

Between blocks a mode's state is its complex c, exact whatever comes: a body that sleeps or rings
freely is moved on by powers of z, and one whose frequencies or decays change goes on from the same
c. Within a block the kernels take it as the pair (Im[z c], Im c), and leave it so while a body is
pushed.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numba import types

from struck.model.arrays import Array, Index
from struck.synth.memory import (
    LEVELS,
    NUMBERS,
    BodyColumn,
    Drive,
    HeldAs,
    Level,
    Memory,
    Mode,
    Output,
    Run,
    Voice,
    address_of,
    call_for_integer,
    result_of,
    view,
)
from struck.synth.sample_loop import (
    OUTPUTS,
    PUSHES,
    Kernel,
    from_source,
    jitted,
    jitted_within,
    kernel,
    name_of,
    samples_of,
)

_MOST = PUSHES[-1]
FAINTEST = 1e-100  # stands in for a zero drive gain, so that states may be divided by it


@jitted
def make_block(reals: Array, wholes: Index) -> None:
    """Make one block of all bodies, in place in their real and whole numbers."""
    memory = view(reals, wholes)
    link(memory)
    memory.sounds[:] = 0.0
    for body in range(memory.bodies.shape[0]):
        if steady(memory, body):
            go_on(memory, body)
        elif not rest(memory, body):
            ramped = begin(memory, body)
            push(memory, body, ramped)
            end(memory, body, ramped)


@jitted_within
def go_on(memory: Memory, body: int) -> None:
    """Let the one voice of a body push it as in the last block."""
    voice = memory.bodies[body, BodyColumn.VOICE]
    ramped, unit = False, True
    run(memory, body, 0, (voice, voice, voice, voice), 1, ramped, unit)
    direct(memory, body, voice)


@jitted_within
def push(memory: Memory, body: int, ramped: bool) -> None:  # noqa: FBT001 - compiled: positional
    """Let all voices push a body, as many at a time as kernels take."""
    paired = memory.outputs.shape[1] == memory.run[Run.OUTPUTS] and few(memory, body)
    unit = paired and not ramped and lone(memory, body)
    prepare(memory, body, paired, unit)
    voice = memory.bodies[body, BodyColumn.VOICE]
    again = False
    while not again or voice >= 0:
        count, silent = 0, memory.voices.shape[0] - 1
        voices = (silent, silent, silent, silent)
        while voice >= 0 and count < memory.run[Run.PUSHES]:
            voices = (voice, voices[0], voices[1], voices[2])
            voice = memory.voices[voice, Voice.NEXT]
            count += 1
        push_together(memory, body, voices, count, ramped, unit, again)
        if not paired:
            put_back(memory, body, count, again)
        again = True
    if paired:
        memory.bodies[body, BodyColumn.HELD_AS] = HeldAs.UNIT_PAIRS if unit else HeldAs.PAIRS


@jitted_within
def prepare(memory: Memory, body: int, paired: bool, unit: bool) -> None:  # noqa: FBT001 - compiled: positional
    """Convert a body's state to the form that the next kernel takes."""
    held_as = memory.bodies[body, BodyColumn.HELD_AS]
    if unit and held_as != HeldAs.UNIT_PAIRS:
        measure(memory, body, memory.bodies[body, BodyColumn.VOICE])
    elif not paired or (held_as == HeldAs.UNIT_PAIRS and not unit):
        settle(memory, body)


@jitted_within
def push_together(
    memory: Memory,
    body: int,
    voices: tuple[int, int, int, int],
    count: int,
    ramped: bool,  # noqa: FBT001 - compiled: positional
    unit: bool,  # noqa: FBT001 - compiled: positional
    again: bool,  # noqa: FBT001 - compiled: positional
) -> None:
    """Let some voices push a body; later groups (`again`) start from a state of zero."""
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    together = memory.run[Run.OUTPUTS]
    for row in range(0, memory.outputs.shape[1], together):
        if again:
            clear(memory, first, last)
        elif memory.bodies[body, BodyColumn.HELD_AS] == HeldAs.STATE:
            unpack(memory, first, last)
        made = run(memory, body, row, voices, count, ramped, unit)
        tail(memory, body, row, together, voices, count, made)


@jitted_within
def put_back(memory: Memory, body: int, count: int, again: bool) -> None:  # noqa: FBT001 - compiled: positional
    """Convert pairs to states, added to the states of earlier groups."""
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    if count == 0 and not again:
        leap(memory, first, last)
    else:
        pack(memory, first, last, 1.0 if again else 0.0)


@jitted_within
def steady(memory: Memory, body: int) -> bool:
    """Tell whether all is as in the last block, and that had one steady push."""
    bodies, voices, voice = memory.bodies, memory.voices, memory.bodies[body, BodyColumn.VOICE]
    if (
        bodies[body, BodyColumn.HELD_AS] != HeldAs.UNIT_PAIRS
        or bodies[body, BodyColumn.MOVED]
        or voice < 0
    ):
        return False
    still = voices[voice, Voice.ACTIVE] == 1 and not voices[voice, Voice.MOVED]
    return still and voices[voice, Voice.NEXT] < 0


@jitted_within
def rest(memory: Memory, body: int) -> bool:
    """Let a sleeping body sleep on, or wake it."""
    bodies = memory.bodies
    if (
        bodies[body, BodyColumn.VOICE] < 0
        and not bodies[body, BodyColumn.MOVED]
        and bodies[body, BodyColumn.ASLEEP]
    ):
        bodies[body, BodyColumn.SLEPT] += memory.forces.shape[1]
        return True
    wake(memory, body)
    return False


@jitted_within
def begin(memory: Memory, body: int) -> bool:
    """Prepare all gains of a body; tell whether any of them moves."""
    moves = memory.bodies[body, BodyColumn.MOVED] != 0
    begin_outputs(memory, body)
    voice = memory.bodies[body, BodyColumn.VOICE]
    while voice >= 0:
        if memory.voices[voice, Voice.ACTIVE] > 1 or memory.voices[voice, Voice.MOVED]:
            moves = True
            feed(memory, body, voice, 0)
            begin_drive(memory, voice)
        voice = memory.voices[voice, Voice.NEXT]
    return moves


@jitted_within
def few(memory: Memory, body: int) -> bool:
    """Tell whether there are pushes, and no more than a kernel takes at once."""
    count, voice = 0, memory.bodies[body, BodyColumn.VOICE]
    while voice >= 0:
        count, voice = count + 1, memory.voices[voice, Voice.NEXT]
    return 0 < count <= memory.run[Run.PUSHES]


@jitted_within
def lone(memory: Memory, body: int) -> bool:
    """Tell whether one voice alone pushes, and its kernel leaves nothing over."""
    voice = memory.bodies[body, BodyColumn.VOICE]
    return (
        memory.voices[voice, Voice.NEXT] < 0
        and memory.forces.shape[1] % memory.run[Run.SAMPLES] == 0
    )


@jitted_within
def end(memory: Memory, body: int, moved: int) -> None:
    """Arrive at all gains of a body, and let it sleep when it has become silent."""
    end_outputs(memory, body)
    voice = memory.bodies[body, BodyColumn.VOICE]
    if voice < 0:
        memory.bodies[body, BodyColumn.ASLEEP] = may_sleep(memory, body)
    while voice >= 0:
        end_drive(memory, voice)
        if moved:
            feed(memory, body, voice, 1)
        direct(memory, body, voice)
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
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
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


@jitted
def refresh(memory: Memory, body: int) -> None:
    """Compute all that follows from the poles of a body."""
    modes, rate, block = memory.modes, memory.levels[Level.RATE], memory.forces.shape[1]
    for n in range(memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]):
        log = complex(modes[Mode.LOG_RE, n], modes[Mode.LOG_IM, n])
        turn, leap = np.exp(log), np.exp(log * block)
        modes[Mode.TURN_RE, n], modes[Mode.TURN_IM, n] = turn.real, turn.imag
        modes[Mode.LEAP_RE, n], modes[Mode.LEAP_IM, n] = leap.real, leap.imag
        modes[Mode.FEEDBACK, n] = 2 * turn.real
        modes[Mode.LOSS, n] = -np.exp(2 * log.real)
        modes[Mode.INPUT, n] = turn.imag / rate
        # Places that only fill up have no pole: nothing comes in there, nothing goes out.
        modes[Mode.INVERSE, n] = 1 / turn.imag if turn.imag > 0 else 0.0
        hold = 1 / (1 - turn) / rate if turn.imag > 0 else 0j
        modes[Mode.HOLD_RE, n], modes[Mode.HOLD_IM, n] = hold.real, hold.imag
        if turn.imag <= 0:
            memory.outputs[Output.STILL, :, n] = 0.0


@jitted_within
def advance(memory: Memory, first: int, last: int, samples: float) -> None:
    """Advance the free ringing of modes by a number of samples."""
    modes = memory.modes
    for n in range(first, last):
        turn = np.exp(complex(modes[Mode.LOG_RE, n], modes[Mode.LOG_IM, n]) * samples)
        state = complex(modes[Mode.STATE_RE, n], modes[Mode.STATE_IM, n]) * turn
        modes[Mode.STATE_RE, n], modes[Mode.STATE_IM, n] = state.real, state.imag


@jitted_within
def leap(memory: Memory, first: int, last: int) -> None:
    """Let modes ring for a block."""
    modes = memory.modes
    for n in range(first, last):
        real, imag = modes[Mode.STATE_RE, n], modes[Mode.STATE_IM, n]
        turn_re, turn_im = modes[Mode.LEAP_RE, n], modes[Mode.LEAP_IM, n]
        modes[Mode.STATE_RE, n] = real * turn_re - imag * turn_im
        modes[Mode.STATE_IM, n] = real * turn_im + imag * turn_re


@jitted_within
def unpack(memory: Memory, first: int, last: int) -> None:
    """Turn states into the pairs that kernels take."""
    modes = memory.modes
    for n in range(first, last):
        real, imag = modes[Mode.STATE_RE, n], modes[Mode.STATE_IM, n]
        modes[Mode.LATEST, n] = modes[Mode.TURN_RE, n] * imag + modes[Mode.TURN_IM, n] * real
        modes[Mode.PREVIOUS, n] = imag


@jitted_within
def clear(memory: Memory, first: int, last: int) -> None:
    """Start pairs from rest."""
    memory.modes[Mode.LATEST, first:last] = 0.0
    memory.modes[Mode.PREVIOUS, first:last] = 0.0


@jitted_within
def pack(memory: Memory, first: int, last: int, kept: float) -> None:
    """Turn pairs into states, on top of `kept` (0 or 1) times those there are."""
    modes = memory.modes
    for n in range(first, last):
        previous = modes[Mode.PREVIOUS, n]
        ahead = modes[Mode.LATEST, n] - modes[Mode.TURN_RE, n] * previous
        modes[Mode.STATE_RE, n] = kept * modes[Mode.STATE_RE, n] + ahead * modes[Mode.INVERSE, n]
        modes[Mode.STATE_IM, n] = kept * modes[Mode.STATE_IM, n] + previous


@jitted
def settle(memory: Memory, body: int) -> None:
    """Convert a body's state to its complex c."""
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    if memory.bodies[body, BodyColumn.HELD_AS] == HeldAs.UNIT_PAIRS:
        for n in range(first, last):  # sooner compiled than whole arrays
            memory.modes[Mode.LATEST, n] *= memory.modes[Mode.UNIT, n]
            memory.modes[Mode.PREVIOUS, n] *= memory.modes[Mode.UNIT, n]
    if memory.bodies[body, BodyColumn.HELD_AS] != HeldAs.STATE:
        pack(memory, first, last, 0.0)
        memory.bodies[body, BodyColumn.HELD_AS] = HeldAs.STATE


@jitted_within
def measure(memory: Memory, body: int, voice: int) -> None:
    """Convert states to pairs in units of a voice's gains, and outputs to fit."""
    modes, outputs = memory.modes, memory.outputs
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    if memory.bodies[body, BodyColumn.HELD_AS] == HeldAs.STATE:
        unpack(memory, first, last)
    for n in range(first, last):
        gain = memory.drives[Drive.GAIN, voice, n - first]
        modes[Mode.UNIT, n] = gain if abs(gain) > FAINTEST else FAINTEST
        modes[Mode.LATEST, n] /= modes[Mode.UNIT, n]
        modes[Mode.PREVIOUS, n] /= modes[Mode.UNIT, n]
    for row in range(outputs.shape[1]):
        for n in range(first, last):
            unit = modes[Mode.UNIT, n]
            outputs[Output.UNIT_WEIGHT, row, n] = outputs[Output.WEIGHT, row, n] * unit
            outputs[Output.UNIT_TURNED, row, n] = outputs[Output.TURNED, row, n] * unit
    memory.bodies[body, BodyColumn.HELD_AS] = HeldAs.UNIT_PAIRS


@jitted
def wake(memory: Memory, body: int) -> None:
    """Advance a sleeping body to the present."""
    bodies = memory.bodies
    if bodies[body, BodyColumn.ASLEEP]:
        advance(
            memory,
            bodies[body, BodyColumn.FIRST],
            bodies[body, BodyColumn.LAST],
            bodies[body, BodyColumn.SLEPT],
        )
        bodies[body, BodyColumn.ASLEEP] = bodies[body, BodyColumn.SLEPT] = 0


@jitted_within
def may_sleep(memory: Memory, body: int) -> bool:
    """Tell whether a body's loudest possible sound is below its share of the loudest so far."""
    modes, total = memory.modes, 0.0
    for n in range(memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]):
        size = abs(modes[Mode.STATE_RE, n]) + abs(modes[Mode.STATE_IM, n])
        total += modes[Mode.LOUDNESS, n] * size
    loudest = LEVELS + body
    memory.levels[loudest] = max(memory.levels[loudest], total)
    return total <= memory.levels[Level.QUIET] * memory.levels[loudest]


@jitted_within
def begin_outputs(memory: Memory, body: int) -> None:
    """Prepare output gains that move in this block; else the last ones hold."""
    if not memory.bodies[body, BodyColumn.MOVED]:
        return
    modes, outputs, block = memory.modes, memory.outputs, memory.forces.shape[1]
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    modes[Mode.LOUDNESS, first:last] = 0.0
    for row in range(outputs.shape[1]):
        for n in range(first, last):
            inverse, turn = modes[Mode.INVERSE, n], modes[Mode.TURN_RE, n]
            now, target = outputs[Output.RE, row, n], outputs[Output.TARGET_RE, row, n]
            turned = outputs[Output.IM, row, n] * inverse
            change = (outputs[Output.TARGET_IM, row, n] * inverse - turned) / block
            outputs[Output.TURNED, row, n] = turned
            outputs[Output.TURNED_SLOPE, row, n] = change
            outputs[Output.WEIGHT, row, n] = now - turned * turn
            outputs[Output.WEIGHT_SLOPE, row, n] = (target - now) / block - change * turn
            size = abs(target) + abs(outputs[Output.TARGET_IM, row, n])
            modes[Mode.LOUDNESS, n] = max(modes[Mode.LOUDNESS, n], size)


@jitted_within
def end_outputs(memory: Memory, body: int) -> None:
    """Arrive at the gains that outputs moved to."""
    if not memory.bodies[body, BodyColumn.MOVED]:
        return
    modes, outputs = memory.modes, memory.outputs
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    for row in range(outputs.shape[1]):
        for n in range(first, last):
            real, imag = outputs[Output.TARGET_RE, row, n], outputs[Output.TARGET_IM, row, n]
            turned = imag * modes[Mode.INVERSE, n]
            outputs[Output.RE, row, n], outputs[Output.IM, row, n] = real, imag
            outputs[Output.TURNED, row, n] = turned
            outputs[Output.WEIGHT, row, n] = real - turned * modes[Mode.TURN_RE, n]
            outputs[Output.WEIGHT_SLOPE, row, n] = outputs[Output.TURNED_SLOPE, row, n] = 0.0
    stand(memory, body)
    memory.bodies[body, BodyColumn.MOVED] = 0


@jitted
def stand(memory: Memory, body: int) -> None:
    """Compute minus the steady output under a unit force: added, it makes static load silent."""
    modes, outputs = memory.modes, memory.outputs
    for row in range(outputs.shape[1]):
        for n in range(memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]):
            real, imag = outputs[Output.RE, row, n], outputs[Output.IM, row, n]
            hold_re, hold_im = modes[Mode.HOLD_RE, n], modes[Mode.HOLD_IM, n]
            outputs[Output.STILL, row, n] = -(real * hold_im + imag * hold_re)


@jitted_within
def begin_drive(memory: Memory, voice: int) -> None:
    """Prepare a drive that moves in this block; else the last one holds."""
    if not memory.voices[voice, Voice.MOVED]:
        return
    drives, block = memory.drives, memory.forces.shape[1]
    body = memory.voices[voice, Voice.BODY]
    first = memory.bodies[body, BodyColumn.FIRST]
    for n in range(memory.bodies[body, BodyColumn.LAST] - first):
        now, given = drives[Drive.NOW, voice, n], memory.modes[Mode.INPUT, first + n]
        drives[Drive.GAIN, voice, n] = now * given
        drives[Drive.SLOPE, voice, n] = (drives[Drive.TARGET, voice, n] - now) * given / block


@jitted_within
def end_drive(memory: Memory, voice: int) -> None:
    """Arrive at the drive that a voice moved to."""
    if not memory.voices[voice, Voice.MOVED]:
        return
    drives, body = memory.drives, memory.voices[voice, Voice.BODY]
    first = memory.bodies[body, BodyColumn.FIRST]
    for n in range(memory.bodies[body, BodyColumn.LAST] - first):
        drives[Drive.NOW, voice, n] = drives[Drive.TARGET, voice, n]
        drives[Drive.GAIN, voice, n] = (
            drives[Drive.NOW, voice, n] * memory.modes[Mode.INPUT, first + n]
        )
        drives[Drive.SLOPE, voice, n] = 0.0
    memory.voices[voice, Voice.MOVED] = 0


@jitted_within
def feed(memory: Memory, body: int, voice: int, end: int) -> None:
    """Compute the direct gain of a voice's force at the begin (0) or end (1) of a block.

    It begins with the steady output of the poles before: a force stays silent when they change.
    """
    for row in range(memory.outputs.shape[1]):
        memory.feeds[end, voice, row] = _still(memory, body, voice, row)


@jitted_within
def direct(memory: Memory, body: int, voice: int) -> None:
    """Add each force's direct part, which cancels the steady output: only changes are heard."""
    block, force = memory.forces.shape[1], memory.forces[voice]
    for row in range(memory.outputs.shape[1]):
        begin, end = memory.feeds[0, voice, row], memory.feeds[1, voice, row]
        for k in range(block):
            level = begin + (end - begin) * (k + 1) / block
            memory.sounds[body, row, k] += level * force[k]
        memory.feeds[0, voice, row] = end


@jitted_within
def _still(memory: Memory, body: int, voice: int, row: int) -> float:
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    drive, still = memory.drives[Drive.NOW, voice], memory.outputs[Output.STILL, row]
    level = 0.0
    for n in range(last - first):
        level += drive[n] * still[first + n]
    return level


@jitted_within
def link(memory: Memory) -> None:
    """Chain the voices that push each body in this block into a list."""
    memory.bodies[:, BodyColumn.VOICE] = -1
    for voice in range(memory.voices.shape[0] - 2, -1, -1):
        if memory.voices[voice, Voice.ACTIVE]:
            body = memory.voices[voice, Voice.BODY]
            memory.voices[voice, Voice.NEXT] = memory.bodies[body, BodyColumn.VOICE]
            memory.bodies[body, BodyColumn.VOICE] = voice


def runner(rows: int, *, turned: bool, voices: int = _MOST) -> tuple[int, int, int, int]:
    """Return `Memory.run` for rows of outputs, complex where `turned`, and at most `voices`."""
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
    """Let `count` voices push some outputs of a body; return how many samples were made."""
    arguments = (memory, body, row, voices, count, ramped, unit)
    return call_for_integer(memory.run[Run.ADDRESS], arguments)


@cache  # what is called by its address is kept for as long as Python runs
def _run(rows: int, most: int, *, turned: bool) -> Kernel:
    """Return the function that lets the right kernel make whole frames of a block."""
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
