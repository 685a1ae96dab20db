"""The core's library with pages around every array that nobody may touch.

Each array is copied to memory that ends at such a page, or begins right after one; what is left of
its own pages holds a pattern that must not change. A step beyond an array is a fault, or is found.
"""

from __future__ import annotations

import ctypes
import json
import mmap
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from struck import core as binding
from struck.model.arrays import AnyArray, Index

PAGE = mmap.PAGESIZE
_PATTERN = 0xA5
_LINE = 64
_ARRAYS = {"D": np.float64, "F": np.float32, "I": np.int64, "C": np.complex128, "B": np.uint8}


class Pages:
    """Memory between two pages that nobody may touch."""

    def __init__(self, size: int) -> None:
        inner = max(1, -(-size // PAGE)) * PAGE
        self._bytes = np.frombuffer(mmap.mmap(-1, inner + 2 * PAGE), np.uint8)
        self.inner, self._place = self._bytes[PAGE : PAGE + inner], slice(0)
        protect, length = ctypes.CDLL(None).mprotect, ctypes.c_size_t(PAGE)
        for ahead in (0, PAGE + inner):
            page = ctypes.c_void_p(self._bytes.ctypes.data + ahead)
            assert protect(page, length, 0) == 0  # PROT_NONE

    def put(self, array: AnyArray, *, last: bool, step: int = 1) -> AnyArray:
        """Return a copy at the end or the begin; it begins at a multiple of `step` bytes."""
        first = (len(self.inner) - array.nbytes) // step * step if last else 0
        self._place = slice(first, first + array.nbytes)
        self.inner[:] = _PATTERN
        copied = self.inner[self._place].view(array.dtype).reshape(array.shape)
        copied[...] = array
        return copied

    def require_pattern(self) -> None:
        """Check that nothing beside the copy was written to."""
        place = self._place
        beside = self.inner[: place.start], self.inner[place.stop :]
        assert all((each == _PATTERN).all() for each in beside), "written beside an array"


class GuardedLibrary:
    """The library, whose functions of the table are called with guarded copies of arrays."""

    def __init__(self, library: ctypes.CDLL, *, last: bool) -> None:
        self._library, self._last = library, last
        self._pages: list[Pages] = []
        self.kept: list[Pages] = []  # of arrays that are passed by their address
        self.counts: Counter[str] = Counter()

    def __getattr__(self, name: str) -> Callable[..., object]:
        function = getattr(self._library, name)
        signature = binding.SIGNATURES.get(name)
        if signature is None:
            return function
        letters = signature.split(" ")[0]

        def guarded(*arguments: object) -> object:
            given = _rung(arguments) if name == "friction_add_reading" else list(arguments)
            return self._called(name, function, letters, given)

        setattr(self, name, guarded)
        return guarded

    def _called(
        self, name: str, function: Callable[..., object], letters: str, given: list[Any]
    ) -> object:
        places = [i for i, value in enumerate(given) if isinstance(value, np.ndarray)]
        for count, place in enumerate(places):
            wanted = _ARRAYS.get(letters[place])
            assert wanted is None or given[place].dtype == wanted, (name, place)
            self._require(count, given[place].nbytes)
        used = self._pages[: len(places)]
        copies = [
            pages.put(given[place], last=self._last)
            for pages, place in zip(used, places, strict=True)
        ]
        passed = list(given)
        for copied, place in zip(copies, places, strict=True):
            passed[place] = copied.ctypes.data if letters[place] == "P" else copied
        found = function(*passed)
        self.counts[name] += 1
        for pages in (*used, *self.kept):
            pages.require_pattern()
        for copied, place in zip(copies, places, strict=True):
            if given[place].flags.writeable:
                given[place][...] = copied
            else:
                assert np.array_equal(given[place], copied, equal_nan=True), (name, place)
        return found

    def _require(self, number: int, size: int) -> None:
        """Make the pages of this number large enough."""
        if number == len(self._pages):
            self._pages.append(Pages(size))
        # A page or two too many would be too slow to look at in each call.
        elif not size <= len(self._pages[number].inner) <= size + 4 * PAGE:
            self._pages[number] = Pages(size)

    def guard(self, array: AnyArray, step: int = 1) -> AnyArray:
        """Return a copy that stays guarded while this library is used."""
        self.kept = self.kept[-31:]
        self.kept.append(Pages(array.nbytes + step))
        return self.kept[-1].put(array, last=self._last, step=step)


def _rung(arguments: Sequence[Any]) -> list[Any]:
    """Return the arguments of friction with arrays in the place of their addresses."""
    values, starts, counts, levels, *rest = arguments

    def at(place: int, kind: type[ctypes._SimpleCData], count: int) -> AnyArray:
        return np.ctypeslib.as_array(ctypes.cast(place, ctypes.POINTER(kind)), (count,)).copy()

    firsts: Index = at(starts, ctypes.c_int64, levels)
    sizes: Index = at(counts, ctypes.c_int64, levels)
    return [at(values, ctypes.c_float, int((firsts + sizes).max())), firsts, sizes, levels, *rest]


def install(*, last: bool) -> GuardedLibrary:
    """Let all that asks for the core from now on get a guarded one; memory of banks too."""
    from struck.synth import memory, resonators

    library = binding.library()
    assert isinstance(library, ctypes.CDLL)
    guarded = GuardedLibrary(library, last=last)
    plain = memory.lay_out

    def laid_out(counts: tuple[int, ...], **sizes: int) -> tuple[AnyArray, Index]:
        reals, wholes = plain(counts, **sizes)
        return guarded.guard(reals, _LINE), guarded.guard(wholes)

    binding.entry.cache_clear()
    binding.library = lambda: guarded
    resonators.lay_out = laid_out
    return guarded


def main(how: str, seeds: int) -> None:
    """Make calls by chance, arrays "first" or "last" on their pages or "plain"; print how many."""
    from tests.core import chance

    guarded = None if how == "plain" else install(last=how == "last")
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        for made in chance.ALL:
            list(made(random))
        list(chance.called_back(random, guarded.guard if guarded else lambda array: array))
    print(json.dumps(guarded.counts if guarded else {}))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
