"""What ears cost: moving bodies, each through 256 taps for each of two ears, of real time.

Played live KEMAR has 256 taps, of which the verdict is; rendered it has all 448.
The processor time of the thread, as a share of the time that the sound lasts; medians of rounds.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np
import peak

from struck.ears.hearing import Hearing
from struck.ears.listeners import Binaural, Listener, Stereo, Trajectory
from struck.ears.propagation import Emitter
from struck.radiation.multipoles import Multipoles

RATE, BODIES, SHARE = 48_000, 16, 0.10
SECONDS = 1.0
MODES, FIELD = 100, 0.3  # of a computed field, and ms to tell it to two ears


def circling(number: int) -> Emitter:
    """Return a body that goes round the listener, each with a pace of its own."""
    pace, radius = 0.2 + 0.05 * number, 1.0 + 0.2 * number

    def centre(moment: float) -> tuple[float, float, float]:
        turn = 2 * math.pi * pace * moment + number
        return radius * math.cos(turn), radius * math.sin(turn), 0.3

    return Emitter(centre=Trajectory.of("position", centre))


def measured(listener: Listener, block: int, rounds: int, *, brief: bool) -> list[float]:
    """Return the share of real time that each round took."""
    bodies = [circling(number) for number in range(BODIES)]
    hearing = Hearing(bodies, listener, sample_rate=RATE, brief=brief)
    samples = np.random.default_rng(1).standard_normal((hearing.lines, block))
    count = int(SECONDS * RATE / block)
    shares = []
    for _ in range(rounds + 1):
        begun = time.thread_time()
        for _ in range(count):
            hearing.next_block(samples)
        shares.append((time.thread_time() - begun) * RATE / (count * block))
    return shares[1:]  # the first compiles


def of_a_field(rounds: int) -> float:
    """Return what it takes to tell a computed field of 100 modes of degree 8 to two ears, ms."""
    chance = np.random.default_rng(1)
    waves = [chance.normal(size=81) + 1j * chance.normal(size=81) for _ in range(MODES)]
    field = Multipoles.of(
        waves, np.linspace(10, 100, MODES), radius=0.06, errors=np.zeros((MODES, 2))
    )
    ears, times = np.array([[1.0, 0.1, 0.2], [1.0, -0.1, 0.2]]), []
    for _ in range(rounds + 1):
        begun = time.thread_time()
        for _ in range(200):
            field.at(ears)
        times.append((time.thread_time() - begun) / 200 * 1e3)
    return statistics.median(times[1:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    rounds: int = parser.parse_args().rounds
    print(f"{peak.machine()}, {BODIES} moving bodies, 2 ears")
    print(f"{'head':12} {'taps':>4} {'block':>5} {'share of a core':>15} {'least':>6}")
    kemar, verdict = Binaural(position=(0, 0, 0), facing=(1, 0, 0)), math.inf
    for name, listener, brief in (
        ("kemar live", kemar, True),
        ("kemar", kemar, False),
        ("exact", Stereo(position=(0, 0, 0), facing=(1, 0, 0)), True),
    ):
        for block in (64, 128, 256, 512):
            shares = measured(listener, block, rounds, brief=brief)
            median, taps = statistics.median(shares), listener.filters(RATE, brief=brief).taps
            print(f"{name:12} {taps:4} {block:5} {median:15.3f} {min(shares):6.3f}")
            if name == "kemar live" and block == 128:
                verdict = median
    met = "met" if verdict <= SHARE else "MISSED"
    field = of_a_field(rounds)
    told = "met" if field <= FIELD else "MISSED"
    print(f"field of {MODES} modes of degree 8, at most {FIELD} ms: {field:.2f} ms, {told}")
    print(f"at most {SHARE:.0%} of a core (kemar live, blocks of 128): {verdict:.1%}, {met}")


if __name__ == "__main__":
    main()
