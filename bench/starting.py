"""How long `import struck` takes beside `import numpy`, and the first minutes step by step."""

from __future__ import annotations

import importlib.util
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]

TARGET = 2.0
_LINES = {
    "import numpy": ("-c", "import numpy"),
    "import struck": ("-c", "import struck"),
    "import struck; struck.analyze": ("-c", "import struck; struck.analyze"),
    "struck --help": ("-m", "struck", "--help"),
}


# The first minutes of a person, step by step, each done again twice with another number.
_STEPS = {
    "strike": """
def use(n):
    tube = Tube(length=0.5 + 0.01 * n, radius=0.0125, wall=0.001)
    chime = struck.analyze(tube, "aluminium", accuracy="preview", cache=False)
    struck.render(chime, struck.Strike(at="end"), seconds=2).save("chime.wav")
""",
    "scrape": """
bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="free"), "steel")
def use(n):
    scrape = struck.Scrape(path=[(0.05,), (0.2,)], speed=0.1, load=1.0, seed=n)
    struck.render(bar, scrape, seconds=1)
""",
    "roll": """
def use(n):
    roll = struck.Roll(path=[(0.05,), (0.2,)], radius=0.01, speed=0.1, mass=0.05, seed=n)
    struck.render(bar, roll, seconds=1)
""",
    "fit": """
sound = struck.render(bar, struck.Strike(at="end"), seconds=1)
def use(n): struck.fit([sound], cache=False)
""",
    "live": """
import ctypes, numpy as np
class Outlet:
    name, sample_rate, channels, load, latency, active = "none", 48000.0, 2, 0.0, 0.0, True
    def open(self, callback, shared, block):
        place, word = ctypes.c_void_p, ctypes.c_ulong
        kind = ctypes.CFUNCTYPE(ctypes.c_int, place, place, word, place, word, place)
        self.call, self.shared = kind(callback), shared
    def start(self): pass
    def close(self): pass
def use(n):
    import struck.live
    outlet = Outlet()
    frames = np.zeros((128, 2), np.float32)
    with struck.live.Player([bar], outlet=outlet) as player:
        player.begin()
        player.strike()
        for _ in range(20):
            outlet.call(None, frames.ctypes.data, 128, None, 0, outlet.shared.address)
""",
    "picture": """
def use(n): struck.show(bar, f"bar{n}.png")
""",
}
_BEGIN = """
import os, sys
def spent(): return sum(os.times()[:4])
begun = spent()
import struck
from struck.shapes import Bar
from struck.solids import Tube
struck.analyze, struck.render
print("import", spent() - begun, flush=True)
"""
_STEP = """
taken = []
for n in range(3):
    begun = spent(); use(n); taken.append(spent() - begun)
print("{name}", *taken, flush=True)
"""
LATER = 1.0  # s of processor time that a first use takes above the next, imports among them


def spent_by_children() -> float:
    """Return the processor time of all children so far, s."""
    return sum(os.times()[2:4])


def install(folder: Path) -> None:
    """Install struck from this clone into a folder; print the processor time."""
    alone = all(importlib.util.find_spec(name) for name in ("hatchling", "ziglang"))
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    command += ["--disable-pip-version-check", "--target", str(folder), str(ROOT)]
    begun = spent_by_children()
    subprocess.run(
        [*command, *(["--no-build-isolation", "--no-index"] if alone else [])], check=True
    )
    print(f"{'install':10} {spent_by_children() - begun:6.2f} s of a processor")


def show_first_minutes() -> None:
    """Print what each step takes in an empty folder for the first time and for the second."""
    program = _BEGIN + "".join(
        each + _STEP.replace("{name}", name) for name, each in _STEPS.items()
    )
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        install(place / "installed")
        given = {"PYTHONPATH": str(place / "installed"), "STRUCK_CACHE": str(place / "cache")}
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", program],
            cwd=place,
            env=os.environ | given | {"MPLBACKEND": "Agg"},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    for line in done.stdout.splitlines():
        name, first, *later = line.split()
        if not later:
            print(f"{name:10} {float(first):6.2f} s of a processor")
            continue
        above = float(first) - min(map(float, later))
        verdict = "met" if above <= LATER else "MISSED"
        print(
            f"{name:10} {float(first):6.2f} s, again {float(later[0]):.2f} s: "
            f"{above:.2f} s above, at most {LATER:g} s: {verdict}"
        )


def show(turns: int = 7) -> None:
    """Let fresh interpreters take turns; print medians and whether the target is met."""
    times: dict[str, list[float]] = {line: [] for line in _LINES}
    for _ in range(turns):
        for line, arguments in _LINES.items():
            begun = time.perf_counter()
            subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
            times[line].append(time.perf_counter() - begun)
    for line, taken in times.items():
        print(f"{line:32} {1e3 * statistics.median(taken):6.0f} ms")
    ours, numpy = (statistics.median(times[f"import {name}"]) for name in ("struck", "numpy"))
    verdict = "met" if ours <= TARGET * numpy else "MISSED"
    print(f"import struck at most {TARGET:g} times import numpy: {ours / numpy:.2f}, {verdict}\n")


if __name__ == "__main__":
    show()
    show_first_minutes()
