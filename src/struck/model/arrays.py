"""Arrays and other arguments: short names for annotations, and conversion of the values given.

`checked` converts the arguments of a public name to what its annotations name, once: numbers of
any type become Python's float or int, and arrays those of NumPy in double precision, so that a
result does not depend on the caller's types. Text for a number, or a path for a material, is
refused with the argument's name, before an error deep in the work. Bounds are checked by the names
themselves, where they are known.
"""

from __future__ import annotations

import functools
import inspect
import math
import operator
import os
import re
import reprlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import chain, islice
from numbers import Complex as ComplexNumber
from numbers import Number, Real
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, NoReturn, TypeVar, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from struck.errors import ArgumentError, OptionError, StruckError, article, nearest, rounded

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]
AnyComplex = NDArray[np.complexfloating]
Single = NDArray[np.float32]
AnyArray = NDArray[Any]
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}  # of lengths, m


def numbers(
    name: str,
    values: object,
    *,
    width: int = 0,
    kind: type[np.inexact[Any]] = np.float64,
    error: type[StruckError] = OptionError,
) -> Any:  # noqa: ANN401 - an array of that kind
    """Return values as an array of numbers, rows of `width` of them where that is given.

    Arrays that are so already are returned as they are.
    """
    array = _to_array(values, np.dtype(kind))
    if type(array) is _Unfit:
        raise error(
            f"{name}: {short_text(values)} holds what is no number: give numbers{array.reason}"
        )
    if width and (not array.size or array.shape[-1:] != (width,)):
        raise error(f"{name}: the shape is {array.shape}: give {width} numbers each")
    return array


class _Shortened(reprlib.Repr):
    """Texts of values of any size and class, whose own text may take long or fail."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 9, 2 * _MAX_TEXT_LENGTH, 2 * _MAX_TEXT_LENGTH
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = _MAX_TEXT_LENGTH

    def repr_int(self, x: int, level: int) -> str:
        """Return the digits of a number that has few."""
        del level
        return "a number of more than 300 digits" if _is_huge(x) else repr(x)


def short_text(value: object) -> str:
    """Return a value as messages show it: its text, or how it begins."""
    text = _Shortened().repr(value)
    text = " ".join(text.split()) if "\n" in text else text  # as that of a table of pandas
    if len(text) < _MAX_TEXT_LENGTH:
        return text
    return f"{article(type(value).__name__)} that begins {text[:20]}"


_MAX_TEXT_LENGTH = 60  # characters of a value in a message
_MAX_LISTED_NUMBERS = 9  # numbers of an array that are shown one by one
_ARRAYS = {"Array", "Index", "Mask", "Complex", "AnyComplex", "Single", "NDArray", "ArrayLike"}
_MAX_MAGNITUDE = 1e100  # of a number: its square, and sums of such, are finite


def require_numbers(
    name: str,
    values: object,
    shape: tuple[int, ...],
    *,
    least: float | None = None,
    gaps: bool = False,
) -> None:
    """Require an array of numbers of that shape, none so large that a square overflows.

    With `gaps` some may be NaN or infinite.
    """
    array = values if isinstance(values, np.ndarray) or shape else np.asarray(values)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iufc":
        raise ArgumentError(
            f"{name}: {article(type(values).__name__)} where an array of numbers belongs"
        )
    if array.shape != shape:
        raise OptionError(f"{name}: the shape is {array.shape} and must be {shape}: make them fit")
    if least is not None and np.any(array < least):
        raise OptionError(
            f"{name}: some go down to {rounded(np.nanmin(array))}: give at least {rounded(least)}"
        )
    if not gaps and array.dtype.kind in "fc":
        flat = array.reshape(-1)
        with np.errstate(all="ignore"):
            energy = np.vdot(flat, flat).real  # one pass that takes no memory
        if not float(energy) <= _MAX_MAGNITUDE**2:
            _refuse_beyond(name, array)


def _refuse_beyond(name: str, array: Array) -> None:
    """Refuse numbers that are not finite or beyond `_MAX_MAGNITUDE`."""
    bad_numbers = array[~(np.abs(array).astype(np.float64) <= _MAX_MAGNITUDE)]
    if bad_numbers.size:
        raise OptionError(
            f"{name}: {bad_numbers.size} of {array.size} numbers are not finite or beyond "
            f"{rounded(_MAX_MAGNITUDE)}, as {bad_numbers[0]}: leave those out"
        )


def require_number(
    name: str,
    value: object,
    least: float = 0.0,
    most: float = _MAX_MAGNITUDE,
    *,
    hint: str = "it must be a finite number of at least 0",
    above: bool = False,
    whole: bool = False,
    unit: str = "",
    error: type[StruckError] = OptionError,
) -> None:
    """Require a number from `least` (excluded if `above`) to `most`.

    `hint` ends the message about numbers below `least` and about those that are not finite.
    """
    if not isinstance(value, Real):
        raise ArgumentError(f"{name} is {value!r}: give a number{unit and ' in' + unit}")
    try:
        number = float(value)
    except OverflowError:  # whole numbers have no end, and no text beyond 4,300 digits
        number = value = math.inf
    is_within = least < number if above else least <= number
    if not is_within or number == math.inf or (whole and number % 1):
        raise error(f"{name} is {value}{unit}: {hint}")
    if number > most:
        raise error(f"{name} is {rounded(number)}{unit}: it must be at most {rounded(most)}")


def require_sample_rate(sample_rate: float, *, whole: bool = False, least: float = 1.0) -> None:
    """Require a sample rate that a sound may have, Hz."""
    hint = f"give a {'whole' if whole else 'positive'} one, as 48000"
    require_number("sample rate", sample_rate, least, 1e6, whole=whole, hint=hint, unit=" Hz")


# Arguments by annotations of public names, converted before any work.

Made = TypeVar("Made", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class _Unfit:
    """What a conversion returns for a value that is not of its kind; a reason ends the message."""

    reason: str = ""


_UNFIT = _Unfit()


class _Kind(NamedTuple):
    """A kind of argument: a conversion, which may return an `_Unfit`, and its name in messages."""

    convert: Callable[[Any], Any]
    description: str


# More words for an argument of a kind.
_LAWS = ", as struck.InternalFriction(loss_tangent=0.01), struck.Rayleigh or struck.Measured"
_HINTS = {
    ("damping", "a Damping"): _LAWS,
    ("fitted", "a FittedModes"): ", as of struck.fit, or any object with frequencies, decays and "
    "gains, each (M,), as types.SimpleNamespace(frequencies=...)",
    ("youngs_modulus", "a number"): " in Pa",
    ("density", "a number"): " in kg/m^3",
    ("part", "text"): ", as part='{}'",
    ("damping", "text"): ", own or heard; a law of one's own is a material's: material.damped(law)",
    ("memory", "a number"): ", in bytes, as 2e9",
    ("recordings", "text"): "; an array as Sound(samples=array, sample_rate=48000)",
    ("up", "text"): ", as up='z'",
    ("lowest", "a number"): ", of one note: call it once for each of several",
}
_BOUND_NAMES = {"self", "cls"}  # bound by Python
_BITS = 1023  # of the largest whole number that fits one of double precision


def checked(made: Made) -> Made:
    """Make a function or class convert its arguments to the types that its annotations name.

    Fields of a dataclass hold converted values: Python's floats, and arrays of float64.

    Raises
    ------
    ArgumentError
        On a value of another kind.
    """
    if not isinstance(made, type):
        return _converting(made, made.__name__.removesuffix("_recordings"))  # as in `struck`
    kind: Any = made
    kind.__init__ = _converting(kind.__init__, kind.__name__)
    fields_by_name = getattr(kind, "__dataclass_fields__", {})
    if any(_ARRAYS & set(re.findall(r"\w+", str(field.type))) for field in fields_by_name.values()):
        kind.__repr__ = brief
    return kind


def brief(self: Any) -> str:  # noqa: ANN401 - any dataclass
    """Return an object of a dataclass in a line: arrays by their shapes, large parts by name."""
    parts = [
        f"{field.name}={_part(getattr(self, field.name))}" for field in fields(self) if field.repr
    ]
    return f"{type(self).__name__}({', '.join(parts)})"


def _part(value: Any) -> str:  # noqa: ANN401 - any object
    if isinstance(value, np.ndarray):
        return f"array {value.shape}" if value.size > _MAX_LISTED_NUMBERS else str(value.tolist())
    text = repr(value)
    if len(text) < 2 * _MAX_TEXT_LENGTH and "\n" not in text:
        return text
    length_text = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"{type(value).__name__}{length_text}"


def _converting(function: Any, whose: str) -> Any:  # noqa: ANN401 - any function
    code = function.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    has_variadic = code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)
    optional_names = {*(function.__kwdefaults__ or ())}
    optional_names |= {
        *names[code.co_argcount - len(function.__defaults__ or ()) : code.co_argcount]
    }
    required_names = {*names} - optional_names - {"self"}

    @functools.cache
    def kinds() -> dict[str, _Kind]:
        module = vars(sys.modules[function.__module__])
        annotations = {name: str(function.__annotations__.get(name, "Any")) for name in names}
        return {name: _kind_of_annotation(text, module) for name, text in annotations.items()}

    @functools.wraps(function)
    def converting(*arguments: Any, **keywords: Any) -> Any:  # noqa: ANN401 - as the function
        kinds_by_name = kinds()
        if not has_variadic and (
            len(arguments) > code.co_argcount or not keywords.keys() <= kinds_by_name.keys()
        ):
            refuse_names(whose, code.co_argcount, names, arguments, keywords)
        values = list(arguments)
        for number, (name, value) in enumerate(zip(names, arguments, strict=False)):
            kind = kinds_by_name[name]
            values[number] = converted = kind.convert(value)
            if type(converted) is _Unfit:
                _refuse(name, value, kind.description, converted.reason, whose)
        for name, value in keywords.items():
            kind = kinds_by_name.get(name, _ANY)
            keywords[name] = converted = kind.convert(value)
            if type(converted) is _Unfit:
                _refuse(name, value, kind.description, converted.reason, whose)
        if required_names and (
            lacking := required_names.difference(names[: len(arguments)], keywords)
        ):
            missing = ", ".join(f"{name}=" for name in names if name in lacking)
            raise ArgumentError(f"{whose} was not given {missing}: {_taken(names)}")
        return function(*values, **keywords)

    return converting


def _taken(names: Sequence[str]) -> str:
    return "it takes " + ", ".join(f"{name}=" for name in names if name not in _BOUND_NAMES)


def refuse_names(
    whose: str,
    count: int,
    names: Sequence[str],
    arguments: Sequence[Any],
    keywords: Mapping[str, Any],
) -> None:
    """Refuse arguments beyond the `first` without a name, or of names that a function lacks."""
    if len(arguments) > count:
        pairs = zip(names[count:], arguments[count:], strict=False)
        text = ", ".join(f"{name}={short_text(value)}" for name, value in pairs)
        raise ArgumentError(
            f"{whose} was given {short_text(arguments[count])} without a name: give "
            f"{whose}({'..., ' * (count > (names[0] in _BOUND_NAMES))}{text})"
        )
    unknown = next(name for name in keywords if name not in names)
    suggestion = nearest(unknown, [name for name in names if name not in _BOUND_NAMES], "{}=")
    raise ArgumentError(
        f"{whose} has no {unknown}= (given as {short_text(keywords[unknown])}): "
        f"{suggestion}{_taken(names)}"
    )


def _refuse(name: str, value: object, description: str, reason: str, whose: str) -> NoReturn:
    """Refuse a value, by a message that gives the kinds that fit."""
    kinds = description
    if name in {"impulse", "speed", "force"} and len(_items(value) or ()) == 3:
        kinds += f"; {name}= says how hard, and direction= says which way"
    if (name, description.partition(" or ")[0]) in _HINTS:
        kinds += _HINTS[name, description.partition(" or ")[0]].format(value)
    is_path = isinstance(value, str | os.PathLike)
    if is_path and "a ModalModel" in description:
        load = f", as struck.load({short_text(value)})"
        kinds += "; give it first, and then the path" if whose == "save" else load
    elif whose == "save" and hasattr(value, "save"):
        kinds += f"; {article(type(value).__name__)} has its own save(path)"
    raise ArgumentError(f"{name} is {short_text(value)}: {whose} takes {kinds}{reason}")


def _kind_of_annotation(annotation: str, module: Mapping[str, Any]) -> _Kind:
    """Return the kind of value that an annotation allows."""
    if annotation.startswith("InitVar["):
        annotation = annotation[len("InitVar[") : -1]
    return _union([_kind(part, module) for part in _separate(annotation, "|")])


def _union(kinds: Sequence[_Kind]) -> _Kind:
    """Return the kind of any of some kinds: the first that fits converts a value."""
    if any(kind is _ANY for kind in kinds):
        return _ANY
    if len(kinds) == 1:
        return kinds[0]
    # None is tried first, as it is the quickest.
    ordered_kinds = sorted(kinds, key=lambda kind: kind.description != "None")

    def convert(value: Any) -> Any:  # noqa: ANN401 - any object
        reasons = ""
        for kind in ordered_kinds:
            converted = kind.convert(value)
            if type(converted) is not _Unfit:
                return converted
            reasons = reasons or converted.reason
        return _Unfit(reasons)

    return _Kind(convert, " or ".join(dict.fromkeys(kind.description for kind in kinds)))


def _separate(annotation: str, separator: str) -> Iterator[str]:
    """Yield the parts of an annotation between separators outside of brackets."""
    depth, start = 0, 0
    for position, letter in enumerate(annotation):
        depth += (letter in "[(") - (letter in "])")
        if letter == separator and not depth:
            yield annotation[start:position].strip()
            start = position + 1
    yield annotation[start:].strip()


def _kind(annotation: str, module: Mapping[str, Any]) -> _Kind:
    """Return the kind of value that an annotation without alternatives allows."""
    name, _, rest = annotation.partition("[")
    inner = rest.removesuffix("]")
    if name == "Sequence":
        is_of_numbers = inner in {"float", "int"}
        return _NUMBERS if is_of_numbers else _list_of(_kind_of_annotation(inner, module))
    if name == "tuple":
        return _tuple_of([*_separate(inner, ",")], module)
    if name == "Mapping" and inner:
        return _mapping_to(_kind_of_annotation([*_separate(inner, ",")][-1], module))
    if annotation in _KINDS or name in _KINDS:
        return _KINDS.get(annotation) or _KINDS[name]
    if name in module:
        return _kind_of_object(module[name], name)
    # Not loaded yet, as is everything that the verbs name for type checkers alone.
    return (
        _instance(lambda value: _is_named(value, name), article(name)) if name in _NAMED else _ANY
    )


def _kind_of_object(kind: Any, name: str) -> _Kind:  # noqa: ANN401 - any object
    """Return the kind of value that a class, or a union of classes, allows; any for others."""
    if isinstance(kind, UnionType):
        return _union([_kind_of_part(part) for part in get_args(kind)])
    if not isinstance(kind, type) or kind in {object, Any}:
        return _ANY
    if getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False):
        return _ANY
    return _KINDS.get(name) or _instance(lambda value: isinstance(value, kind), article(name))


def _kind_of_part(part: Any) -> _Kind:  # noqa: ANN401 - a class, perhaps with parameters
    """Return the kind of value that a class of a union allows."""
    origin = get_origin(part)
    if origin not in {tuple, Mapping}:
        return _kind_of_object(origin or part, part.__name__)
    return _kind(re.sub(r"[\w.]+\.(?=\w)", "", str(part)), {})  # without modules


def _is_named(value: object, name: str) -> bool:
    return any(kind.__name__ == name for kind in type(value).__mro__)


# Conversions of a value to a kind, which return an `_Unfit` for others. Most values are of their
# type already, and are returned at once.


def _instance(fits: Callable[[Any], bool], description: str) -> _Kind:
    """Return the kind of values that pass a test; they are not changed."""
    return _Kind(lambda value: value if fits(value) else _UNFIT, description)


def _is_number(value: object) -> bool:
    is_complex = isinstance(value, ComplexNumber) and not isinstance(value, Real)
    return isinstance(value, Number) and not is_complex


def _is_huge(value: object) -> bool:
    return isinstance(value, int) and value.bit_length() > _BITS


def _to_float(value: Any) -> Any:  # noqa: ANN401 - any object
    if type(value) is float:
        return value
    if not _is_number(value) or _is_huge(value):
        return _UNFIT
    try:
        with np.errstate(over="ignore"):  # a long double beyond the range is infinite
            return float(value)
    except (ArithmeticError, TypeError, ValueError):
        return _UNFIT


def _to_int(value: Any) -> Any:  # noqa: ANN401 - any object
    if isinstance(value, bool) or not _is_number(value):
        return _UNFIT
    try:
        integer = int(value)
        return integer if integer == value and not _is_huge(integer) else _UNFIT
    except (ArithmeticError, TypeError, ValueError):
        return _UNFIT


def _to_complex(value: Any) -> Any:  # noqa: ANN401 - any object
    number = _to_float(value)
    is_complex = type(number) is _Unfit and isinstance(value, ComplexNumber)
    return complex(value) if is_complex and not _is_huge(value) else number


def _to_bool(value: Any) -> Any:  # noqa: ANN401 - any object
    return bool(value) if isinstance(value, bool | np.bool_) else _UNFIT


def _to_array(values: Any, dtype: np.dtype[Any]) -> Any:  # noqa: ANN401 - any object
    """Convert to an array of that type; one that is so already is returned itself."""
    if type(values) is np.ndarray and values.dtype is dtype:
        return values
    try:
        fault = _find_fault(values)
        return _cast(np.asarray(values), dtype) if fault is None else fault
    except MemoryError:
        raise
    except Exception:  # noqa: BLE001 - objects of other packages raise what they like
        return _UNFIT


def _cast(array: AnyArray, dtype: np.dtype[Any]) -> Any:  # noqa: ANN401 - or an `_Unfit`
    """Convert an array of any type to an array of numbers."""
    kind = array.dtype.kind
    if kind == "O":
        return _convert_objects(array, dtype)
    if kind not in "biufc":
        return _UNFIT
    if kind == "c" and dtype.kind != "c":
        return _Unfit(", which are real")
    with np.errstate(all="ignore"):
        if array.dtype != dtype and dtype == np.float32:
            array = array.astype(np.float64)  # of all types: rounded as Python's numbers are
        converted = array.astype(dtype, copy=False)
        if dtype.kind in "ib" and (is_changed := converted != array).any():
            return _Unfit(f", and {array[is_changed][0]} is not")
    return converted


def _convert_objects(array: AnyArray, dtype: np.dtype[Any]) -> Any:  # noqa: ANN401 - or an `_Unfit`
    """Convert an array of objects, all of which have to be numbers."""
    convert = {"f": _to_float, "i": _to_int, "c": _to_complex, "b": _to_bool}[dtype.kind]
    items = [convert(item) for item in array.flat]
    if any(type(item) is _Unfit for item in items):
        return _UNFIT
    with np.errstate(over="ignore"):
        return np.array(items, dtype).reshape(array.shape)


def _find_fault(values: Any) -> _Unfit | None:  # noqa: ANN401 - any object
    """Return why an object can be no array, as far as is known before memory is requested."""
    is_array = isinstance(values, Number | memoryview) or hasattr(values, "__array__")
    if not (is_array or _is_list_type(type(values))):
        return _UNFIT
    rows: list[Any] = [values]
    for _ in range(_MAX_DEPTH):
        kinds = set(map(type, rows))
        if any(issubclass(kind, np.ndarray) and hasattr(kind, "mask") for kind in kinds):
            masked_count = sum(np.count_nonzero(np.ma.getmaskarray(row)) for row in rows)
            if masked_count:
                return _Unfit(f", and {masked_count} of these are masked: fill or leave them out")
        kinds = {kind for kind in kinds if _is_list_type(kind)}
        if not kinds:
            return None
        rows = [row for row in rows if type(row) in kinds]
        count = sum(map(len, rows))
        if count > _MAX_LISTED:
            return _Unfit(f", listed up to {_MAX_LISTED} of them: give a NumPy array")
        rows = [*islice(chain.from_iterable(rows), count + 1)]
        if len(rows) != count:  # of an object that is not as long as it says
            return _UNFIT
    return _UNFIT


def _to_numbers(value: Any) -> Any:  # noqa: ANN401 - any object
    """Convert a number to a float, a list or tuple to one of floats, and arrays to float64."""
    kind = type(value)
    if kind is float or (kind in {tuple, list} and set(map(type, value)) == {float}):
        return value
    array = _to_array(value, _DOUBLE)
    if type(array) is _Unfit or not isinstance(value, Sequence | Number):
        return array
    return tuple(array.tolist()) if isinstance(value, tuple) else array.tolist()


def _to_place(value: Any) -> Any:  # noqa: ANN401 - any object
    return value if value is None or isinstance(value, str) else _to_numbers(value)


def _list_of(inner: _Kind) -> _Kind:
    """Return the kind of lists, or arrays, of a kind."""

    def convert(value: Any) -> Any:  # noqa: ANN401 - any object
        items = _items(value)
        if items is None or inner is _ANY:
            return _UNFIT if items is None else value
        converted = [inner.convert(item) for item in items]
        if any(type(item) is _Unfit for item in converted):
            return _UNFIT
        is_same = type(value) in {list, tuple} and all(map(operator.is_, items, converted))
        return value if is_same else converted

    return _Kind(convert, "a list" if inner is _ANY else f"a list of {inner.description}")


def _to_items(value: Any, name: str) -> Any:  # noqa: ANN401 - any object
    """Convert the items of a list that are of a named kind; others are refused by their reader."""
    items = _items(value)
    if not items:
        return value
    converted = [_if_fitting(_KINDS[name], item) for item in items]
    return tuple(converted) if isinstance(value, tuple) else converted


def _is_list_type(kind: type[Any]) -> bool:
    return issubclass(kind, Sequence) and not issubclass(kind, (*_TEXT, memoryview))


def _items(value: Any) -> list[Any] | None:  # noqa: ANN401 - any object
    """Return the items of a list, or the rows of an array; None for another object."""
    if not _is_list_type(type(value)):
        array = value if isinstance(value, np.ndarray) else _to_array(value, _DOUBLE)
        return None if type(array) is _Unfit or not array.ndim else [*array]
    count = len(value)
    items = [*islice(value, count + 1)] if count <= _MAX_LISTED else []
    return items if len(items) == count else None


def _tuple_of(parts: Sequence[str], module: Mapping[str, Any]) -> _Kind:
    """Return the kind of lists that are given where a tuple belongs, which they become."""
    of_numbers = {*parts} - {"..."} in ({"float"}, {"int"})
    inner = _kind_of_annotation(parts[0], module)
    exact = {float if parts[0] == "float" else int}
    dtype = _DOUBLE if parts[0] == "float" else _INTEGER

    def convert(value: Any) -> Any:  # noqa: ANN401 - any object
        if of_numbers and type(value) is tuple and set(map(type, value)) == exact:
            return value
        if of_numbers:
            array = _to_array(value, dtype)
            if type(array) is _Unfit:
                return array
            return tuple(array.tolist()) if array.ndim else _UNFIT
        items = _items(value)
        return _UNFIT if items is None else tuple(_if_fitting(inner, item) for item in items)

    count = "" if "..." in parts else f"{len(parts)} "
    return _Kind(convert, f"{count}numbers" if of_numbers else "a list")


def _mapping_to(inner: _Kind) -> _Kind:
    """Return the kind of mappings to a kind."""

    def convert(value: Any) -> Any:  # noqa: ANN401 - any object
        if not isinstance(value, Mapping):
            return _UNFIT
        items = {key: _if_fitting(inner, item) for key, item in value.items()}
        return value if all(items[key] is item for key, item in value.items()) else items

    return _Kind(convert, "a mapping")


def _if_fitting(kind: _Kind, value: Any) -> Any:  # noqa: ANN401 - any object
    """Return a converted value; itself where it is of another kind, which its user refuses."""
    converted = kind.convert(value)
    return value if type(converted) is _Unfit else converted


def _array_of(dtype: np.dtype[Any], description: str = "numbers") -> _Kind:
    return _Kind(functools.partial(_to_array, dtype=dtype), description)


_TEXT = (str, bytes, bytearray)
_MAX_DEPTH = 8  # of lists in lists; no array here has more than 4 dimensions
_MAX_LISTED = 2**24  # numbers in lists: converted in 2 s, in 0.5 GB
_DOUBLE, _INTEGER = np.dtype(np.float64), np.dtype(np.int64)
_NAMED = frozenset(
    [
        *("Body", "Contacts", "Fitting", "Material", "Mesh", "ModalModel", "Room", "Scene"),
        *("Sound", "SoundMap", "Strike", "Survey"),
    ]
)
_ANY = _Kind(lambda value: value, "anything")
_NUMBERS = _Kind(_to_numbers, "numbers")
_PLACE = _Kind(_to_place, "a name or coordinates")
_KINDS = {
    "None": _instance(lambda value: value is None, "None"),
    "float": _Kind(_to_float, "a number"),
    "int": _Kind(_to_int, "a whole number"),
    "bool": _Kind(_to_bool, "True or False"),
    "str": _instance(lambda value: isinstance(value, str) and "\0" not in value, "text"),
    "Path": _instance(lambda value: isinstance(value, Path), "a path"),
    "os.PathLike": _instance(lambda value: isinstance(value, os.PathLike), "a path"),
    "Callable": _instance(callable, "a function"),
    "Progress": _instance(callable, "a function of a stage and the fraction done"),
    "Mapping": _instance(lambda value: isinstance(value, Mapping), "a mapping"),
    "Band": _Kind(functools.partial(_to_items, name="float"), "two frequencies"),
    "Place": _PLACE,
    "Waypoints": _list_of(_PLACE),
    **dict.fromkeys(["Pairs", "Thickness"], _NUMBERS),
    **dict.fromkeys(["Array", "ArrayLike"], _array_of(_DOUBLE)),
    "NDArray[np.float32]": _array_of(np.dtype(np.float32)),
    "Complex": _array_of(np.dtype(np.complex128)),
    "Index": _array_of(_INTEGER, "whole numbers"),
    "Mask": _array_of(np.dtype(np.bool_), "True or False for each"),
}
