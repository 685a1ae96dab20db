"""How well and how fast modes are found in recordings whose modes are known, beside others.

Scenes: modes from 120 Hz to 14 kHz, three in ten beside another (0.3 to 5 Hz), 2 s with half a
second of noise before. Found: share of all modes whose frequency is right within 0.5 Hz or 10
cents, and within 0.45 of the distance to the next; detected: of those 16 dB over the noise; false:
modes that are none; errors are medians over the modes found. All take turns on the same takes, in
one process and on one thread; s/s is processor time of a second of ringing of one channel.
"""

from __future__ import annotations

import argparse
import importlib
import os
import statistics
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import starmap
from pathlib import Path
from typing import Any

# Before NumPy is imported: one thread each.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import dense
import fitters
import numpy as np
import peak
from fitters import GATED, OURS, WRITTEN, Job, Modes
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import refine, with_best_gains
from struck.recordings.poles.search import fit_poles
from struck.recordings.segments import Segment
from struck.recordings.takes import Take
from tests.recordings import sounds
from tests.recordings.scenes import (
    LEAD,
    RATE,
    Scene,
    Score,
    Truth,
    body,
    hummed,
    in_room,
    paired,
    recorded,
    scene,
    score,
    struck_softly,
)
from tests.recordings.scenes import pairs as pair_scene
from tests.recordings.test_processing import coded

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
FASTER, DENSE, REAL, BUDGET = 5.0, 10.0, 2.0, 64
AT_ONCE, A_SECOND, WORST = 0.15, 0.3, 5.0  # processor s: of a take, of its seconds, of all modes
SINGLE = ((20, 60), (50, 40), (50, 20), (100, 40), (100, 20), (200, 60), (200, 20))
SHARED = ((30, 8, 20), (100, 8, 40), (100, 8, 20), (60, 24, 30))
PAIRS = ((0.5, 0.3), (2.0, 0.3), (2.0, 1.0), (8.0, 0.3), (8.0, 1.0), (8.0, 3.0))
SHARED_FOLDER = Path(__file__).parents[2] / "shared"
PROTOTYPE = SHARED_FOLDER / "prototypes" / "fitting"
RECORDINGS = SHARED_FOLDER / "data" / "recordings"
HEAD = f"{'found':>6} {'det':>5} {'false':>6} {'cents':>8} {'decay %':>8} {'gain dB':>8} {'s/s':>6}"


def verdict(claim: str, value: float, *, met: bool) -> None:
    """Print whether a target is met."""
    print(f"{claim}: {value:.2f}, {'met' if met else 'MISSED'}", flush=True)


def job_of(take: Scene) -> Job:
    """Return what a fitter gets to see of a scene."""
    modes = len(take.truth.frequencies)
    return Job(samples=take.samples, lead=LEAD, sample_rate=RATE, modes=modes)


def row(name: str, scores: Sequence[Score], costs: Sequence[float]) -> str:
    """Return means as a line of a table."""

    def mean(field: str) -> float:
        return float(np.mean([getattr(each, field) for each in scores]))

    return (
        f"{name:24} {mean('found'):6.3f} {mean('detected'):5.3f} {mean('false'):6.1f} "
        f"{mean('cents'):8.4f} {100 * mean('decay'):8.3f} {mean('gain'):8.3f} {np.mean(costs):6.2f}"
    )


def single(seeds: range, scenes: Iterable[tuple[int, int]], peers: Iterable[str]) -> None:
    """Print the table of single takes in white noise, and how much faster we are than 2007."""
    contenders = {OURS: fitters.ours, WRITTEN: fitters.written, GATED: fitters.gated}
    contenders |= {name: fitters.PEERS[name] for name in peers}
    ratios: dict[tuple[int, int], tuple[float, float]] = {}
    for modes, level in scenes:
        print(f"\n{f'{modes} modes, {level} dB':24} {HEAD}", flush=True)
        scores: dict[str, list[Score]] = {name: [] for name in contenders}
        costs: dict[str, list[float]] = {name: [] for name in contenders}
        for seed in seeds:
            take = scene(modes, level, np.random.default_rng(seed))
            job = job_of(take)
            for name, fitter in contenders.items():
                seconds, found = fitters.timed(fitter, job)
                scores[name].append(score(take.truth, *found))
                costs[name].append(seconds / job.seconds)
        for name in contenders:
            print(row(name, scores[name], costs[name]), flush=True)
        ratios[modes, level] = (ratio(costs, WRITTEN), ratio(costs, GATED))
    print()
    for (modes, level), (whole, gate) in ratios.items():
        claim = f"{modes} modes, {level} dB: at least {FASTER:g} times faster than {WRITTEN}"
        verdict(f"{claim} (gated {gate:.2f})", whole, met=whole >= FASTER)


def ratio(costs: dict[str, list[float]], name: str) -> float:
    """Return how many times longer another takes than we: the median of rounds."""
    return statistics.median(
        theirs / own for theirs, own in zip(costs[name], costs[OURS], strict=True)
    )


def takes(seed: int) -> dict[str, Array]:
    """Return takes (1, n) by name: clean, disturbed and processed ones."""
    chance = np.random.default_rng(seed)
    dry = scene(40, 50, chance)
    rooms = {f"room at {away} m": (0.35, away) for away in (0.3, 1.2)}
    made = {
        "dry": dry.samples,
        "dry, 200 modes": scene(200, 60, chance).samples,
        "dry, 10 s": scene(40, 50, chance, seconds=10.0).samples,
        "hum": hummed(dry, -20, chance).samples,
        "soft mallet": struck_softly(40, 50, chance).samples,
        **{
            name: in_room(40, 50, chance, seconds=seconds, distance=away).samples
            for name, (seconds, away) in rooms.items()
        },
    }
    for kilobits in (128, 64):
        made[f"MP3, {kilobits} kbit/s"] = coded(0.7 * dry.samples[0], kilobits)[None]
    return made


def refused(seed: int) -> dict[str, Array]:
    """Return sounds (1, n) by name that no fit takes for an object's."""
    chance = np.random.default_rng(seed)
    return {
        "chord, 8 s": sounds.chord(8.0)[None],
        "speech, 10 s": sounds.speech(chance, 10.0)[None],
        "cymbal": sounds.cymbal(chance)[None],
        "noise that fades": sounds.burst(chance)[None],
    }


def limits(seeds: range) -> None:
    """Print processor time of single takes: at 64 modes over its limit, and of all modes."""
    print(f"\n{'single take':24} {'64 modes, s':>12} {'limit, s':>9} {'all modes, s/s':>15}")
    over, worst = [], []
    for seed in seeds:
        for name, samples in (takes(seed) | refused(seed)).items():
            take = Take(samples=samples, sample_rate=RATE)
            few, every = (cost_of(take, modes) for modes in (BUDGET, None))
            limit = AT_ONCE + A_SECOND * take.duration
            over.append(few / limit)
            worst.append(every / take.duration)
            print(f"{name:24} {few:12.2f} {limit:9.2f} {worst[-1]:15.2f}", flush=True)
    claim = f"single takes within {AT_ONCE} s + {A_SECOND} s/s at {BUDGET} modes, of that the most"
    verdict(claim, max(over), met=max(over) <= 1)
    verdict(f"all modes of a take under {WORST:g} s/s", max(worst), met=max(worst) < WORST)


def cost_of(take: Take, modes: int | None) -> float:
    """Return the processor time of a fit or a refusal, s, the least of three."""
    spent = []
    for _ in range(3 if modes else 1):
        begun = time.thread_time()
        with suppress(RecordingError):
            fit_poles(take, budget=modes)
        spent.append(time.thread_time() - begun)
    return min(spent)


def pairs(seeds: range, levels: Sequence[int]) -> None:
    """Print which share of the modes of four isolated close pairs is found."""
    head = " ".join(f"{f'{level} dB':>14}" for level in levels)
    print(f"\n{f'four pairs, found: {OURS} / {GATED}':46} {head}", flush=True)
    for decay, split in PAIRS:
        cells = []
        for level in levels:
            takes = [pair_scene(decay, split, level, np.random.default_rng(s)) for s in seeds]
            both = [
                np.mean([score(take.truth, *fitter(job_of(take))).found for take in takes])
                for fitter in (fitters.ours, fitters.gated)
            ]
            cells.append(f"{both[0]:6.2f} / {both[1]:5.2f}")
        print(f"{f'decay {decay:g} 1/s, {split:g} Hz apart':46} {' '.join(cells)}", flush=True)


def strong_missing(truth: Truth, found: Modes) -> float:
    """Return which share of the gains 40 dB over the noise have no value within 6 dB."""
    strong = np.abs(truth.gains) ** 2 / (4 * truth.decays) * RATE > 1e4 * truth.noise[:, None] ** 2
    rows, columns = paired(truth, *found)
    levels = np.maximum(np.abs(found[1][:, columns]), 1e-12) / np.abs(truth.gains[:, rows])
    right = np.zeros_like(strong)
    right[:, rows] = np.abs(20 * np.log10(levels)) < 6
    return float(1 - right[strong].mean())


def shared(seeds: range, scenes: Iterable[tuple[int, int, int]]) -> None:
    """Print the table of several microphones in the noise of a fan."""
    contenders = {OURS: fitters.ours, GATED: fitters.gated}
    for modes, channels, level in scenes:
        title = f"{modes} modes, {channels} mics, {level} dB"
        print(f"\n{title:24} {HEAD} {'strong gains missing':>21}", flush=True)
        for name, fitter in contenders.items():
            scores, costs, missing = [], [], []
            for seed in seeds:
                take = scene(modes, level, np.random.default_rng(seed), channels=channels, fan=True)
                seconds, found = fitters.timed(fitter, job_of(take))
                scores.append(score(take.truth, *found))
                costs.append(seconds / job_of(take).seconds)
                missing.append(strong_missing(take.truth, found))
            print(f"{row(name, scores, costs)} {100 * np.mean(missing):20.1f}%", flush=True)


def table_of_positions() -> Scene:
    """Return 6 contacts by 8 listeners of a body of 25 modes, 1.5 s at 20 dB."""
    chance = np.random.default_rng(48)
    frequencies, decays, gains = body(25, chance)
    contacts = chance.standard_normal((6, 1, 25))
    listeners = chance.standard_normal((2, 8, 25)).T @ np.array([1, 1j])
    both = (contacts * listeners.T).reshape(48, 25) * gains
    return recorded(frequencies, decays, both, 20, chance, seconds=1.5)


def left_over(segment: Segment, noise: Array, ringing: Exponentials) -> float:
    """Return the energy that a fit leaves, the noise's being 1."""
    left = (segment.residual(with_best_gains([segment], ringing)) ** 2).sum(axis=1)
    return float((left / noise**2).sum() / segment.samples.size)


def positions(rounds: int) -> None:
    """Print how long 48 channels take to refine, all at once and by blocks."""
    take = table_of_positions()
    samples, noise, truth = (
        np.ascontiguousarray(take.samples[:, LEAD:]),
        take.truth.noise,
        take.truth,
    )
    chance = np.random.default_rng(1)
    off = chance.standard_normal((2, len(truth.poles))).T @ np.array([0.2, 0.2j])
    start = truth.poles + truth.decays * off
    dense.refined(start[:2], samples[:2], noise[:2], RATE, steps=1)  # warms up
    whole, bare = [], []
    for _ in range(rounds):
        begun = time.thread_time()
        exact = dense.refined(start, samples, noise, RATE)
        theirs, begun = time.thread_time() - begun, time.thread_time()
        segment = Segment.of(samples, RATE, Noise.white(noise**2))
        prepared = time.thread_time()
        first = with_best_gains([segment], silent(start, len(samples)))
        found = refine([segment], first, sweeps=4, steps=4)
        whole.append(theirs / (time.thread_time() - begun))
        bare.append(theirs / (time.thread_time() - prepared))
    costs = (left_over(segment, noise, each) for each in (first, silent(exact, 48), found))
    print("\n48 channels, 25 modes: left by start {:.4f}, dense {:.7f}, ours {:.7f}".format(*costs))
    claim = f"48 channels refined: at least {DENSE:g} times faster than dense"
    for name, ratios in (("transforms there, as in a fit", bare), ("transforms too", whole)):
        middle = statistics.median(ratios)
        verdict(f"{claim} ({name})", middle, met=middle >= DENSE)


def silent(poles: Complex, channels: int) -> Exponentials:
    """Return poles without gains."""
    return Exponentials(poles=poles, gains=np.zeros((channels, len(poles)), complex))


def whole_prototype() -> None:
    """Print how long the prototype of the research takes for all of a fit to 48 channels."""
    if not PROTOTYPE.is_dir():
        print("the prototype is not here: no whole fit of it to compare with")
        return
    sys.path.insert(0, str(PROTOTYPE))
    try:
        prototype: Any = importlib.import_module("gfit")
    except ModuleNotFoundError as error:
        print(f"the prototype needs {error.name}, for a whole fit of it: pip install {error.name}")
        return
    take = table_of_positions()
    prototype.fit(take.samples[:1], LEAD, RATE, lm_iters=1)  # warms up

    def by_prototype(job: Job) -> Modes:
        poles, gains, _ = prototype.fit(job.samples, job.lead, job.sample_rate)
        return poles, gains

    print(f"\n{'48 channels, 25 modes':24} {HEAD}", flush=True)
    spent = []
    for name, fitter in ((OURS, fitters.ours), ("prototype", by_prototype)):
        seconds, found = fitters.timed(fitter, job_of(take))
        spent.append(seconds)
        cost = seconds / job_of(take).seconds
        print(row(name, [score(take.truth, *found)], [cost]), flush=True)
    times = spent[1] / spent[0]
    claim = f"48 channels fitted: at least {DENSE:g} times faster than the prototype"
    verdict(claim, times, met=times >= DENSE)


def real() -> None:
    """Print how long real recordings take, for orientation."""
    if not RECORDINGS.is_dir():
        print("the recordings of the research are not here: none fitted")
        return
    print(f"\n{f'recording, {BUDGET} modes at most':36} {'s/s':>6} {'signal to residual, dB':>24}")
    costs = list(starmap(one_recording, sorted(of_recordings().items())))
    verdict(f"every recording within {REAL:g} s/s", max(costs), met=max(costs) <= REAL)


def of_recordings() -> dict[str, list[Path]]:
    """Return files by name, left and right together."""
    takes: dict[str, list[Path]] = {}
    for path in sorted(RECORDINGS.glob("*.wav")):
        takes.setdefault(path.stem.removesuffix("_L").removesuffix("_R"), []).append(path)
    return takes


def one_recording(name: str, paths: list[Path]) -> float:
    """Fit one, print it and return processor seconds a second of audio."""
    parts = [Take.load(path) for path in paths]
    samples = np.vstack([part.samples for part in parts])
    take = Take(samples=samples, sample_rate=parts[0].sample_rate, name=name)
    begun = time.thread_time()
    fit = fit_poles(take, budget=BUDGET)
    cost = (time.thread_time() - begun) / take.duration
    title = f"{name} ({len(samples)} channels)"
    print(f"{title:36} {cost:6.2f} {fit.verdict.signal_to_residual:24.1f}", flush=True)
    return cost


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer scenes, a minute or so")
    quick: bool = parser.parse_args().quick
    print(peak.machine())
    missing = fitters.missing()
    for name, reason in missing.items():
        print(f"{name} is not here: {reason}")
    fitters.timed(fitters.ours, job_of(scene(5, 60, np.random.default_rng(0))))  # imports
    seeds = range(7000, 7001 if quick else 7002)
    peers = [name for name in fitters.PEERS if name not in missing]
    single(seeds, SINGLE[1:5:3] if quick else SINGLE, peers)
    limits(seeds[:1] if quick else range(5))
    pairs(seeds, (20,) if quick else (60, 40, 20))
    shared(seeds[:1], SHARED[:1] if quick else SHARED)
    positions(3)
    if not quick:
        whole_prototype()
        real()


if __name__ == "__main__":
    main()
