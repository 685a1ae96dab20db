"""Others that play a bank of 256 modes: each as fast as it goes, under noise at every sample.

Faust and STK are compiled here, for this very machine, and called block by block as we are; it is
the compiler's whole -ffast-math for Faust, but not when linking, which would change how all of the
process rounds. SuperCollider and Csound are programs: a long run less one of a second.
"""

from __future__ import annotations

import ctypes
import resource
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import supercollider
from numpy.typing import NDArray

RATE, BLOCK, MODES = 48_000, 128, 256
_PLACES = np.arange(MODES) / (MODES - 1)
FREQUENCIES = 30.0 * 600.0**_PLACES
T60 = 0.2 + 3 * (1 - _PLACES)
DECAYS = np.log(1000) / T60
FAUST, KLANK, CSOUND = "Faust", "SuperCollider Klank", "Csound mode"
STK, LFILTER = "STK BiQuad", "scipy.signal.lfilter"
# How much is played in a turn, s.
_KLANK_SECONDS, _CSOUND_SECONDS = 30, 10

Call = Callable[[], object]
"""Makes a block."""
Measure = Callable[[], float]
"""Plays and returns the processor time of a block, s."""

PACKAGES = {
    FAUST: "faust g++",
    KLANK: "supercollider-server",
    CSOUND: "csound",
    STK: "libstk-dev g++",
}


def missing() -> dict[str, str]:
    """Return which peers are not here, and how to install each."""
    compiler = shutil.which("g++") is not None
    there = {
        FAUST: compiler and shutil.which("faust") is not None,
        KLANK: shutil.which("scsynth") is not None,
        CSOUND: shutil.which("csound") is not None,
        STK: compiler and _has_header("stk/BiQuad.h"),
    }
    return {
        name: f"on Debian, apt-get install {PACKAGES[name]}" for name in there if not there[name]
    }


def _has_header(name: str) -> bool:
    done = subprocess.run(
        ["g++", "-fsyntax-only", "-x", "c++", "-"],  # noqa: S607 - whichever is on PATH
        input=f"#include <{name}>\n",
        text=True,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    return done.returncode == 0


# name: (number, how faust writes the program). Of -vs 8, 16, 24, 32, 64 and 128 the fastest, and
# of 8, 16 and 32 in double precision.
_FAUST_FORMS = {
    f"{FAUST} -vec -vs 16": ("float", ["-vec", "-vs", "16"]),
    f"{FAUST}, scalar": ("float", []),
    f"{FAUST} -double -vec -vs 8": ("double", ["-double", "-vec", "-vs", "8"]),
    f"{FAUST} -double, scalar": ("double", ["-double"]),
}
# What pm.modalModel(n, frequencies, t60s, gains) comes to, without its search through lists.
_FAUST_PROGRAM = f"""
pm = library("physmodels.lib");
frequency(i) = 30 * pow(600, i / {MODES - 1});
t60(i) = 0.2 + 3 * (1 - i / {MODES - 1});
process = _ <: par(i, {MODES}, pm.modeFilter(frequency(i), t60(i), 1 / {MODES})) :> _;
"""
_FAUST_WRAPPER = """
#define FAUSTFLOAT {number}
struct Meta {{ void declare(const char*, const char*) {{}} }};
struct UI {{ void openVerticalBox(const char*) {{}} void closeBox() {{}} }};
struct dsp {{ virtual ~dsp() {{}} }};
#include "{program}"
extern "C" void* start() {{ mydsp* bank = new mydsp(); bank->init({rate}); return bank; }}
extern "C" void play(void* bank, int count, {number}* in, {number}* out) {{
    static_cast<mydsp*>(bank)->compute(count, &in, &out);
}}
"""


def faust(folder: Path) -> Iterator[tuple[str, Call]]:
    """Compile Faust's bank in each of its forms (a minute or two)."""
    program = folder / "bank.dsp"
    program.write_text(_FAUST_PROGRAM, encoding="ascii")
    for place, (name, (number, options)) in enumerate(_FAUST_FORMS.items()):
        written = folder / f"bank{place}.cpp"
        _run("faust", "-lang", "cpp", *options, program, "-o", written)
        source = _FAUST_WRAPPER.format(number=number, program=written.name, rate=RATE)
        yield name, _compiled(folder / f"faust{place}", source, number, "-ffast-math")


_STK_WRAPPER = """
#include <stk/BiQuad.h>
#include <cmath>
#include <vector>
using Bank = std::vector<stk::BiQuad>;
extern "C" void* start() {{
    stk::Stk::setSampleRate({rate});
    Bank* bank = new Bank({modes});
    for (int i = 0; i < {modes}; ++i) {{
        double place = i / ({modes} - 1.0), t60 = 0.2 + 3 * (1 - place);
        (*bank)[i].setResonance(30 * std::pow(600, place), std::pow(0.001, 1 / (t60 * {rate})));
    }}
    return bank;
}}
extern "C" void play(void* bank, int count, double* in, double* out) {{
    for (int k = 0; k < count; ++k) {{
        double sum = 0;
        for (auto& filter : *static_cast<Bank*>(bank)) sum += filter.tick(in[k]);
        out[k] = sum / {modes};
    }}
}}
"""


def stk(folder: Path) -> Iterator[tuple[str, Call]]:
    """Compile a bank of STK's filters, as its own Modal has one."""
    source = _STK_WRAPPER.format(rate=RATE, modes=MODES)
    yield STK, _compiled(folder / "stk", source, "double", libraries=("-lstk",))


def _compiled(
    path: Path, source: str, number: str, *options: str, libraries: tuple[str, ...] = ()
) -> Call:
    """Return a call of a C++ bank: `start` makes it, `play` fills a block."""
    code, thing, library = (path.with_suffix(end) for end in (".cc", ".o", ".so"))
    code.write_text(source, encoding="ascii")
    _run("g++", "-c", "-fPIC", "-O3", "-march=native", *options, code, "-o", thing)
    _run("g++", "-shared", thing, *libraries, "-o", library)
    loaded = ctypes.CDLL(str(library))
    loaded.start.restype = ctypes.c_void_p
    loaded.play.argtypes = (ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    bank, kind = loaded.start(), np.dtype(np.float64 if number == "double" else np.float32)
    kept = force, sound = noise().astype(kind), np.zeros(BLOCK, kind)
    places = force.ctypes.data, sound.ctypes.data

    def call() -> object:
        loaded.play(bank, BLOCK, *places)
        return kept  # which must live as long as this can be called

    return call


def _run(*command: str | Path) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def noise() -> NDArray[np.float64]:
    """Return a block of noise."""
    return np.random.default_rng(1).standard_normal(BLOCK)


def lfilter() -> Iterator[tuple[str, Call]]:
    """Filter mode after mode by SciPy."""
    from scipy.signal import lfilter as filtered

    radii, force = np.exp(-DECAYS / RATE), noise()
    numerator = np.array([1.0, 0.0, -1.0]) / MODES
    denominators = np.stack(
        [np.ones(MODES), -2 * radii * np.cos(2 * np.pi * FREQUENCIES / RATE), radii**2], axis=1
    )
    states = np.zeros((MODES, 2))

    def call() -> NDArray[np.float64]:
        sound = np.zeros(BLOCK)
        for n in range(MODES):
            heard, states[n] = filtered(numerator, denominators[n], force, zi=states[n])
            sound += heard
        return sound

    yield LFILTER, call


def klank(folder: Path) -> Measure:
    """Write scores for SuperCollider's server, which then plays without a sound card."""

    def command(seconds: int) -> list[str]:
        score, sound = folder / f"{seconds}.osc", folder / "klank.wav"
        score.write_bytes(supercollider.score(FREQUENCIES, T60, seconds))
        quiet = ["-V", "-1", "-D", "0", "-z", str(BLOCK), "-o", "1"]
        return ["scsynth", *quiet, "-N", str(score), "_", str(sound), str(RATE), "WAV", "float"]

    return _program(command, _KLANK_SECONDS)


def csound(folder: Path) -> Measure:
    """Write scores for Csound."""

    def command(seconds: int) -> list[str]:
        path = folder / f"{seconds}.csd"
        path.write_text(_CSOUND.format(**_csound_parts(), seconds=seconds), encoding="ascii")
        return ["csound", str(path)]

    return _program(command, _CSOUND_SECONDS)


_CSOUND = """<CsoundSynthesizer>
<CsOptions>
-n -d -m0
</CsOptions>
<CsInstruments>
sr = {rate}
ksmps = {block}
nchnls = 1
0dbfs = 1
instr 1
aforce rand 0.01
{modes}
out ({total}) / {count}
endin
</CsInstruments>
<CsScore>
i 1 0 {seconds}
</CsScore>
</CsoundSynthesizer>
"""


def _csound_parts() -> dict[str, object]:
    qualities = np.pi * FREQUENCIES / DECAYS
    modes = (
        f"a{n} mode aforce, {frequency:.6f}, {quality:.6f}"
        for n, (frequency, quality) in enumerate(zip(FREQUENCIES, qualities, strict=True))
    )
    total = " + ".join(f"a{n}" for n in range(MODES))
    return {
        "rate": RATE,
        "block": BLOCK,
        "count": MODES,
        "modes": "\n".join(modes),
        "total": total,
    }


def _program(command: Callable[[int], list[str]], seconds: int) -> Measure:
    """Return how to measure a program: a long run less one of a second."""
    long, short = command(1 + seconds), command(1)
    return lambda: (_spent(long) - _spent(short)) * BLOCK / (seconds * RATE)


def _spent(command: list[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
