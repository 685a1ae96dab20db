// The page's resonators, ears, limiter and their whole against those of Python.
import assert from 'node:assert/strict';
import test from 'node:test';
import {
  KINDS,
  Ring,
  command,
  logarithms,
} from '../../../src/struck/explorer/static/sound/commands.js';
import { WasmKit } from '../../../src/struck/explorer/static/sound/core.js';
import { SinglePoint, readHead } from '../../../src/struck/explorer/static/sound/head.js';
import { BLOCK, PlainKit } from '../../../src/struck/explorer/static/sound/plain.js';
import { Propagation, STRETCH } from '../../../src/struck/explorer/static/sound/propagation.js';
import { REPORT, Synthesis } from '../../../src/struck/explorer/static/sound/synthesis.js';
import { apart, contentOf, decibels, goldenOf } from './reading.mjs';

const RATE = 48000;
const core = await WebAssembly.compile(contentOf('core.wasm'));
const KITS = {
  wasm: (channels = 1) => new WasmKit(core, { sampleRate: RATE, channels }),
  javascript: (channels = 1) => new PlainKit({ sampleRate: RATE, channels }),
};
const row = ({ data, shape }, number) => {
  const width = shape.slice(1).reduce((product, size) => product * size, 1);
  return data.subarray(number * width, (number + 1) * width);
};

/** Play the script of a golden case on a bank, block by block. */
function rung(bank, golden) {
  const poles = (number) =>
    logarithms(
      { frequencies: row(golden.frequencies, number), decays: row(golden.decays, number) },
      null,
      RATE,
    );
  bank.setPoles(poles(0), 0);
  bank.setOutputs(row(golden.outputs, 0), 0);
  const starts = [];
  golden.strikes.reduce((sum, { length }) => (starts.push(sum), sum + length * BLOCK), 0);
  const heard = new Float64Array(golden.blocks * BLOCK);
  for (let block = 0; block < golden.blocks; block++) {
    if (block in golden.changes) bank.setPoles(poles(golden.changes[block]), 0);
    if (block === golden.moved) bank.setOutputs(row(golden.outputs, 1), 0);
    golden.strikes.forEach(({ voice, block: first, length }, number) => {
      const place = block - first;
      if (place === length) bank.stop(voice);
      if (place < 0 || place >= length) return;
      const begin = starts[number] + place * BLOCK;
      bank.force(voice).set(golden.forces.data.subarray(begin, begin + BLOCK));
      if (place) bank.go(voice);
      else bank.start(voice, row(golden.drives, number), 0);
    });
    bank.make();
    heard.set(bank.sound, block * BLOCK);
  }
  return heard;
}

for (const [name, kit] of Object.entries(KITS)) {
  test(`${name}: resonators over 10 s of strikes, changes and a hold`, async () => {
    const golden = await goldenOf('rung.golden');
    const bank = kit().bank(golden.frequencies.shape[1], 3);
    const found = rung(bank, golden);
    assert.ok(golden.strikes.length > 10);
    for (let second = 0; second < 10; second++) {
      const part = (all) => all.subarray(second * RATE, (second + 1) * RATE);
      const error = decibels(apart(part(found), part(golden.heard.data)));
      assert.ok(error < -120, `second ${second}: ${error} dB`);
    }
  });

  test(`${name}: what has died away becomes 0 while other modes ring on`, () => {
    const bank = kit().bank(2, 1);
    const modes = { frequencies: Float64Array.of(440, 3000), decays: Float64Array.of(0.1, 2000) };
    bank.setPoles(logarithms(modes, null, RATE), 0);
    bank.setOutputs(Float64Array.of(1, 1, 0, 0), 0);
    bank.start(0, Float64Array.of(1, 1), 0);
    bank.force(0).fill(0)[0] = 1;
    bank.make();
    bank.stop(0);
    for (let k = 0; k < 120; k++) bank.make();
    const [re, im] = bank.state(1);
    assert.ok(re === 0 && im === 0);
    assert.ok(Math.hypot(...bank.state(0)) > 1e-6);
  });

  test(`${name}: a limiter that opens, and a sample that is no number`, async () => {
    const { before, after } = await goldenOf('limited.golden');
    const made = kit(2);
    const found = new Float64Array(after.data.length);
    const half = after.data.length / 2;
    for (let first = 0; first < half; first += BLOCK) {
      for (const channel of [0, 1])
        made.mix.set(
          before.data.subarray(channel * half + first, channel * half + first + BLOCK),
          channel * BLOCK,
        );
      made.limit(true);
      for (const channel of [0, 1])
        found.set(
          made.mix.subarray(channel * BLOCK, (channel + 1) * BLOCK),
          channel * half + first,
        );
    }
    assert.ok(decibels(apart(found, after.data)) < -250);
  });

  for (const [ears, file] of [
    ['mono', null],
    ['stereo', 'exact'],
    ['binaural', 'kemar'],
  ]) {
    test(`${name}: what a moving listener hears, ${ears}`, async () => {
      const golden = await goldenOf(`${ears}.golden`);
      const head = file ? await readHead(contentOf(`${file}.head`)) : new SinglePoint();
      const error = decibels(apart(heardBy(kit(head.ears), head, golden), golden.heard.data));
      assert.ok(error < -100, `${error} dB`);
    });
  }
}

/** Let the ears hear the rows of a golden case. */
function heardBy(kit, head, golden) {
  const propagation = new Propagation(head, RATE);
  assert.equal(propagation.lead, golden.lead);
  for (let k = 0; k < golden.poses.shape[0]; k++) {
    const pose = row(golden.poses, k);
    propagation.course.set(pose[0], pose, 1);
  }
  const lines = [0, 1].map(() => Object.assign(kit.line(head.taps, 4096), { longest: 3000 }));
  const ways = lines.map((line, k) => propagation.way(line, row(golden.centres, k), 0.1));
  const length = golden.sent.shape[1];
  const heard = new Float32Array(head.ears * length);
  for (let first = 0; first < length; first += BLOCK) {
    if (first % STRETCH === 0) propagation.goOn(ways);
    kit.heard.fill(0);
    lines.forEach((line, k) =>
      line.hear(row(golden.sent, k).subarray(first, first + BLOCK), first % STRETCH, STRETCH),
    );
    for (let ear = 0; ear < head.ears; ear++)
      heard.set(kit.heard.subarray(ear * BLOCK, (ear + 1) * BLOCK), ear * length + first);
  }
  return heard;
}

const MODEL = {
  frequencies: Float64Array.of(440, 1230, 3567, 9000),
  decays: Float64Array.of(3, 5, 9, 40),
};
const BODY = {
  count: 4,
  poles: logarithms(MODEL, null, RATE),
  outputs: Float64Array.of(1, 2, 3, 4, 0.5, 0, -1, 0),
  centre: [0, 0, 0],
  radius: 0.1,
};
const FORCE = Float64Array.from({ length: 60 }, (_, k) => Math.sin((Math.PI * k) / 60));
const DRIVE = Float64Array.of(1, -1, 0.5, 0.2);
const strike = (sample, body = 0) =>
  command(KINDS.STRIKE, body, sample, FORCE.length, DRIVE.length, FORCE, DRIVE);
const POSE = [2, 0, 0, -1, 0, 0, 0, 0, 1];

/** Return a scene of one body, heard from 2 m. */
function scene(kit = KITS.wasm, options = {}) {
  const synthesis = new Synthesis(kit(), new SinglePoint(), options);
  synthesis.post(command(KINDS.POSE, 0, 0, 0, POSE));
  synthesis.add(0, BODY);
  return synthesis;
}

/** Play some samples in render quanta of a size. */
function played(synthesis, length, quantum = 128) {
  const all = new Float32Array(length);
  for (let first = 0; first < length; first += quantum)
    synthesis.process([all.subarray(first, Math.min(first + quantum, length))]);
  return all;
}

const loudest = (samples) => samples.reduce((most, each) => Math.max(most, Math.abs(each)), 0);

test('any render quantum makes the very same samples', () => {
  const told = (synthesis) => [100, 700, 5000].forEach((sample) => synthesis.post(strike(sample)));
  const [whole, ...others] = [128, 64, 100, 384, 441].map((quantum) => {
    const synthesis = scene();
    told(synthesis);
    return played(synthesis, 9600, quantum);
  });
  assert.ok(loudest(whole) > 1e-6);
  for (const other of others) assert.deepEqual(other, whole);
});

test('WebAssembly and JavaScript play the same scene', () => {
  const [one, other] = [KITS.wasm, KITS.javascript].map((kit) => {
    const synthesis = scene(kit);
    [10, 11, 5000].forEach((sample) => synthesis.post(strike(sample)));
    synthesis.post(command(KINDS.POSE, 0, 0, 0.3, [1, 1, 0, -1, 0, 0, 0, 0, 1]));
    return played(synthesis, 30000);
  });
  assert.ok(decibels(apart(other, one)) < -110);
});

test('a strike sounds at its sample, wherever that lies in a block', () => {
  const at = (sample) => {
    const synthesis = scene();
    synthesis.post(strike(sample));
    return played(synthesis, 6000);
  };
  const one = at(1024);
  const first = one.findIndex((each) => Math.abs(each) > 1e-9);
  assert.ok(Math.abs(first - (1024 + 80 + 72 + Math.round((2 / 343.21) * RATE))) < 20, `${first}`);
  // Later by a few samples within its block: the same, later.
  const other = at(1024 + 37);
  const error = apart(other.subarray(37 + 1000), one.subarray(1000, 6000 - 37));
  assert.ok(decibels(error) < -100, `${decibels(error)}`);
});

test('a context that went on alone for a while loses no strike, and keeps its time', () => {
  const [synthesis, other] = [scene(), scene()];
  const one = new Float32Array(128);
  synthesis.process([one], 0);
  synthesis.process([one], 10240);
  other.process([one], 0);
  synthesis.post(strike(10240 + 1280));
  other.post(strike(1280));
  const rest = [];
  for (let k = 1; k < 40; k++) {
    synthesis.process([one], 10240 + 128 * k);
    rest.push(...one);
  }
  assert.ok(loudest(rest) > 1e-6);
  assert.ok(decibels(apart(rest, played(other, rest.length))) < -100);
});

/** Play two channels; at some samples another head begins to hear. */
function heardByHeads(kit, head, length, changes = {}) {
  const synthesis = new Synthesis(kit, head);
  synthesis.post(command(KINDS.POSE, 0, 0, 0, POSE));
  synthesis.post(command(KINDS.POSE, 0, 0, 1, [0.5, 1.2, 0.3, -1, 0.2, 0, 0, 0, 1]));
  synthesis.add(0, BODY);
  [0, 3000, 24000].forEach((sample) => synthesis.post(strike(sample)));
  const channels = [0, 1].map(() => new Float32Array(length));
  for (let first = 0; first < length; first += BLOCK) {
    if (changes[first]) synthesis.setHead(changes[first]);
    synthesis.process(channels.map((all) => all.subarray(first, first + BLOCK)));
  }
  return channels;
}

for (const [name, kit] of Object.entries(KITS)) {
  test(`${name}: another head takes over what rings, without a click`, async () => {
    const [ball, ear] = [await readHead(contentOf('exact.head')), new SinglePoint()];
    const measured = await readHead(contentOf('kemar.head'));
    const length = 30720;
    for (const [from, to] of [[ear, measured], [measured, ball], [ball, ear]]) {
      const begun = 7 * 1280; // amid the ringing of two blows
      const found = heardByHeads(kit(2), from, length, { [begun]: to });
      const [before, after] = [from, to].map((head) => heardByHeads(kit(2), head, length));
      const done = begun + 4 * STRETCH; // the next stretch, responses that fill, the crossfade
      for (const channel of [0, 1]) {
        const [one, other] = [before[channel], after[channel]];
        assert.deepEqual(found[channel].subarray(0, begun), one.subarray(0, begun));
        const error = apart(found[channel].subarray(done), other.subarray(done));
        assert.ok(decibels(error) < -100, `${decibels(error)} dB`);
        const rough = (samples) =>
          loudest(samples.map((x, k, all) => (k > 2 ? x - 3 * all[k - 1] + 3 * all[k - 2] - all[k - 3] : 0)));
        const part = (samples) => samples.subarray(begun, done);
        const limit = Math.max(rough(part(one)), rough(part(other)));
        assert.ok(rough(part(found[channel])) < 1.05 * limit);
      }
    }
  });
}

test('heads that change over and over take no more memory', async () => {
  const heads = [new SinglePoint(), await readHead(contentOf('exact.head'))];
  const kit = KITS.wasm(2);
  const changes = (count) =>
    Object.fromEntries(Array.from({ length: count }, (_, k) => [k * 5 * STRETCH, heads[k % 2]]));
  const channels = [0, 1].map(() => new Float32Array(BLOCK));
  const synthesis = new Synthesis(kit, heads[0]);
  synthesis.add(0, BODY);
  const play = (count) => {
    const when = changes(count);
    for (let first = 0; first < count * 5 * STRETCH; first += BLOCK) {
      if (when[first]) synthesis.setHead(when[first]);
      synthesis.process(channels);
    }
  };
  play(4);
  const bytes = kit.buffer.byteLength;
  play(60);
  assert.equal(kit.buffer.byteLength, bytes);
});

test('strikes beyond the voices are dropped and counted', () => {
  const synthesis = scene(KITS.wasm, { voices: 3 });
  for (let k = 0; k < 10; k++) synthesis.post(strike(64));
  const sound = played(synthesis, 3000);
  assert.equal(synthesis.told()[REPORT.DROPPED], 7);
  const three = scene(KITS.wasm, { voices: 3 });
  for (let k = 0; k < 3; k++) three.post(strike(64));
  assert.deepEqual(played(three, 3000), sound);
});

test('strikes that come late are played at once and counted', () => {
  const synthesis = scene();
  played(synthesis, 4096);
  synthesis.post(strike(100));
  assert.ok(loudest(played(synthesis, 4096)) > 1e-6);
  assert.equal(synthesis.told()[REPORT.LATE], 1);
});

test('a body of other poles goes on without a click, and a stranger is refused', () => {
  const synthesis = scene();
  synthesis.post(strike(0));
  played(synthesis, 9600);
  const before = played(synthesis, 1280);
  const other = { frequencies: MODEL.frequencies.map((f) => 1.1 * f), decays: MODEL.decays };
  const outputs = [BODY.outputs.subarray(0, 4), BODY.outputs.subarray(4)];
  synthesis.post(command(KINDS.MODEL, 0, undefined, 4, logarithms(other, null, RATE), ...outputs));
  const after = played(synthesis, 1280);
  const steps = (samples) => loudest(samples.map((each, k) => (k ? each - samples[k - 1] : 0)));
  assert.ok(steps(after) < 1.3 * steps(before));
  synthesis.post(command(KINDS.POLES, 0, undefined, 3, new Float64Array(6)));
  synthesis.post(strike(undefined, 5));
  assert.equal(synthesis.told()[REPORT.DROPPED], 2);
});

test('a body that leaves fades, and its memory is used again', () => {
  const kit = KITS.wasm();
  const synthesis = new Synthesis(kit, new SinglePoint());
  synthesis.add(0, BODY);
  synthesis.post(strike(0));
  played(synthesis, 4800);
  synthesis.post(command(KINDS.FADE, 0, undefined));
  assert.ok(loudest(played(synthesis, 2048)) > 0);
  assert.equal(loudest(played(synthesis, 4800).subarray(2048)), 0);
  played(synthesis, 60000);
  const bytes = kit.buffer.byteLength;
  for (let round = 0; round < 40; round++) {
    synthesis.add(round, BODY);
    synthesis.post(command(KINDS.FADE, round, undefined));
    played(synthesis, 40960);
  }
  assert.equal(kit.buffer.byteLength, bytes);
});

test('a body that has died away sleeps, and wakes', () => {
  const synthesis = scene();
  synthesis.post(strike(0));
  played(synthesis, 10 * RATE);
  assert.equal(synthesis.told()[REPORT.RINGING], 0);
  synthesis.post(strike(undefined));
  assert.ok(loudest(played(synthesis, 4800)) > 1e-6);
  assert.equal(synthesis.told()[REPORT.RINGING], 1);
});

test('a ring hands over commands in order, and refuses what it has no room for', () => {
  const ring = Ring.ofWords(64);
  const reader = new Ring(ring.memory);
  const seen = [];
  const take = (words, at) => seen.push(Array.from(words.subarray(at, at + words[at])));
  let written = 0;
  for (let round = 0; round < 50; round++) {
    const size = 1 + (round % 5);
    while (ring.write(command(KINDS.LEVEL, written, undefined, new Float64Array(size)))) written++;
    reader.read(take);
  }
  assert.equal(seen.length, written);
  assert.ok(written > 200);
  seen.forEach((words, number) => assert.equal(words[2], number));
});
