// What the page tells of a body in words. Its panels look up their fields as they load.
import assert from 'node:assert/strict';
import test from 'node:test';

globalThis.document = { getElementById: () => null };
const { weight } = await import('../../../src/struck/explorer/static/panel/object.js');

test('a mass is a plain number of its unit, to three digits', () => {
  const told = [2.5e-6, 9.996e-4, 0.05674, 0.1, 0.9994, 0.9996, 2.93, 999.6, 1234.5, 58_900, 7.85e22].map(weight);
  assert.deepEqual(told.slice(0, -1), [
    '2.5 mg', '1 g', '56.7 g', '100 g', '999 g', '1 kg', '2.93 kg', '1000 kg', '1230 kg', '58900 kg',
  ]);
  assert.equal(told.at(-1), '78500000000000000000000 kg');
});
