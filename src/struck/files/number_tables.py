"""Tables of numbers as CSV files."""

from __future__ import annotations

import csv
import io
import math
import os

from struck.files.atomic import require_ending, write_bytes
from struck.model.arrays import checked
from struck.model.third_octaves import NumberTable

_KINDS = (".csv",)


@checked
def save_table(table: NumberTable, path: str | os.PathLike[str]) -> None:
    """Save a table of numbers as a CSV file.

    Numbers have all their digits; unknown ones are empty. The first line contains the headings.

    Parameters
    ----------
    table : NumberTable
        The table, such as `struck.energy(...).bands`.
    path : path
        File that ends in ``.csv``. An existing one is replaced.

    Raises
    ------
    FileFormatError
        If the ending is another one, or the folder does not exist.

    Examples
    --------
    >>> table = struck.model.NumberTable(columns={"frequency (Hz)": np.array([440.0, 880.0])})
    >>> struck.files.save_table(table, "tones.csv")
    """
    require_ending(path, _KINDS, "tables")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.headings)
    writer.writerows(
        ["" if math.isnan(value) else repr(value) for value in row] for row in table.rows
    )
    write_bytes(path, text.getvalue().encode())
