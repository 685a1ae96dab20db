// By itself, as other kinds of kits in the same program make calls of them dearer.
import assert from 'node:assert/strict';
import test from 'node:test';
import {
  KINDS,
  Ring,
  command,
  logarithms,
} from '../../../src/struck/explorer/static/sound/commands.js';
import { WasmKit } from '../../../src/struck/explorer/static/sound/core.js';
import { SinglePoint } from '../../../src/struck/explorer/static/sound/head.js';
import { REPORT, Synthesis } from '../../../src/struck/explorer/static/sound/synthesis.js';
import { contentOf } from './reading.mjs';

const MODEL = { frequencies: Float64Array.of(440, 1230), decays: Float64Array.of(3, 5) };
const BODY = {
  count: 2,
  poles: logarithms(MODEL, null, 48000),
  outputs: Float64Array.of(1, 2, 0.5, 0),
  centre: [0, 0, 0],
  radius: 0.1,
};

test('strikes through a shared ring leave the worklet nothing to collect', async () => {
  const core = await WebAssembly.compile(contentOf('core.wasm'));
  const kit = new WasmKit(core, { sampleRate: 48000, channels: 1 });
  const synthesis = new Synthesis(kit, new SinglePoint());
  synthesis.add(0, BODY);
  const ring = Ring.ofWords(2 ** 14);
  const reader = new Ring(ring.memory);
  const force = new Float64Array(60).fill(1);
  const blow = command(KINDS.STRIKE, 0, undefined, 60, 2, force, Float64Array.of(1, -1));
  const out = [new Float32Array(128)];
  const go = (rounds) => {
    for (let k = 0; k < rounds; k++) {
      if (k % 4 === 0) ring.write(blow);
      reader.read(synthesis.take);
      synthesis.process(out);
    }
  };
  go(40000); // compiled by now
  const before = process.memoryUsage().heapUsed;
  go(4000);
  const more = process.memoryUsage().heapUsed - before;
  assert.ok(more < 4000 * 64, `${more} bytes in 4000 blocks`);
  assert.equal(synthesis.told()[REPORT.DROPPED], 0);
  assert.ok(synthesis.told()[REPORT.PEAK] > 0);
});
