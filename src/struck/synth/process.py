"""One block of a whole scene, body by body."""

from __future__ import annotations

from struck.synth import blocks
from struck.synth.compiling import jitted, jitted_within
from struck.synth.dispatch import run
from struck.synth.memory import (
    Array,
    Body,
    Drive,
    HeldAs,
    Index,
    Memory,
    Mode,
    Output,
    Run,
    Voice,
    view,
)


@jitted
def make_block(reals: Array, wholes: Index) -> None:
    """Make one block of all bodies' sounds in their memory.

    It takes the real and the whole numbers of `struck.synth.memory`, as two arrays cost less to
    hand to compiled code than their many parts. `Memory.run` must be set, as `runner` tells.
    """
    memory = view(reals, wholes)
    blocks.link(memory)
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
    voice = memory.bodies[body, Body.VOICE]
    ramped, unit = False, True
    run(memory, body, 0, (voice, voice, voice, voice), 1, ramped, unit)
    blocks.direct(memory, body, voice)


@jitted_within
def push(memory: Memory, body: int, ramped: bool) -> None:  # noqa: FBT001 - compiled: positional
    """Let all voices of a body push it, as many at a time as kernels take.

    A body that few voices push stays as pairs from block to block.
    """
    paired = memory.outputs.shape[1] == memory.run[Run.OUTPUTS] and few(memory, body)
    unit = paired and not ramped and lone(memory, body)
    prepare(memory, body, paired, unit)
    voice = memory.bodies[body, Body.VOICE]
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
        memory.bodies[body, Body.HELD_AS] = HeldAs.UNIT_PAIRS if unit else HeldAs.PAIRS


@jitted_within
def prepare(memory: Memory, body: int, paired: bool, unit: bool) -> None:  # noqa: FBT001 - compiled: positional
    """See that a body's state is held as it is to be taken."""
    held_as = memory.bodies[body, Body.HELD_AS]
    if unit and held_as != HeldAs.UNIT_PAIRS:
        blocks.measure(memory, body, memory.bodies[body, Body.VOICE])
    elif not paired or (held_as == HeldAs.UNIT_PAIRS and not unit):
        blocks.settle(memory, body)


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
    """Let some voices push at once, group by group of outputs; `again` after others, from rest."""
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    together = memory.run[Run.OUTPUTS]
    for row in range(0, memory.outputs.shape[1], together):
        if again:
            blocks.clear(memory, first, last)
        elif memory.bodies[body, Body.HELD_AS] == HeldAs.STATE:
            blocks.unpack(memory, first, last)
        made = run(memory, body, row, voices, count, ramped, unit)
        tail(memory, body, row, together, voices, count, made)


@jitted_within
def put_back(memory: Memory, body: int, count: int, again: bool) -> None:  # noqa: FBT001 - compiled: positional
    """Turn pairs into states, on top of those of voices before."""
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    if count == 0 and not again:
        blocks.leap(memory, first, last)
    else:
        blocks.pack(memory, first, last, 1.0 if again else 0.0)


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
def few(memory: Memory, body: int) -> bool:
    """Tell whether there are pushes, and no more than a kernel takes at once."""
    count, voice = 0, memory.bodies[body, Body.VOICE]
    while voice >= 0:
        count, voice = count + 1, memory.voices[voice, Voice.NEXT]
    return 0 < count <= memory.run[Run.PUSHES]


@jitted_within
def lone(memory: Memory, body: int) -> bool:
    """Tell whether one voice alone pushes, and its kernel leaves nothing over."""
    voice = memory.bodies[body, Body.VOICE]
    return (
        memory.voices[voice, Voice.NEXT] < 0
        and memory.forces.shape[1] % memory.run[Run.SAMPLES] == 0
    )


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
