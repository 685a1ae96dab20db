"""The core under the sanitizers of a system's compiler, and between pages nobody may touch."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from struck import core as binding
from struck.core import build

pytestmark = pytest.mark.prove

ROOT = Path(__file__).parents[2]
CALLS, SEEDS = 10_000, 150
FOUND = ("runtime error", "Sanitizer")
TESTS = ("tests/core", "tests/ears/test_delay_lines.py", "tests/live/test_callback_memory.py",
         "tests/live/test_ring.py", "tests/synth/test_resonators.py")  # fmt: skip
PROBE = """
typedef double two __attribute__((vector_size(16)));
two turned(two a) { return __builtin_shufflevector(a, a, 1, 0); }
int main(void) { return 0; }
"""
TWO_THREADS = """
#include <pthread.h>
#include <stdio.h>
#include "callback.h"
#include "queue.h"

void queue_publish(int64_t *memory);
int callback_play(const void *, float *, unsigned long, const void *, unsigned long,
                  struct shared *);
enum { RECORDS = 100000, SLOTS = 4, WIDTH = 3 };
static int64_t memory[HEAD + SLOTS * 2 * WIDTH] = {SLOTS, WIDTH, WIDTH};
static int64_t counters[8], read, spoiled;
static double state[26] = {[3] = 1, 1, 2, 1, 2, 1}, mix[1]; /* the shortest limiter */

static void *write_all(void *unused) {
  for (int64_t number = 0; number < RECORDS; number++) {
    while (queue_waiting(memory) == SLOTS) sched_yield();
    int64_t *integers = (int64_t *)integers_of(memory, number);
    double *reals = (double *)reals_of(memory, number);
    for (int n = 0; n < WIDTH; n++) integers[n] = reals[n] = (double)(number + n);
    queue_publish(memory);
    release(counters + OPEN, number % 2);
  }
  return unused;
}

static void look(void *unused, const int64_t *integers, const double *reals, int64_t fresh,
                 double *outputs, int64_t channels) {
  read += fresh;
  for (int n = 0; n < WIDTH; n++)
    spoiled += integers[n] != read - 1 + n || reals[n] != (double)(read - 1 + n);
  outputs[0] = 0;
}

int main(int count, char **names) {
  float played[1];
  struct shared shared = {memory, state, 26, 0, mix, counters, 1, 1, look};
  pthread_t writer;
  pthread_create(&writer, 0, write_all, 0);
  while (read < RECORDS)
    if (count > 1) {
      callback_play(0, played, 1, 0, 0, &shared);
      sched_yield();
    } else {
      while (queue_waiting(memory) == 0) sched_yield();
      look(0, integers_of(memory, read), reals_of(memory, read), 1, mix, 1);
      queue_release(memory);
    }
  pthread_join(writer, 0);
  printf("%d spoiled\\n", (int)spoiled);
  return spoiled != 0;
}
"""


def run(
    *command: str, folder: Path = ROOT, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT / "src"), str(ROOT)))}
    return subprocess.run(
        command, cwd=folder, env=os.environ | paths | dict(environment or {}),
        capture_output=True, text=True, check=False, timeout=900,
    )  # fmt: skip


def gcc(folder: Path, *sanitizers: str) -> tuple[str, ...]:
    """Return the command of a compiler with these sanitizers, which has been tried; or skip."""
    command = ["gcc", "-std=gnu11", "-g", "-w", f"-I{build.HERE}"]
    command += [f"-fsanitize={','.join(sanitizers)}", "-fno-sanitize-recover=all"]
    if sys.platform != "linux" or not shutil.which("gcc"):
        pytest.skip("no gcc on Linux: its sanitizers are not there")
    (folder / "probe.c").write_text(PROBE)
    made = run(*command, "probe.c", "-o", "probe", folder=folder)
    if made.returncode or run("./probe", folder=folder).returncode:
        pytest.skip(f"gcc has no {', '.join(sanitizers)}, or no vectors (12 has): {made.stderr}")
    return tuple(command)


def level() -> int:
    compiled = binding.entry("core_level")
    return compiled() if compiled else 0


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What lets a program use a core that addresses and arithmetic are checked in.

    It is of the narrowest vectors, since gcc takes five times as long for the widest, which the
    tests with guarded pages below load.
    """
    folder = tmp_path_factory.mktemp("core")
    command = gcc(folder, "address", "undefined", "float-cast-overflow")
    options = ["-O1", "-fPIC", "-shared", "-fno-math-errno", "-fno-omit-frame-pointer"]
    options += ["-march=x86-64-v2"] if level() else []
    sources = [str(path) for path in sorted(build.HERE.glob("*.c"))]
    number = f"-DFINGERPRINT={build.fingerprint()}LL"
    made = run(*command, *options, number, *sources, "-lm", "-o", "core.so", folder=folder)
    assert made.returncode == 0, made.stderr
    runtime = run("gcc", "-print-file-name=libasan.so").stdout.strip()
    return {
        "CORE_UNDER_TEST": str(folder / "core.so"), "LD_PRELOAD": runtime,
        "ASAN_OPTIONS": "detect_leaks=0", "PYTHONMALLOC": "malloc",
    }  # fmt: skip


def require_nothing_found(done: subprocess.CompletedProcess[str]) -> None:
    said = done.stdout + done.stderr
    assert done.returncode == 0, said[-5000:]
    assert not [word for word in FOUND if word in said], said[-5000:]


def test_tests_of_the_core_find_nothing(checked: dict[str, str]) -> None:
    left_out = [f"--ignore=tests/core/test_{name}.py" for name in ("sanitizers", "binding")]
    options = ["-q", "-p", "no:cacheprovider", "-p", "tests.core.sanitized", *left_out]
    done = run(sys.executable, "-m", "pytest", *options, *TESTS, environment=checked)
    require_nothing_found(done)
    assert " passed" in done.stdout


def sanitized(program: str, checked: dict[str, str]) -> subprocess.CompletedProcess[str]:
    program = f"import tests.core.sanitized\nfrom tests.core import guarded\n{program}"
    return run(sys.executable, "-c", program, environment=checked)


def test_calls_by_chance_find_nothing(checked: dict[str, str]) -> None:
    require_nothing_found(sanitized(f"guarded.main('plain', {SEEDS})", checked))


BEYOND = """
import numpy as np
from struck import core as binding
table, found = np.zeros((2, 13, 512)), np.zeros((3, 512))
binding.entry("bessel_series_sum")(3 + {ahead}, 512, np.ones(3 + {ahead}), table, found)
"""


def test_a_step_beyond_an_array_is_seen_by_the_sanitizer(checked: dict[str, str]) -> None:
    assert "Sanitizer" not in sanitized(BEYOND.format(ahead=0), checked).stderr
    assert "heap-buffer-overflow" in sanitized(BEYOND.format(ahead=1), checked).stderr


@pytest.mark.parametrize("how", ["first", "last"])
@pytest.mark.parametrize("core", ["v2", ""])
def test_calls_by_chance_touch_nothing_beside_their_arrays(how: str, core: str) -> None:
    if sys.platform == "win32" or not level():
        pytest.skip("pages are guarded as POSIX does, for the cores of x86-64")
    program = [sys.executable, "-X", "faulthandler", "-m", "tests.core.guarded"]
    done = run(*program, how, str(SEEDS), environment={"STRUCK_CORE": core})
    assert done.returncode == 0, done.stderr[-5000:]
    counts = json.loads(done.stdout)
    assert counts.keys() == {name for name in binding.SIGNATURES if not name.startswith("core_")}
    assert sum(counts.values()) >= CALLS


@pytest.mark.parametrize("how", ["first", "last"])
def test_a_step_beyond_an_array_is_seen_by_the_pages(how: str) -> None:
    if sys.platform == "win32":
        pytest.skip("pages are guarded as POSIX does")
    program = f"from tests.core import guarded\nguarded.install(last={how == 'last'})\n{BEYOND}"
    assert run(sys.executable, "-c", program.format(ahead=0)).returncode == 0
    assert run(sys.executable, "-c", program.format(ahead=1)).returncode != 0


@pytest.mark.parametrize("order", ["", "-D__ATOMIC_RELEASE=__ATOMIC_RELAXED"])
@pytest.mark.parametrize("reader", [(), ("callback",)])
def test_the_queue_has_no_race(tmp_path: Path, order: str, reader: tuple[str, ...]) -> None:
    command = gcc(tmp_path, "thread")
    (tmp_path / "threads.c").write_text(TWO_THREADS)
    sources = [str(build.HERE / f"{name}.c") for name in ("queue", "callback", "limiter")]
    # What makes a block is not called here, and left out.
    left_out = ["-ffunction-sections", "-Wl,--gc-sections"]
    options = ["-O1", "-pthread", *left_out, *order.split()]
    made = run(*command, *options, "threads.c", *sources, "-lm", "-o", "threads", folder=tmp_path)
    assert made.returncode == 0, made.stderr
    done = run("./threads", *reader, folder=tmp_path)
    if order:  # a weaker order is seen
        assert "data race" in done.stderr
    else:
        require_nothing_found(done)
        assert done.stdout == "0 spoiled\n"
