"""What takes turns in the benchmark of the synthesis, and how it is measured."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import cycle

import numpy as np
import peak
from numpy.typing import NDArray
from peers import BLOCK, RATE, Call, Measure

from struck import core
from struck.excitation.excitation import Push
from struck.synth.poles import Poles
from struck.synth.resonators import Resonators, Stepped

Array = NDArray[np.float64]
TURN = 2e-3
"""About what a turn takes, s."""
ENGINE, WHOLE = "engine, compiled", "Resonators.process"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bank:
    """What rings: Hz and 1/s."""

    frequencies: Array
    decays: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """Who plays what, and what it took: of each turn the time of a block and of a product, s."""

    name: str
    modes: int
    measure: Measure
    block: int = BLOCK
    operations: int = 0
    blocks: list[float] = field(default_factory=list)
    products: list[float] = field(default_factory=list)

    def turn(self) -> None:
        """Measure once, just after the core's peak."""
        self.products.append(spent(peak.multiply_adds) / peak.MULTIPLY_ADDS)
        self.blocks.append(self.measure())

    @property
    def in_real_time(self) -> float:
        """Modes that a core could play."""
        return self.modes * self.block / RATE / statistics.median(self.blocks)

    @property
    def share(self) -> float:
        """What the counted operations would take at the peak, of what they took."""
        count = self.modes * self.block * self.operations
        pairs = zip(self.products, self.blocks, strict=True)
        return statistics.median(count * product / block for product, block in pairs)

    def times(self, other: Contender) -> float:
        """Return how many times as long as another it takes for a sample of a mode."""
        pairs = zip(self.blocks, other.blocks, strict=True)
        ratio = statistics.median(mine / theirs for mine, theirs in pairs)
        return ratio * other.modes * other.block / (self.modes * self.block)


def spent(call: Callable[[], object], count: int = 1) -> float:
    """Return the processor time of so many calls, s."""
    begun = time.thread_time()
    for _ in range(count):
        call()
    return time.thread_time() - begun


def repeated(call: Call, blocks: int = 1) -> Measure:
    """Return how to measure a call that makes so many blocks.

    Each turn begins with one that does not count: the others have filled the caches.
    """
    call()
    count = max(1, round(TURN / max(spent(call), 1e-6)))

    def measure() -> float:
        call()
        return spent(call, count) / (count * blocks)

    return measure


def bank(modes: int) -> Bank:
    """Return modes spread evenly over octaves, 30 Hz to 18 kHz, decaying at 0.5 to 200 1/s."""
    decays = np.random.default_rng(2).uniform(np.log(0.5), np.log(200.0), modes)
    return Bank(frequencies=np.geomspace(30.0, 18e3, modes), decays=np.exp(decays))


def operations(pushes: int, outputs: int, *, turned: bool) -> int:
    """Return what a sample of a mode takes without ramps: products, mostly with a sum."""
    return 2 + pushes + (2 * outputs if turned else outputs)


def described(pushes: int, outputs: int, *, turned: bool = False, moving: bool = False) -> str:
    """Return in words what is played."""
    gains = "complex" if turned else "real"
    return f"{pushes} in {outputs} out, {gains}{', moving' if moving else ''}"


def compiled(
    modes: int, block: int = BLOCK, pushes: int = 1, outputs: int = 1, *, turned: bool = False
) -> Contender:
    """Let the engine play as an audio device's callback has it: whole, without Python."""
    engine = Stepped(
        [Poles.of(bank(modes), RATE)],
        points=outputs,
        block=block,
        voices=16,
        sample_rate=float(RATE),
    )
    drive, random = np.ones(modes), np.random.default_rng(3)
    push = {(0, n): (random.standard_normal(block), drive) for n in range(pushes)}
    engine.next_block(push, {0: np.full((outputs, modes), 1 + 1j * turned)})
    engine.next_block(push, {})  # from here on nothing moves
    blocks = 16
    make_block = core.address("bank_make_block")
    return Contender(
        name=f"{ENGINE}, {described(pushes, outputs, turned=turned)}",
        modes=modes,
        block=block,
        operations=operations(pushes, outputs, turned=turned),
        measure=repeated(lambda: peak.blocks(make_block, *engine.numbers, blocks), blocks),
    )


def whole(
    modes: int,
    block: int = BLOCK,
    pushes: int = 1,
    outputs: int = 1,
    *,
    moving: bool = False,
) -> Contender:
    """Let `Resonators.process` play, with all its Python; `moving`: other gains every block."""
    random = np.random.default_rng(3)
    resonators = Resonators([bank(modes)], block=block, points=outputs)
    forces = random.standard_normal((pushes, block))
    gains = [random.uniform(0.5, 1.0, (pushes + outputs, modes)) for _ in range(2)]
    voices = [
        [Push(force=f, drive=d, voice=n) for n, (f, d) in enumerate(zip(forces, g, strict=False))]
        for g in gains
    ]
    resonators.process(voices[0], [gains[0][pushes:]])
    turns = cycle((each, [g[pushes:]]) for each, g in zip(voices, gains, strict=True))
    still = voices[0], ()
    return Contender(
        name=f"{WHOLE}, {described(pushes, outputs, moving=moving)}",
        modes=modes,
        block=block,
        operations=operations(pushes, outputs, turned=False),
        measure=repeated(lambda: resonators.process(*(next(turns) if moving else still))),
    )
