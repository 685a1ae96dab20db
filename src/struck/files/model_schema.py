"""The published schema of the metadata of model files, and the check of metadata by it.

The check implements the keywords of JSON Schema (draft 2020-12) that `model.schema.json` uses: a
package that implements all of them would be one more dependency.
"""

from __future__ import annotations

import json
import operator
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from struck.errors import FileFormatError, article, printable, rounded

_NUMBER = (int, float)
_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": _NUMBER,
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
}
_TYPE_NAMES = {
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
    "string": "a text",
    "array": "a list",
}
_KIND = "kind"  # key by which objects of several kinds are distinguished
_LARGEST = sys.float_info.max  # JSON's numbers have no end
_MISSING = object()
_MAX_SHOWN = 60  # characters of a value in a message

Schema = Any  # a JSON object, or false, which no value follows
Place = tuple[str | int, ...]  # keys and indices of items, from the outermost


@dataclass(frozen=True, slots=True)
class _Fault:
    """A value that does not follow the schema."""

    place: Place
    value: object
    hint: str  # the values that the schema allows


@cache
def model_schema() -> Schema:
    """Return the schema of the metadata of model files."""
    text = (resources.files("struck.files") / "model.schema.json").read_text(encoding="utf-8")
    return json.loads(text)


def require_schema(metadata: object) -> None:
    """Raise FileFormatError if metadata, as `json.loads` returns them, break the schema."""
    fault = _first_fault(metadata, model_schema(), ())
    if fault is not None:
        place = printable(".".join(map(str, fault.place)) or "metadata")[:_MAX_SHOWN]
        text = "missing" if fault.value is _MISSING else repr(fault.value)[:_MAX_SHOWN]
        raise FileFormatError(
            f"its {place} is {printable(text)}: give {fault.hint}, by docs/reference/model_file.md"
        )


def _first_fault(value: Any, schema: Schema, place: Place) -> _Fault | None:  # noqa: ANN401 - JSON
    """Return where a value breaks a schema, None if it does not."""
    if schema is False:
        return _Fault(place, value, "no such key")
    schema = _dereference(schema)
    for key in schema.get("required", ()) if isinstance(value, dict) else ():
        if key not in value:
            return _Fault((*place, key), _MISSING, "it")
    for keyword, (kinds, follows, hint) in _RULES.items():
        if keyword in schema and isinstance(value, kinds) and not follows(value, schema[keyword]):
            return _Fault(place, value, hint(schema[keyword]))
    for keyword in ("anyOf", "oneOf"):
        if keyword in schema and (fault := _fault_of_choices(value, schema[keyword], place)):
            return fault
    faults = (_first_fault(*part) for part in _parts(value, schema, place))
    return next(filter(None, faults), None)


def _dereference(schema: Schema) -> Schema:
    name = schema.get("$ref", "").removeprefix("#/$defs/")
    return model_schema()["$defs"][name] if name else schema


def _parts(value: object, schema: Schema, place: Place) -> Iterator[tuple[Any, Schema, Place]]:
    """Yield the parts of an object or a list that have a schema, and their places."""
    if isinstance(value, dict):
        schemas, others = schema.get("properties", {}), schema.get("additionalProperties", {})
        for key, part in value.items():
            yield part, schemas.get(key, others), (*place, key)
    if isinstance(value, list) and "items" in schema:
        item_schema = _dereference(schema["items"])
        for index in _deciding_items(value):
            yield value[index], item_schema, (*place, index)


def _deciding_items(items: list[Any]) -> Iterator[int]:
    """Yield the indices of items that follow a schema only if all do: of numbers, the extremes."""
    for kind in {*map(type, items)}:
        if kind in {int, float, str}:
            members = [item for item in items if type(item) is kind]
            yield from (items.index(min(members)), items.index(max(members)))
        else:
            yield from (index for index, item in enumerate(items) if type(item) is kind)


def _fault_of_choices(value: object, schemas: list[Schema], place: Place) -> _Fault | None:
    """Return the fault of the schema that was meant, None if a value follows one of several."""
    schemas = [_dereference(schema) for schema in schemas]
    kinds = {
        schema["properties"][_KIND]["const"]: schema
        for schema in schemas
        if _KIND in schema.get("properties", {})
    }
    if kinds and isinstance(value, dict):
        kind = value.get(_KIND)
        if not isinstance(kind, str) or kind not in kinds:
            return _Fault((*place, _KIND), kind, f"one of {', '.join(kinds)}")
        return _first_fault(value, kinds[kind], place)
    faults = [fault for schema in schemas if (fault := _first_fault(value, schema, place))]
    if len(faults) < len(schemas):
        return None
    # The one that was meant agrees with the value farthest.
    deepest = max(faults, key=lambda fault: len(fault.place))
    hints = [fault.hint for fault in faults if fault.place == deepest.place]
    return _Fault(deepest.place, deepest.value, " or ".join(hints))


def _is_of_type(value: object, names: str | list[str]) -> bool:
    """Return whether a value is of a type, or of one of several."""
    if isinstance(names, list):
        return any(_is_of_type(value, name) for name in names)
    if not isinstance(value, _TYPES[names]):
        return False
    if names in {"number", "integer"} and isinstance(value, int | float):
        return not isinstance(value, bool) and -_LARGEST <= value <= _LARGEST  # True is an int
    return True


def _is_one_of(value: object, choices: list[object]) -> bool:
    return any(type(value) is type(choice) and value == choice for choice in choices)


def _list_types(names: str | list[str]) -> str:
    names = [names] if isinstance(names, str) else names
    return " or ".join(_TYPE_NAMES.get(name) or article(name) for name in names)


# By keyword: the types of value that it rules, its test, and the hint on what is allowed.
_RULES: dict[str, tuple[Any, Callable[[Any, Any], bool], Callable[[Any], str]]] = {
    "type": (object, _is_of_type, _list_types),
    "const": (object, lambda value, only: _is_one_of(value, [only]), json.dumps),
    "enum": (object, _is_one_of, lambda choices: " or ".join(map(json.dumps, choices))),
    "minItems": (list, lambda value, n: len(value) >= n, lambda n: f"at least {n} items"),
    "maxItems": (list, lambda value, n: len(value) <= n, lambda n: f"at most {n} items"),
    "minProperties": (dict, lambda value, n: len(value) >= n, lambda n: f"at least {n} keys"),
    "maxProperties": (dict, lambda value, n: len(value) <= n, lambda n: f"at most {n} keys"),
    "minimum": (_NUMBER, operator.ge, lambda bound: f"a number of at least {rounded(bound)}"),
    "maximum": (_NUMBER, operator.le, lambda bound: f"a number of at most {rounded(bound)}"),
    "exclusiveMinimum": (_NUMBER, operator.gt, lambda bound: f"a number above {rounded(bound)}"),
}
