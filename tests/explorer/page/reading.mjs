// What the tests of the page's modules share: files that Python wrote, and how far results lie apart.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { readContainer } from '../../../src/struck/explorer/static/model/container.js';

const FOLDER = process.env.STRUCK_GOLDEN;

/** Return the content of a file as a buffer of its own. */
export function contentOf(name, folder = FOLDER) {
  const bytes = readFileSync(join(folder, name));
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
}

export const jsonOf = (name) => JSON.parse(readFileSync(join(FOLDER, name), 'utf8'));

/** Return JSON values and arrays of a golden case. */
export async function goldenOf(name) {
  const { metadata, tensors } = await readContainer(contentOf(name), { kind: 'golden' });
  return { ...JSON.parse(metadata.json), ...tensors };
}

/** Return the largest difference as a share of the largest wanted value. */
export function apart(found, wanted) {
  if (found.length !== wanted.length) return Infinity;
  let [difference, size] = [0, 0];
  for (let k = 0; k < wanted.length; k++) {
    if (!Number.isFinite(found[k])) return Infinity;
    difference = Math.max(difference, Math.abs(found[k] - wanted[k]));
    size = Math.max(size, Math.abs(wanted[k]));
  }
  return size ? difference / size : difference;
}

export const decibels = (share) => 20 * Math.log10(Math.max(share, 1e-15));
