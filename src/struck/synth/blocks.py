"""One block of all bodies, from the store alone: what an audio callback runs.

Between blocks a mode's state is its complex c, exact whatever comes: a body that sleeps or rings
freely is moved on by powers of z, and one whose frequencies or decays change goes on from the same
c. Within a block the kernels take it as the pair (Im[z c], Im c), and leave it so while a body is
pushed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.synth.compiling import jitted, jitted_within
from struck.synth.memory import LEVELS, Body, Drive, HeldAs, Level, Memory, Mode, Output, Voice

Array = NDArray[np.float64]
FAINTEST = 1e-100
"""A gain for those of nothing: what is divided by it stays finite, what it multiplies is lost."""


@jitted
def refresh(memory: Memory, body: int) -> None:
    """Work out all that follows from the poles of a body."""
    modes, rate, block = memory.modes, memory.levels[Level.RATE], memory.forces.shape[1]
    for n in range(memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]):
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
    """Let modes ring for so many samples, unheard."""
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
    """See that a body's state is its c."""
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    if memory.bodies[body, Body.HELD_AS] == HeldAs.UNIT_PAIRS:
        for n in range(first, last):  # sooner compiled than whole arrays
            memory.modes[Mode.LATEST, n] *= memory.modes[Mode.UNIT, n]
            memory.modes[Mode.PREVIOUS, n] *= memory.modes[Mode.UNIT, n]
    if memory.bodies[body, Body.HELD_AS] != HeldAs.STATE:
        pack(memory, first, last, 0.0)
        memory.bodies[body, Body.HELD_AS] = HeldAs.STATE


@jitted_within
def measure(memory: Memory, body: int, voice: int) -> None:
    """Turn states into pairs in units of a voice's gains, and outputs to fit."""
    modes, outputs = memory.modes, memory.outputs
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    if memory.bodies[body, Body.HELD_AS] == HeldAs.STATE:
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
    memory.bodies[body, Body.HELD_AS] = HeldAs.UNIT_PAIRS


@jitted
def wake(memory: Memory, body: int) -> None:
    """Bring a sleeping body to where it would be by now."""
    bodies = memory.bodies
    if bodies[body, Body.ASLEEP]:
        advance(memory, bodies[body, Body.FIRST], bodies[body, Body.LAST], bodies[body, Body.SLEPT])
        bodies[body, Body.ASLEEP] = bodies[body, Body.SLEPT] = 0


@jitted_within
def may_sleep(memory: Memory, body: int) -> bool:
    """Tell whether all that a body can still sound like is below its share of the loudest."""
    modes, total = memory.modes, 0.0
    for n in range(memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]):
        size = abs(modes[Mode.STATE_RE, n]) + abs(modes[Mode.STATE_IM, n])
        total += modes[Mode.LOUDNESS, n] * size
    loudest = LEVELS + body
    memory.levels[loudest] = max(memory.levels[loudest], total)
    return total <= memory.levels[Level.QUIET] * memory.levels[loudest]


@jitted_within
def begin_outputs(memory: Memory, body: int) -> None:
    """Prepare gains that move in this block; if none does, those of the last block hold."""
    if not memory.bodies[body, Body.MOVED]:
        return
    modes, outputs, block = memory.modes, memory.outputs, memory.forces.shape[1]
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
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
    if not memory.bodies[body, Body.MOVED]:
        return
    modes, outputs = memory.modes, memory.outputs
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    for row in range(outputs.shape[1]):
        for n in range(first, last):
            real, imag = outputs[Output.TARGET_RE, row, n], outputs[Output.TARGET_IM, row, n]
            turned = imag * modes[Mode.INVERSE, n]
            outputs[Output.RE, row, n], outputs[Output.IM, row, n] = real, imag
            outputs[Output.TURNED, row, n] = turned
            outputs[Output.WEIGHT, row, n] = real - turned * modes[Mode.TURN_RE, n]
            outputs[Output.WEIGHT_SLOPE, row, n] = outputs[Output.TURNED_SLOPE, row, n] = 0.0
    stand(memory, body)
    memory.bodies[body, Body.MOVED] = 0


@jitted
def stand(memory: Memory, body: int) -> None:
    """Work out anew, for outputs as they are, what constant unit forces would end in."""
    modes, outputs = memory.modes, memory.outputs
    for row in range(outputs.shape[1]):
        for n in range(memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]):
            real, imag = outputs[Output.RE, row, n], outputs[Output.IM, row, n]
            hold_re, hold_im = modes[Mode.HOLD_RE, n], modes[Mode.HOLD_IM, n]
            outputs[Output.STILL, row, n] = -(real * hold_im + imag * hold_re)


@jitted_within
def begin_drive(memory: Memory, voice: int) -> None:
    """Prepare a drive that moves in this block; if it does not, that of the last block holds."""
    if not memory.voices[voice, Voice.MOVED]:
        return
    drives, block = memory.drives, memory.forces.shape[1]
    body = memory.voices[voice, Voice.BODY]
    first = memory.bodies[body, Body.FIRST]
    for n in range(memory.bodies[body, Body.LAST] - first):
        now, given = drives[Drive.NOW, voice, n], memory.modes[Mode.INPUT, first + n]
        drives[Drive.GAIN, voice, n] = now * given
        drives[Drive.SLOPE, voice, n] = (drives[Drive.TARGET, voice, n] - now) * given / block


@jitted_within
def end_drive(memory: Memory, voice: int) -> None:
    """Arrive at the drive that a voice moved to."""
    if not memory.voices[voice, Voice.MOVED]:
        return
    drives, body = memory.drives, memory.voices[voice, Voice.BODY]
    first = memory.bodies[body, Body.FIRST]
    for n in range(memory.bodies[body, Body.LAST] - first):
        drives[Drive.NOW, voice, n] = drives[Drive.TARGET, voice, n]
        drives[Drive.GAIN, voice, n] = (
            drives[Drive.NOW, voice, n] * memory.modes[Mode.INPUT, first + n]
        )
        drives[Drive.SLOPE, voice, n] = 0.0
    memory.voices[voice, Voice.MOVED] = 0


@jitted_within
def feed(memory: Memory, body: int, voice: int, end: int) -> None:
    """Work out anew how loudly a voice's force is heard directly: at the end, or begin, of a block.

    A block begins with what the poles before would end in: a force stays silent when they change.
    """
    for row in range(memory.outputs.shape[1]):
        memory.feeds[end, voice, row] = _still(memory, body, voice, row)


@jitted_within
def direct(memory: Memory, body: int, voice: int) -> None:
    """Take off what a constant force would still sound like: only what changes is heard."""
    block, force = memory.forces.shape[1], memory.forces[voice]
    for row in range(memory.outputs.shape[1]):
        begin, end = memory.feeds[0, voice, row], memory.feeds[1, voice, row]
        for k in range(block):
            level = begin + (end - begin) * (k + 1) / block
            memory.sounds[body, row, k] += level * force[k]
        memory.feeds[0, voice, row] = end


@jitted_within
def _still(memory: Memory, body: int, voice: int, row: int) -> float:
    first, last = memory.bodies[body, Body.FIRST], memory.bodies[body, Body.LAST]
    drive, still = memory.drives[Drive.NOW, voice], memory.outputs[Output.STILL, row]
    level = 0.0
    for n in range(last - first):
        level += drive[n] * still[first + n]
    return level


@jitted_within
def link(memory: Memory) -> None:
    """Give each body the list of voices that push it in this block."""
    memory.bodies[:, Body.VOICE] = -1
    for voice in range(memory.voices.shape[0] - 2, -1, -1):
        if memory.voices[voice, Voice.ACTIVE]:
            body = memory.voices[voice, Voice.BODY]
            memory.voices[voice, Voice.NEXT] = memory.bodies[body, Body.VOICE]
            memory.bodies[body, Body.VOICE] = voice
