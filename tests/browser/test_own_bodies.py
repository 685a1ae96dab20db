"""A person's own bodies in the browser: placed apart, recordings, fields and what is inaudible."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from playwright.sync_api import Browser

import struck
from struck.explorer.server import Explorer
from struck.model.provenance import Provenance
from struck.shapes import Bar, RectangularPlate
from struck.solids import Block, Tube
from tests.browser.room import STANDS, THERE, Visit
from tests.browser.test_room_page import recorded

NAMES = ["plank", "sheet", "die", "chime"]


@pytest.fixture(scope="module")
def unlike() -> list[struck.ModalModel]:
    """Return bodies of 16 mm to 1.2 m; all modes of the die lie above hearing."""
    plank = Bar(length=1.2, width=0.09, thickness=0.02, ends="free")
    sheet = RectangularPlate(length=1.0, width=0.8, thickness=0.002, edges="free")
    die, chime = Block(size=(0.016,) * 3), Tube(length=0.505, radius=0.0125, wall=0.001)
    return [
        struck.analyze(plank, "oak", band=(20, 4000)),
        struck.analyze(sheet, "steel", band=(20, 300)),
        struck.analyze(die, "steel", accuracy="preview", band=(20, 100e3)),
        struck.analyze(chime, "aluminium", accuracy="preview", band=(20, 3000)),
    ]


def fitted() -> struck.ModalModel:
    """Return a recording whose fit spends its first and its third mode on the blow."""
    tape = recorded()
    modes = np.arange(6)
    return replace(
        tape,
        frequencies=tape.frequencies[modes],
        natural_frequencies=tape.frequencies[modes],
        decays=np.array([900.0, 3.0, 800.0, 4.0, 5.0, 6.0]),
        gains=replace(tape.gains, outputs=tape.gains.outputs[modes]),
        provenance=Provenance(method="fit of 1 hit", details={"blow": [0, 2]}),
    )


@pytest.fixture(scope="module")
def visit(browser: Browser, unlike: list[struck.ModalModel]) -> Iterator[Visit]:
    models = [*unlike, fitted()]
    with Explorer(given=models, names=[*NAMES, "take"]) as explorer:
        one = Visit(browser, explorer.url, size=(1000, 640))
        one.wait(THERE + "5")
        one.wait(STANDS)
        yield one
        one.context.close()


BOXES = """[...struck.room.solids.values()].map((solid) => {
  const around = (object) => {
    const box = solid.box().makeEmpty().setFromObject(object);
    return [box.min.toArray(), box.max.toArray()];
  };
  return [around(solid.mesh), around(solid.group.parent)]; // with its stand
})"""
# The middle of the part of a body that is seen, on the page: of its pixels that a ray meets.
SEEN = """(id) => {
  const { stage, solids, touch } = struck.room;
  const solid = solids.get(id);
  const { left, top } = stage.canvas.getBoundingClientRect();
  const points = solid.mesh.geometry.attributes.position;
  for (let k = 0; k < points.count; k += 1 + Math.floor(points.count / 400)) {
    const point = [points.getX(k), points.getY(k), points.getZ(k)];
    const { x, y } = stage.project(solid.inRoom(point));
    if (touch.at(x, y)?.id === id) return [left + x, top + y];
  }
  return null;
}"""

# How near the picture begins, and the camera comes, where the die alone stands, ten times smaller.
NEAR_TO_THE_DIE = """() => {
  const { stage, solids } = struck.room;
  const die = solids.get('given_3');
  die.resize(0.1);
  stage.enclose([die.box()], true);
  const answer = [stage.camera.near, stage.controls.minDistance];
  die.resize(1);
  stage.enclose([...solids.values()].map((solid) => solid.box()), true);
  return answer;
}"""

BY_THE_DIE = """() => {
  const { stage, solids, touch } = struck.room;
  const { x, y } = stage.project(solids.get('given_3').box().min);
  const steps = [-6, -4, -2, 0, 2, 4, 6];
  return steps.flatMap((right) => steps.map((down) => touch.at(x + right, y + down)?.id));
}"""
LAID_OUT = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def test_bodies_of_unlike_size_stand_apart_and_each_is_clicked(visit: Visit) -> None:
    visit.page.evaluate("struck.room.home()")
    visit.wait(STANDS)
    boxes = np.array(visit.page.evaluate(BOXES))  # (5, 2, 2, 3)
    for first in range(5):
        for second in range(first):
            one, other = boxes[first, 1], boxes[second, 1]
            assert ((one[0] > other[1]) | (other[0] > one[1])).any(), (first, second)
    for number in range(1, 6):
        visit.page.evaluate(LAID_OUT)  # by the panel of the object before
        pixel = visit.page.evaluate(SEEN, f"given_{number}")
        assert pixel is not None, number
        visit.page.mouse.click(*pixel)
        visit.wait(f"struck.struck === 'given_{number}'")
        assert visit.page.evaluate("struck.chosen") == f"given_{number}"
    # The die is two pixels wide: any pixel by it is good enough.
    assert set(visit.page.evaluate(BY_THE_DIE)) == {"given_3"}
    near, nearest = visit.page.evaluate(NEAR_TO_THE_DIE)
    assert 0 < near < nearest / 2  # of the die, 1.6 mm, nothing is cut off that faces the camera


def test_recording_is_a_record_with_its_own_modes_first(visit: Visit) -> None:
    visit.page.evaluate("struck.choose('given_5')")
    colours = visit.page.evaluate(
        "struck.room.solids.get('given_5').mesh.material.map(({ color }) => color.getHex())"
    )
    assert colours == [0xB4541F, 0x2B3238]  # its label and its grooves; no drum
    rows = visit.page.locator("#modes [role=option]").all_inner_texts()
    shown = [float(row.split("\n")[1]) for row in rows]
    truth = recorded().frequencies[[1, 3, 4, 5, 0, 2]]
    np.testing.assert_allclose(shown, truth, atol=0.06)
    assert visit.page.locator("#modes .noise").count() == 2
    assert visit.page.locator("#modes .part").inner_text() == "2 of the noise of the blow"
    assert "2 of them of the noise of the blow" in visit.page.locator("#object-facts").inner_text()
    assert "8 ms" in rows[4]
    for expected in (1, 3, 4, 5, 0):  # by key, in the order of the list
        visit.page.keyboard.press("m")
        assert (
            visit.page.evaluate(
                "Number(document.querySelector('#modes [aria-selected=true]').dataset.mode)"
            )
            == expected
        )
    visit.page.locator("#mode-0").click()


def test_what_cannot_be_heard_is_said(visit: Visit) -> None:
    visit.page.evaluate("struck.choose('given_3')")
    said = visit.page.locator("#object-notes").inner_text()
    assert "Its only mode cannot be heard: it lies at" in said
    assert "its recoil alone" in said
    assert "inaudible" in visit.page.locator("#mode-0").inner_text()
    visit.page.evaluate("struck.choose('given_1')")
    assert not visit.page.locator("#object-notes").is_visible()


@pytest.mark.prove
def test_field_is_said_to_be_played_as_its_average(browser: Browser) -> None:
    block = struck.analyze(
        Block(size=(0.1, 0.03, 0.02)), "steel", accuracy="preview", band=(20, 12e3)
    )
    with Explorer(given=[block.radiating(band=(5e3, 12e3))], names=["block"]) as explorer:
        visit = Visit(browser, explorer.url)
        visit.wait(THERE + "1")
        said = visit.page.locator("#object-notes").inner_text()
        assert "average over all directions" in said
        assert not visit.log
        visit.context.close()


@pytest.mark.prove
def test_sixty_bodies_are_within_reach_of_the_camera(browser: Browser) -> None:
    bodies = [
        struck.analyze(
            Bar(length=size, width=size / 8, thickness=size / 40), "steel", band=(20, 2e4)
        )
        for size in np.geomspace(0.05, 1.5, 6)
    ]
    with Explorer(given=bodies * 10, names=[f"bar {n}" for n in range(60)]) as explorer:
        visit = Visit(browser, explorer.url)
        visit.wait(THERE + "60", 60)
        visit.wait(STANDS)
        seen = visit.page.evaluate(
            """() => [...struck.room.solids.values()].filter((solid) => {
              const { stage } = struck.room;
              const box = solid.box();
              const { clientWidth, clientHeight } = stage.canvas;
              return [box.min, box.max].every((corner) => {
                const { x, y, front } = stage.project(corner);
                return front && x > 0 && y > 0 && x < clientWidth && y < clientHeight;
              });
            }).length"""
        )
        assert seen == 60
        away, most = visit.page.evaluate(
            "[struck.room.stage.controls.getDistance(), struck.room.stage.controls.maxDistance]"
        )
        assert away < most
        for number in (1, 37, 60):
            assert visit.page.evaluate(SEEN, f"given_{number}") is not None
        assert not visit.log
        visit.context.close()
