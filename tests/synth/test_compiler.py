"""Machine code that was kept is used again only while all that it was made of is the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from struck.synth.compiler import Compiler


@pytest.mark.parametrize("changed", ["one", "other"])
def test_a_change_of_any_package_gives_another_name(tmp_path: Path, changed: str) -> None:
    files = [tmp_path / folder / "loops.py" for folder in ("one", "other")]
    for file in files:
        file.parent.mkdir()
        file.write_text("def loop(): ...\n")
    before = Compiler.of_packages(*map(str, files))
    assert Compiler.of_packages(*map(str, files)) == before
    (tmp_path / changed / "another.py").write_text("def more(): ...\n")
    assert Compiler.of_packages(*map(str, files)) != before


def test_what_a_device_calls_is_compiled_once_for_all() -> None:
    callback = pytest.importorskip("struck.live.callback")
    callback.compiled()
    assert callback.compiled.__wrapped__().cache_hits == 1
