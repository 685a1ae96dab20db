"""Pages that need no other file."""

from __future__ import annotations

import base64
from html.parser import HTMLParser

from matplotlib.figure import Figure

from struck.model.html import STYLE, document, picture, table


class Reader(HTMLParser):
    """What a page holds: texts by the element they stand in, and attributes of images."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[tuple[str, str]] = []
        self.image: dict[str, str | None] = {}
        self._inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag
        if tag == "img":
            self.image = dict(attrs)

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append((self._inside, data.strip()))


def test_a_title_is_text_and_a_body_is_not() -> None:
    texts = Reader(document("a <b> & c", "<p>one</p>", style="p { color: red; }")).texts
    assert ("title", "a <b> & c") in texts
    assert ("h1", "a <b> & c") in texts
    assert ("p", "one") in texts
    assert dict(texts)["style"].startswith(STYLE[:20])
    assert dict(texts)["style"].endswith("p { color: red; }")


def test_a_figure_stands_in_the_page_itself() -> None:
    image = Reader(picture('the "loudest" hit', Figure(figsize=(1, 1)))).image
    assert image["alt"] == 'the "loudest" hit'
    kind, _, data = (image["src"] or "").partition(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(data).startswith(b"\x89PNG")


def test_cells_are_text() -> None:
    texts = Reader(table(("mode", "<Hz>"), [("1", "440"), ("2", "a & b")])).texts
    assert texts == [
        ("th", "mode"),
        ("th", "<Hz>"),
        *(("td", t) for t in ("1", "440", "2", "a & b")),
    ]
