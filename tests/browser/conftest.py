"""A browser for the tests of this folder, where the system has one; see `browser`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright

import struck
from struck.solids import Block

NAMES = ("chromium", "chromium-browser", "google-chrome")
ALONE = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --autoplay-policy=no-user-gesture-required "
    "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist "
    "--disable-gpu-compositing"  # without a graphics processor it takes longer than all else
)


def chromium() -> str | None:
    """Return the path of a Chromium, if the system has one."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Yield a Chromium without a window; with STRUCK_BROWSER=required a failure where none is."""
    path = chromium()
    if path is None:
        if os.environ.get("STRUCK_BROWSER") == "required":
            pytest.fail(f"there is none of {', '.join(NAMES)} on the path, and one is required")
        pytest.skip("no Chromium on the path: what the page does in a browser is not tested")
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=path, args=ALONE.split())
        yield made
        made.close()


@pytest.fixture(scope="session")
def block() -> struck.ModalModel:
    """Return a bronze block of finite elements."""
    body = Block(size=(0.3, 0.12, 0.02))
    return struck.analyze(body, "bronze", accuracy="preview")
