"""How long `import struck` takes beside `import numpy`, and the command beside both."""

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
