"""How long `import struck` takes beside `import numpy`, and first uses beside second ones."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

TARGET = 2.0
_LINES = {
    "import numpy": ("-c", "import numpy"),
    "import struck": ("-c", "import struck"),
    "import struck; struck.analyze": ("-c", "import struck; struck.analyze"),
    "struck --help": ("-m", "struck", "--help"),
}


# What is done twice in a fresh process, after what it needs is there.
_FIRSTS = {
    "scrape": """
scrape = struck.Scrape(path=[(0.05,), (0.2,)], speed=0.1, load=1.0, roughness="sandpaper")
def use(): struck.render(bar, scrape, seconds=1)
""",
    "touch": """
roll = struck.Roll(path=[(0.05,), (0.2,)], radius=0.01, speed=0.1, mass=0.05)
def use(): struck.render(bar, roll, seconds=1)
""",
    "live strike": """
import ctypes
class Outlet:
    name, sample_rate, channels, load, latency, active = "none", 48000.0, 2, 0.0, 0.0, True
    def open(self, callback, shared, block):
        place = ctypes.c_void_p
        word = ctypes.c_ulong
        kind = ctypes.CFUNCTYPE(ctypes.c_int, place, place, word, place, word, place)
        self.call, self.shared = kind(callback), shared
    def start(self): pass
    def close(self): pass
def use():
    outlet = Outlet()
    frames = np.zeros((128, 2), np.float32)
    with struck.live.Player([bar], outlet=outlet) as player:
        player.begin()
        player.strike()
        for _ in range(20):
            outlet.call(None, frames.ctypes.data, 128, None, 0, outlet.shared.address)
""",
    "fit": """
sound = struck.render(bar, struck.Strike(), seconds=1)
def use(): struck.fit([sound], cache=False)
""",
}
_BEFORE = """
import time, numpy as np, scipy.signal, scipy.spatial.transform
import struck, struck.live, struck.recordings
struck.synth.Resonators, struck.Scrape, struck.Roll
from struck.shapes import Bar
shape = Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
bar = struck.analyze(shape, "steel")
"""
_AFTER = """
taken = []
for _ in range(3):
    begun = time.process_time(); use(); taken.append(time.process_time() - begun)
print(taken[0] - min(taken[1:]))
"""
LATER = 0.5  # s of processor time, imports among them


def show_first_uses() -> None:
    """Print what the first use of each takes above the second, in a fresh process."""
    for name, program in _FIRSTS.items():
        command = [sys.executable, "-W", "ignore", "-c", _BEFORE + program + _AFTER]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        above = float(done.stdout)
        verdict = "met" if above <= LATER else "MISSED"
        print(f"first {name}: {above:.2f} s above the next, at most {LATER:g} s: {verdict}")


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
    show_first_uses()
