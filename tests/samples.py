"""Cases of a test of which a sample runs in `make test`, and the others as proofs."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet


def sampled(cases: Iterable[object], *sample: object) -> list[ParameterSet]:
    """Return the cases, those outside the sample marked as proofs; ValueError on another sample."""
    every = list(cases)
    if strangers := [case for case in sample if case not in every]:
        raise ValueError(f"{strangers} are not among the cases {every}")
    return [pytest.param(case, marks=() if case in sample else pytest.mark.prove) for case in every]
