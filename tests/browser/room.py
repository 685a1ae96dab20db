"""A page of the room in a browser, and what tests ask of it."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.image import imread
from playwright.sync_api import Browser, ConsoleMessage, Page

from struck.model.arrays import Array

THERE = "[...struck.models.values()].filter(Boolean).length >= "
SAID = "document.getElementById('messages').innerText.includes('{}')"
# The camera has arrived, nothing moves, and the last picture is drawn.
STANDS = "!struck.room.stage.tickers.size && !struck.room.stage.waiting"
NO_WEBGL = """
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest);
  };
"""


class Visit:
    """A page, and all that the browser had to say about it."""

    def __init__(self, browser: Browser, url: str, **options: Any) -> None:  # noqa: ANN401 - of a context
        script = options.pop("script", None)
        size = options.pop("size", (1000, 640))
        viewport = {"width": size[0], "height": size[1]}
        self.context = browser.new_context(viewport=viewport, bypass_csp=True, **options)
        self.page: Page = self.context.new_page()
        if script:
            self.page.add_init_script(script)
        self.log: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda error: self.log.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(url)

    def _note(self, said: ConsoleMessage) -> None:
        # A browser that puts pictures together without a graphics processor reads them back.
        if "GPU stall due to ReadPixels" not in said.text:
            self.log.append(f"{said.type}: {said.text}")

    def wait(self, condition: str, seconds: float = 20.0) -> None:
        self.page.wait_for_function(condition, timeout=1000 * seconds, polling=50)

    def messages(self) -> str:
        return self.page.locator("#messages").inner_text()

    def picture(self, place: str = "#view") -> Array:
        """Return a screenshot as numbers from 0 to 1 (height, width, 3)."""
        return imread(io.BytesIO(self.page.locator(place).screenshot()))[..., :3]

    def pixel(self, name: str, point: Array) -> tuple[float, float]:
        """Return where a point of a body is on the page."""
        at = self.page.evaluate(
            """([id, point]) => {
              const { stage, solids } = struck.room;
              const { x, y } = stage.project(solids.get(id).inRoom(point));
              const { left, top } = stage.canvas.getBoundingClientRect();
              return [left + x, top + y];
            }""",
            [name, list(point)],
        )
        return at[0], at[1]
