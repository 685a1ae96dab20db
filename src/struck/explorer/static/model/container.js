/**
 * The container of model files: tensors and text in safetensors form, sealed by a SHA-256.
 * Tensors are views of the given buffer, never copies. `struck/files/container.py` writes them.
 */

/** Refusal of a file, in a sentence that says the way out. */
export class FormatError extends Error {
  name = 'FormatError';
}

const LONGEST_HEADER = 16 * 2 ** 20;
const KINDS = { F64: Float64Array, F32: Float32Array, U32: Uint32Array };
const SEAL = /"sha256"\s*:\s*"([0-9a-f]{64})"/;
const AGAIN = 'copy it again from its source, or save the model again';

/**
 * Return the texts and tensors of a sealed file.
 * @param {ArrayBuffer} buffer the whole file; must not change while it is read
 * @param {{kind?: string, newest?: number}} expected name of the format, and its newest version
 * @returns {Promise<{metadata: Record<string, string>, tensors: Record<string, Tensor>}>}
 * @throws {FormatError} when it is damaged, truncated, of another kind or newer
 */
export async function readContainer(buffer, { kind = 'struck', newest = 1 } = {}) {
  const { end, entries } = readHeader(buffer);
  const metadata = entries.__metadata__;
  requireVersion(metadata, kind, newest);
  await requireSeal(buffer, end);
  /** @type {Record<string, Tensor>} */
  const tensors = {};
  for (const [name, entry] of Object.entries(entries))
    if (name !== '__metadata__') tensors[name] = tensorOf(buffer, end, name, entry);
  return { metadata, tensors };
}

/**
 * @typedef {{data: Float64Array | Float32Array | Uint32Array, shape: number[]}} Tensor
 */

function readHeader(buffer) {
  const view = new DataView(buffer);
  const length = buffer.byteLength < 8 ? 0 : Number(view.getBigUint64(0, true));
  if (!(length >= 2 && length <= LONGEST_HEADER))
    throw new FormatError(
      `it does not begin like a model file (a header of ${length} bytes, with 2 to ` +
        `${LONGEST_HEADER} allowed): ${AGAIN}`,
    );
  if (8 + length > buffer.byteLength)
    throw new FormatError(
      `it ends after ${buffer.byteLength} bytes, within its header of ${length}: ${AGAIN}`,
    );
  const entries = parsed(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const texts = entries?.__metadata__;
  const textual = texts && Object.values(texts).every((each) => typeof each === 'string');
  if (!textual) throw new FormatError(`its header holds no text, it is damaged: ${AGAIN}`);
  return { end: 8 + length, entries };
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    throw new FormatError(`its header cannot be read, it is damaged: ${AGAIN}`);
  }
}

function requireVersion(metadata, kind, newest) {
  if (metadata.format !== kind)
    throw new FormatError(
      `its format is '${metadata.format}' and not '${kind}': give a .${kind} file`,
    );
  const version = metadata.version ?? '';
  if (!/^[1-9][0-9]{0,5}$/.test(version))
    throw new FormatError(`its version is '${version}', no number, it is damaged: ${AGAIN}`);
  if (Number(version) > newest)
    throw new FormatError(
      `its version is ${version}, and this page reads up to ${newest}: update struck`,
    );
}

/** Refuse a file unless the SHA-256 that it names is that of its content, the seal itself zeros. */
async function requireSeal(buffer, end) {
  const digest = globalThis.crypto?.subtle;
  if (!digest)
    throw new FormatError(
      'the browser gives no SHA-256 to pages from elsewhere: open this one by https or 127.0.0.1',
    );
  // One character a byte, so that the place of a match is that of its bytes.
  const text = new TextDecoder('latin1').decode(new Uint8Array(buffer, 0, end));
  const found = SEAL.exec(text);
  const place = found ? found.index + found[0].length - 65 : 0;
  const bytes = new Uint8Array(buffer);
  const seal = bytes.slice(place, place + 64);
  if (found) bytes.fill(48, place, place + 64);
  const digesting = digest.digest('SHA-256', buffer); // has taken its copy when it returns
  bytes.set(seal, place);
  const sum = Array.from(new Uint8Array(await digesting), (byte) =>
    byte.toString(16).padStart(2, '0'),
  );
  if (!found || sum.join('') !== found[1])
    throw new FormatError(
      `its content does not match its SHA-256, it is damaged or truncated: ${AGAIN}`,
    );
}

function tensorOf(buffer, start, name, entry) {
  const kind = KINDS[entry?.dtype];
  if (!kind)
    throw new FormatError(`its tensor '${name}' is of type ${entry?.dtype}: update struck`);
  const [first, last] = entry.data_offsets ?? [];
  const count = (entry.shape ?? []).reduce((product, size) => product * size, 1);
  const fits = first >= 0 && last <= buffer.byteLength - start;
  if (!fits || last - first !== count * kind.BYTES_PER_ELEMENT)
    throw new FormatError(`its tensor '${name}' does not lie within the file: ${AGAIN}`);
  const place = start + first;
  const data =
    place % kind.BYTES_PER_ELEMENT
      ? new kind(buffer.slice(place, start + last)) // not written by struck
      : new kind(buffer, place, count);
  return { data, shape: entry.shape };
}
