"""Damaged mesh files by the thousand: each is a valid mesh or one `MeshError`, and soon."""

from __future__ import annotations

import base64
import copy
import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from struck.errors import MeshError
from struck.files import guard as guards
from struck.files.guard import read_contents
from struck.files.meshes import load_mesh
from struck.files.messages import Part
from struck.model.mesh import Mesh
from struck.solids.surface.closedness import require_closed

Change = Callable[[bytearray, np.random.Generator], bytearray]

SEEDS = ["obj", "ascii.stl", "stl", "ascii.ply", "ply", "off", "glb", "gltf"]
SAMPLE, ALL = 25, 250  # of each seed: 200 and 2,000 files
BEGIN = {"ascii.ply": 11, "off": 30, "glb": 12}  # past files that take seconds to repair
TEXT = {"obj", "ascii.stl", "ascii.ply", "off", "gltf"}
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    *("nan", "inf", "-inf", "1e309", "-1e309", "1e308", "-1.7e308", "1e155", "1e-320", "-0.0"),
    *("-1", "0", "1", "3", "7", "255", "65536", "2147483647", "2147483648", "4294967295"),
    *("-2147483649", "9223372036854775807", "9223372036854775808", "1e9", "1000000000", "0x10"),
    *("99999999999999999999999999", "1.5", "", "x", "1/2/3", "1_0", "-", "null", "[]"),
)
LEAVES = [
    *(None, True, -1, 0, 1, 3, 80, 2**31, 2**63, 10**9, 1.5, 1e308, -1e308, float("nan")),
    *("x", "../x", [], {}, [[]], [0], [0, 0], [1e38] * 16, [1e200] * 3, [float("inf")] * 3),
    *(5120, 5121, 5123, 5125, 5126, "SCALAR", "VEC2", "VEC3", "MAT4", 4, 5, 6),
]
EMBEDDED = "data:application/octet-stream;base64,"
WORDS = [
    *(np.float32(value).tobytes() for value in (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, 0)),
    *(np.uint32(value).tobytes() for value in (1, 2**31 - 1, 2**31, 2**32 - 1, 2**16, 80)),
]


def seed(kind: str, number: int) -> bytes:
    """Return a sound file of a small body."""
    bodies = [trimesh.creation.icosphere(subdivisions=1), trimesh.creation.box((1, 2, 3))]
    body = bodies[number % 2]
    if kind == "ascii.stl":
        return trimesh.exchange.stl.export_stl_ascii(body).encode()
    if kind == "ascii.ply":
        return trimesh.exchange.ply.export_ply(body, encoding="ascii")
    if kind == "gltf":
        return body.export(file_type="gltf", embed_buffers=True)["model.gltf"]
    if kind == "glb" and number % 3 == 0:
        scene = trimesh.Scene({"a": bodies[0], "b": bodies[1]})
        return scene.export(file_type="glb")
    content = body.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


def block(data: bytearray, rng: np.random.Generator) -> slice:
    start = int(rng.integers(len(data)))
    return slice(start, start + int(rng.choice([1, 4, 12, 50, 400])))


def flipped(data: bytearray, rng: np.random.Generator) -> bytearray:
    for place in rng.integers(len(data), size=rng.integers(1, 4)):
        data[place] ^= 1 << rng.integers(7)
    return data


def truncated(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: rng.integers(len(data))]


def inserted(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = rng.integers(len(data))
    data[place:place] = rng.bytes(int(rng.choice([1, 2, 4, 30, 1000])))
    return data


def deleted(data: bytearray, rng: np.random.Generator) -> bytearray:
    del data[block(data, rng)]
    return data


def doubled(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = rng.integers(len(data))
    data[place:place] = data[block(data, rng)] * int(rng.choice([1, 2, 100]))
    return data


def emptied(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = block(data, rng)
    data[place] = bytes([rng.choice([0, 32, 255])]) * len(data[place])
    return data


def with_other_numbers(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Replace numbers of a text, of a header as often as of its body."""
    found = list(NUMBER.finditer(data))
    near = found[:12] if rng.random() < 0.5 else found
    for place in sorted(rng.integers(len(near), size=rng.integers(1, 4)) if near else [])[::-1]:
        data[slice(*near[place].span())] = NUMBERS[rng.integers(len(NUMBERS))].encode()
    return data


def with_other_words(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Replace aligned words of a binary file, of its first bytes as often as of the rest."""
    near = len(data) if rng.random() < 0.5 else min(len(data), 200)
    for place in rng.integers(max(1, near // 4), size=rng.integers(1, 4)):
        data[4 * place : 4 * place + 4] = WORDS[rng.integers(len(WORDS))]
    return data


def shuffled(data: bytearray, rng: np.random.Generator) -> bytearray:
    lines = bytes(data).split(b"\n")
    first = int(rng.integers(len(lines)))
    some = slice(first, first + int(rng.choice([2, 5, len(lines)])))
    order = rng.permutation(len(lines[some]))
    lines[some] = [lines[some][place] for place in order]
    return bytearray(b"\n".join(lines))


def opened(data: bytearray) -> tuple[dict[str, Any], bytes] | None:
    """Return the header of a glTF or GLB and what follows it; nothing where it is damaged."""
    binary = data[:4] == b"glTF"
    length = int.from_bytes(data[12:16], "little") if binary else len(data)
    start = 20 if binary else 0
    try:
        header = json.loads(data[start : start + length])
    except ValueError:
        return None
    return (header, bytes(data[start + length :])) if isinstance(header, dict) else None


def closed(header: dict[str, Any], rest: bytes, *, binary: bool) -> bytearray:
    text = json.dumps(header).encode()
    if not binary:
        return bytearray(text)
    text += b" " * (-len(text) % 4)
    lengths = np.array([2, 20 + len(text) + len(rest), len(text)], "<u4").tobytes()
    return bytearray(b"glTF" + lengths + b"JSON" + text + rest)


def with_other_leaves(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Replace or remove what a glTF header says somewhere."""
    found = opened(data)
    if found is None:
        return data
    header, rest = found
    for _ in range(rng.integers(1, 3)):
        places = list(leaves(header))
        container, key = places[rng.integers(len(places))]
        if rng.random() < 0.2:
            del container[key]
        else:
            container[key] = copy.deepcopy(LEAVES[rng.integers(len(LEAVES))])
    return closed(header, rest, binary=data[:4] == b"glTF")


def leaves(tree: dict[str, Any] | list[Any]) -> Iterator[tuple[Any, Any]]:
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield tree, key
        if isinstance(value, dict | list):
            yield from leaves(value)


def with_other_buffers(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Replace words of the geometry of a glTF, and leave its header whole."""
    found = opened(data)
    if found is None:
        return data
    header, rest = found
    if data[:4] == b"glTF":
        changed = bytes(with_other_words(bytearray(rest[8:]), rng)) if len(rest) > 8 else b""
        return closed(header, rest[:8] + changed, binary=True)
    buffers = header.get("buffers")
    for buffer in buffers if isinstance(buffers, list) else []:
        if isinstance(buffer, dict) and str(buffer.get("uri")).startswith(EMBEDDED):
            try:
                plain = bytearray(base64.b64decode(buffer["uri"].removeprefix(EMBEDDED)) or b" ")
            except ValueError:
                continue
            buffer["uri"] = EMBEDDED + base64.b64encode(with_other_words(plain, rng)).decode()
    return closed(header, b"", binary=False)


ANYWHERE: list[Change] = [flipped, truncated, inserted, deleted, doubled, emptied]
IN_TEXT: list[Change] = [*ANYWHERE, *[with_other_numbers] * 6, *[shuffled] * 2]
IN_BINARY: list[Change] = [*ANYWHERE, *[with_other_words] * 5, with_other_numbers]
IN_GLTF: list[Change] = [*IN_TEXT[::2], *[with_other_leaves] * 10, *[with_other_buffers] * 6]


def mutant(kind: str, number: int) -> bytes:
    """Return a file with one to three changes; the same for the same number."""
    rng = np.random.default_rng([SEEDS.index(kind), number])
    data = bytearray(seed(kind, number))
    changes = IN_TEXT if kind in TEXT else IN_BINARY
    if kind in {"glb", "gltf"}:
        changes = IN_GLTF
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        data = changes[rng.integers(len(changes))](data, rng) or bytearray(b" ")
    return bytes(data)


def outcome(path: Path) -> str:
    """Return "refused", "unreadable" or "valid", within 10 s of the processor."""
    started = time.process_time()
    result = read_and_repaired(path)
    if time.process_time() - started >= 10:  # other processes may have slowed it down: once more
        started = time.process_time()
        assert read_and_repaired(path) == result
        assert time.process_time() - started < 10
    return result


def read_and_repaired(path: Path) -> str:
    """Return "refused", "unreadable" or "valid" for parts as the file has them, and repaired."""
    try:
        parts = read_contents(path).parts
    except MeshError:
        parts = []
    for part in parts:
        require_valid(part)
    bodies = [body for repair in (False, True) if (body := loaded(path, repair=repair))]
    assert parts or not bodies
    return "valid" if bodies else "refused" if parts else "unreadable"


def loaded(path: Path, *, repair: bool) -> Mesh | None:
    """Return a sound closed body, or nothing where one error says what is wrong."""
    try:
        body = load_mesh(path, repair=repair)
    except MeshError as error:
        assert str(error).startswith(f"{path}: ")  # noqa: PT017
        assert str(error).isprintable()  # noqa: PT017
        return None
    require_valid(body)
    require_closed(body)
    assert 0 < body.volume < np.inf
    return body


def require_valid(surface: Part | Mesh) -> None:
    assert surface.points.shape[1] == surface.faces.shape[1] == 3
    assert np.isfinite(surface.points).all()
    assert surface.faces.min() >= 0
    assert surface.faces.max() < len(surface.points)


def memory_of_the_reader() -> int:
    """Return the most address space that the reader has held, bytes."""
    status = Path(f"/proc/{guards._GUARD.process_id}/status")
    return 1024 * int(re.findall(r"VmPeak:\s*(\d+)", status.read_text())[0])


def memory_of_this_process() -> int:
    """Return the most memory that this process has held, bytes."""
    return 1024 * int(re.findall(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[0])


def check(kind: str, numbers: range, folder: Path) -> None:
    path = folder / f"a.{kind}"
    outcomes = []
    if sys.platform == "linux":  # what the tests before took is not theirs
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    for number in numbers:
        path.write_bytes(mutant(kind, number))
        outcomes.append(outcome(path))
    # else the changes would be too weak or too strong to tell
    assert {"valid", "unreadable"} <= set(outcomes)
    path.write_bytes(seed(kind, 1))
    assert load_mesh(path).volume == pytest.approx(6, rel=1e-5)
    if sys.platform == "linux":
        assert memory_of_the_reader() <= 2 * 2**30
        assert memory_of_this_process() <= 2 * 2**30


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", SEEDS)
def test_a_sample_of_damaged_files(tmp_path: Path, kind: str) -> None:
    begin = BEGIN.get(kind, 0)
    check(kind, range(begin, begin + SAMPLE), tmp_path)


@pytest.mark.prove
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", SEEDS)
def test_two_thousand_damaged_files(tmp_path: Path, kind: str) -> None:
    check(kind, range(ALL), tmp_path)
