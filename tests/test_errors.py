"""Texts that all messages have in common: numbers as people write them."""

from __future__ import annotations

import ast
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from struck import errors
from struck.errors import rounded

PACKAGE = Path(__file__).parents[1] / "src/struck"
WRITTEN = {
    (172.4, 2): "170",
    (1e2, 1): "100",
    (99.96, 3): "100",
    (15432.1, 4): "15430",
    (0.12345, 3): "0.123",
    (999_999.6, 6): "1e6",
    (72e9, 6): "7.2e10",
    (2.0567e-9, 4): "2.057e-9",
    (1.234e-4, 2): "0.00012",
    (-0.0, 3): "0",
    (float("inf"), 3): "inf",
    (343, 6): "343",
}


@pytest.mark.parametrize(("value", "digits"), WRITTEN)
def test_numbers_are_written_as_people_write_them(value: float, digits: int) -> None:
    assert rounded(value, digits) == WRITTEN[value, digits]


def test_signs_are_written_where_they_matter() -> None:
    assert rounded(312.6, 3, sign=True) == "+313"
    assert rounded(-0.5, 3, sign=True) == "-0.5"


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 9))
def test_a_written_number_is_the_number_to_its_digits(value: float, digits: int) -> None:
    text = rounded(value, digits)
    assert "e+" not in text
    assert not re.search(r"e-?0|\.0*$|\.\d*0(e|$)", text)
    exact = float(f"{value:.{digits}g}")
    assert math.isclose(float(text), exact, rel_tol=1e-14, abs_tol=0)


def is_constant(value: ast.expr) -> bool:
    """Return whether a value is made of constants of a module, whose texts are known."""
    names = [node.id for node in ast.walk(value) if isinstance(node, ast.Name)]
    return all(name.isupper() for name in names)


def test_no_text_is_written_in_a_format_that_brings_powers_of_ten() -> None:
    """A format such as .2g makes "1.7e+02" of 172: `rounded` does not."""
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FormattedValue) and node.format_spec is not None:
                form = ast.unparse(node.format_spec)
                if path.name != "errors.py" and (
                    re.search(r"\.[1-5]g|e'$", form)
                    or (form == "f'g'" and not is_constant(node.value))
                ):
                    wrong.append(f"{path.relative_to(PACKAGE)}:{node.lineno}: {form}")
    assert not wrong


def test_names_in_a_message_cannot_steer_a_terminal_or_forge_a_line() -> None:
    for kind in (errors.StruckError, errors.FileFormatError, errors.DeviceError):
        assert str(kind("a\x1b[31m\nstruck: \udcff \u202e done")) == (
            r"a\x1b[31m\nstruck: \xff \u202e done"
        )
        assert str(kind("na\u00efve 5 \N{MICRO SIGN}m")) == "na\u00efve 5 \N{MICRO SIGN}m"
