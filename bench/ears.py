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

RATE, BODIES, SHARE = 48_000, 16, 0.10
SECONDS = 1.0


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
    print(f"at most {SHARE:.0%} of a core (kemar live, blocks of 128): {verdict:.1%}, {met}")


if __name__ == "__main__":
    main()
