// The page's model files, gains, holds, strikes and pulses against those of Python.
import assert from 'node:assert/strict';
import test from 'node:test';
import { effectiveMass, resolved } from '../../../src/struck/explorer/static/excitation/hertz.js';
import { sampledPulse } from '../../../src/struck/explorer/static/excitation/pulse.js';
import { FormatError, readModel } from '../../../src/struck/explorer/static/model/model.js';
import { logarithms } from '../../../src/struck/explorer/static/sound/commands.js';
import { apart, contentOf, goldenOf, jsonOf } from './reading.mjs';

const SAME = 1e-6;
const MESHED = ['block', 'tube'];
const { strikers, ...pulses } = await goldenOf('pulses.golden');

const row = (tensor, number, width = tensor.shape.at(-1)) =>
  tensor.data.subarray(number * width, (number + 1) * width);

for (const name of jsonOf('names.json')) {
  const buffer = contentOf(`${name}.struck`);
  const model = await readModel(buffer);
  const golden = await goldenOf(`${name}.golden`);

  test(`${name}: arrays are views of the file`, () => {
    assert.equal(model.frequencies.buffer, buffer);
    if (model.shapes) assert.equal(model.shapes.buffer, buffer);
  });

  test(`${name}: outputs toward a listener`, () => {
    for (let k = 0; k < golden.listeners.shape[0]; k++) {
      const { re, im } = model.toward(Array.from(row(golden.listeners, k)));
      const both = Float64Array.from(
        { length: 2 * re.length },
        (_, n) => (n % 2 ? im : re)[n >> 1],
      );
      assert.ok(apart(both, row(golden.toward, k, both.length)) < 1e-14);
    }
  });

  test(`${name}: poles, and outputs at 1 m, of modes and of recoil`, () => {
    const pairs = (re, im) =>
      Float64Array.from({ length: 2 * re.length }, (_, n) => (n % 2 ? im : re)[n >> 1]);
    const words = logarithms(model, null, pulses.sampleRate);
    const count = words.length / 2;
    const poles = pairs(words.subarray(0, count), words.subarray(count));
    assert.ok(apart(poles, golden.logarithms.data) < 1e-14);
    const { re, im } = model.aside(pulses.sampleRate);
    assert.ok(apart(pairs(re, im), golden.aside.data) < 1e-12);
    assert.equal(count, model.count + (model.recoil ? 3 : 0));
  });

  if (model.recorded) continue;
  const count = golden.points.shape[0];
  const contactAt = (k, face) => model.contact({ point: Array.from(row(golden.points, k)), face });

  test(`${name}: contacts and gains, by the face that a ray met and by the nearest one`, () => {
    assert.ok(Math.abs(model.extent - golden.extent) < 1e-12);
    assert.ok(Math.abs(model.radius - golden.radius) < 1e-12);
    let worst = 0;
    for (let k = 0; k < count; k++) {
      for (const face of [golden.faces.data[k], undefined]) {
        const contact = contactAt(k, face);
        assert.ok(apart(contact.direction, row(golden.directions, k)) < 1e-9, `direction ${k}`);
        if (model.exactTo === Infinity)
          worst = Math.max(worst, apart(model.drive(contact), row(golden.drives, k)));
      }
    }
    assert.ok(worst < SAME, `${worst}`);
  });

  test(`${name}: a grip raises decays`, { skip: model.exactTo < Infinity }, () => {
    for (let k = 0; k < golden.raised.shape[0]; k++)
      assert.ok(apart(model.raised(contactAt(k), 12), row(golden.raised, k)) < SAME);
  });

  test(`${name}: impulse and time of contact of strikes`, () => {
    for (const { said, impulse, duration } of golden.blows) {
      const striker = said.striker && strikers[said.striker];
      const found = resolved(model, contactAt(0), { ...said, striker });
      assert.ok(apart([found.impulse, found.duration], [impulse, duration]) < 1e-9);
      assert.ok(Math.abs(found.duration - duration) <= 1e-9 * duration, said.striker);
    }
  });

  test(`${name}: vertices of a mode's picture`, { skip: !MESHED.includes(name) }, () => {
    const mode = model.count - 1;
    const shape = model.modeShape(mode);
    for (const vertex of [0, 17])
      for (const axis of [0, 1, 2])
        assert.equal(
          shape[3 * vertex + axis],
          model.shapes[(3 * vertex + axis) * model.count + mode],
        );
  });
}

test('a body known by its mesh alone says up to where it is true to 1 %', async () => {
  const model = await readModel(contentOf('corner.struck'));
  const golden = await goldenOf('corner.golden');
  assert.ok(model.exactTo > model.frequencies[0] && model.exactTo < Infinity, `${model.exactTo}`);
  const modes = model.naturalFrequencies.filter((each) => each <= model.exactTo).length;
  const { drives } = golden;
  for (let mode = 0; mode < modes; mode++) {
    const of = (k) => row(drives, k)[mode];
    const found = Array.from({ length: golden.points.shape[0] }, (_, k) =>
      model.drive(model.contact({ point: Array.from(row(golden.points, k)) })),
    );
    const wanted = found.map((_, k) => of(k));
    assert.ok(
      apart(
        found.map((each) => each[mode]),
        wanted,
      ) < 0.01,
      `mode ${mode}`,
    );
  }
});

test('pulses are band-limited as in Python', () => {
  pulses.pulses.forEach(({ first, ...said }, number) => {
    const found = sampledPulse({ ...said, sampleRate: pulses.sampleRate });
    assert.equal(found.first, first);
    assert.ok(apart(found.force, pulses[`force${number}`].data) < 1e-12, `${said.duration}`);
  });
});

test('a body without modes is heard by its recoil', async () => {
  const model = await readModel(contentOf('die.struck'));
  assert.equal(model.count, 0);
  const drive = model.drive(model.loudest());
  assert.equal(drive.length, 3);
  assert.ok(drive.some((each) => each > 0));
});

test('a free body struck beside its centre gives way: a thin rod at its end, as a quarter', () => {
  const inertia = [
    [1e-9, 0, 0],
    [0, 1 / 12, 0],
    [0, 0, 1 / 12],
  ];
  const rod = { mass: 1, centre: [0, 0, 0], inertia, direction: [0, 0, 1] };
  assert.ok(Math.abs(effectiveMass({ ...rod, point: [0.5, 0, 0] }) - 0.25) < 1e-12);
  assert.ok(Math.abs(effectiveMass({ ...rod, point: [0, 0, 0] }) - 1) < 1e-12);
});

test('a place off the body is refused with the distance', async () => {
  const model = await readModel(contentOf('block.struck'));
  assert.throws(() => model.contact({ point: [1, 1, 1] }), /m off the body, more than 0.004/);
  assert.throws(() => model.contact({ point: [NaN, 0, 0] }), /\(NaN, 0, 0\): give finite numbers/);
  assert.throws(() => model.toward([0, 0, 0]), /inside its radius/);
});

const DAMAGED = {
  'a changed number': [(bytes) => (bytes[bytes.length - 9] ^= 1), /does not match its SHA-256/],
  'a changed header': [(bytes) => (bytes[400] ^= 1), /SHA-256|header|format|text/],
  'a shorter file': [null, /SHA-256|within/],
  'no model at all': [(bytes) => bytes.fill(0), /does not begin like a model file/],
};

for (const [name, [damage, message]] of Object.entries(DAMAGED)) {
  test(`${name} is refused in a sentence`, async () => {
    let buffer = contentOf('bar.struck');
    if (damage) damage(new Uint8Array(buffer));
    else buffer = buffer.slice(0, buffer.byteLength - 8);
    await assert.rejects(readModel(buffer), (error) => {
      assert.ok(error instanceof FormatError);
      assert.match(error.message, message);
      return true;
    });
  });
}

test('a newer file asks for a newer struck', async () => {
  await assert.rejects(
    readModel(contentOf('newer.struck')),
    /its version is 2, and this page reads/,
  );
});
