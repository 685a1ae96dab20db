"""Compilation of the core's C files into shared libraries, by the C compiler in ``ziglang``.

Installation runs this. In a source tree ``python src/struck/core/build.py`` compiles again after a
C file has changed, for this machine and for the page (``core.wasm``); it needs the package
``ziglang``. Only the standard library is used, as the build backend runs this file by its path.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
LIBRARIES = HERE / "libraries"
# Sums may be taken in any order, and products join sums; NaN and infinity stay what they are.
SUMS = ("-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-ffp-contract=fast")
COMMON = ("-std=c11", "-O3", "-fno-math-errno", "-fno-sanitize=all", "-fvisibility=hidden", "-g0")
WARNINGS = ("-Wall", "-Wextra", "-Werror")
# Files without rearranged arithmetic: each step rounds as written.
STRICT_FILES = frozenset({"limiter", "queue", "callback", "recorder"})
# What the page runs, and how: small code, except for the loops that take most of the time. With
# -Os, ears took three times as long to save 400 bytes.
LOOPS, FEW_BYTES = ("-O2",), ("-Os", "-DSCALAR")
PAGE = {
    "bank": LOOPS,
    "block": FEW_BYTES,
    "delay_lines": LOOPS,
    "limiter": FEW_BYTES,
    "version": FEW_BYTES,
}
PAGES = "wasm32"  # its platform
# How libraries are linked, by their endings; that of the page imports nothing, and so needs no C
# library, which would take a minute to compile.
LINK_FLAGS = {
    ".so": ("-shared", "-lm"),
    ".dylib": ("-shared", "-lm"),
    ".dll": ("-shared",),
    ".wasm": (
        "-nostdlib",
        "-lcompiler_rt",
        "-Wl,--no-entry,--export-dynamic,--strip-all,-z,stack-size=65536",
    ),
}


@dataclass(frozen=True)
class Target:
    """A processor and a system that the core is compiled for."""

    name: str  # of the library, without its ending
    triple: str  # as zig calls processor, system and C library
    processor: str  # the oldest one on which the library runs
    ending: str


def _x86(system: str, ending: str) -> list[Target]:
    return [
        Target(f"core_v{level}", f"x86_64-{system}", f"x86_64_v{level}", ending)
        for level in (2, 3, 4)
    ]


TARGETS: dict[str, list[Target]] = {
    "linux-x86_64": _x86("linux-gnu.2.17", ".so"),
    "linux-aarch64": [Target("core_arm", "aarch64-linux-gnu.2.17", "generic", ".so")],
    "macos-x86_64": _x86("macos.12.0", ".dylib"),
    "macos-arm64": [Target("core_arm", "aarch64-macos.12.0", "apple_m1", ".dylib")],
    "windows-x86_64": _x86("windows-gnu", ".dll"),
    PAGES: [Target("core", "wasm32-wasi", "generic+simd128", ".wasm")],
}


def this_platform() -> str:
    """Return the name of the platform that Python runs on, as in `TARGETS` or not in it."""
    system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = platform.machine().lower().replace("amd64", "x86_64")
    if system == "macos" and machine == "aarch64":
        machine = "arm64"
    return f"{system}-{machine}"


def sources(target: Target) -> list[Path]:
    """Return the C files that a library is made of."""
    files = sorted(HERE.glob("*.c"))
    return [path for path in files if target.ending != ".wasm" or path.stem in PAGE]


def fingerprint() -> int:
    """Return a number of 63 bits that changes with every C file, header and flag."""
    digest = hashlib.sha256(repr((SUMS, COMMON, sorted(STRICT_FILES), PAGE)).encode())
    for path in sorted((*HERE.glob("*.c"), *HERE.glob("*.h"))):
        digest.update(path.name.encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return int.from_bytes(digest.digest()[:8], "little") >> 1


def compiler() -> list[str]:
    """Return the command of the C compiler."""
    return [sys.executable, "-P", "-m", "ziglang", "cc"]


def build(
    name: str, folder: Path = LIBRARIES, *, run: Callable[[list[str]], None] | None = None
) -> list[Path]:
    """Compile all libraries of a platform into a folder; return their paths.

    Raises
    ------
    RuntimeError
        Where the compiler is missing or finds a fault.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        libraries = [
            _library(target, Path(scratch), run or _run) for target in TARGETS.get(name, [])
        ]
        places = [folder / path.name for path in libraries]
        for path, place in zip(libraries, places, strict=True):
            part = place.with_name(f".{place.name}.{os.getpid()}")
            shutil.copyfile(path, part)
            part.replace(place)
    return places


def _library(target: Target, scratch: Path, run: Callable[[list[str]], None]) -> Path:
    commands = list(_compilations(target, scratch))
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(run, commands))
    library = scratch / f"{target.name}{target.ending}"
    # The processor is not named here: what zig compiles for a system alone serves all its
    # libraries.
    link = ["-target", target.triple.replace("wasi", "freestanding"), "-s", "-o", str(library)]
    if target.ending == ".dylib":  # which is called as it was made, unless it has a name
        link += [f"-Wl,-install_name,@rpath/{library.name}"]
    run([*compiler(), *link, *_objects(target, scratch), *LINK_FLAGS[target.ending]])
    return library


def _objects(target: Target, scratch: Path) -> Iterator[str]:
    return (str(scratch / f"{target.name}_{source.stem}.o") for source in sources(target))


def _compilations(target: Target, scratch: Path) -> Iterable[list[str]]:
    for source, object_path in zip(sources(target), _objects(target, scratch), strict=True):
        sums = ("-ffp-contract=off",) if source.stem in STRICT_FILES else SUMS
        size = PAGE[source.stem] if target.ending == ".wasm" else ()
        position = ("-fPIC",) if target.ending in {".so", ".dylib"} else ()
        options = (*COMMON, *WARNINGS, *sums, *size, *position, f"-DFINGERPRINT={fingerprint()}LL")
        aim = ("-target", target.triple, f"-mcpu={target.processor}")
        yield [*compiler(), *aim, *options, "-c", str(source), "-o", object_path]


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - zig
    if "No module named ziglang" in result.stderr:
        raise RuntimeError(
            "the C compiler of the package ziglang is missing: pip install ziglang (it needs the "
            "network once), or install a finished wheel of struck"
        )
    if result.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{result.stderr}")


if __name__ == "__main__":
    here = [this_platform(), PAGES]
    for each in sys.argv[1:] or here:
        for made in build(each, LIBRARIES if each in here else LIBRARIES / each):
            print(made)  # noqa: T201 - a command
