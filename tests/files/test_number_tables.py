"""Tables of numbers as CSV files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from struck.errors import FileFormatError, OptionError
from struck.files import save_table
from struck.model import NumberTable

TABLE = NumberTable(
    columns={
        "third octave (Hz)": np.array([31.5, 40.0]),
        "modes": np.array([2, 0]),
        "energy (J)": np.array([1 / 3, np.nan]),
    }
)


def test_every_digit_is_kept(tmp_path: Path) -> None:
    save_table(TABLE, tmp_path / "bands.csv")
    with (tmp_path / "bands.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["third octave (Hz)", "modes", "energy (J)"]
    assert rows[1] == ["31.5", "2", repr(1 / 3)]
    assert rows[2] == ["40.0", "0", ""]


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="csv"):
        save_table(TABLE, tmp_path / "bands.txt")
    with pytest.raises(FileFormatError):
        save_table(TABLE, tmp_path / "missing" / "bands.csv")


def test_columns_of_other_lengths_are_refused() -> None:
    with pytest.raises(OptionError, match=r"b: the shape is \(3,\) and must be \(2,\)"):
        NumberTable(columns={"a": np.zeros(2), "b": np.zeros(3)})


def test_text_has_four_digits() -> None:
    assert str(TABLE).splitlines() == [
        "third octave (Hz)  modes  energy (J)",
        "31.5                   2      0.3333",
        "40                     0           -",
    ]
