"""Arrays and other arguments: short names for annotations, and checks of the values given.

`checked` compares the arguments of a public name with its annotations: text for a number, or a
path for a material, is refused with the argument's name, before an error deep in the work. Bounds
are checked by the names themselves, where they are known.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from numbers import Number, Real
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin

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
    """Return values as an array of numbers, rows of `width` of them where that is given."""
    try:
        array = np.asarray(values, kind)
    except (TypeError, ValueError, OverflowError):
        raise error(f"{name}: {_shown(values)} holds what is no number: give numbers") from None
    if width and (not array.size or array.shape[-1:] != (width,)):
        raise error(f"{name}: the shape is {array.shape}: give {width} numbers each")
    return array


def _shown(value: object) -> str:
    text = "a number of more than 300 digits" if _is_huge(value) else repr(value)
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


# Types of arguments by annotations of public names, checked before any work.

Made = TypeVar("Made", bound=Callable[..., Any])
# A kind of argument: a test of a value, and the words by which messages name the kind.
Sort = tuple[Callable[[Any], bool], str]

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
    """Make a function or class refuse arguments whose types do not fit its annotations.

    Raises
    ------
    ArgumentError
        On a value of another sort.
    """
    if not isinstance(made, type):
        return _refusing(made, made.__name__.removesuffix("_recordings"))  # as in `struck`
    kind: Any = made
    kind.__init__ = _refusing(kind.__init__, kind.__name__)
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


def _refusing(function: Any, whose: str) -> Any:  # noqa: ANN401 - any function
    code = function.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    has_variadic = code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)
    optional_names = {*(function.__kwdefaults__ or ())}
    optional_names |= {
        *names[code.co_argcount - len(function.__defaults__ or ()) : code.co_argcount]
    }
    required_names = {*names} - optional_names - {"self"}

    @functools.cache
    def sorts() -> dict[str, tuple[Sort, ...]]:
        module = vars(sys.modules[function.__module__])
        annotations = {name: str(function.__annotations__.get(name, "Any")) for name in names}
        return {name: _sorts(text, module) for name, text in annotations.items()}

    @functools.wraps(function)
    def refusing(*arguments: Any, **keywords: Any) -> Any:  # noqa: ANN401 - as the function
        sorts_by_name = sorts()
        if not has_variadic and (
            len(arguments) > code.co_argcount or not keywords.keys() <= sorts_by_name.keys()
        ):
            refuse_names(whose, code.co_argcount, names, arguments, keywords)
        for name, value in zip(names, arguments, strict=False):
            _require_sort(name, value, sorts_by_name[name], whose)
        for name, value in keywords.items():
            _require_sort(name, value, sorts_by_name.get(name, ()), whose)
        if required_names and (
            lacking := required_names.difference(names[: len(arguments)], keywords)
        ):
            missing = ", ".join(f"{name}=" for name in names if name in lacking)
            raise ArgumentError(f"{whose} was not given {missing}: {_taken(names)}")
        return function(*arguments, **keywords)

    return refusing


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
        text = ", ".join(f"{name}={_shown(value)}" for name, value in pairs)
        raise ArgumentError(
            f"{whose} was given {_shown(arguments[count])} without a name: give "
            f"{whose}({'..., ' * (count > (names[0] in _BOUND_NAMES))}{text})"
        )
    unknown = next(name for name in keywords if name not in names)
    suggestion = nearest(unknown, [name for name in names if name not in _BOUND_NAMES], "{}=")
    raise ArgumentError(
        f"{whose} has no {unknown}= (given as {_shown(keywords[unknown])}): "
        f"{suggestion}{_taken(names)}"
    )


def _require_sort(name: str, value: object, sorts: tuple[Sort, ...], whose: str) -> None:
    if not sorts or any(fits(value) for fits, _ in sorts):
        return
    kinds = " or ".join(dict.fromkeys(text for _, text in sorts))
    if name in {"impulse", "speed", "force"} and np.shape(np.asarray(value, object)) == (3,):
        kinds += f"; {name}= says how hard, and direction= says which way"
    if (name, kinds.partition(" or ")[0]) in _HINTS:
        kinds += _HINTS[name, kinds.partition(" or ")[0]].format(value)
    is_path = isinstance(value, str | os.PathLike)
    if is_path and "a ModalModel" in kinds:
        load = f", as struck.load({_shown(value)})"
        kinds += "; give it first, and then the path" if whose == "save" else load
    elif whose == "save" and hasattr(value, "save"):
        kinds += f"; {article(type(value).__name__)} has its own save(path)"
    raise ArgumentError(f"{name} is {_shown(value)}: {whose} takes {kinds}")


def _sorts(annotation: str, module: Mapping[str, Any]) -> tuple[Sort, ...]:
    """Return the kinds of value that an annotation allows; none if it allows any."""
    if annotation.startswith("InitVar["):
        annotation = annotation[len("InitVar[") : -1]
    sorts = [_sort(part, module) for part in _alternatives(annotation)]
    return tuple(sort for sort in sorts if sort) if all(sorts) else ()


def _alternatives(annotation: str) -> Iterator[str]:
    """Yield the parts of a union."""
    depth, start = 0, 0
    for position, letter in enumerate(annotation):
        depth += (letter in "[(") - (letter in "])")
        if letter == "|" and not depth:
            yield annotation[start:position].strip()
            start = position + 1
    yield annotation[start:].strip()


def _sort(annotation: str, module: Mapping[str, Any]) -> Sort | None:
    name, _, rest = annotation.partition("[")
    inner = rest.removesuffix("]")
    if name == "Sequence":
        return _NUMBERS if {inner} <= _OF_NUMBERS else _list_of(_sorts(inner, module))
    if name == "tuple":
        return _tuple_of(inner)
    if name in _SORTS:
        return _SORTS[name]
    if name in module:
        return _of_kind(module[name], name)
    # Not loaded yet, as is everything that the verbs name for type checkers alone.
    return (lambda value: _is_named(value, name), article(name)) if name in _NAMED else None


def _tuple_of(inner: str) -> Sort:
    """Return the test that an argument passes as a list, of numbers where the tuple holds them."""
    is_listed, kinds = _list_of(())[0], set(inner.split(", "))
    if not kinds <= _OF_NUMBERS:
        return is_listed, "a list"
    count = "" if "..." in kinds else f"{inner.count(',') + 1} "
    return (lambda value: is_listed(value) and _is_numbers(value)), f"{count}numbers"


def _list_of(inner: tuple[Sort, ...]) -> Sort:
    def fits(value: Any) -> bool:  # noqa: ANN401 - any object
        is_listed = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        if not is_listed and not (isinstance(value, np.ndarray) and value.ndim):
            return False
        return not inner or all(any(sort(item) for sort, _ in inner) for item in value)

    return fits, " of ".join(["a list", *(text for _, text in inner[:1])])


def _of_kind(kind: Any, name: str) -> Sort | None:  # noqa: ANN401 - any object
    """Return the test that a class, or a union of classes, makes of arguments; None if neither."""
    if isinstance(kind, UnionType):
        parts = [_of_kind(get_origin(item) or item, item.__name__) for item in get_args(kind)]
        if not all(parts):
            return None
        texts = " or ".join(part[1] for part in parts if part)
        return (lambda value: any(part[0](value) for part in parts if part)), texts
    if not isinstance(kind, type) or kind in {object, Any}:
        return None
    if getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False):
        return None
    return _SORTS.get(name) or ((lambda value: isinstance(value, kind)), article(name))


def _is_named(value: object, name: str) -> bool:
    return any(kind.__name__ == name for kind in type(value).__mro__)


def _is_number(value: object) -> bool:
    return isinstance(value, Number) and not isinstance(value, complex)


def _is_huge(value: object) -> bool:
    return isinstance(value, int) and value.bit_length() > _BITS


def _is_whole(value: Any) -> bool:  # noqa: ANN401 - any object
    whole = _is_number(value) and not isinstance(value, bool) and not _is_huge(value)
    return whole and float(value).is_integer()


def _is_numbers(value: object) -> bool:
    """Return whether a value is a number, or a list or an array of numbers."""
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        try:
            value = np.asarray(value)
        except (ValueError, OverflowError, TypeError):
            return False
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "biufc"
    return hasattr(value, "__array__") or (isinstance(value, Number) and not _is_huge(value))


_OF_NUMBERS = frozenset(["float", "int", "..."])
_NAMED = frozenset(
    [
        *("Body", "Contacts", "Fitting", "Material", "Mesh", "ModalModel", "Room", "Scene"),
        *("Sound", "SoundMap", "Strike", "Survey"),
    ]
)
_NUMBERS: Sort = (_is_numbers, "numbers")
_SORTS: dict[str, Sort] = {
    "None": (lambda value: value is None, "None"),
    "float": (lambda value: _is_number(value) and not _is_huge(value), "a number"),
    "int": (_is_whole, "a whole number"),
    "bool": (lambda value: isinstance(value, bool | np.bool_), "True or False"),
    "str": (lambda value: isinstance(value, str) and "\0" not in value, "text"),
    "Path": (lambda value: isinstance(value, Path), "a path"),
    "os.PathLike": (lambda value: isinstance(value, os.PathLike), "a path"),
    "Callable": (callable, "a function"),
    "Progress": (callable, "a function of a stage and the fraction done"),
    "Mapping": (lambda value: isinstance(value, Mapping), "a mapping"),
    "Place": (
        lambda value: value is None or isinstance(value, str) or _is_numbers(value),
        "a name or coordinates",
    ),
    **dict.fromkeys(
        ["Array", "ArrayLike", "Complex", "Index", "NDArray", "Pairs", "Thickness"], _NUMBERS
    ),
}
