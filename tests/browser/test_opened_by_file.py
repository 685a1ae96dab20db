"""The file by which a browser is opened leads it into the room."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

import struck
from struck.explorer import server
from struck.explorer.server import Explorer


def test_file_leads_into_the_room(
    browser: Browser, block: struck.ModalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Browsers send no strict cookie along a redirect that begins in a file."""
    opened: list[str] = []
    monkeypatch.setattr(server.webbrowser, "open", lambda url: opened.append(url) or True)
    with Explorer(given=[block], names=["block"]) as room:
        assert room.open_in_browser()
        page = browser.new_page()
        page.goto(opened[0])
        expect(page).to_have_title("struck: a room of objects", timeout=30_000)
        assert page.url == f"http://127.0.0.1:{room.port}/"
        page.close()
