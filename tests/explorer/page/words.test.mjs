// What the page tells of a body in words.
import assert from 'node:assert/strict';
import test from 'node:test';
import { hertz, lasting, length, times, weight } from '../../../src/struck/explorer/static/panel/words.js';


test('a mass is a plain number of its unit, to three digits', () => {
  const told = [2.5e-6, 9.996e-4, 0.05674, 0.1, 0.9994, 0.9996, 2.93, 999.6, 1234.5, 58_900, 7.85e22].map(weight);
  assert.deepEqual(told.slice(0, -1), [
    '2.5 mg', '1 g', '56.7 g', '100 g', '999 g', '1 kg', '2.93 kg', '1000 kg', '1230 kg', '58900 kg',
  ]);
  assert.equal(told.at(-1), '78500000000000000000000 kg');
});

test('lengths, times and frequencies have no power of ten', () => {
  assert.deepEqual([3e-8, 1.2e-4, 0.0994, 0.3, 90].map(length), ['0.000030 mm', '0.12 mm', '99 mm', '30 cm', '9000 cm']);
  const t60 = (seconds) => lasting(Math.log(1000) / seconds);
  assert.deepEqual([2e-5, 0.0072, 0.0097, 0.5, 9.5, 40, 1e4].map(t60), ['0.02 ms', '7 ms', '10 ms', '0.50 s', '9.5 s', '40 s', 'endless']);
  assert.deepEqual([0.0012, 8.5, 999.4, 999.6, 31_400, 2.5e6].map(hertz), ['0.00120 Hz', '8.50 Hz', '999 Hz', '1.00 kHz', '31.4 kHz', '2500 kHz']);
  assert.deepEqual([1.004, 0.1, 9.96, 87.3].map(times), ['as it was', '0.10 times', '10 times', '87 times']);
});
