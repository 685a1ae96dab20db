"""The core as the page runs it: compiled to WebAssembly, run by wasmtime, compared with NumPy."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import wasmtime
from numpy.typing import NDArray

from struck import core
from struck.core import SIGNATURES
from struck.core.build import LIBRARIES, fingerprint
from struck.ears import delay_lines
from struck.live import limiter
from struck.synth import resonators
from tests.core import scenes, test_delay_lines, test_limiter
from tests.core.agreement import EXACT, SINGLE, apart
from tests.synth.scenes import reference

PAGES, PAGE = 64, 65536  # of memory
ROOMS = ("bank_", "core_", "ears_", "limiter_")  # of the entries that it has
Array = NDArray[Any]


class Page:
    """The core in a memory of its own, behind the same entries as the library of this machine."""

    def __init__(self, store: wasmtime.Store, module: wasmtime.Module) -> None:
        self.store, self.module = store, module
        self.exports = wasmtime.Instance(store, module, []).exports(store)
        memory = self.exports["memory"]
        self.next = memory.grow(self.store, PAGES) * PAGE
        size = memory.data_len(self.store)
        self.base = ctypes.addressof(memory.data_ptr(self.store).contents)
        self.bytes = np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(self.base))

    def placed(self, array: Array) -> Array:
        """Return an array of the page's memory with the same numbers."""
        first = -(-self.next // 64) * 64
        self.next = first + array.nbytes
        assert self.next <= len(self.bytes)
        place = self.bytes[first : self.next].view(array.dtype).reshape(array.shape)
        place[...] = array
        return place

    def entry(self, name: str) -> Callable[..., Any]:
        """Return an entry that takes arrays from anywhere, and addresses of the page's memory."""
        letters = SIGNATURES[name].split(" ")[0]

        def run(*given: Any) -> Any:  # noqa: ANN401 - numbers, addresses and arrays
            free, arguments, copies = self.next, [], []
            for letter, value in zip(letters, given, strict=True):
                if isinstance(value, np.ndarray):
                    copies.append((value, self.placed(value)))
                    arguments.append(copies[-1][1].ctypes.data - self.base)
                else:
                    arguments.append(value - self.base if letter == "P" else value)
            result = self.exports[name](self.store, *arguments)
            for value, copy in copies:
                if value.flags.writeable:
                    value[...] = copy
            self.next = free
            return result

        return run


@pytest.fixture(scope="module")
def made() -> tuple[wasmtime.Store, wasmtime.Module]:
    path = LIBRARIES / "core.wasm"  # which an installation has compiled
    assert path.stat().st_size < 30_000
    store = wasmtime.Store()
    return store, wasmtime.Module.from_file(store.engine, str(path))


@pytest.fixture
def page(made: tuple[wasmtime.Store, wasmtime.Module], monkeypatch: pytest.MonkeyPatch) -> Page:
    """Return the core of the page, which the twins in Python call from now on."""
    page, laid_out = Page(*made), resonators.lay_out

    def laid_out_there(*counts: Any, **sizes: int) -> tuple[Array, ...]:  # noqa: ANN401
        return tuple(page.placed(array) for array in laid_out(*counts, **sizes))

    for room in (resonators, limiter, core):
        monkeypatch.setattr(room, "entry", page.entry)
    monkeypatch.setattr(resonators, "compiled", page.entry)
    monkeypatch.setattr(resonators, "lay_out", laid_out_there)
    return page


def test_it_is_of_these_sources_and_needs_nothing(page: Page) -> None:
    assert not page.module.imports
    assert page.entry("core_fingerprint")() == fingerprint()
    entries = {each.name for each in page.module.exports} - {"memory", "__stack_pointer"}
    assert entries == {name for name in SIGNATURES if name.startswith(ROOMS)}


@pytest.mark.parametrize("name", scenes.SCENES)
def test_bank_is_that_of_plain_numpy_and_of_this_machine(
    name: str, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = page.next
    found = scenes.played(name)
    assert page.next > before  # it was played there
    monkeypatch.undo()
    assert apart(found, scenes.played(name, reference)) <= EXACT
    assert apart(found, scenes.played(name)) <= EXACT


@pytest.mark.usefixtures("page")
def test_limiter_is_that_of_plain_python_and_of_this_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = test_limiter.played(limiter.limit)
    monkeypatch.undo()
    for limit in (limiter.limit_plainly, limiter.limit):
        for mine, other in zip(found, test_limiter.played(limit), strict=True):
            assert apart(mine, other) <= EXACT


def heard(hear: Callable[..., None]) -> Array:
    """Return what two ears hear where float32 rounds nothing: all numbers have few bits."""
    random = np.random.default_rng(2)
    lines = np.tile(random.integers(-3, 4, (2, 128)), 2).astype(np.float32)
    between = random.integers(-2, 3, (3, delay_lines.READ)).astype(np.float32) / 2
    delays = np.array([[40, 38, 36], [50, 54, 58], [33, 33, 33]], np.float64)
    gains = np.array([[0, 1, 2], [1, 0.5, 0], [-1, -1, -1]], np.float64)
    history, sound = np.zeros((3, 7 + 16), np.float32), np.zeros((2, 16), np.float32)
    responses = random.integers(-2, 3, (2, 3, 8)).astype(np.float32) / 2
    line_of, ear_of = np.array([0, 1, 1]), np.array([0, 0, 1])
    for number in range(4):
        given = lines, 200 + 16 * number, between, line_of, ear_of, delays, gains, *responses
        hear(*given, 0, 16, history, sound)
    return sound


@pytest.mark.usefixtures("page")
def test_ears_are_those_of_plain_numpy_and_of_this_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exact, found = heard(delay_lines.hear), test_delay_lines.played((5, 27))
    assert np.array_equal(exact, heard(delay_lines.hear_plainly))
    monkeypatch.setattr(delay_lines, "hear", delay_lines.hear_plainly)
    assert apart(found, test_delay_lines.played((5, 27))) <= SINGLE
    monkeypatch.undo()
    assert np.array_equal(exact, heard(delay_lines.hear))
    assert apart(found, test_delay_lines.played((5, 27))) <= SINGLE
