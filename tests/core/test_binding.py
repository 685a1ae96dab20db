"""What becomes of a core that is missing or foreign, and that all sides mean the same numbers."""

from __future__ import annotations

import ctypes
import re
import warnings
from collections.abc import Iterator
from enum import IntEnum
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from struck import core as binding
from struck.core import build
from struck.errors import CoreWarning, OptionError
from struck.live import callback_memory, limiter, ring
from struck.live.ears import EarsMemory
from struck.synth import memory
from tests.core import chance
from tests.core.agreement import EXACT, SINGLE, apart

LEVEL = 0 if (compiled := binding.entry("core_level")) is None else int(compiled())
VARIANTS = [f"v{level}" for level in range(2, LEVEL + 1)]


@pytest.fixture(autouse=True)
def opened_anew() -> Iterator[None]:
    """Let each test open the library, and the next file too."""
    for cached in (binding.library, binding.entry):
        cached.cache_clear()
    yield
    for cached in (binding.library, binding.entry):
        cached.cache_clear()


def test_an_unknown_choice_is_refused_with_those_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STRUCK_CORE", "v9")
    with pytest.raises(OptionError, match=r"'v9': give one of v2, v3, v4, off"):
        binding.library()


def test_a_core_that_is_off_is_not_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STRUCK_CORE", "off")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert binding.entry("bank_make_block") is None


def require_one_warning(reason: str) -> None:
    """Check that the first call alone warns, and tells what to do."""
    with pytest.warns(CoreWarning) as caught:
        found = [binding.entry(name) for name in ("bank_stand", "ears_hear", "bank_stand")]
    assert found == [None] * 3
    [message] = [str(each.message) for each in caught]
    assert re.search(reason, message)
    assert "pip install" in message


@pytest.mark.parametrize("bytes_there", [None, b"", b"not a library", b"\x7fELF" + bytes(60)])
def test_a_missing_or_foreign_library_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, bytes_there: bytes | None
) -> None:
    opened = partial(binding._checked, folder=tmp_path)
    monkeypatch.setattr(binding, "_checked", opened)
    if bytes_there is not None:
        for path in build.LIBRARIES.glob("core*"):
            (tmp_path / path.name).write_bytes(bytes_there)
    require_one_warning("is missing" if bytes_there is None else "core_")


@pytest.mark.parametrize("name", ["fingerprint", "TARGETS", "SIGNATURES"])
def test_a_library_of_other_sources_or_systems_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    other, reason = {
        "fingerprint": (lambda: 1, "other sources"),
        "TARGETS": ({}, "no library for"),
        "SIGNATURES": ({"not_there": " i"}, "other sources"),
    }[name]
    monkeypatch.setattr(binding if name == "SIGNATURES" else build, name, other)
    require_one_warning(reason)


@pytest.mark.skipif(not VARIANTS, reason="the processor is no x86-64")
@pytest.mark.parametrize(("level", "chosen"), [(1, ""), (2, "v3"), (3, "v4")])
def test_a_processor_too_old_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, level: int, chosen: str
) -> None:
    def checked(name: str) -> ctypes.CDLL:
        opened = plain(name)
        vars(opened)["core_level"] = lambda: level
        return opened

    plain = binding._checked
    monkeypatch.setattr(binding, "_checked", checked)
    monkeypatch.setenv("STRUCK_CORE", chosen)
    require_one_warning(f"x86-64-{chosen or 'v2'}, this is a v{level}")


def test_every_entry_of_the_table_is_in_every_library() -> None:
    for path in build.LIBRARIES.glob("core_*"):
        opened = binding._checked(path.name)
        for name, signature in binding.SIGNATURES.items():
            assert len(getattr(opened, name).argtypes) == len(signature.split(" ")[0])


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(4, np.float32),
        np.zeros(4, ">f8"),
        np.zeros(8)[::2],
        np.frombuffer(bytes(33), np.uint8)[1:].view(np.float64),
    ],
    ids=["kind", "order", "gaps", "place"],
)
def test_arrays_of_another_form_are_refused(array: np.ndarray) -> None:
    summed = binding.compiled("bessel_series_sum")
    with pytest.raises(ctypes.ArgumentError, match="contiguous"):
        summed(4, 1, array, np.zeros((1, 13, 1)), np.zeros(4))


def header(name: str) -> str:
    """Return a C file without its comments."""
    return re.sub(r"(?s)/\*.*?\*/", "", (build.HERE / name).read_text(encoding="utf-8"))


def enums(name: str) -> list[dict[str, int]]:
    """Return the names and numbers of each enum of a C file, in order."""
    found = []
    for listed in re.findall(r"\benum\b[^{;()]*\{([^}]*)\}", header(name)):
        numbers: dict[str, int] = {}
        for each in filter(None, (part.strip() for part in listed.split(","))):
            word, _, value = (part.strip() for part in each.partition("="))
            numbers[word] = int(value) if value else max(numbers.values(), default=-1) + 1
        found.append(numbers)
    return found


SIDES: dict[str, type[IntEnum]] = {
    "LOG_RE": memory.Mode,
    "OUT_RE": memory.Output,
    "NOW": memory.Drive,
    "FIRST": memory.BodyColumn,
    "AS_STATE": memory.HeldAs,
    "BODY": memory.Voice,
    "RATE": memory.Level,
}


def require_same(theirs: dict[str, int], ours: dict[str, int]) -> None:
    """Check for the same numbers; names of C may have something before those of Python."""
    assert list(theirs.values()) == list(ours.values())
    for name, short in zip(theirs, ours, strict=True):
        assert name.endswith(short), (name, short)


def test_memory_is_laid_out_as_the_header_says() -> None:
    found = {next(iter(each)): each for each in enums("memory.h")}
    sizes = found.pop("BODIES")
    assert list(sizes.values()) == list(range(memory._HEADER + 1))
    assert (sizes["ROWS"], sizes["COMPLEX"]) == (memory._ROWS, memory._TURNED)
    assert found.keys() == SIDES.keys()
    for first, numbers in found.items():
        ours = {each.name: each.value for each in SIDES[first]}
        if first != "AS_STATE":  # their number comes last
            assert numbers.popitem()[1] == len(ours)
        require_same(numbers, ours)


@pytest.mark.parametrize(
    ("name", "module", "other"),
    [
        ("queue.h", ring, {"TAKEN": "READ", "HEAD": "_HEAD"}),
        (
            "record.h",
            ring,
            {"DRIVE_MOVED": "MOVED", "RECORD_COLUMNS": "_COLUMNS", "STRETCH": "_STRETCH"},
        ),
        ("limiter.c", limiter, {"HEAD": "_HEAD"}),
        ("callback.h", callback_memory, {}),
    ],
)  # fmt: skip
def test_places_are_those_of_python(name: str, module: ModuleType, other: dict[str, str]) -> None:
    for numbers in enums(name):
        for place, number in numbers.items():
            assert getattr(module, other.get(place, place)) == number


@pytest.mark.parametrize(
    ("struct", "ours"),
    [
        ("live_ears", EarsMemory),
        ("arena", callback_memory.Arena),
        ("shared", callback_memory._Places),
    ],
)
def test_structs_of_the_callback_are_those_of_python(
    struct: str, ours: type[ctypes.Structure]
) -> None:
    [body] = re.findall(rf"(?s)struct {struct} \{{(.*?)\}};", header("callback.h"))
    kinds = {"int64_t": ctypes.c_int64, "double": ctypes.c_double}
    theirs: list[tuple[str, type]] = []
    for line in filter(None, (each.strip() for each in body.split(";"))):
        [(kind, names)] = re.findall(r"(?s)^((?:struct )?\w+) (.*)", line)
        for each in names.split(","):
            pointer = each.strip().startswith("*")
            theirs.append((each.strip(" *"), ctypes.c_void_p if pointer else kinds[kind]))
    assert [name for name, _ in theirs] == [name for name, *_ in ours._fields_]
    same = type("Same", (ctypes.Structure,), {"_fields_": theirs})
    assert ctypes.sizeof(same) == ctypes.sizeof(ours)
    for name, _ in theirs:
        assert (getattr(same, name).offset, getattr(same, name).size) == (
            getattr(ours, name).offset,
            getattr(ours, name).size,
        )


def computed(patch: pytest.MonkeyPatch, core: str) -> dict[str, np.ndarray]:
    """Return what a variant of the core computes."""
    patch.setenv("STRUCK_CORE", core)
    binding.library.cache_clear()
    binding.entry.cache_clear()
    return {
        f"{made.__name__} {seed} {number}": array
        for made in (chance.bank, chance.ears, chance.limited, chance.fitted)
        for seed in range(12)
        for number, array in enumerate(made(np.random.default_rng(seed)))
    }


@pytest.mark.skipif(not VARIANTS, reason="the processor is no x86-64")
def test_all_variants_agree_and_each_repeats_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = computed(monkeypatch, VARIANTS[0])
    for core in VARIANTS:
        found, again = (computed(monkeypatch, core) for _ in range(2))
        assert found.keys() == expected.keys()
        for name, array in expected.items():
            bound = SINGLE if name.startswith("ears") else EXACT
            assert np.array_equal(found[name], array) or apart(found[name], array) <= bound, name
            assert again[name].tobytes() == found[name].tobytes(), name
