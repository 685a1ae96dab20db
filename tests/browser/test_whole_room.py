"""The whole room on an empty cache, in a browser: eighteen objects, and no error anywhere."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from struck.explorer.objects import things
from tests.browser.room import THERE, Visit
from tests.explorer.served import opened, patience


@pytest.mark.prove
def test_whole_room_stands_and_sounds_without_an_error(browser: Browser, tmp_path: Path) -> None:
    limit = 300 * patience()
    process = opened(tmp_path, STRUCK_CACHE=str(tmp_path / "cache"))
    try:
        assert process.stderr is not None
        visit = Visit(browser, process.stderr.readline().strip())
        visit.wait(f"{THERE} 18 || document.querySelector('.message')", limit)
        assert visit.messages() == ""
        assert visit.page.evaluate("struck.chosen") == "string"
        visit.page.locator("#canvas").focus()
        struck = []
        for _ in range(18):
            blows = visit.page.evaluate("struck.blows")
            visit.page.keyboard.press(" ")
            visit.wait(f"struck.blows > {blows}", 60)
            struck.append(visit.page.evaluate("struck.struck"))
            visit.page.keyboard.press("ArrowRight")
        assert struck == [thing.name for thing in things()]
        visit.wait("struck.report?.ringing > 0")
        assert visit.page.evaluate("struck.report.dropped") == 0
        assert visit.messages() == ""
        assert not visit.log
        visit.context.close()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0
    assert not errors.splitlines()[1:]  # but how to end it
