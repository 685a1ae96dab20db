"""The checkers of wording and names: what they mark, and how a room fails."""

from __future__ import annotations

import importlib.util
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

CI = Path(__file__).parents[1] / ".ci"


def loaded(name: str) -> ModuleType:
    """Return a script of `.ci` as a module."""
    specification = importlib.util.spec_from_file_location(name, CI / f"{name}.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    specification.loader.exec_module(module)
    return module


plain = loaded("plain")


@pytest.mark.parametrize(
    ("kind", "text", "rule"),
    [
        ("docstring", "Return what a player was told.", "told"),
        ("docstring", "a, b : float, str\n    Two parameters.", "two parameters, one entry"),
        ("comment", "the origin unless given", "unless given"),
        ("message", "export it anew", "anew"),
        ("help", "at most so many", "so many"),
        ("document", "It takes 48 samples a block.", "a unit"),
        ("name", "told", "name: told"),
        ("name", "modes_wanted", "name: wanted"),
    ],
)
def test_a_hit_is_marked(kind: str, text: str, rule: str) -> None:
    assert rule in dict(plain.offences(plain.Text(kind, "a.py:1", text)))


@pytest.mark.parametrize(
    "text",
    [
        "Return the power spectral density at each frequency (F,).",
        "Default: the unit stored in the file, otherwise metres.",
        "Raise `told` if the argument is negative.",
    ],
)
def test_plain_text_is_not_marked(text: str) -> None:
    assert not list(plain.offences(plain.Text("docstring", "a.py:1", text)))


def test_a_bare_participle_is_no_function() -> None:
    hits = dict(plain.offences(plain.Text("name", "a.py:1", "raised", "function")))
    assert hits == {"name: bare participle": "raised"}
    assert not list(plain.offences(plain.Text("name", "a.py:1", "resampled", "function")))


def test_overloaded_names_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("def work(own, mass):\n    _found, heard_level = own, mass\n", encoding="utf-8")
    listed = plain.overloaded(("room", text) for text in plain.texts(path, "module.py"))
    assert listed == ["module.py:1: own", "module.py:2: _found"]


def test_all_names_of_a_module_are_read(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        "LIMIT = 1\nclass Body:\n    def __init__(self, mass):\n        self.weight = mass\n"
        "def work(first, *rest, key=2, **others):\n    total = lambda x: x\n    total = 2\n",
        encoding="utf-8",
    )
    names = {(text.binding, text.text) for text in plain.texts(path, "module.py") if text.binding}
    assert names == {
        *(("constant", "LIMIT"), ("class", "Body"), ("function", "__init__"), ("function", "work")),
        *(("parameter", "mass"), ("attribute", "weight"), ("parameter", "first")),
        *(("parameter", "rest"), ("parameter", "key"), ("parameter", "others")),
        *(("variable", "total"), ("parameter", "x")),
    }


def test_a_room_that_gets_worse_is_named() -> None:
    baseline = {"files": {"told": 2}}
    assert plain.worse({"files": Counter(told=2)}, baseline) == []
    assert plain.worse({"files": Counter(told=3)}, baseline) == ["files: told: 2 -> 3"]
    assert plain.worse({"new": Counter(anew=1)}, baseline) == ["new: anew: 0 -> 1"]


@pytest.mark.parametrize(
    ("name", "binding", "unclear"),
    [
        ("found", "variable", True),
        ("roots", "variable", False),
        ("is_audible", "parameter", False),
        ("likely", "parameter", True),
        ("quickly", "function", True),
        ("estimate_noise", "function", False),
    ],
)
def test_names_need_a_noun_and_functions_a_verb(name: str, binding: str, *, unclear: bool) -> None:
    pytest.importorskip("textblob")  # of the group of linters
    heads = loaded("heads")
    assert heads.is_unclear(plain.Text("name", "a.py:1", name, binding)) is unclear
