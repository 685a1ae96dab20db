"""The program run in a process of its own, its input files, and the memory it took."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh

import struck

# A child tells its own peak, as Linux counts it anew for each program: what getrusage tells begins
# with that of the process it was started from.
RUN = """
import pathlib, re, sys
from struck.cli import main
code = main(sys.argv[1:])
status = pathlib.Path("/proc/self/status").read_text()
print(re.findall(r"VmHWM:\\s*(\\d+)", status)[0], file=sys.stderr)
raise SystemExit(code)
"""


def write_inputs(folder: Path) -> Path:
    """Write a model, a recording of it and a mesh into a folder, and return it."""
    bar = struck.analyze(struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    struck.save(bar, folder / "bar.struck")
    sound = struck.render(bar, struck.Strike(at=(0.02,), time=0.5), seconds=1.5)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(sound.samples.shape)
    samples = (0.5 * sound.samples / sound.peak + noise).astype(np.float32)
    struck.Sound(samples=samples, sample_rate=48_000).save(folder / "tap.wav")
    trimesh.creation.icosphere(subdivisions=2, radius=0.08).export(folder / "ball.stl")
    return folder


def run(folder: Path, *arguments: str) -> int:
    """Run a command in a process of its own and return its peak memory, bytes."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, *arguments],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    return 1024 * int(done.stderr.split()[-1])
