"""The table that leads from each formula of van den Doel & Pai 1998 to the code."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "shapes.md"
ROW = re.compile(r"^\| (\d+) \|.*\|(.*)\|$", re.MULTILINE)
LINK = re.compile(r"`(struck(?:\.\w+)+)`")


def found(name: str) -> object:
    """Return what a dotted name stands for: the longest module in it, then attributes."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            value: object = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            value = getattr(value, part)
        return value
    raise ModuleNotFoundError(name)


def test_every_formula_leads_to_code_that_is_there() -> None:
    rows = ROW.findall(PAGE.read_text(encoding="utf-8"))
    assert [int(number) for number, _ in rows] == list(range(1, 15))
    for number, cell in rows:
        names = LINK.findall(cell)
        assert names, f"formula {number} names no code"
        for name in names:
            assert found(name) is not None
