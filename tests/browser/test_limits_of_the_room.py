"""The room at its limits: bad files, coarse shapes, many modes and vertices, a lost server."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

import struck
from struck.explorer import page_files
from struck.explorer.jobs import PAGE_ENDING
from struck.explorer.server import Explorer
from struck.model.gains import ShapeGains
from struck.model.mesh import Mesh
from struck.radiation import by_name
from struck.shapes import PolygonMembrane
from tests.browser.room import NO_WEBGL, SAID, STANDS, THERE, Visit
from tests.explorer.served import opened, patience

STARTED = "struck.instrument.ready"

# What the worklet is sent for a blow at a place of the first body, once the server, which a busy
# machine may keep, has told in time: the drive is the end of it.
SENT = """async (point) => {
  const { engine } = struck.instrument;
  const write = engine.ring.write;
  let drive;
  do {
    const sent = new Promise((resolve) => {
      engine.ring.write = (words) => {
        if (words[1] === 1) resolve([...words.subarray(-words[5])]);
        return write.call(engine.ring, words);
      };
    });
    struck.strikeAt('given_1', { point });
    drive = await sent;
    await new Promise((resolve) => setTimeout(resolve));
  } while (!struck.drive);
  delete engine.ring.write;
  const model = struck.instrument.model('given_1');
  const own = model.drive(model.contact({ point }));
  const { exactTo } = struck.models.get('given_1');
  return { drive, own: [...own], exactTo };
}"""


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> struck.ModalModel:
    """Return a body of a formula that the page lacks, and let it be sent on a coarse mesh."""
    body = PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000.0)
    model = struck.analyze(body, "steel", band=(20.0, 300.0))
    assert model.geometry is not None
    halved_once = 48 * len(model.frequencies) * len(model.geometry.points)
    monkeypatch.setattr(page_files, "MAX_SHAPE_BYTES", halved_once)
    return model


@pytest.fixture
def explorer(coarse: struck.ModalModel) -> Iterator[Explorer]:
    """Yield a room of that body and two files that cannot be read."""
    with Explorer(given=[coarse] * 3, names=["skin", "damaged", "newer"]) as room:
        jobs = room._jobs.jobs
        paths = [jobs[f"given_{number}"].path.with_suffix(PAGE_ENDING) for number in (1, 2, 3)]
        data = paths[0].read_bytes()
        paths[1].write_bytes(data[:-100] + b"\x01" * 100)
        paths[2].write_bytes(data.replace(b'"version":"1"', b'"version":"9"'))
        yield room


@pytest.mark.prove
def test_files_that_cannot_be_read_coarse_meshes_and_a_lost_server_are_made_up_for(
    browser: Browser, explorer: Explorer, coarse: struck.ModalModel
) -> None:
    visit = Visit(browser, explorer.url, script=NO_WEBGL)  # which is soon there
    visit.wait("document.querySelectorAll('.message.bad').length >= 3")
    said = visit.messages()
    assert "Damaged cannot be read" in said
    assert "Newer cannot be read" in said
    assert "update struck" in said
    visit.wait(THERE + "1")
    visit.page.keyboard.press("1")
    visit.wait(STARTED)
    is_driven_by_the_server_beyond_the_mesh_of_the_page(visit, coarse)
    explorer.stop()
    visit.wait(SAID.format("does not answer"))
    blows = visit.page.evaluate("struck.blows")
    visit.page.locator("#hit").click()
    visit.wait(SAID.format("this one is approximate"))
    visit.wait(f"struck.blows > {blows}")
    assert visit.page.evaluate("struck.drive") is None
    visit.wait("struck.report?.ringing > 0")
    visit.context.close()


def is_driven_by_the_server_beyond_the_mesh_of_the_page(
    visit: Visit, coarse: struck.ModalModel
) -> None:
    place, inward = np.array([[0.055, 0.081, 1.25e-4]]), np.array([[0.0, 0.0, -1.0]])
    sent = visit.page.evaluate(SENT, place[0].tolist())
    truth = coarse.gains.at(place, inward)[0, 0]
    largest = np.abs(truth).max()
    np.testing.assert_allclose(sent["drive"][: len(truth)], truth, atol=1e-5 * largest)
    # The page alone is right to 1 % below what it says, and nowhere as right as the server.
    apart = np.abs(np.array(sent["own"][: len(truth)]) - truth) / largest
    below = coarse.natural_frequencies <= sent["exactTo"]
    assert 0 < below.sum() < len(truth)
    assert apart[below].max() < 0.01
    assert apart[~below].max() > 1e-3
    assert "approximate" not in visit.messages()
    # Of a changed body the server's drive is changed along.
    visit.page.locator("#size").fill("0.3")
    visit.wait("struck.instrument.model('given_1').size > 1.9")
    factor = visit.page.evaluate("struck.instrument.model('given_1').size")
    changed = visit.page.evaluate(SENT, (factor * place[0]).tolist())
    truth = coarse.scaled(factor).gains.at(factor * place, inward)[0, 0]
    found = changed["drive"][: len(truth)]
    np.testing.assert_allclose(found, truth, atol=1e-5 * np.abs(truth).max())


def torus(rows: int, columns: int, modes: int) -> struck.ModalModel:
    """Return a ring of rows times columns vertices with smooth shapes, made up."""
    u, v = np.meshgrid(
        *(2 * np.pi * np.arange(n) / n for n in (rows, columns)), indexing="ij", sparse=True
    )
    away = 0.2 + 0.05 * np.cos(v)
    parts = [away * np.cos(u), away * np.sin(u), 0.05 * np.sin(v) + 0 * u]
    points = np.stack(parts, axis=-1).reshape(-1, 3)
    here = np.arange(rows * columns).reshape(rows, columns)
    right, up = np.roll(here, -1, axis=0), np.roll(here, -1, axis=1)
    both = np.roll(right, -1, axis=1)
    halves = [np.stack(three, axis=-1) for three in ((here, right, both), (here, both, up))]
    surface = Mesh(points=points, faces=np.concatenate(halves).reshape(-1, 3))
    frequencies = np.linspace(200, 12000, modes)
    waves = np.cos(np.arange(modes)[:, None] % 9 * u.ravel() + np.arange(modes)[:, None] % 5)
    shapes = np.zeros((rows * columns, 3, modes), np.float32)
    shapes[:, 2] = np.repeat(waves.T, columns, axis=0)
    gains = ShapeGains(
        surface=surface,
        shapes=shapes,
        outputs=np.full(modes, 1e-3 + 0j),
        radiation=by_name("power"),
        centre=np.zeros(3),
    )
    return struck.ModalModel(
        frequencies=frequencies,
        natural_frequencies=frequencies,
        decays=np.full(modes, 3.0),
        gains=gains,
        complete_to=12000.0,
        geometry=surface,
        places={"top": np.array([0.2, 0.0, 0.05])},
        mass=1.0,
        centre=np.zeros(3),
        inertia=0.02 * np.eye(3),
    )


@pytest.mark.prove
def test_two_hundred_thousand_vertices_are_thinned_which_is_said_and_sound(
    browser: Browser,
) -> None:
    with Explorer(given=[torus(500, 400, 120)], names=["ring"]) as explorer:
        visit = Visit(browser, explorer.url)
        visit.wait(THERE + "1", 60)
        vertices, bytes_ = visit.page.evaluate(
            """() => {
              const model = struck.models.get('given_1');
              return [model.vertices.length / 3, model.shapes.byteLength];
            }"""
        )
        assert bytes_ <= 1.02 * page_files.MAX_SENT_BYTES
        said = visit.page.locator("#object-dropped").inner_text()
        assert f"{200_000 - vertices:.0f} of 200000 vertices were left out" in said
        visit.page.keyboard.press("1")
        # Drawing this body without a graphics card keeps the page from its keys for seconds.
        visit.wait("struck.report?.ringing > 0", 60)
        assert not visit.log
        visit.context.close()


@pytest.mark.prove
def test_two_thousand_modes_sound_and_are_listed(browser: Browser) -> None:
    with Explorer(given=[torus(12, 8, 2000)], names=["ring"]) as explorer:
        visit = Visit(browser, explorer.url, script=NO_WEBGL)
        visit.wait(THERE + "1")
        visit.page.keyboard.press("1")
        visit.wait("struck.report?.modes >= 2000")
        assert "2000 modes" in visit.page.locator("#object-facts").inner_text()
        visit.wait("document.getElementById('counts').innerText.startsWith('2000 modes ring')")
        visit.context.close()


@pytest.mark.prove
def test_two_hundred_clicks_in_the_room_leave_no_memory(
    browser: Browser, block: struck.ModalModel
) -> None:
    with Explorer(given=[block], names=["block"]) as explorer:
        visit = Visit(browser, explorer.url)
        visit.wait(THERE + "1")
        visit.wait(STANDS)
        place = visit.pixel("given_1", np.array([0.0, 0.0, 0.01]))
        session = visit.context.new_cdp_session(visit.page)

        def used() -> float:
            session.send("HeapProfiler.collectGarbage")
            return session.send("Runtime.getHeapUsage")["usedSize"]

        def clicks(number: int) -> None:
            for _ in range(number):
                visit.page.mouse.click(*place)

        clicks(20)
        visit.wait(STARTED)
        before, blows = used(), visit.page.evaluate("struck.blows")
        clicks(200)
        visit.wait(f"struck.blows === {blows + 200}")
        assert used() - before < 20 * 2**20
        visit.context.close()


def hear_first_object(browser: Browser, folder: Path, core: str, seconds: float) -> None:
    """Start the room without any stored model, and wait up to `seconds` for its first sound."""
    begun = time.monotonic()
    with opened(folder, STRUCK_CORE=core) as process:
        assert process.stderr is not None
        visit = Visit(browser, process.stderr.readline().strip())
        visit.wait(THERE + "1", seconds)
        visit.page.keyboard.press("1")
        visit.wait("struck.report?.peak > 1e-3", seconds)
        took = time.monotonic() - begun
        visit.context.close()
        process.send_signal(signal.SIGINT)
    assert took < seconds


@pytest.mark.prove
@pytest.mark.parametrize("core", ["", "off"], ids=["compiled", "without a core"])
def test_first_object_sounds_after_the_start(browser: Browser, tmp_path: Path, core: str) -> None:
    hear_first_object(browser, tmp_path, core, 300.0)  # on a busy machine too


@pytest.mark.prove
@pytest.mark.timed
@pytest.mark.parametrize(("core", "seconds"), [("", 10), ("off", 30)])
def test_first_sound_comes_soon_after_the_start(
    browser: Browser, tmp_path: Path, core: str, seconds: float
) -> None:
    hear_first_object(browser, tmp_path, core, seconds * patience())
