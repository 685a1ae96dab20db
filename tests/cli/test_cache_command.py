"""``struck cache`` tells what is kept and clears it."""

from __future__ import annotations

import hashlib
import json
import warnings
from pathlib import Path

import pytest

from struck.cli import main, warnings_in_one_line
from struck.errors import CacheWarning
from struck.files.cache import Cache


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cache:
    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path / "cache"))
    filled = Cache(tmp_path / "cache")
    for number in range(3):
        filled.put(hashlib.sha256(bytes([number])).hexdigest(), bytes(2**20))
    return filled


def test_it_tells_folder_entries_size_and_cap(
    cache: Cache, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["cache"]) == 0
    text = capsys.readouterr().out.splitlines()
    assert text[0].endswith(str(cache.folder))
    assert text[1:] == ["entries  3", "size     3.0 MiB of at most 2048 MiB"]


def test_machines_get_the_same(cache: Cache, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cache", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "folder": str(cache.folder),
        "entries": 3,
        "bytes": sum(path.stat().st_size for path in cache.folder.iterdir()),
        "most_bytes": 2 * 2**30,
        "removed": 0,
    }


def test_it_clears(cache: Cache, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "entries  0",
        "size     0.0 MiB of at most 2048 MiB",
        "removed  3",
    ]
    assert not list(cache.folder.iterdir())


def test_a_cache_that_is_off_or_empty_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("STRUCK_CACHE", "off")
    assert main(["cache", "--clear"]) == 0
    assert "off" in capsys.readouterr().out
    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path / "missing"))
    assert main(["cache"]) == 0
    assert "entries  0" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_trouble_is_one_line_and_other_warnings_are_as_ever(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with warnings.catch_warnings(record=True) as others:
        warnings.simplefilter("always")
        with warnings_in_one_line():
            warnings.warn("the disk is full", CacheWarning, stacklevel=1)
            warnings.warn("something else", RuntimeWarning, stacklevel=1)
    assert capsys.readouterr().err == "struck: the disk is full\n"
    assert [str(each.message) for each in others] == ["something else"]
