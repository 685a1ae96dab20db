"""Wheels of five platforms, built here; the one of this machine is installed and used."""

from __future__ import annotations

import os
import platform
import re
import struct
import subprocess
import sys
import time
import venv
import zipfile
from pathlib import Path

import pytest

from struck.core.build import HERE, this_platform

ROOT = Path(__file__).parents[2]
X86 = ("core_v2", "core_v3", "core_v4")
# By platform: the tag of the wheel, its libraries, their ending.
WHEELS = {
    "linux-x86_64": ("manylinux_2_17_x86_64.manylinux2014_x86_64", X86, ".so"),
    "linux-aarch64": ("manylinux_2_17_aarch64.manylinux2014_aarch64", ("core_arm",), ".so"),
    "macos-x86_64": ("macosx_12_0_x86_64", X86, ".dylib"),
    "macos-arm64": ("macosx_12_0_arm64", ("core_arm",), ".dylib"),
    "windows-x86_64": ("win_amd64", X86, ".dll"),
}
# What libraries may need of a system: part of every one of its kind.
NEEDED = {
    ".so": {b"libc.so.6", b"libm.so.6", b"ld-linux-x86-64.so.2", b"ld-linux-aarch64.so.1"},
    ".dylib": {b"/usr/lib/libSystem.B.dylib", b"/usr/lib/dyld"},
    ".dll": {b"KERNEL32.dll", b"ntdll.dll"},
}
MEGABYTES, WITH_PAGE = 450, 6_000_000
SERVE = """if True:
    import pathlib, urllib.request
    from http.cookiejar import CookieJar
    import struck, struck.explorer
    bar = struck.analyze(struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    with struck.explore(bar, browser=False, wait=False) as served:
        cookies = urllib.request.HTTPCookieProcessor(CookieJar())
        opener = urllib.request.build_opener(cookies)
        assert b"importmap" in opener.open(served.url).read()
        address = served.url.partition("?")[0]
        for name in ("main.js", "style.css", "vendor/three/three.module.js"):
            kept = pathlib.Path(struck.explorer.__file__).parent / "static" / name
            assert opener.open(f"{address}static/{name}").read() == kept.read_bytes()
"""
USE = """if True:
    import importlib.util, struck
    from struck.core import library
    assert library() is not None
    assert importlib.util.find_spec("numba") is None
    block = struck.solids.Block(size=(0.1, 0.02, 0.01))
    model = struck.analyze(block, "steel", accuracy="preview", cache=False)
    print(struck.render(model, struck.Strike(), seconds=0.2).peak)
"""


def built(folder: Path, name: str, first: Path | None = None) -> Path:
    """Return the wheel that the build backend makes; modules of the folder `first` come first."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    paths = [str(first)] * bool(first) + [os.environ.get("PYTHONPATH", "")]
    told = os.environ | {"STRUCK_PLATFORM": name, "PYTHONPATH": os.pathsep.join(paths)}
    subprocess.run(command, cwd=ROOT, env=told, check=True, capture_output=True, text=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {name: built(tmp_path_factory.mktemp(name), name) for name in WHEELS}


def machine_of(library: bytes) -> str:
    """Return the platform that a library is for, by the numbers at its front."""
    if library.startswith(b"\x7fELF\x02\x01"):
        return {62: "linux-x86_64", 183: "linux-aarch64"}[struct.unpack_from("<H", library, 18)[0]]
    if library.startswith(b"\xcf\xfa\xed\xfe"):
        kinds = {0x1000007: "macos-x86_64", 0x100000C: "macos-arm64"}
        return kinds[struct.unpack_from("<I", library, 4)[0]]
    assert library.startswith(b"MZ")
    (header,) = struct.unpack_from("<I", library, 60)
    assert library[header : header + 4] == b"PE\0\0"
    return {0x8664: "windows-x86_64"}[struct.unpack_from("<H", library, header + 4)[0]]


def mac_commands(library: bytes) -> dict[int, bytes]:
    """Return the load commands of a Mach-O library by their numbers."""
    (count,), place, commands = struct.unpack_from("<I", library, 16), 32, {}
    for _ in range(count):
        kind, size = struct.unpack_from("<II", library, place)
        commands[kind] = library[place : place + size]
        place += size
    return commands


def require_loadable(library: bytes, name: str, own: bytes) -> None:
    """Check that a library needs nothing that a system of its tag may lack."""
    if name.startswith("linux"):
        needed = set(re.findall(rb"\b(?:ld-linux|lib)[\w.+-]*\.so[.\d]*", library)) - {own}
        versions = re.findall(rb"GLIBC_(\d+)\.(\d+)", library)
        assert max((int(major), int(minor)) for major, minor in versions) <= (2, 17)
        assert needed <= NEEDED[".so"]
    elif name.startswith("macos"):
        commands = mac_commands(library)
        needed = set(re.findall(rb"[@/][\w./]+(?:\.dylib|dyld)", library)) - {b"@rpath/" + own}
        assert needed <= NEEDED[".dylib"]
        assert struct.unpack_from("<I", commands[0x32], 12)[0] == 12 << 16  # least macOS
        assert name == "macos-x86_64" or 0x1D in commands  # signed: others are not loaded
    else:
        needed = set(re.findall(rb"[\w.-]+\.dll", library)) - {own}
        own_runtime = {each for each in needed if each.startswith(b"api-ms-win-crt-")}
        assert needed - own_runtime <= NEEDED[".dll"]


@pytest.mark.prove
@pytest.mark.parametrize("name", WHEELS)
def test_wheels_hold_their_libraries_alone(name: str, wheels: dict[str, Path]) -> None:
    tag, libraries, ending = WHEELS[name]
    assert re.fullmatch(rf"struck-[\d.]+-py3-none-{re.escape(tag)}\.whl", wheels[name].name)
    with zipfile.ZipFile(wheels[name]) as wheel:
        inside = {each for each in wheel.namelist() if each.startswith("struck/core/")}
        sources = {each.name for pattern in ("*.c", "*.h", "*.py") for each in HERE.glob(pattern)}
        made = {f"libraries/{library}{ending}" for library in libraries} | {"libraries/core.wasm"}
        assert {each.removeprefix("struck/core/") for each in inside} == sources | made
        (info,) = (each for each in wheel.namelist() if each.endswith(".dist-info/WHEEL"))
        told = wheel.read(info).decode()
        assert "Root-Is-Purelib: false" in told
        assert set(re.findall(r"^Tag: py3-none-(\S+)", told, re.MULTILINE)) == set(tag.split("."))
        for library in libraries:
            content = wheel.read(f"struck/core/libraries/{library}{ending}")
            assert machine_of(content) == name
            require_loadable(content, name, f"{library}{ending}".encode())
    if name != this_platform():
        print(f"{wheels[name].name}: {wheels[name].stat().st_size / 1e6:.1f} MB, not run here")  # noqa: T201


def environment(wheels: dict[str, Path], folder: Path, extra: str) -> tuple[Path, dict[str, str]]:
    """Return Python where struck alone is installed, and what it is told: no compiler to find."""
    if this_platform() not in WHEELS:
        pytest.skip(f"no wheel is for {this_platform()}")
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    command = [python, "-m", "pip", "install", "--quiet", f"{wheels[this_platform()]}{extra}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "No matching distribution" in done.stderr or "onnection" in done.stderr:
        pytest.skip(f"the package index is out of reach: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    told = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return python, told | {"PATH": str(python.parent), "XDG_CACHE_HOME": str(folder / "cache")}


@pytest.fixture(scope="module")
def installed(
    wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, str]]:
    return environment(wheels, tmp_path_factory.mktemp("installed"), "")


def files_of(python: Path) -> dict[Path, tuple[int, int]]:
    found = (path for path in python.parents[1].rglob("*") if path.is_file())
    return {path: (path.stat().st_size, path.stat().st_mtime_ns) for path in found}


@pytest.mark.prove
def test_a_wheel_in_an_empty_environment_sounds_and_writes_nothing(
    installed: tuple[Path, dict[str, str]], tmp_path: Path
) -> None:
    python, told = installed
    before = files_of(python)
    command = [python, "-W", "error", "-c", USE]
    done = subprocess.run(
        command, cwd=tmp_path, env=told, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0
    assert files_of(python) == before
    pip = sum(size for path, (size, _) in before.items() if "pip" in path.parts)
    megabytes = (sum(size for size, _ in before.values()) - pip) / 1e6
    print(f"an environment with struck alone: {megabytes:.0f} MB")  # noqa: T201
    assert megabytes <= MEGABYTES


@pytest.mark.prove
def test_a_wheel_in_an_empty_environment_serves_the_page(
    wheels: dict[str, Path], tmp_path: Path
) -> None:
    python, told = environment(wheels, tmp_path / "made", "[explorer]")
    assert wheels[this_platform()].stat().st_size <= WITH_PAGE
    done = subprocess.run(
        [python, "-c", SERVE], cwd=tmp_path, env=told, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.prove
@pytest.mark.timed
def test_import_takes_no_longer_than_two_of_numpy(
    installed: tuple[Path, dict[str, str]], tmp_path: Path
) -> None:
    python, told = installed

    def seconds(module: str) -> float:
        begin = time.perf_counter()
        subprocess.run([python, "-c", f"import {module}"], cwd=tmp_path, env=told, check=True)
        return time.perf_counter() - begin

    taken = {module: min(seconds(module) for _ in range(7)) for module in ("numpy", "struck")}
    print(taken)  # noqa: T201
    assert taken["struck"] <= 2 * taken["numpy"]


def test_a_platform_that_is_misspelt_is_refused_by_the_build(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as caught:
        built(tmp_path, "linux-arm")
    assert "STRUCK_PLATFORM is 'linux-arm': give one of linux-x86_64" in caught.value.stderr


def test_a_build_without_ziglang_names_it(tmp_path: Path) -> None:
    (tmp_path / "ziglang.py").write_text("raise ModuleNotFoundError('No module named ziglang')")
    with pytest.raises(subprocess.CalledProcessError) as caught:
        built(tmp_path, "linux-aarch64", tmp_path)
    assert "pip install ziglang" in caught.value.stderr.splitlines()[-1]


@pytest.mark.prove
def test_an_unknown_machine_gets_struck_without_a_core_that_says_so_once(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text("import platform; platform.machine = lambda: 'x'")
    path = built(tmp_path, "", tmp_path)
    assert path.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(path) as wheel:
        wheel.extractall(tmp_path)
    use = USE.replace("assert library() is not None", "assert library() is None")
    use = use.replace('    assert importlib.util.find_spec("numba") is None\n', "")
    told = os.environ | {"PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-W", "always", "-c", use]
    done = subprocess.run(
        command, cwd=tmp_path, env=told, capture_output=True, text=True, check=True
    )
    assert done.stderr.count("CoreWarning") == 1, done.stderr
    assert f"there is no library for {platform.system().lower()}-x" in done.stderr
