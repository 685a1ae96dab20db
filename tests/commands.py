"""The program run in a process of its own, and the memory it took."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
