"""Tables of jobs: what is no table, and cells that are no values, are one refusal in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from struck.batch.job_table import jobs_of, table_rows
from struck.errors import FileFormatError, OptionError, StruckError
from tests.samples import sampled


def table_of(folder: Path, text: str, name: str = "jobs.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ("inf", "inf is no whole number"),
        ("nan", "nan is no whole number"),
        ("5.5", "5.5 is no whole number"),
        ("1" + "0" * 400, "a number has 1329 bits, and at most 63 fit"),
        ('"1' + "0" * 400 + '"', "is not understood"),
        ("[1]", "is not understood"),
        ("{a = 1}", "is not understood"),
    ],
)
def test_modes_that_are_no_number_are_refused(tmp_path: Path, modes: str, words: str) -> None:
    table = table_of(tmp_path, f'[[files]]\nfile = "a.obj"\nmodes = {modes}\n')
    with pytest.raises(StruckError) as caught:
        jobs_of(None, "steel", table, {})
    assert words in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("modes", [10**400, float("inf"), "1e999", [], None])
def test_modes_given_in_python_are_a_number_or_refused(modes: object) -> None:
    rows: list[dict[str, Any]] = [{"file": "a.obj", "modes": modes}]
    if modes is None:
        assert "modes" not in jobs_of(None, "steel", rows, {})[0].options
        return
    with pytest.raises(OptionError, match="row 1 of the table is not understood"):
        jobs_of(None, "steel", rows, {})


def test_names_of_unknown_columns_are_escaped_and_few(tmp_path: Path) -> None:
    columns = [f'"\\u001b[{number}m{"x" * 100}" = 1' for number in range(1000)]
    table = table_of(tmp_path, '[[files]]\nfile = "a.obj"\n' + "\n".join(columns))
    with pytest.raises(OptionError) as caught:
        jobs_of(None, "steel", table, {})
    message = str(caught.value)
    assert message.isprintable()
    assert r"has no \x1b[0m" in message
    assert " and 997 more" in message
    assert len(message) < 1000


@pytest.mark.parametrize(
    "text",
    [
        "",
        "files = 5",
        "files = [1, 2]",
        "[[files]]\nfile = 'a'\n[[other]]\nfile = 'b'",
        "[files]\nfile = 'a'",
    ],
)
def test_files_without_a_table_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(FileFormatError, match="holds no table: give "):
        table_rows(table_of(tmp_path, text))


@pytest.mark.parametrize("file", ["5", "['a.obj']", "''", "{}"])
def test_rows_name_a_file(tmp_path: Path, file: str) -> None:
    table = table_of(tmp_path, f"[[files]]\nfile = {file}\n")
    with pytest.raises(OptionError, match="names no file: it is needed"):
        jobs_of(None, "steel", table, {})


CELLS = ["5", "inf", "-1", "'x'", "''", "true", "[]", "[1, 'x']", "{}", "1979-05-27", r'"\u0000"']
COLUMNS = (
    "output",
    "material",
    "size",
    "wall",
    "modes",
    "repair",
    "filled",
    "immersed",
    "air_mass",
    "band",
    "fixed",
    "units",
    "part",
)


@pytest.mark.parametrize("column", sampled(COLUMNS, "modes", "band", "output", "material"))
def test_whatever_a_cell_holds(tmp_path: Path, column: str) -> None:
    refusals = 0
    for cell in CELLS:
        table = table_of(tmp_path, f'[[files]]\nfile = "a.obj"\n{column} = {cell}\n')
        try:
            (job,) = jobs_of(None, "steel", table, {})
        except StruckError:
            refusals += 1
        else:
            assert job.file.endswith("a.obj")
    assert refusals


def test_csv_with_too_long_cells_is_refused(tmp_path: Path) -> None:
    table = table_of(tmp_path, f"file\n{'x' * 200_000}\n", "jobs.csv")
    with pytest.raises(FileFormatError, match="field larger than field limit"):
        table_rows(table)
