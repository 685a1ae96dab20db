"""Remake the pictures of docs/images and the sounds that the tutorial plays.

`python -m docs.media` makes all of them, `python -m docs.media bowl ears` some. The sounds come of
the tutorial's own code, and `make docs` makes them where they are missing. The pictures of the room
need a Chromium, as tests/browser does.
"""

from __future__ import annotations

import os
import re
import runpy
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

DOCS = Path(__file__).parent
ROOT = DOCS.parent
IMAGES, SOUNDS = DOCS / "images", DOCS / "static/sounds"
TUTORIAL = DOCS / "tutorial/first_sound.md"
PLAYED = re.compile(r"_static/sounds/(\w+)\.wav")
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SECONDS, RATE = 1.6, 24_000  # of a sound in a page; Hz


@contextmanager
def elsewhere() -> Iterator[Path]:
    """Work in a folder that is removed afterwards."""
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(home)


def figures(_block: Any, variables: dict[str, Any], configuration: dict[str, Any]) -> str:  # noqa: ANN401 - as sphinx-gallery calls it
    """Save the figure that a block of an example ends with; return its reST."""
    from matplotlib.figure import Figure
    from sphinx_gallery.scrapers import figure_rst

    last = variables["example_globals"].pop("___", None)
    variables["example_globals"]["___"] = last
    if not isinstance(last, Figure) or last in variables.setdefault("drawn", []):
        return ""
    variables["drawn"].append(last)
    path = next(variables["image_path_iterator"])
    last.savefig(path)
    text = figure_rst([path], configuration["src_dir"])
    return ".. container:: picture\n\n" + textwrap.indent(text, "    ")


def shorten(source: Path, goal: Path) -> None:
    """Write the beginning of a sound, at the rate of the pages."""
    import numpy as np
    from scipy.signal import resample_poly

    import struck

    sound = struck.Sound.load(source)
    samples = sound.samples[:, : round(SECONDS * sound.sample_rate)]
    shorter = np.float32(resample_poly(samples, RATE, sound.sample_rate, axis=1))
    struck.Sound(samples=shorter, sample_rate=RATE).save(goal, encoding="int16")


def keep(picture: Path, name: str) -> None:
    """Keep a picture in docs/images, with at most 256 colours."""
    from PIL import Image

    with Image.open(picture) as image:
        image.convert("RGB").quantize(256).save(IMAGES / name, optimize=True)


def tutorial(*, pictures: bool = True) -> None:
    """Run the tutorial's code; keep the sounds that pages play, and its two pictures."""
    played = {name for page in DOCS.rglob("*.md") for name in PLAYED.findall(page.read_text())}
    with elsewhere() as folder:
        namespace: dict[str, Any] = {"__name__": "__main__"}
        for code in BLOCK.findall(TUTORIAL.read_text(encoding="utf-8")):
            exec(compile(code, TUTORIAL.name, "exec"), namespace)  # noqa: S102 - our own page
        SOUNDS.mkdir(parents=True, exist_ok=True)
        for name in sorted(played):
            shorten(folder / f"{name}.wav", SOUNDS / f"{name}.wav")
        for name in ("ring", "ring_blow") if pictures else ():
            keep(folder / f"{name}.png", f"tutorial_{name.split('_')[-1]}.png")


def bowl() -> None:
    """Draw the bowl of the first page."""
    import struck
    from struck.report.charts import overview, save
    from struck.solids import bowl as shape

    model = struck.analyze(shape(), "bronze", accuracy="preview")
    strike = struck.Strike(at="rim", striker="wood", speed=0.5)
    sound = struck.render(model, strike, seconds=3.0)
    save(overview(model, sound, title="A bronze bowl", at="the rim"), IMAGES / "bowl.png")
    keep(IMAGES / "bowl.png", "bowl.png")


def from_script(script: str, *names: str) -> Callable[[], None]:
    """Return a function that runs a script and keeps some of the pictures that it draws."""

    def draw() -> None:
        # Without the arguments of this command, which name pictures.
        with elsewhere() as folder, patch.object(sys, "argv", [script]):
            runpy.run_path(str(ROOT / script), run_name="__main__")
            for name in names:
                keep(folder / name, name)

    return draw


def room() -> None:
    """Take pictures of the room of objects, with the bell chosen, and of one of its modes."""
    from playwright.sync_api import sync_playwright

    import struck
    from tests.browser.conftest import ALONE, chromium
    from tests.browser.room import STANDS, THERE

    with (
        struck.explore(browser=False, wait=False) as explorer,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=ALONE.split())
        sizes = {"viewport": {"width": 1360, "height": 820}, "device_scale_factor": 1.25}
        page = browser.new_context(bypass_csp=True, **sizes).new_page()
        page.goto(explorer.url)
        page.wait_for_function(THERE + "18", timeout=600_000)
        page.get_by_text("Bell", exact=True).first.click()
        page.wait_for_function(STANDS, timeout=60_000)
        page.locator("#simple").uncheck()
        page.locator("#whole").click()
        page.wait_for_function(STANDS, timeout=60_000)
        page.screenshot(path=IMAGES / "room.png")
        page.get_by_text("Bell", exact=True).first.click()
        page.wait_for_function(STANDS, timeout=60_000)
        for _ in range(3):  # the third mode
            page.keyboard.press("m")
        page.wait_for_timeout(3000)
        page.screenshot(path=IMAGES / "mode.png")
        browser.close()
    for name in ("room.png", "mode.png"):
        keep(IMAGES / name, name)


MEDIA: dict[str, Callable[[], None]] = {
    "tutorial": tutorial,
    "bowl": bowl,
    "field": from_script("examples/walk_round_a_bowl.py", "balloon.png", "brightness.png"),
    "ears": from_script("examples/two_ears.py", "ears.png"),
    "sound_map": from_script("bench/sound_map.py", "sound_map.png", "sound_map_grids.png"),
    "layers": from_script("docs/layers.py"),
    "thin_bodies": from_script("docs/thin_bodies.py"),
    "room": room,
}

if __name__ == "__main__":
    for each in sys.argv[1:] or MEDIA:
        MEDIA[each]()
        print("made", each)
