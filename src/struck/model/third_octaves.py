"""Third octaves, and tables of numbers with their headings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from struck.errors import rounded
from struck.model.arrays import Array, Index, brief, checked, require_numbers
from struck.model.html import aligned, table

# IEC 61260-1:2014, 5.2 to 5.5: ten bands in a factor of 10, 1 kHz is the centre of one, and the
# nominal frequencies of a decade.
_BANDS_PER_DECADE = 10
_REFERENCE = 1000.0  # Hz
_NOMINAL_MANTISSAS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
_DIGITS = 4  # of a number in a text


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NumberTable:
    """Columns of numbers with their headings, as text, as HTML and for files.

    Parameters
    ----------
    columns : mapping of str to array (N,)
        Columns by heading, which contains the unit; NaN for an unknown number.

    Raises
    ------
    OptionError
        If the columns differ in length.

    Examples
    --------
    >>> print(struck.model.NumberTable(columns={"Hz": np.array([440.0]), "1/s": np.array([2.5])}))
    Hz   1/s
    440  2.5
    """

    __repr__ = brief
    columns: Mapping[str, Index | Array]

    def __post_init__(self) -> None:
        first = next(iter(self.columns.values()), np.zeros(0))
        for heading, column in self.columns.items():
            require_numbers(heading, column, np.shape(first)[:1] or (0,), gaps=True)

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the columns."""
        return tuple(self.columns)

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """Numbers of each row."""
        columns = (np.asarray(column).tolist() for column in self.columns.values())
        return list(zip(*columns, strict=True))

    def __str__(self) -> str:
        return "\n".join(aligned([self.headings, *self._texts]))

    def _repr_html_(self) -> str:
        return table(self.headings, self._texts)

    @property
    def _texts(self) -> list[tuple[str, ...]]:
        """Numbers of each row as text, "-" where one is unknown."""
        return [
            tuple("-" if np.isnan(value) else rounded(value, _DIGITS) for value in row)
            for row in self.rows
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThirdOctaves:
    """Third-octave bands that hold all of some frequencies, the lowest first.

    Parameters
    ----------
    first : int
        Number of the lowest band, counted from that of 1 kHz.
    members : array (M,) of int
        Band of each frequency, counted from the lowest band.
    """

    first: int
    members: Index

    @classmethod
    def of(cls, frequencies: Array) -> ThirdOctaves:
        """Return the bands of frequencies (M,), Hz."""
        steps = _BANDS_PER_DECADE * np.log10(np.asarray(frequencies) / _REFERENCE)
        numbers = np.floor(steps + 0.5).astype(np.int64)
        first = int(numbers.min()) if len(numbers) else 0
        return cls(first=first, members=numbers - first)

    @property
    def counts(self) -> Index:
        """Number of frequencies in each band (B,)."""
        return np.bincount(self.members)

    @property
    def centres(self) -> Array:
        """Exact centre frequencies (B,), Hz."""
        return _REFERENCE * 10 ** ((self.first + np.arange(len(self.counts))) / _BANDS_PER_DECADE)

    @property
    def edges(self) -> Array:
        """Frequencies (B + 1,) between the bands, Hz."""
        steps = self.first - 0.5 + np.arange(len(self.counts) + 1)
        return _REFERENCE * 10 ** (steps / _BANDS_PER_DECADE)

    @property
    def nominal_centres(self) -> Array:
        """Nominal centre frequencies (B,), Hz, such as 31.5 or 1250."""
        numbers = self.first + np.arange(len(self.counts))
        decades, steps = np.divmod(numbers, _BANDS_PER_DECADE)
        return _REFERENCE * np.asarray(_NOMINAL_MANTISSAS)[steps] * 10.0**decades

    def sums(self, values: Array) -> Array:
        """Return the sums of values (M,) in each band (B,)."""
        sums = np.bincount(self.members, weights=values, minlength=len(self.counts))
        return np.asarray(sums, np.float64)

    def means(self, values: Array, weights: Array) -> Array:
        """Return the weighted means of values (M,) in each band (B,); NaN in empty bands."""
        weight_sums = self.sums(weights)
        sums = self.sums(values * weights)
        return np.divide(
            sums, weight_sums, out=np.full(len(weight_sums), np.nan), where=weight_sums > 0
        )
