"""Docstrings of public names give a caller all they need."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

PACKAGE = Path(__file__).parents[1] / "src/struck"
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

SHAPE = re.compile(r"\(\s*[\w+*`/ -]+(?:,\s*[\w+*/. -]*)+\)")
UNIT = re.compile(
    r"\b(?:m|mm|s|ms|kg|g|N|Pa|Hz|kHz|dB|J|K|1/s|m/s|rad/s|units?|relative|ratios?|factors?"
    r"|shares?|fraction|seconds|bytes|GiB|times|pixels|cents|degrees|samples?|probability)\b"
    r"|%|0 to 1"
)
END = r"(?=^\w[\w ]*\n-+$|\Z)"  # of a section
SECTION = re.compile(rf"^(?:Parameters|Attributes)\n-+\n(.*?){END}", re.MULTILINE | re.DOTALL)
# Docstrings may refer to those of another public name.
REFERENCE = re.compile(r"(?:parameters\s+are\s+those\s+of|\bsee)\s+`(struck\.[\w.]+)`")
ARRAYS = re.compile(r"\b(?:Array(?:Like)?|Index|Mask|Complex|Single)\b")
NUMBERS = re.compile(r"\bfloat\b|\bArray")
DEFAULT = re.compile(r"\boptional\b|\bdefault\b", re.IGNORECASE)
MANY = 380


@cache
def public() -> dict[str, Any]:
    """Return what the stubs of the rooms offer, each once, with the public methods of classes."""
    found: dict[str, Any] = {}
    for stub in sorted(PACKAGE.rglob("__init__.pyi")):
        room = ".".join(stub.parent.relative_to(PACKAGE.parent).parts)
        for statement in ast.parse(stub.read_text(encoding="utf-8")).body:
            for alias in statement.names if isinstance(statement, ast.ImportFrom) else ():
                value = getattr(importlib.import_module(room), alias.asname or alias.name)
                if inspect.isclass(value) or inspect.isfunction(value):
                    found[f"{room}.{alias.asname or alias.name}"] = value
    once = {value: name for name, value in reversed(found.items())}
    methods = {
        f"{name}.{key}": getattr(value, "__func__", value)
        for owner, name in once.items()
        if inspect.isclass(owner)
        for key, value in vars(owner).items()
        if not key.startswith("_")
    }
    names = {name: value for value, name in once.items()}
    return names | {key: value for key, value in methods.items() if inspect.isfunction(value)}


def owner_of(name: str) -> type | None:
    """Return the public class of a method."""
    owner = public().get(name.rpartition(".")[0])
    return owner if inspect.isclass(owner) else None


def parameters(value: Any) -> dict[str, str]:  # noqa: ANN401 - a function or a class
    """Return names and annotations of what a call is given; nothing for protocols and errors."""
    made = not inspect.isclass(value) or not (
        getattr(value, "_is_protocol", False) or issubclass(value, Exception)
    )
    return {
        each.name: str(each.annotation)
        for each in (inspect.signature(value).parameters.values() if made else ())
        if each.name not in {"self", "cls"} and not each.name.startswith("_")
    }


def raised(function: Callable[..., Any]) -> set[str]:
    """Return the errors that a function's own statements raise."""
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(function)))
    return set(re.findall(r"^\s+raise (\w+Error)\(", source, re.MULTILINE))


def explanation(value: Any) -> str:  # noqa: ANN401 - a function or a class
    """Return a docstring, after it that of the name to which it refers for parameters."""
    text = inspect.getdoc(value) or ""
    other = REFERENCE.search(text)
    return text + "\n\n" + (inspect.getdoc(public().get(other[1])) or "") if other else text


@cache
def gaps(name: str) -> list[str]:
    """Return what a docstring leaves out."""
    value, found = public()[name], []
    text, given = explanation(value), parameters(value)
    sections = "".join(SECTION.findall(text)) + "".join(re.findall(r"`[^`]+`", text))
    said = text if owner_of(name) else sections
    found += [f"parameter {each}" for each in given if not re.search(rf"\b{each}\b", said)]
    returned = getattr(value, "__annotations__", {}).get("return", "")
    kinds = " ".join([*given.values(), str(returned)])
    found += ["shapes"] if ARRAYS.search(kinds) and not SHAPE.search(text) else []
    found += ["units"] if NUMBERS.search(kinds) and not UNIT.search(text) else []
    if not inspect.isclass(value):
        found += [f"error {each}" for each in raised(value) if each not in text]
    return found


def entries(text: str) -> list[str]:
    """Return the names of the parameters of a docstring, as they are written in its entries."""
    section = re.search(rf"^Parameters\n-+\n(.*?){END}", text, re.MULTILINE | re.DOTALL)
    lines = section[1].splitlines() if section else []
    return [line.partition(" : ")[0] for line in lines if line[:1].strip()]


def unlisted(name: str) -> list[str]:
    """Return the parameters without an entry of their own, and entries for several parameters."""
    value, text = public()[name], inspect.getdoc(public()[name]) or ""
    listed = entries(text)
    if "The parameters are those of `struck." in text:
        return listed
    required = set(parameters(value))
    keywords = {
        each.name
        for each in (inspect.signature(value).parameters.values() if required else ())
        if each.kind is each.VAR_KEYWORD
    }
    if set(listed) - required - keywords:  # options of a call, one by one
        required -= keywords
    several = [entry for entry in listed if "," in entry]
    return sorted(required - {entry.lstrip("*") for entry in listed}) + several


def without_default(name: str) -> list[str]:
    """Return the parameters with a default whose entries do not state it."""
    value, text = public()[name], inspect.getdoc(public()[name]) or ""
    names = []
    for parameter in inspect.signature(value).parameters.values():
        entry = re.search(
            rf"^{parameter.name} : .*\n(?:(?: {{4}}.*)?\n)*", text + "\n", re.MULTILINE
        )
        if parameter.default is not parameter.empty and entry and not DEFAULT.search(entry[0]):
            names.append(parameter.name)
    return names


def is_explained(name: str) -> bool:
    """Return whether a docstring is whole, or a method's is in its protocol or parent class."""
    owner, method = owner_of(name), name.rpartition(".")[2]
    if not gaps(name) or owner is None:
        return not gaps(name)
    kin = (each for each in public() if each.endswith(f".{method}") and each != name)
    parents = [
        each
        for each in kin
        if (other := owner_of(each))
        and (getattr(other, "_is_protocol", False) or other in owner.__mro__)
    ]
    return any(not gaps(each) for each in parents)


def test_docstrings_of_public_names_say_all_a_caller_needs() -> None:
    assert len(public()) > MANY
    assert not {name: gaps(name) for name in public() if not is_explained(name)}


def test_each_parameter_has_an_entry() -> None:
    assert not {name: unlisted(name) for name in public() if unlisted(name)}


def test_each_optional_parameter_states_its_default() -> None:
    assert not {name: without_default(name) for name in public() if without_default(name)}


def test_a_parameter_without_an_entry_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    from struck.model.damping import Rayleigh

    text = "Law.\n\nParameters\n----------\nmass, stiffness : float\n    Both."
    monkeypatch.setattr(Rayleigh, "__doc__", text)
    missing = ["contains_air", "external", "mass", "stiffness", "mass, stiffness"]
    assert sorted(unlisted("struck.Rayleigh")) == sorted(missing)
    monkeypatch.setattr(
        Rayleigh, "__doc__", f"{text}\nexternal : float\n    1/s.\n\nRaises\n------"
    )
    assert without_default("struck.Rayleigh") == ["external"]


def test_a_gap_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    from struck.model.damping import Rayleigh

    monkeypatch.setattr(Rayleigh.decays, "__doc__", "Return the decay rates.")
    assert "parameter frequencies" in gaps.__wrapped__("struck.Rayleigh.decays")
    assert "shapes" in gaps.__wrapped__("struck.Rayleigh.decays")


# Names of classes in docstrings: in the types of entries, and in backticks.

ENTRY = re.compile(r"^ {0,8}(\w[\w*, ]*) : (.+)$", re.MULTILINE)
QUOTED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
CLASS = re.compile(r"(?<![\w./-])[A-Z][a-z]\w*")
# Words with a capital that are no class of struck.
OTHERS = {"None", "True", "False", "Hertz", "Figure", "Path", "PathLike", "Open3D", "PyVista"} | {
    "PaStreamCallback"
}


@cache
def trees() -> dict[Path, ast.Module]:
    """Return the syntax tree of each module."""
    paths = sorted(PACKAGE.rglob("*.py"))
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


@cache
def documented() -> list[tuple[Path, Documented]]:
    """Return each module, class and function, with the file that defines it.

    Expressions are not entered, which are most of the nodes of a syntax tree.
    """

    def inside(node: ast.AST) -> Iterator[Documented]:
        if isinstance(node, Documented):
            yield node
        for name in ("body", "orelse", "handlers", "finalbody"):
            statements = getattr(node, name, ())
            for statement in statements if isinstance(statements, list) else ():
                yield from inside(statement)

    return [(path, node) for path, tree in trees().items() for node in inside(tree)]


@cache
def classes() -> set[str]:
    """Return the names of all classes."""
    return {node.name for _, node in documented() if isinstance(node, ast.ClassDef)}


@cache
def defined() -> set[str]:
    """Return the names of all classes, and of types and constants at the level of modules."""
    found = OTHERS | classes()
    for node in (node for tree in trees().values() for node in tree.body):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {each.id for each in targets if isinstance(each, ast.Name)}
    return found


def unknown_names(text: str, fields: dict[str, str] | None = None) -> list[str]:
    """Return the classes of a docstring that nothing defines, or that are not those of `fields`.

    `fields` gives the annotations of a class; one that is a class alone must be the entry's type.
    """
    wrong = []
    for entry, kind in ENTRY.findall(text):
        named = CLASS.findall(kind)
        wrong += [name for name in named if name not in defined()]
        for name in entry.split(", "):
            own = (fields or {}).get(name.strip(), "")
            plain = own in classes()
            wrong += [f"{name}: {own}"] if plain and named and own not in named else []
    quoted = [part for name in QUOTED.findall(text) for part in name.split(".")]
    return wrong + [part for part in quoted if CLASS.fullmatch(part) and part not in defined()]


def test_names_of_classes_in_docstrings_exist() -> None:
    wrong = {}
    for path, node in documented():
        if text := ast.get_docstring(node):
            fields = {
                each.target.id: ast.unparse(each.annotation)
                for each in node.body
                if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
            }
            if unknown := unknown_names(text, fields):
                wrong[f"{path.stem}.{getattr(node, 'name', '')}"] = unknown
    assert not wrong


def test_a_class_that_is_gone_is_seen() -> None:
    assert unknown_names("verdict : Judgement") == ["Judgement"]
    assert unknown_names("Its `Judgement.reason`.") == ["Judgement"]
    assert unknown_names("heard : Ringing", {"heard": "Exponentials"})[-1] == "heard: Exponentials"
