"""Text files that people write: bounds on size, keys, depth and numbers, and time."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from struck.errors import FileFormatError
from struck.files.toml_text import MAX_BYTES, read_text, read_toml


def file_of(folder: Path, text: str) -> Path:
    path = folder / "a.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_values_return(tmp_path: Path) -> None:
    text = '\ufeffa.b."c d" = 9223372036854775807\nx = [1.5, "1.2.3.4.5.6.7.8"]\n'
    assert read_toml(file_of(tmp_path, text)) == {
        "a": {"b": {"c d": 2**63 - 1}},
        "x": [1.5, "1.2.3.4.5.6.7.8"],
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = = 1", "is no TOML: Invalid value"),
        ("a = 9223372036854775808", "a number has 64 bits, and at most 63 fit"),
        ("a = 1" + "0" * 400, "bits, and at most 63 fit"),
        ("a = [{b = [[0, 1" + "0" * 400 + "]]}]", "bits, and at most 63 fit"),
        ("a = 1" + "0" * 5000, "is no TOML: Exceeds the limit"),
        ("a = " + "[" * 10_000 + "]" * 10_000, "too deep in one another: make them flat"),
        ("a = " + "{a = " * 10_000, "too deep in one another: make them flat"),
        (".".join(["a"] * 20_000) + " = 1", "a key has more than 8 parts"),
        (".".join(['"a b"'] * 20_000) + " = 1", "a key has more than 8 parts"),
        (" . ".join(["'\"'"] * 20_000) + " = 1", "a key has more than 8 parts"),
        (".".join(["a" * 200] * 20_000) + " = 1", "a key has more than 8 parts"),
        (".".join(['"\\""'] * 20_000) + " = 1", "a key has more than 8 parts"),
        ("[" + ".".join(["a"] * 20_000) + "]", "a key has more than 8 parts"),
        ("\n".join(f"[a{n}.b]" for n in range(1001)), "1001 tables have names of several parts"),
        ("\n".join(f" [[ a{n} . '].' ]] #" for n in range(1001)), "1001 tables have names of"),
        ("x = {" + ".".join(["a"] * 20_000) + " = 1}", "a key has more than 8 parts"),
    ],
)
def test_what_is_beyond_the_bounds_is_refused_at_once(
    tmp_path: Path, text: str, words: str
) -> None:
    path = file_of(tmp_path, text)
    start = time.process_time()
    with pytest.raises(FileFormatError, match=r"a\.toml") as caught:
        read_toml(path)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 500
    assert time.process_time() - start < 5


def test_large_files_and_other_texts_are_refused(tmp_path: Path) -> None:
    path = file_of(tmp_path, "#" * (MAX_BYTES + 1))
    with pytest.raises(FileFormatError, match=f"at most {MAX_BYTES} are read"):
        read_toml(path)
    path.write_bytes(b"a = '\xff'")
    with pytest.raises(FileFormatError, match="is no UTF-8 text"):
        read_text(path)


def numbered(line: str) -> str:
    """Return lines that differ by a number, as long together as a file may be."""
    count = MAX_BYTES // len(line.format(1_000_000))
    return "".join(line.format(number) for number in range(count))


WORST = {
    "keys of eight parts": "b{}." + ".".join(["a"] * 7) + "=1\n",
    "tables": "[a{}]\n",
    "lists of tables": "[[a{}]]\n",
    "keys": "a{}=1\n",
    "whole numbers": "x{}=[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]\n",
    "dots": "x{}='................................................................'\n",
}


@pytest.mark.prove
@pytest.mark.timed
@pytest.mark.parametrize("name", WORST)
def test_the_largest_files_are_read_in_time(tmp_path: Path, name: str) -> None:
    path = file_of(tmp_path, numbered(WORST[name]))
    start = time.process_time()
    read_toml(path)
    assert time.process_time() - start < 10
