/**
 * What the page tells the worklet, in numbers alone: the same words travel in messages and in
 * memory that both share. A command is its length, kind, body and sample, then what it brings.
 */

export const KINDS = { STRIKE: 1, POLES: 2, MODEL: 3, POSE: 4, LEVEL: 5, FADE: 6 };
export const [LENGTH, KIND, BODY, SAMPLE, BROUGHT] = [0, 1, 2, 3, 4];
export const AT_ONCE = -1; // in place of a sample

/**
 * Return the words of a command.
 * @param {number} kind of `KINDS`
 * @param {number} body
 * @param {number | undefined} sample of the context, at which it takes effect
 * @param {...(number | ArrayLike<number>)} brought numbers and arrays of them, one after the other
 */
export function command(kind, body, sample, ...brought) {
  let size = BROUGHT;
  for (const each of brought) size += typeof each === 'number' ? 1 : each.length;
  const words = new Float64Array(size);
  words.set([words.length, kind, body, sample ?? AT_ONCE]);
  let place = BROUGHT;
  for (const each of brought) {
    if (typeof each === 'number') words[place++] = each;
    else {
      words.set(each, place);
      place += each.length;
    }
  }
  return words;
}

/**
 * Return logarithms of the factors of a sample of all modes, then of recoil, where the body has it:
 * real parts, then imaginary ones. Those of modes at or above half the sample rate are 0.
 * @param {{frequencies: ArrayLike<number>, decays: ArrayLike<number>,
 *   recoil?: import('../model/recoil.js').Recoil | null}} model
 * @param {ArrayLike<number> | null} raised by which decays of modes are higher, 1/s
 * @param {number} sampleRate Hz
 */
export function logarithms({ frequencies, decays, recoil }, raised, sampleRate) {
  const modes = frequencies.length;
  const more = recoil ? recoil.poles(sampleRate) : [];
  const count = modes + more.length;
  const words = new Float64Array(2 * count);
  for (let n = 0; n < modes; n++) {
    if (frequencies[n] >= sampleRate / 2) continue;
    words[n] = -(decays[n] + (raised ? raised[n] : 0)) / sampleRate;
    words[count + n] = (2 * Math.PI * frequencies[n]) / sampleRate;
  }
  more.forEach(([re, im], n) => {
    words[modes + n] = re / sampleRate;
    words[count + modes + n] = im / sampleRate;
  });
  return words;
}

const [WRITTEN, READ] = [0, 1];
const HEAD = 16; // bytes before the words: how many were written and read so far
const SKIP = -1; // in place of a length: the rest of the ring is not used

/** A ring of commands in memory that page and worklet share: neither waits for the other. */
export class Ring {
  /** @param {SharedArrayBuffer} memory */
  constructor(memory) {
    this.memory = memory;
    this.counts = new Int32Array(memory, 0, 2);
    this.words = new Float64Array(memory, HEAD);
    this.place = 0;
  }

  static ofWords(count) {
    return new Ring(new SharedArrayBuffer(HEAD + 8 * count));
  }

  get #free() {
    const used = (Atomics.load(this.counts, WRITTEN) - Atomics.load(this.counts, READ)) | 0;
    return this.words.length - used;
  }

  /** Write a command; false where there is no room for it now. The page calls it. */
  write(words) {
    const rest = this.words.length - this.place;
    const skipped = rest < words.length ? rest : 0;
    if (words.length + skipped > this.#free) return false;
    if (skipped) {
      this.words[this.place] = SKIP;
      this.place = 0;
    }
    this.words.set(words, this.place);
    this.place = (this.place + words.length) % this.words.length;
    Atomics.add(this.counts, WRITTEN, words.length + skipped);
    return true;
  }

  /** Give each command that waits to a function of words and place. The worklet calls it. */
  read(take) {
    while (Atomics.load(this.counts, WRITTEN) !== Atomics.load(this.counts, READ)) {
      let size = this.words[this.place];
      if (size === SKIP) {
        size = this.words.length - this.place;
        this.place = 0;
      } else {
        take(this.words, this.place);
        this.place = (this.place + size) % this.words.length;
      }
      Atomics.add(this.counts, READ, size);
    }
  }
}
