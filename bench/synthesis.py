"""How many modes a core plays in real time: of the core's peak, beside others.

All contenders take turns, round by round, in one process and on one thread; what counts is the
processor time of the thread (of the whole process for separate programs). Whatever else the machine
does falls on all of them: ratios within a round are what lasts.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import statistics
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path

# Before NumPy is imported: one thread each.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import peak
import peers
from contenders import ENGINE, WHOLE, Contender, compiled, repeated, spent, whole
from peers import BLOCK

import struck
from struck.shapes import Bar

FEW, GRID, MANY = 256, 1024, 8192
PEERS = {peers.FAUST: 8.0, peers.KLANK: 6.0, peers.CSOUND: 25.0, peers.LFILTER: 400.0}
SHARE, SECOND = 1.15, 1.20
NEAR = 0.75  # of the ratio at the core's peak, where the peak itself is slower than the target
# Multiply-adds a mode and sample that a share of the peak counts, and the fewest there can be.
_COUNTED, _LEAST = 4, 3
QUICK_ROUNDS, ROUNDS = 15, 21
STRIKES, GROWTH = 1000, 12.0


def ours(*, quick: bool) -> Iterator[Contender]:
    """Yield what we play: by size, by pushes and outputs and gains, by block."""
    for modes in (FEW, GRID, MANY):
        yield compiled(modes)
        yield whole(modes)
    yield compiled(MANY, outputs=2)
    for modes in (FEW, MANY):
        yield whole(modes, moving=True)
    for turned in (False, True):
        for pushes, outputs in product((1, 2, 4), (1, 2) if quick else (1, 2, 8)):
            yield compiled(GRID, BLOCK, pushes, outputs, turned=turned)
    for block in (64, 256, 512, 1024):
        for modes in (FEW, GRID):
            yield whole(modes, block)
    for pushes, outputs in () if quick else product((1, 2, 4), (1, 2, 8)):
        yield whole(GRID, BLOCK, pushes, outputs)


def others(folder: Path, *, quick: bool) -> Iterator[Contender]:
    """Yield the peers that are here; say how to install the rest."""
    missing = peers.missing()
    for name, remedy in missing.items():
        print(f"{name} is not here: {remedy}")
    calls = [*peers.lfilter()]
    if peers.STK not in missing:
        calls += peers.stk(folder)
    if peers.FAUST not in missing and not quick:
        calls += peers.faust(folder)
    for name, call in calls:
        yield Contender(name=name, modes=peers.MODES, measure=repeated(call))
    programs = {peers.KLANK: peers.klank, peers.CSOUND: peers.csound}
    for name, program in {} if quick else programs.items():
        if name not in missing:
            yield Contender(name=name, modes=peers.MODES, measure=program(folder))


def take_turns(contenders: Sequence[Contender], rounds: int) -> None:
    """Measure all of them so many times."""
    for turn in range(rounds):
        for contender in contenders:
            contender.turn()
        print(f"  round {turn + 1} of {rounds}", file=sys.stderr, flush=True)


def show_machine() -> None:
    """Print what all this ran on."""
    names = ("numpy", "scipy", "ziglang")
    versions = (f"{name} {importlib.metadata.version(name)}" for name in names)
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    print(f"{peak.machine()}, {os.cpu_count()} cores, load {load} (others may share it)")
    print(f"Python {platform.python_version()}, {', '.join(versions)}; one thread")
    pairs = [(spent(peak.multiply_adds), spent(peak.wait)) for _ in range(15)]
    rate = peak.MULTIPLY_ADDS / statistics.median(each for each, _ in pairs)
    clock = peak.CYCLES / statistics.median(each for _, each in pairs)
    print(
        f"peak {rate / 1e9:.1f} thousand million multiply-adds a second, float64: "
        f"{rate / clock:.1f} a cycle at about {clock / 1e9:.1f} GHz\n"
    )


def show(contenders: Iterable[Contender]) -> None:
    """Print the table."""
    heads = f"{'modes':>6} {'block':>5} {'us a block':>10} {'least':>9} {'modes in real time':>18}"
    print(f"{'median':56} {heads} {'of the peak':>11}")
    for each in contenders:
        median, least = statistics.median(each.blocks), min(each.blocks)
        share = f"{each.share:11.2f}" if each.operations else ""
        print(
            f"{each.name:56} {each.modes:6} {each.block:5} {1e6 * median:10.2f} {1e6 * least:9.2f}"
            f" {each.in_real_time:18,.0f} {share}"
        )
    print(
        "Of the peak: two products a sample of a mode and one for each push and real output, two "
        "for each complex output; ramps not counted. One steady push does without its product, "
        "so that more than 1 is possible."
    )


def verdict(claim: str, value: float, *, met: bool) -> None:
    """Print whether a target is met."""
    print(f"{claim}: {value:.2f}, {'met' if met else 'MISSED'}")


def find(contenders: Iterable[Contender], name: str, modes: int) -> Contender:
    """Return the first whose name begins so."""
    return next(
        each
        for each in contenders
        if each.name.startswith(name) and (each.modes, each.block) == (modes, BLOCK)
    )


def show_targets(contenders: Sequence[Contender]) -> None:
    """Print whether we are as near the peak, and as much faster than others, as we mean to be."""
    print()
    for name in (ENGINE, WHOLE):
        share = find(contenders, name, MANY).share
        verdict(f"{MANY} modes, at least {SHARE:g} of the peak ({name})", share, met=share >= SHARE)
    one, two = (find(contenders, f"{ENGINE}, 1 in {n} out, real", MANY) for n in (1, 2))
    ratio = two.times(one)
    claim = f"two outputs at most {SECOND:g} times one (their multiply-adds are 4 to 3)"
    verdict(claim, ratio, met=ratio <= SECOND)
    show_peers(contenders)


def show_growth() -> None:
    """Print how many times as long eight times as many strikes take."""
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="free"), "steel")
    taken = {}
    for count in (STRIKES, 8 * STRIKES):
        times = [10 * i / count for i in range(count)]
        strikes = [struck.Strike(at=(0.1,), impulse=0.01, time=each) for each in times]
        taken[count] = min(
            spent(lambda now=strikes: struck.render(bar, now, seconds=10)) for _ in range(3)
        )
    ratio = taken[8 * STRIKES] / taken[STRIKES]
    claim = f"{8 * STRIKES} strikes in 10 s at most {GROWTH:g} times {STRIKES}"
    verdict(claim, ratio, met=ratio <= GROWTH)


def show_peers(contenders: Sequence[Contender]) -> None:
    """Print how many times faster we are; where the core's peak forbids it, what share of that."""
    for peer, target in PEERS.items():
        forms = [each for each in contenders if each.name.startswith(peer)]
        if not forms:
            continue
        fastest = min(forms, key=lambda each: statistics.median(each.blocks))
        for name in (ENGINE, WHOLE):
            mine = find(contenders, name, FEW)
            ratio = fastest.times(mine)
            highest = ratio / mine.share * _COUNTED / _LEAST
            if highest >= target:
                claim = f"at least {target:g} times faster than {fastest.name} ({name})"
                verdict(claim, ratio, met=ratio >= target)
                continue
            claim = (
                f"{ratio:.1f} times faster than {fastest.name} ({name}); {target:g} times is "
                f"beyond this core, whose peak is {highest:.1f}: at least {NEAR:g} of it"
            )
            verdict(claim, ratio / highest, met=ratio >= NEAR * highest)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute, without slow peers")
    parser.add_argument("--rounds", type=int, help=f"turns of each ({ROUNDS}; {QUICK_ROUNDS})")
    arguments = parser.parse_args()
    quick: bool = arguments.quick
    show_machine()
    with tempfile.TemporaryDirectory() as folder:
        contenders = [*ours(quick=quick), *others(Path(folder), quick=quick)]
        take_turns(contenders, arguments.rounds or (QUICK_ROUNDS if quick else ROUNDS))
    show(contenders)
    show_targets(contenders)
    show_growth()


if __name__ == "__main__":
    main()
