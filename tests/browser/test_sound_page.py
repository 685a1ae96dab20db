"""The sound of the page in a browser: the worklet, offline and on the clock, against Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser

import struck
from struck import Body, Strike
from struck.ears.hearing import Hearing
from struck.ears.listeners import Binaural, Mono, Trajectory
from struck.ears.propagation import Emitter
from struck.excitation.excitation import Hold
from struck.excitation.hertz import strikers
from struck.explorer.page_files import head_bytes
from struck.files.model_file import to_bytes
from struck.live.limiter import limit, limiter
from struck.model.model import ModalModel
from struck.scene.body import centre_of, radius_of
from struck.shapes import String
from struck.solids import Block
from struck.synth.poles import with_recoil
from struck.synth.resonators import Resonators
from tests.browser.site import Site, Visit, visiting
from tests.core.agreement import apart

Array = NDArray[Any]
RATE, BLOCK = 48_000, 128
LATE = 152  # samples: leads of delay lines and limiter
PLACES = ((0.0, 0.0, 0.0), (0.6, -0.4, 0.2))  # of the bodies, m
GRIP = 30.0

# Plays a script: what happens at which time, and where the listener goes.
PLAY = """
  const { createEngine } = await import('/static/sound/engine.js');
  const { readModel } = await import('/static/model/model.js');
  const channels = given.ears === 'mono' ? 1 : 2;
  const context = new OfflineAudioContext(channels, given.samples, given.rate);
  const engine = await createEngine(context, { ears: given.ears, forcePlain: given.plain });
  const read = async (name) => readModel(await (await fetch(name)).arrayBuffer());
  const models = await Promise.all(given.models.map(read));
  const bodies = models.map((model, k) => engine.addModel(model, { position: given.places[k] }));
  engine.setFullScale(given.fullScale);
  for (const { time, position, forward } of given.poses)
    engine.moveListener({ position, forward }, time);
  for (const { body, point, striker, speed, time } of given.strikes)
    engine.strike({
      body: bodies[body],
      contact: models[body].contact({ point }),
      striker: given.strikers[striker],
      speed,
      time,
    });
  for (const { body, point, begin, end } of given.holds) {
    const contact = models[body].contact({ point });
    const hold = engine.hold({ body: bodies[body], contact, grip: given.grip, time: begin });
    engine.release(hold, end);
  }
  for (const { body, model, time } of given.changes)
    engine.changeModel(bodies[body], await read(model), time);
  engine.node.connect(context.destination);
  await engine.settled();
  const sound = await context.startRendering();
  const all = new Float32Array(channels * given.samples);
  for (let k = 0; k < channels; k++) all.set(sound.getChannelData(k), k * given.samples);
  await fetch('/sound', { method: 'POST', body: all });
  const { kind, note, ears, last, ring } = engine;
  return { kind, note, ears, last, isolated: crossOriginIsolated, shared: !!ring };
"""


@dataclass(frozen=True, kw_only=True)
class Script:
    """What happens to two bodies while a listener walks."""

    models: Sequence[ModalModel]
    strikes: list[dict[str, Any]]
    holds: list[dict[str, Any]]
    changed: ModalModel | None  # what the second body becomes, at the last third
    times: Array
    positions: Array
    ahead: Array
    seconds: float

    @property
    def blocks(self) -> int:
        return round(self.seconds * RATE / BLOCK)


@pytest.fixture(scope="module")
def models() -> list[ModalModel]:
    string = struck.analyze(
        String(length=0.65, radius=5e-4, tension=70.0), "steel", band=(20, 4000)
    )
    block = Block(size=(0.2, 0.05, 0.02))
    return [struck.analyze(block, "steel", accuracy="preview", band=(20, 15000)), string]


def script(models: Sequence[ModalModel], seconds: float, strikes: int) -> Script:
    rng = np.random.default_rng(23)
    places = [[-0.0713, 0.0213, 0.01], [0.211, 0.0, 0.0005]]
    names = ("steel", "wood", "felt")
    times = np.sort(rng.uniform(0.02, 0.9 * seconds, strikes)).tolist()
    said = [
        {
            "body": number % 2,
            "point": places[number % 2],
            "striker": names[number % 3],
            "speed": float(rng.uniform(0.2, 1.0)),
            "time": time,
        }
        for number, time in enumerate(times)
    ]
    hold = {"body": 0, "point": [0.08, 0.0, 0.01], "begin": 0.4 * seconds, "end": 0.6 * seconds}
    moments = np.linspace(0, seconds, round(6 * seconds))
    walk = np.column_stack([2 * np.cos(moments), 2 * np.sin(moments), 0.2 + 0 * moments])
    ahead = np.column_stack([-np.cos(2 * moments), -np.sin(2 * moments), 0.1 + 0 * moments])
    return Script(
        models=models,
        strikes=said,
        holds=[hold],
        changed=models[1].made_of("brass"),
        times=moments,
        positions=walk,
        ahead=ahead,
        seconds=seconds,
    )


def in_the_page(
    visit: Visit, it: Script, *, ears: str, full_scale: float, plain: bool = False
) -> dict[str, Any]:
    for number, model in enumerate(it.models):
        visit.site.given[f"/model{number}"] = to_bytes(model)
    changes = []
    if it.changed is not None:
        visit.site.given["/changed"] = to_bytes(it.changed)
        changes = [{"body": 1, "model": "/changed", "time": it.seconds * 2 / 3}]
    poses = [
        {"time": time, "position": position, "forward": forward}
        for time, position, forward in zip(
            it.times.tolist(), it.positions.tolist(), it.ahead.tolist(), strict=True
        )
    ]
    return visit.run(
        PLAY,
        models=[f"/model{number}" for number in range(len(it.models))],
        strikes=it.strikes,
        holds=it.holds,
        changes=changes,
        poses=poses,
        places=PLACES,
        ears=ears,
        plain=plain,
        grip=GRIP,
        rate=RATE,
        samples=it.blocks * BLOCK,
        fullScale=full_scale,
        strikers={name: dict(each) for name, each in strikers().items()},
    )


def sent_by(it: Script, number: int) -> Array:
    """Return what a body sounds like at 1 m, by the resonators of Python."""
    model = it.models[number]
    strikes = [
        Strike(at=each["point"], striker=each["striker"], speed=each["speed"], time=each["time"])
        for each in it.strikes
        if each["body"] == number
    ]
    holds = [each for each in it.holds if each["body"] == number]
    raised = [Hold(at=each["point"], grip=GRIP).raised(model) for each in holds]
    begun = [strike.begin(model, RATE) for strike in strikes]
    bank = Resonators([model], sample_rate=RATE, block=BLOCK, voices=len(strikes))
    far = centre_of(model) + np.array([5.0, 0.0, 0.0])
    outputs, heard, held = outputs_at(model, far), [], None
    last = round(it.seconds * 2 / 3 * RATE)
    for block in range(it.blocks):
        time = round(block * BLOCK)
        changes = it.changed is not None and number == 1 and 0 <= time - last < BLOCK
        if changes and it.changed is not None:
            model = it.changed
            bank.change(0, model)
            outputs = outputs_at(model, far)
        now = [round(e["begin"] * RATE) <= time < round(e["end"] * RATE) for e in holds]
        if now != held and (any(now) or held is not None):
            more = sum((part for part, on in zip(raised, now, strict=True) if on), model.decays * 0)
            bank.change(0, replace(model, decays=model.decays + more))
        held = now
        pushes = [
            replace(push, voice=voice)
            for voice, each in enumerate(begun)
            if (push := each.advance(BLOCK)) is not None
        ]
        given = [outputs] if block == 0 or changes else ()
        heard.append(bank.process(pushes, given)[0, 0].copy())
    return np.concatenate(heard)


def outputs_at(model: ModalModel, place: Array) -> Array:
    """Return the gains at 1 m, by those at a place 5 m away: of modes, then of recoil (1, N)."""
    away = np.array([np.linalg.norm(place - centre_of(model))])
    return away * with_recoil(model.gains.toward(place[None])[0], model.recoil, away, RATE)


def heard_of(it: Script, rows: Array, full_scale: float) -> Array:
    """Return what the walking listener hears of bodies' sounds (bodies, n), through the limiter."""
    emitters = [
        Emitter(centre=Trajectory.of("position", centre_of(model) + place), radius=radius_of(model))
        for model, place in zip(it.models, PLACES, strict=False)
    ]
    listener = Binaural(position=(it.times, it.positions), facing=(it.times, it.ahead))
    hearing = Hearing(emitters, listener, sample_rate=RATE, brief=True)
    samples = hearing.next_block(rows) * full_scale
    limit(limiter(sample_rate=RATE, channels=2), samples, opened=True)
    return samples


@pytest.fixture
def visit(browser: Browser) -> Iterator[Visit]:
    site = Site()
    with visiting(browser, site) as made:
        yield made
        assert not made.log


def test_the_worklet_plays_what_python_does(visit: Visit, models: list[ModalModel]) -> None:
    visit.site.given[f"/static/heads/kemar-{RATE}.bin"] = head_bytes("kemar", RATE)
    it = script(models, 1.0, 10)
    rows = np.stack([sent_by(it, number) for number in range(2)])
    full_scale = 0.3 / np.abs(heard_of(it, rows, 1.0)).max()
    expected = heard_of(it, rows, full_scale)
    told = in_the_page(visit, it, ears="binaural", full_scale=full_scale)
    assert (told["kind"], told["ears"], told["note"]) == ("wasm", "binaural", "")
    assert told["isolated"]
    assert told["shared"]
    assert told["last"]["dropped"] == told["last"]["late"] == 0
    assert apart(visit.samples("/sound", 2), expected) < -100
    told = in_the_page(visit, it, ears="binaural", full_scale=full_scale, plain=True)
    assert told["kind"] == "javascript"
    assert apart(visit.samples("/sound", 2), expected) < -100


@pytest.mark.prove
@pytest.mark.parametrize("ears", ["mono", "binaural"])
def test_a_minute_of_strikes_holds_and_steps_is_the_offline_render(
    visit: Visit, models: list[ModalModel], ears: str
) -> None:
    visit.site.given[f"/static/heads/kemar-{RATE}.bin"] = head_bytes("kemar", RATE)
    it = replace(script(models, 60.0, 240), changed=None)
    expected = rendered(it, ears)
    full_scale = float(0.5 / np.abs(expected).max())
    told = in_the_page(visit, it, ears=ears, full_scale=full_scale)
    assert told["last"]["dropped"] == told["last"]["late"] == 0
    found = visit.samples("/sound", len(expected))[:, LATE:]
    assert apart(found, full_scale * expected[:, : found.shape[1]]) < -80


def rendered(it: Script, ears: str) -> Array:
    """Return what the walking listener hears by `struck.render` (ears, n).

    With two ears it is that of the head's brief responses, which all live playing has.
    """
    seconds = it.blocks * BLOCK / RATE
    if ears == "mono":
        bodies = [
            Body(model=model, excitations=said_to(it, number), position=PLACES[number])
            for number, model in enumerate(it.models)
        ]
        listener = Mono(position=(it.times, it.positions))
        return struck.render(bodies, seconds=seconds, listener=listener).samples
    far = np.array([5.0, 0.0, 0.0])
    sent = [
        struck.render(
            model, said_to(it, number), seconds=seconds, listener=centre_of(model) + far
        ).samples[0]
        for number, model in enumerate(it.models)
    ]
    rows = 5.0 * np.stack(sent).astype(np.float64)
    return 1e6 * heard_of(it, rows, 1e-6)[:, LATE:]  # far below where the limiter begins


def said_to(it: Script, number: int) -> list[Strike | Hold]:
    """Return what happens to a body, as Python is told.

    One without a hold gets one of nearly nothing: strikes then go through resonators. The closed
    form that they get alone is of a force that is not band-limited.
    """
    strikes = [
        Strike(at=each["point"], striker=each["striker"], speed=each["speed"], time=each["time"])
        for each in it.strikes
        if each["body"] == number
    ]
    holds = [
        Hold(at=each["point"], grip=GRIP, time=each["begin"], seconds=each["end"] - each["begin"])
        for each in it.holds
        if each["body"] == number
    ]
    return [*strikes, *(holds or [Hold(at=strikes[0].at, grip=1e-12)])]


RECORDER = b"""
  registerProcessor('recorder', class extends AudioWorkletProcessor {
    process([[samples]]) {
      if (samples) this.port.postMessage({ frame: currentFrame, samples: samples.slice() });
      return true;
    }
  });
"""
RECORD = """
  const { createEngine } = await import('/static/sound/engine.js');
  const { readModel } = await import('/static/model/model.js');
  const model = await readModel(await (await fetch('/model0')).arrayBuffer());
  const context = new AudioContext({ sampleRate: given.rate });
  await context.resume();
  await context.audioWorklet.addModule('/recorder.js');
  const engine = await createEngine(context, {});
  const body = engine.addModel(model, {});
  engine.setFullScale(given.fullScale);
  engine.moveListener({ position: given.position, forward: [-1, 0, 0] });
  const recorder = new AudioWorkletNode(context, 'recorder');
  engine.node.connect(recorder).connect(context.destination);
  const all = new Float32Array(given.samples);
  const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
  await wait(0.5);
  const first = 128 * Math.ceil((context.currentTime + 0.5) * given.rate / 128);
  let frames = 0;
  recorder.port.onmessage = ({ data: { frame, samples } }) => {
    if (frame < first || frame - first >= all.length) return;
    all.set(samples, frame - first);
    frames += samples.length;
  };
  for (const { point, striker, speed, time } of given.strikes)
    engine.strike({
      body,
      contact: model.contact({ point }),
      striker: given.strikers[striker],
      speed,
      time: first / given.rate + time,
    });
  while (context.currentTime < first / given.rate + all.length / given.rate + 0.3) await wait(0.1);
  await fetch('/sound', { method: 'POST', body: all });
  const { dropped, late } = engine.counts();
  await context.close();
  return { frames, dropped, late };
"""


@pytest.mark.prove
def test_ten_seconds_on_the_clock_are_what_python_plays(
    visit: Visit, models: list[ModalModel]
) -> None:
    visit.site.given["/model0"] = to_bytes(models[0])
    visit.site.given["/recorder.js"] = RECORDER
    whole = script(models, 9.6, 60)
    strikes = [each for each in whole.strikes if each["body"] == 0]
    it = replace(whole, strikes=strikes, holds=[], changed=None)
    row, place = sent_by(it, 0), centre_of(models[0]) + np.array([1.2, 0.0, 0.0])
    emitter = Emitter(centre=Trajectory.of("position", centre_of(models[0])))
    heard = Hearing([emitter], Mono(position=place), sample_rate=RATE).next_block(row[None])
    full_scale = 0.3 / np.abs(heard).max()
    told = visit.run(
        RECORD,
        rate=RATE,
        samples=it.blocks * BLOCK,
        strikes=it.strikes,
        position=place.tolist(),
        fullScale=full_scale,
        strikers={name: dict(each) for name, each in strikers().items()},
    )
    assert told == {"frames": it.blocks * BLOCK, "dropped": 0, "late": 0}
    delay = round(0.0015 * RATE)  # of the limiter, which is open by then
    found = visit.samples("/sound", 1)[:, delay:]
    assert apart(found, full_scale * heard[:, : found.shape[1]]) < -80


CLICKS = """
  const { createEngine } = await import('/static/sound/engine.js');
  const { readModel } = await import('/static/model/model.js');
  const model = await readModel(await (await fetch('/model')).arrayBuffer());
  const vertices = model.vertices.length / 3;
  const points = Array.from({ length: 20 }, (_, k) => model.surface.vertex((40 * k) % vertices));
  const clicks = async (many) => {
    const context = new OfflineAudioContext(1, 0.1 * many * 48000, 48000);
    const engine = await createEngine(context, {});
    const body = engine.addModel(model, {});
    engine.calibrate(given.striker);
    const begun = performance.now();
    for (let k = 0; k < many; k++) {
      const contact = model.contact({ point: points[k % 20] });
      engine.strike({ body, contact, striker: given.striker, time: 0.02 + 0.09 * k });
    }
    engine.node.connect(context.destination);
    await engine.settled();
    const sound = await context.startRendering();
    const took = (performance.now() - begun) / 1000;
    engine.close();
    const peak = sound.getChannelData(0).reduce((most, each) => Math.max(most, Math.abs(each)), 0);
    return { took, peak, dropped: engine.counts().dropped };
  };
  await clicks(20);
  const before = performance.memory.usedJSHeapSize;
  const told = await clicks(200);
  return { ...told, count: model.count, grown: performance.memory.usedJSHeapSize - before };
"""


@pytest.mark.prove
def test_two_hundred_clicks_are_faster_than_real_time_and_leave_no_memory(
    visit: Visit,
) -> None:
    model = struck.analyze(
        Block(size=(0.5, 0.08, 0.02)), "steel", accuracy="preview", band=(20, 20000)
    )
    visit.site.given["/model"] = to_bytes(model)
    told = visit.run(CLICKS, striker=dict(strikers()["wood"]))
    assert told["count"] > 30
    assert told["dropped"] == 0
    assert told["peak"] > 0.05
    assert told["took"] < 20 / 3
    assert told["grown"] < 20 * 2**20


LIVE = """
  const { createEngine } = await import('/static/sound/engine.js');
  const { readModel } = await import('/static/model/model.js');
  const model = await readModel(await (await fetch('/model0')).arrayBuffer());
  const context = new AudioContext({ sampleRate: 48000 });
  await context.resume();
  const engine = await createEngine(context, { ears: given.ears });
  const reports = [];
  engine.onReport((report) => reports.push(report));
  const body = engine.addModel(model, {});
  engine.calibrate(given.striker);
  engine.moveListener({ position: [1, 0, 0], forward: [-1, 0, 0] });
  engine.node.connect(context.destination);
  const contact = model.loudest();
  const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
  await wait(0.2);
  engine.strike({ body, contact, striker: given.striker });
  await wait(0.3);
  const struck = { ...reports.at(-1), peak: Math.max(...reports.map(({ peak }) => peak)) };
  engine.node.port.postMessage({ burn: given.burn });
  const late = performance.now() + 5000;
  const more = () => reports.at(-1).underruns > struck.underruns && reports.at(-1).load > 0.5;
  while (given.burn && !more() && performance.now() < late) await wait(0.05);
  const burnt = reports.at(-1);
  const told = { note: engine.note, kind: engine.kind, ears: engine.ears, struck, burnt };
  told.shared = !!engine.ring;
  engine.close();
  await context.close();
  return told;
"""


@pytest.mark.prove
def test_on_the_clock_a_strike_sounds_and_an_overloaded_worklet_counts_underruns(
    visit: Visit, models: list[ModalModel]
) -> None:
    visit.site.given["/model0"] = to_bytes(models[0])
    told = visit.run(LIVE, striker=dict(strikers()["wood"]), burn=20, ears="mono")
    assert told["kind"] == "wasm"
    assert 0.2 < told["struck"]["peak"] < 0.3  # -12 dB at 1 m
    assert told["struck"]["ringing"] == 1
    assert told["struck"]["modes"] == len(models[0].frequencies)  # its recoil is none of them
    assert told["burnt"]["underruns"] > told["struck"]["underruns"]
    assert told["burnt"]["load"] > 0.5


REFUSED = """
  const { createEngine } = await import('/static/sound/engine.js');
  const { readModel } = await import('/static/model/model.js');
  const read = async (name) => readModel(await (await fetch(name)).arrayBuffer());
  const models = await Promise.all(['/model0', '/model1'].map(read));
  const context = new OfflineAudioContext(1, 9600, 48000);
  const said = async (action) => {
    try {
      await action();
      return 'nothing';
    } catch (error) {
      return `${error.name}: ${error.message}`;
    }
  };
  const engine = await createEngine(context, {});
  const body = engine.addModel(models[0], {});
  const told = {
    ears: await said(() => createEngine(context, { ears: 'three' })),
    body: await said(() => engine.strike({ body: 7, contact: models[0].loudest() })),
    change: await said(() => engine.changeModel(body, models[1])),
    worklet: await said(() => createEngine({}, {})),
  };
  engine.replaceModel(body, models[1]);
  engine.strike({ body, contact: models[1].loudest(), striker: given.striker, time: 0.02 });
  engine.node.connect(context.destination);
  await engine.settled();
  const samples = (await context.startRendering()).getChannelData(0);
  engine.removeModel(body);
  told.removed = await said(() => engine.changeModel(body, models[0]));
  return { ...told, dropped: engine.counts().dropped, heard: samples.some((each) => each !== 0) };
"""


@pytest.mark.prove
def test_what_cannot_be_is_refused_in_a_sentence_and_another_body_takes_the_place(
    visit: Visit, models: list[ModalModel]
) -> None:
    for number, model in enumerate(models):
        visit.site.given[f"/model{number}"] = to_bytes(model)
    told = visit.run(REFUSED, striker=dict(strikers()["wood"]))
    few, many = (len(model.frequencies) for model in models)
    assert told["ears"] == "RangeError: ears are 'three': give mono, stereo or binaural"
    assert told["body"] == "RangeError: there is no body 7: add a model first"
    assert told["change"] == (
        f"RangeError: the changed model has {many} modes, the body {few} modes and recoil: "
        "replace it"
    )
    assert told["worklet"].startswith("Error: this browser has no AudioWorklet here: open")
    assert told["removed"] == "RangeError: there is no body 0: add a model first"
    assert (told["dropped"], told["heard"]) == (0, True)


@pytest.mark.prove
def test_without_isolation_core_or_head_sound_goes_on_and_the_page_says_so(
    browser: Browser, models: list[ModalModel]
) -> None:
    site = Site(isolated=False)
    site.given["/model0"] = to_bytes(models[0])
    del site.given["/static/core.wasm"]
    with visiting(browser, site) as visit:
        told = visit.run(LIVE, striker=dict(strikers()["wood"]), burn=0, ears="binaural")
    assert (told["kind"], told["ears"], told["shared"]) == ("javascript", "mono", False)
    assert "The fast core is out of reach (the server answered 404)" in told["note"]
    assert "The ears are out of reach (the server answered 404): you hear with one." in told["note"]
    assert 0.2 < told["struck"]["peak"] < 0.3
