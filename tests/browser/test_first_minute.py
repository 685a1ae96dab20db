"""The first minute in the room: what is chosen, said and heard, and what goes wrong then."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

import struck
from struck.explorer.jobs import Job
from struck.explorer.objects import things
from struck.explorer.server import Explorer
from struck.shapes import Bar, String
from tests.browser.room import NO_WEBGL, SAID, THERE, Visit

LATE = 1200  # ms by which an answer of the server is held back
HINT = "document.getElementById('hint').innerText"
STATUS = "document.getElementById('status').innerText"


@pytest.fixture(scope="module")
def models() -> list[struck.ModalModel]:
    bar = Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    wire = String(length=0.65, radius=5e-4, tension=70.0, stiff=True)
    return [
        struck.analyze(bar, "bronze", band=(20, 8000)),
        struck.analyze(wire, "steel", band=(20, 2000)),
    ]


@pytest.fixture(scope="module")
def explorer(models: list[struck.ModalModel]) -> Iterator[Explorer]:
    with Explorer(given=models, names=["Bar", "String"]) as opened:
        yield opened


def late(**waits: int) -> str:
    """Return a script by which answers come later, ms, whose addresses have those parts."""
    return f"""
      const ask = globalThis.fetch;
      globalThis.fetch = async (path, ...rest) => {{
        const answer = await ask(path, ...rest);
        for (const [part, wait] of Object.entries({waits}))
          if (String(path).includes(part)) await new Promise((done) => setTimeout(done, wait));
        return answer;
      }};
    """


def told(visit: Visit) -> list[str]:
    """Return the messages that a page without a picture shows beside that."""
    return visit.page.locator(".message", has_not_text="WebGL").all_inner_texts()


@pytest.mark.prove
def test_first_of_the_list_is_chosen_though_it_comes_last(
    browser: Browser, explorer: Explorer
) -> None:
    visit = Visit(browser, explorer.url, script=NO_WEBGL + late(given_1=3 * LATE, given_2=LATE))
    visit.wait("!document.getElementById('empty').hidden")
    assert "Bar is being read" in visit.page.locator("#empty").inner_text()
    visit.wait(THERE + "1")
    assert visit.page.evaluate("struck.chosen") is None
    visit.wait(THERE + "2")
    assert visit.page.evaluate("struck.chosen") == "given_1"
    assert visit.page.locator("#empty").is_hidden()
    visit.context.close()


@pytest.mark.prove
def test_object_that_is_not_there_yet_leaves_something_to_read_and_click(browser: Browser) -> None:
    string = next(thing for thing in things() if thing.name == "string")
    with Explorer() as explorer:
        jobs = explorer._jobs
        jobs.jobs["string"] = Job(thing=string, path=jobs.folder / "string.struck")
        visit = Visit(browser, explorer.url, script=NO_WEBGL)
        visit.wait("!document.getElementById('empty').hidden")
        assert "The first is the string" in visit.page.locator("#empty").inner_text()
        assert "on their way" in visit.page.evaluate(HINT)
        visit.page.locator("#empty button").click()
        visit.wait("struck.instrument.ready")
        visit.wait(f"{HINT}.startsWith('The sound is ready')")
        visit.context.close()


def test_one_polite_status_names_the_chosen_object_and_the_blow(
    browser: Browser, explorer: Explorer, models: list[struck.ModalModel]
) -> None:
    visit = Visit(browser, explorer.url, script=NO_WEBGL)
    visit.wait(THERE + "2")
    live = visit.page.evaluate(
        """[...document.querySelectorAll('[role=status], [role=alert], [aria-live], output')]
          .filter((each) => each.getAttribute('aria-live') !== 'off' && !each.closest('#messages'))
          .map((each) => each.id)"""
    )
    assert live == ["status"]
    count = [len(model.frequencies) for model in models]
    assert visit.page.evaluate(STATUS) == f"Bar, {count[0]} modes, bronze"
    visit.page.locator("#canvas").focus()
    visit.page.keyboard.press("ArrowRight")
    assert visit.page.evaluate(STATUS) == f"String, {count[1]} modes, steel"
    visit.page.wait_for_timeout(600)
    visit.page.keyboard.press("1")
    said = visit.page.evaluate(STATUS)
    assert said.startswith("String, struck")
    visit.wait("struck.instrument.ready")
    visit.page.keyboard.press("1")
    assert visit.page.evaluate(STATUS).strip() == "String, struck"
    visit.context.close()


@pytest.mark.prove
def test_one_ear_sounds_until_the_measured_head_is_ready(
    browser: Browser, explorer: Explorer
) -> None:
    """What rings goes on while the head changes, and when ears are chosen."""
    visit = Visit(browser, explorer.url, script=NO_WEBGL + late(kemar=LATE))
    visit.wait(THERE + "2")
    visit.page.keyboard.press("1")
    visit.wait("struck.report?.ringing > 0")
    assert visit.page.evaluate("struck.instrument.engine.ears") == "mono"
    assert "one ear until two are ready" in visit.page.evaluate(HINT)
    visit.wait("struck.instrument.engine.ears === 'binaural'")
    visit.wait(f"{HINT}.startsWith('Click an object')")
    assert visit.page.evaluate("struck.report.ringing") > 0
    visit.page.evaluate("globalThis.before = struck.instrument.engine")
    visit.page.locator("#ears").select_option("stereo")
    visit.wait("struck.instrument.engine.ears === 'stereo'")
    assert visit.page.evaluate("globalThis.before === struck.instrument.engine")
    assert visit.page.evaluate("struck.report.ringing") > 0
    assert told(visit) == []
    visit.context.close()


OVERTAKEN = """async () => {
  const { instrument } = struck;
  const model = instrument.model('given_1');
  const part = (count) => ({
    modes: [...Array(count).keys()], factor: 1, size: 1, dropped: [], settled: true,
    frequencies: [...model.frequencies].slice(0, count),
    natural_frequencies: [...model.naturalFrequencies].slice(0, count),
    decays: [...model.decays].slice(0, count),
    outputs: [...Array(count).keys()].map((n) => [model.outputs[2 * n], model.outputs[2 * n + 1]]),
    mass: model.mass, centre: model.centre, inertia: model.inertia, material: model.material,
    recoil: model.recoil,
  });
  const context = instrument.context;
  const reported = async (time) => {
    while (struck.report.time < time) await new Promise((done) => setTimeout(done, 20));
    return struck.report.peak;
  };
  const peaks = [];
  for (let round = 0; round < 20; round += 1) {
    instrument.change('given_1', part(2 + (round % 2)));
    await reported(context.currentTime + 0.1);
    const begun = context.currentTime;
    struck.strikeAt('given_1', { point: [0.15, 0.015, 0.0025] });
    instrument.change('given_1', part(3 - (round % 2)));
    const stalled = context.currentTime - begun > 0.03; // of a busy machine: it rang before
    const peak = await reported(begun + 0.2); // long after the body that was struck has faded
    if (!stalled) peaks.push(peak);
  }
  return [struck.report.dropped, peaks.length ? Math.min(...peaks) : 0];
}"""


@pytest.mark.prove
def test_blow_is_heard_though_the_number_of_modes_changes_at_once(
    browser: Browser, explorer: Explorer
) -> None:
    visit = Visit(browser, explorer.url, script=NO_WEBGL)
    visit.wait(THERE + "2")
    visit.page.keyboard.press("1")
    visit.wait("struck.instrument.ready")
    dropped, least = visit.page.evaluate(OVERTAKEN)
    assert dropped == 0
    assert least > 1e-4
    visit.context.close()


@pytest.mark.prove
def test_refused_change_leaves_the_material_that_sounds(
    browser: Browser, explorer: Explorer
) -> None:
    visit = Visit(browser, explorer.url, script=NO_WEBGL)
    visit.wait(THERE + "2")
    visit.page.evaluate("struck.choose('given_2')")
    visit.page.locator("#material").select_option("glass")
    visit.wait(SAID.format("tiff"))
    visit.wait("document.getElementById('material').value === 'steel'")
    assert visit.page.locator("#original").is_hidden()
    visit.context.close()


@pytest.mark.prove
def test_lost_server_is_told_once_and_one_that_was_started_again_says_reload(
    browser: Browser, models: list[struck.ModalModel]
) -> None:
    with Explorer(given=models, names=["Bar", "String"]) as explorer:
        visit = Visit(browser, explorer.url, script=NO_WEBGL)
        visit.wait(THERE + "2")
        port = explorer.port
    visit.wait(SAID.format("does not answer"))
    visit.page.locator("#material").select_option("glass")
    visit.wait("document.getElementById('material').value === 'bronze'")
    assert len(told(visit)) == 1
    with Explorer(given=models, names=["Bar", "String"], port=port):
        visit.wait(SAID.format("reload with the new address"))
        assert len(told(visit)) == 1
        assert "does not answer" not in visit.messages()
    visit.context.close()


def test_failed_objects_are_told_once_in_the_words_of_the_page(
    browser: Browser, models: list[struck.ModalModel]
) -> None:
    with Explorer(given=models[:1], names=["Bar"]) as explorer:
        jobs = explorer._jobs
        for thing in [each for each in things() if each.name in {"table", "chair"}]:
            job = Job(thing=thing, path=jobs.folder / thing.name, state="failed")
            job.message = "this is a fault of struck"
            jobs.jobs[thing.name] = job
        visit = Visit(browser, explorer.url, script=NO_WEBGL)
        visit.wait(THERE + "1")
        visit.wait(SAID.format("Table, Chair could not be computed: this is a fault of struck."))
        assert len(re.findall("could not be computed", visit.messages())) == 1
        visit.context.close()
