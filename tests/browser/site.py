"""A server of the page's modules and of what a test gives, and a page that keeps its log."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page

import struck.explorer
from struck.core.build import LIBRARIES

STATIC = Path(struck.explorer.__file__).parent / "static"
TYPES = {".js": "text/javascript", ".wasm": "application/wasm", ".html": "text/html"}
BLANK = b'<!doctype html><meta charset="utf-8"><title>test</title><link rel="icon" href="data:,">'


class Site:
    """The page's modules under `/static`, given files under their names, and what was sent back."""

    def __init__(self, *, isolated: bool = True) -> None:
        self.given: dict[str, bytes] = {"/": BLANK}
        self.given["/static/core.wasm"] = (LIBRARIES / "core.wasm").read_bytes()
        self.sent: dict[str, bytes] = {}
        self.isolated = isolated

    def content(self, path: str) -> bytes | None:
        if path in self.given:
            return self.given[path]
        file = (STATIC / path.removeprefix("/static/")).resolve()
        inside = path.startswith("/static/") and file.is_relative_to(STATIC.resolve())
        return file.read_bytes() if inside and file.is_file() else None


def handler(site: Site) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = unquote(self.path)
            content = site.content(path)
            self.send_response(200 if content is not None else 404)
            self.send_header("Content-Type", TYPES.get(Path(path).suffix, "text/html"))
            self.send_header("Content-Length", str(len(content or b"")))
            if site.isolated:
                self.send_header("Cross-Origin-Opener-Policy", "same-origin")
                self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
            self.end_headers()
            self.wfile.write(content or b"")

        def do_POST(self) -> None:
            length = int(self.headers["Content-Length"])
            site.sent[self.path] = self.rfile.read(length)
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return Handler


class Visit:
    """A page of a site, and all that the browser had to say about it."""

    def __init__(self, page: Page, site: Site) -> None:
        self.page, self.site = page, site
        self.log: list[str] = []
        page.on("console", lambda message: self.log.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.log.append(str(error)))

    def run(self, program: str, **given: object) -> dict[str, Any]:
        """Run the body of an asynchronous function of `given` in the page; return what it does."""
        return self.page.evaluate(
            f"async (given) => {{ {program} }}", json.loads(json.dumps(given))
        )

    def samples(self, name: str, channels: int) -> NDArray[np.float32]:
        """Return the samples (channels, n) that the page sent back under a name."""
        return np.frombuffer(self.site.sent[name], np.float32).reshape(channels, -1)


@contextmanager
def visiting(browser: Browser, site: Site) -> Iterator[Visit]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler(site))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    context = browser.new_context()
    try:
        visit = Visit(context.new_page(), site)
        visit.page.goto(f"http://127.0.0.1:{server.server_port}/")
        yield visit
    finally:
        context.close()
        server.shutdown()
        server.server_close()
        thread.join()
