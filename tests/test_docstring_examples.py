"""Examples in docstrings run, and print what they show."""

from __future__ import annotations

import doctest
import inspect
import sys
from pathlib import Path

import numpy as np
import pytest

import struck
from tests.test_words import public

EXAMPLES = {
    name: text for name, value in public().items() if ">>>" in (text := inspect.getdoc(value) or "")
}


# The cheapest stay in every run; each of the others takes up to seconds of a processor.
QUICK = {"struck.analyze", "struck.load", "struck.materials", "struck.save", "struck.shapes.Bar"}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else pytest.mark.prove)
        for name in sorted(EXAMPLES)
    ],
)
def test_example_prints_what_it_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    home = sys.modules[inspect.unwrap(public()[name]).__module__]
    namespace = {**vars(home), "np": np, "struck": struck}
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], namespace, name, None, 0)
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    runner.run(test, out=output.append)
    assert not runner.summarize(verbose=False).failed, "".join(output)
