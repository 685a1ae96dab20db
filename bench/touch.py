"""What touching costs: a scrape, reading its surface, and 64 contacts that move among 16 bodies.

Prints microseconds of processor time a block of 128 samples at 48 kHz, and the real-time factor of
64 touches, told 1,000 times a second, on 16 bodies of about 100 modes each: seconds of sound a
second of one core. `bench/versions.py` compares scrapes with an earlier checkout.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import struck
from struck import Scrape
from struck.excitation import TouchLog
from struck.excitation.excitation import Push
from struck.excitation.roughness import Profile, Roughness
from struck.excitation.scraping_force import add_reading, levels_of
from struck.solids import Block
from struck.synth.resonators import Resonators

RATE, BLOCK = 48_000, 128
SIZE = (0.4, 0.3, 0.003)
TOP = SIZE[2] / 2


def least(work: Callable[[], object], turns: int) -> float:
    """Return the least processor time of a call, s: what the machine's other work spared."""
    times = []
    for _ in range(turns):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def scrape(model: struck.ModalModel, roughness: Roughness | Profile) -> float:
    """Return the time of a block of a whole scrape, s: force, path and drive."""
    ends = [(-0.15, -0.1, TOP), (0.15, 0.1, TOP)]
    pushing = Scrape(
        path=ends, speed=0.1, load=1.0, roughness=roughness, radius=1e-3, repeat="back"
    ).begin(model, RATE)
    return least(lambda: [pushing.advance(BLOCK) for _ in range(64)], 40) / 64


def reading() -> tuple[float, float]:
    """Return the time of a block of heights, s: of a texture, and of a profile's table."""
    layers = Roughness.named("sandpaper").layers()
    places = np.outer(np.arange(64 * BLOCK) * (0.1 / RATE), [0.6, 0.8, 0.0])
    table = levels_of(Profile.named("sandpaper"))
    turns, out = np.linspace(0, 0.1, 64 * BLOCK), np.zeros(64 * BLOCK)
    textured = least(lambda: layers.at(places), 40) / 64
    tabled = least(lambda: add_reading(table, turns, (0.5, 0.5), (1.0, 1.0), out), 40) / 64
    return textured, tabled


def log(chance: np.random.Generator, seconds: float) -> TouchLog:
    """Return a touch that wanders over the top of a body for so long, told at 1 kHz."""
    times = np.arange(0, seconds, 1e-3)
    first, second, third = chance.uniform(0, 6, 3)
    x = 0.1 * np.sin(2 * np.pi * 0.7 * times + first)
    y = 0.08 * np.sin(2 * np.pi * 0.9 * times + second)
    points = np.column_stack([x, y, np.full(len(times), TOP)])
    speeds = np.linalg.norm(np.gradient(points, 1e-3, axis=0), axis=1)
    return TouchLog(
        times=times, points=points, forces=1 + 0.5 * np.sin(5 * times + third), speeds=speeds
    )


def many(model: struck.ModalModel, *, seconds: float, bodies: int = 16, each: int = 4) -> float:
    """Return how many seconds of sound a second of one core makes."""
    chance = np.random.default_rng(0)
    voices = bodies * each
    logs = [log(chance, seconds) for _ in range(voices)]
    bank = Resonators([model] * bodies, sample_rate=RATE, block=BLOCK, voices=voices)
    outputs = [model.gains.toward(np.array([[0.0, 0.0, 1.0]]))[0]] * bodies
    begin = time.process_time()
    begun = [each.begin(model, RATE) for each in logs]
    for block in range(int(seconds * RATE) // BLOCK):
        pushes = [
            Push(force=push.force, drive=push.drive, body=voice // each, voice=voice)
            for voice, pushing in enumerate(begun)
            if (push := pushing.advance(BLOCK)) is not None
        ]
        bank.process(pushes, () if block else outputs)
    return seconds / (time.process_time() - begin)


def main() -> None:
    """Print what touching costs."""
    model = struck.analyze(Block(size=SIZE), "steel", accuracy="preview", band=(20, 7000))
    print(f"bodies of {len(model.frequencies)} modes, blocks of {BLOCK} at {RATE} Hz")
    for name, roughness in (
        ("texture", Roughness.named("sandpaper")),
        ("measured profile", Profile.named("sandpaper")),
    ):
        print(f"a whole scrape, {name}: {1e6 * scrape(model, roughness):.1f} us a block")
    textured, tabled = reading()
    print(f"heights of a texture: {1e6 * textured:.1f} us a block, all its layers")
    print(f"heights of a profile's table: {1e6 * tabled:.1f} us a block")
    factors = [many(model, seconds=0.5) for _ in range(3)]
    print(f"64 contacts told at 1 kHz on 16 bodies: real-time factor {max(factors):.2f}")


if __name__ == "__main__":
    main()
