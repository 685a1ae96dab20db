"""How many modes and bodies the page plays in a browser on one core, beside Python's bank.

The browser has one core to itself and renders offline as fast as it can; Python's bank takes turns
with it. Then it plays on the clock on all cores, and the worklet counts what came too late.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from pathlib import Path
from typing import Any

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import peak
from playwright.sync_api import sync_playwright

from struck.excitation.excitation import Push
from struck.explorer.page_files import head_bytes
from struck.synth.resonators import Resonators
from tests.browser.conftest import ALONE, chromium
from tests.browser.site import Site, Visit, visiting

RATE, BLOCK = 48_000, 128
MODES, EACH = 20_000, 2_000
PUSHED, RINGING, SHARE = 20_000, 40_000, 0.2
BODIES = {"binaural": 16, "mono": 64}
LATENCY = 0.020  # s from a click to its first sample in the worklet

# A model of chance, as a body of a recording would be, struck where the bench says.
MODEL = """
  const { createEngine } = await import('/static/sound/engine.js');
  const contact = { point: [0, 0, 0], direction: [0, 0, 0] };
  const modelOf = (count, seed, slowest) => {
    let state = seed + 1;
    const random = () => (state = (state * 16807) % 2147483647) / 2147483647;
    const some = (low, high) =>
      Float64Array.from({ length: count }, () => low + (high - low) * random());
    const aside = { re: some(-1, 1), im: some(-1, 1) };
    return { count, frequencies: some(40, 20000), decays: some(slowest, 4 * slowest),
      aside: () => aside,
      centre: [0, 0, 0], radius: 0.1, drive: () => some(-1, 1) };
  };
"""
SPEED = (
    MODEL
    + """
  const context = new OfflineAudioContext(1, given.rate * given.seconds, given.rate);
  const engine = await createEngine(context, {});
  for (let first = 0; first < given.modes; first += given.each) {
    const model = modelOf(given.each, first, 0.2);
    const body = engine.addModel(model, { position: [1, 0, 0] });
    const duration = given.pushed ? given.seconds : 0.001;
    engine.strike({ body, contact, impulse: 1e-6, duration, time: 0.001 });
  }
  engine.node.connect(context.destination);
  await engine.settled();
  globalThis.render = async () => {
    await context.startRendering();
    return { kind: engine.kind, dropped: engine.counts().dropped };
  };
  return {};
"""
)
CLOCK = (
    MODEL
    + """
  const context = new AudioContext({ sampleRate: given.rate });
  await context.resume();
  const engine = await createEngine(context, { ears: given.ears });
  const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
  engine.setFullScale(1e-6);
  engine.node.connect(context.destination);
  const bodies = Array.from({ length: given.bodies }, (_, k) =>
    engine.addModel(modelOf(given.modes, k, 0.5), {
      position: [2 * Math.cos(k), 2 * Math.sin(k), 0.2],
    }));
  await engine.settled();
  await wait(1);
  const before = { ...engine.counts() };
  const [loads, delays] = [[], []];
  engine.onReport((report) => loads.push(report.load));
  const end = performance.now() + 1000 * given.seconds;
  for (let k = 0; performance.now() < end; k++) {
    const clicked = Date.now();
    engine.strike({ body: bodies[k % bodies.length], contact, impulse: 1, duration: 0.001 });
    const turn = k / 40;
    const forward = [Math.cos(turn), Math.sin(turn), 0];
    engine.moveListener({ position: [0.3 * Math.sin(turn), 0, 0], forward });
    await wait(0.1);
    delays.push((engine.counts().struck - clicked) / 1000);
  }
  const after = { ...engine.counts() };
  await context.close();
  return { ears: engine.ears, underruns: after.underruns - before.underruns, ringing: after.ringing,
    dropped: after.dropped, loads, delays };
"""
)


def processor_time() -> float:
    """Return the processor time of all processes that this one has started, s."""
    children: dict[int, list[int]] = {}
    spent: dict[int, float] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(")")[2].split()
        except OSError:  # has ended
            continue
        number = int(entry.parent.name)
        children.setdefault(int(fields[1]), []).append(number)
        spent[number] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    total, waiting = 0.0, children.get(os.getpid(), [])
    while waiting:
        number = waiting.pop()
        total += spent[number]
        waiting = waiting + children.get(number, [])
    return total


def in_the_browser(visit: Visit, *, pushed: bool, seconds: float) -> float:
    """Return how many modes go in real time: of the browser's own processor time."""
    visit.run(SPEED, rate=RATE, seconds=seconds, modes=MODES, each=EACH, pushed=pushed)
    begun = processor_time()
    told = visit.run("return render();")
    spent = processor_time() - begun
    if told["dropped"] or told["kind"] != "wasm" or visit.log:
        raise SystemExit(f"the browser plays something else: {told}, {visit.log}")
    return MODES * seconds / spent


def in_python(*, pushed: bool, seconds: float) -> float:
    """Return how many modes go in real time, by Python's bank on the same core."""
    rng = np.random.default_rng(1)

    class Modes:
        frequencies = rng.uniform(40, 20000, EACH)
        decays = rng.uniform(0.2, 0.8, EACH)

    bank = Resonators([Modes()], sample_rate=RATE, block=BLOCK)
    outputs = rng.normal(size=(1, EACH)) + 1j * rng.normal(size=(1, EACH))
    push = Push(force=np.ones(BLOCK), drive=rng.normal(size=EACH))
    bank.process([push], [outputs])
    bank.process([push] if pushed else [])
    count = round(seconds * MODES / EACH * RATE / BLOCK)
    begun = time.process_time()
    for _ in range(count):
        bank.process([push] if pushed else [])
    return MODES * seconds / (time.process_time() - begun)


def measure_speed(visit: Visit, rounds: int) -> list[str]:
    """Print modes in real time, and return what is missed."""
    missed = []
    for pushed, wanted in ((True, PUSHED), (False, RINGING)):
        found: dict[str, list[float]] = {"page": [], "python": []}
        for _ in range(rounds):
            found["page"].append(in_the_browser(visit, pushed=pushed, seconds=2.0))
            found["python"].append(in_python(pushed=pushed, seconds=0.5))
        page, python = (statistics.median(found[name]) for name in ("page", "python"))
        least = min(wanted, SHARE * python)
        what = "pushed, complex outputs" if pushed else "ringing, complex outputs"
        met = "met" if page >= least else "MISSED"
        print(f"{what:26} page {page:9,.0f}  python {python:9,.0f}  least {least:9,.0f}  {met}")
        missed += [what] * (page < least)
    return missed


def measure_clock(visit: Visit, seconds: float) -> list[str]:
    """Print underruns and delays of real-time scenes, and return what is missed.

    A machine that stops threads for milliseconds loses sound of any page: where a scene of one body
    does, which takes no time, underruns of the others are left open.
    """
    scene: dict[str, Any] = {"rate": RATE, "modes": 60, "seconds": seconds}
    alone = visit.run(CLOCK, ears="mono", bodies=1, **scene)["underruns"]
    print(f"1 body, {seconds:g} s: {alone} underruns, which are the machine's")
    missed = []
    for ears, bodies in BODIES.items():
        told = visit.run(CLOCK, ears=ears, bodies=bodies, **scene)
        load, delay = statistics.median(told["loads"]), statistics.median(told["delays"])
        whole = told["ears"] == ears and told["ringing"] == bodies and not told["dropped"]
        good = whole and not told["underruns"]
        verdict = "met" if good else "OPEN" if whole and alone else "MISSED"
        print(
            f"{bodies} bodies, {told['ears']:8} {seconds:g} s: {told['underruns']} underruns, "
            f"{told['ringing']} ringing, load {load:.0%} (most {max(told['loads']):.0%}): {verdict}"
        )
        worst, met = max(told["delays"]), "met" if delay <= LATENCY else "MISSED"
        print(f"  click to first sample {delay * 1e3:.1f} ms (worst {worst * 1e3:.1f}): {met}")
        missed += [f"{bodies} bodies"] * (verdict == "MISSED") + ["click"] * (delay > LATENCY)
    return missed


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=60.0, help="of the scenes on the clock")
    given = parser.parse_args()
    path = chromium()
    if path is None:
        raise SystemExit("there is no Chromium on the path: install one")
    print(f"{peak.machine()}; how many modes: one core for the browser and for Python in turn")
    site = Site()
    site.given[f"/static/heads/kemar-{RATE}.bin"] = head_bytes("kemar", RATE)
    every = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set[int]()
    missed: list[str] = []
    with sync_playwright() as playwright:
        # On the clock its sound has a core, while windows and clicks have another.
        for cores, measure in (
            ({max(every, default=0)}, lambda visit: measure_speed(visit, given.rounds)),
            (every, lambda visit: measure_clock(visit, given.seconds)),
        ):
            if every:
                os.sched_setaffinity(0, cores)
            browser = playwright.chromium.launch(executable_path=path, args=ALONE.split())
            with visiting(browser, site) as visit:
                missed += measure(visit)
            browser.close()
    print("none missed" if not missed else f"MISSED: {', '.join(missed)}")


if __name__ == "__main__":
    main()
