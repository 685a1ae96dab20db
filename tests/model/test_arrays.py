"""Conversion of arguments by annotations: what they become, and what is refused in which words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import struck
from struck import shapes, solids
from struck.errors import ArgumentError
from struck.model.arrays import Array, Complex, Index, Mask, checked, numbers
from struck.model.contact import Place
from tests.foreign_numbers import (
    ARRAYS,
    NO_ARRAYS,
    NO_SCALARS,
    SCALARS,
    Foreign,
    python_number,
    python_numbers,
    same,
)

Course = float | tuple[Sequence[float], Sequence[float]] | Callable[[float], float]


@checked
def converted(
    *,
    number: float = -7.5,
    maybe: float | None = None,
    whole: int = -7,
    flag: bool = False,
    text: str = "",
    either: int | str | None = None,
    pitch: float | str = -7.5,
    array: Array | None = None,
    any_array: ArrayLike | None = None,
    index: Index | None = None,
    mask: Mask | None = None,
    complexes: Complex | None = None,
    single: NDArray[np.float32] | None = None,
    place: Place = None,
    size: tuple[float, float, float] | None = None,
    counts: tuple[int, int] | None = None,
    notes: tuple[float | str, ...] = (),
    course: Course | None = None,
    rows: Sequence[Sequence[float]] = (),
    table: Mapping[str, float] | None = None,
    many: ArrayLike | Sequence[ArrayLike] | None = None,
) -> Any:  # noqa: ANN401 - what was given
    """Return the arguments that are not as by default."""
    given = {name: value for name, value in locals().items() if value is not None}
    return {
        name: value
        for name, value in given.items()
        if name not in _DEFAULTS or value is not _DEFAULTS[name]
    }


_DEFAULTS = converted.__wrapped__.__kwdefaults__
HALF = np.float16(0.3)
THREE = np.array([0.0, 1.0, 2.0])

CONVERSIONS: list[tuple[str, Any, Any]] = [
    ("number", HALF, float(HALF)),
    ("number", 3, 3.0),
    ("number", True, 1.0),
    ("number", Fraction(1, 3), 1 / 3),
    ("number", Decimal("0.1"), 0.1),
    ("number", np.longdouble(1) / 3, 1 / 3),
    ("number", np.longdouble("1e4000"), np.inf),
    ("maybe", np.int8(7), 7.0),
    ("whole", np.uint64(2**64 - 1), 2**64 - 1),
    ("whole", 3.0, 3),
    ("whole", np.float32(3), 3),
    ("whole", Decimal(2**60 + 1), 2**60 + 1),
    ("flag", np.True_, True),
    ("either", np.int16(3), 3),
    ("either", "bar", "bar"),
    ("pitch", HALF, float(HALF)),
    ("pitch", "A4", "A4"),
    ("array", [1, 2.5], np.array([1.0, 2.5])),
    ("array", 3, np.array(3.0)),
    ("array", np.float32(0.1), np.array(float(np.float32(0.1)))),
    ("array", [Fraction(1, 3), Decimal("0.1"), 1], np.array([1 / 3, 0.1, 1.0])),
    ("array", [2**70], np.array([2.0**70])),
    ("array", THREE.astype(">f4"), THREE),
    ("array", np.ma.MaskedArray([0, 1, 2]), THREE),
    ("array", np.array([[1, 2]]).view(np.matrix), np.array([[1.0, 2.0]])),
    ("any_array", Foreign(THREE.astype(np.int8)), THREE),
    ("index", [0.0, 1.0], np.array([0, 1])),
    ("index", np.array([7], np.uint8), np.array([7])),
    ("index", [], np.zeros(0, np.int64)),
    ("mask", [True, False], np.array([True, False])),
    ("mask", [1, 0], np.array([True, False])),
    ("complexes", [1, 2j], np.array([1, 2j])),
    ("complexes", np.array([1], np.complex64), np.array([1 + 0j])),
    ("single", [0.1], np.array([0.1], np.float32)),
    # Rounded once to double precision, as Python's number is, and then to single.
    (
        "single",
        np.longdouble(1) + np.longdouble(2) ** -24 + np.longdouble(2) ** -60,
        np.array(1.0, np.float32),
    ),
    ("place", (0, 1, 2), (0.0, 1.0, 2.0)),
    ("place", [HALF, 1], [float(HALF), 1.0]),
    ("place", THREE.astype(np.int32), THREE),
    ("place", "rim", "rim"),
    ("size", THREE.astype(np.float32), (0.0, 1.0, 2.0)),
    ("size", [0, 1, 2], (0.0, 1.0, 2.0)),
    ("counts", np.array([2, 3], np.uint8), (2, 3)),
    ("notes", ["A4", np.float32(2)], ("A4", 2.0)),
    ("course", (np.arange(2), [1, 2]), (np.array([0.0, 1.0]), [1.0, 2.0])),
    ("course", np.float32(2), 2.0),
    ("rows", [(0, 1), [HALF]], [(0.0, 1.0), [float(HALF)]]),
    ("table", {"a": HALF}, {"a": float(HALF)}),
    ("many", [[0, 1], [HALF]], [np.array([0.0, 1.0]), np.array([float(HALF)])]),
]


@pytest.mark.parametrize(("name", "value", "expected"), CONVERSIONS)
def test_arguments_are_converted_by_their_annotations(
    name: str, value: object, expected: object
) -> None:
    assert same(converted(**{name: value}), {name: expected})


READ_ONLY = np.arange(3.0)
READ_ONLY.setflags(write=False)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("number", 1.5),
        ("array", READ_ONLY),
        ("array", np.arange(6.0).reshape(2, 3).T),
        ("index", np.arange(3)),
        ("single", np.zeros(2, np.float32)),
        ("place", (0.5, 1.0)),
        ("rows", [(0.0, 1.0), [2.0]]),
        ("table", {"a": 1.0}),
    ],
)
def test_what_is_of_the_type_already_is_passed_as_it_is(name: str, value: object) -> None:
    assert converted(**{name: value})[name] is value


REFUSALS: list[tuple[str, Any, str]] = [
    ("number", "1", "number is '1': converted takes a number$"),
    ("number", np.complex64(1), "takes a number"),
    ("number", np.array(1.0), "takes a number"),
    ("number", np.ma.masked, "takes a number"),
    ("number", Decimal("sNaN"), "takes a number"),
    ("number", 10**400, "a number of more than 300 digits: converted takes a number"),
    ("number", np.datetime64("2026-01-01"), "takes a number"),
    ("whole", 0.5, "takes a whole number"),
    ("whole", True, "takes a whole number"),
    ("whole", np.float32("inf"), "takes a whole number"),
    ("flag", 1, "takes True or False"),
    ("either", b"x", "takes a whole number or text or None"),
    ("array", "123", "takes numbers or None"),
    ("array", ["1", "2"], "takes numbers or None"),
    ("array", [1.0, None], "takes numbers or None"),
    ("array", [[1.0], [1.0, 2.0]], "takes numbers or None"),
    ("array", [1.0, 2j], "takes numbers or None, which are real"),
    ("array", [10**5000], "takes numbers or None"),
    ("array", np.ma.MaskedArray([1.0, 2.0], [False, True]), "and 1 of these are masked"),
    ("array", [np.ma.masked, 1.0], "and 1 of these are masked"),
    ("array", [np.ma.MaskedArray([1.0, 2.0], [True, True])] * 2, "and 4 of these are masked"),
    ("array", range(10**9), "listed up to 16777216 of them: give a NumPy array"),
    ("array", [[1.0], range(10**9)], "listed up to 16777216 of them"),
    ("array", (value for value in "123"), "takes numbers"),
    ("array", {1.0, 2.0}, "takes numbers"),
    ("array", bytearray(8), "takes numbers"),
    ("array", np.zeros(2, "M8[s]"), "takes numbers"),
    ("array", np.zeros(2, [("x", float)]), "takes numbers"),
    ("index", [0, 0.5], "takes whole numbers or None, and 0.5 is not"),
    ("index", [np.inf], "takes whole numbers or None, and inf is not"),
    ("index", np.array([2**63], np.uint64), "takes whole numbers or None"),
    ("index", [2**64], "takes whole numbers or None"),
    ("mask", [2], "takes True or False for each or None, and 2 is not"),
    ("complexes", ["1j"], "takes numbers or None"),
    ("size", (1.0, "2", 3.0), "takes 3 numbers or None"),
    ("size", 1.0, "takes 3 numbers or None"),
    ("course", {}, "takes a number or a list or a function or None"),
    ("rows", [1.0, "x"], "takes a list of numbers"),
    ("table", [1.0], "takes a mapping or None"),
]


@pytest.mark.parametrize(("name", "value", "words"), REFUSALS)
def test_other_arguments_are_refused_in_words(name: str, value: object, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        converted(**{name: value})


class Endless(Sequence):
    """A list that states three items and has more."""

    def __len__(self) -> int:
        return 3

    def __getitem__(self, place: Any) -> float:  # noqa: ANN401 - of a `Sequence`
        return float(place)


class Broken:
    """An object whose array fails, as that of a tensor on another device."""

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        raise RuntimeError(dtype, copy)


class Nameless(Broken):
    """One that fails in print as well."""

    def __repr__(self) -> str:
        raise RuntimeError


def _nested_in_itself() -> list[Any]:
    rows: list[Any] = []
    rows += [rows] * 2
    return rows


@pytest.mark.parametrize("value", [Endless(), Broken(), Nameless(), _nested_in_itself()])
@pytest.mark.parametrize("name", ["array", "place", "many"])
def test_objects_that_fail_as_arrays_are_refused(name: str, value: object) -> None:
    with pytest.raises(ArgumentError):
        converted(**{name: value})


def test_fields_hold_converted_values() -> None:
    bar = shapes.Bar(length=HALF, width=np.float32(0.03), thickness=np.longdouble(0.005))
    assert {type(part) for part in (bar.length, bar.width, bar.thickness)} == {float}
    block = solids.Block(size=np.array([0.25, 0.5, 1], np.float16), elements=np.array([4, 1, 1]))
    assert same((block.size, block.elements), ((0.25, 0.5, 1.0), (4, 1, 1)))
    assert hash(block) == hash(solids.Block(size=(0.25, 0.5, 1.0), elements=(4, 1, 1)))
    strike = struck.Strike(at=np.array([1, 2, 3], np.int8), seed=np.uint8(255), time=np.int8(8))
    assert same((strike.at, strike.seed, strike.time), ((1.0, 2.0, 3.0), 255, 8.0))


@pytest.mark.parametrize("kind", SCALARS)
@pytest.mark.parametrize("value", [0.3, 3.0, 7800.0])
def test_numbers_of_all_types_are_pythons_number(kind: str, value: float) -> None:
    number = SCALARS[kind](value)
    assert same(converted(number=number), {"number": float(number)})
    if number == int(number):
        assert same(converted(whole=number), {"whole": python_number(number, whole=True)})


@pytest.mark.parametrize("kind", NO_SCALARS)
def test_what_is_no_number_is_refused(kind: str) -> None:
    for name in ("number", "whole"):
        with pytest.raises(ArgumentError, match=r"takes a (whole )?number"):
            converted(**{name: NO_SCALARS[kind](1.5)})


@pytest.mark.parametrize("kind", ARRAYS)
def test_arrays_of_all_types_are_those_of_pythons_numbers(kind: str) -> None:
    for base in (np.array([0.3, 2.0, 7.7]), np.array([[1.1, 2.0], [3.0, 44.4]])):
        values = ARRAYS[kind](base)
        expected = np.array(python_numbers(values), np.float64)
        assert same(converted(array=values), {"array": expected})
        assert same(numbers("it", values), expected)


@pytest.mark.parametrize("kind", NO_ARRAYS)
def test_what_is_no_array_of_numbers_is_refused(kind: str) -> None:
    for name in ("array", "index", "complexes", "single"):
        with pytest.raises(ArgumentError, match=f"{name} is .*: converted takes (whole )?numbers"):
            converted(**{name: NO_ARRAYS[kind](np.array([1.0, 2.0, 3.0]))})


@checked
@dataclass(frozen=True, kw_only=True)
class Held:
    """A class whose parameters are converted before its own work."""

    values: Array
    total: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "total", float(self.values.sum()))


def test_a_class_converts_before_its_own_work() -> None:
    assert Held(values=Foreign(np.array([1, 2], np.uint8))).total == 3.0
