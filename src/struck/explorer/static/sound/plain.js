/**
 * Resonators and delay lines in JavaScript, where a browser has no WebAssembly with vectors.
 * The same numbers as `core.js`, several times slower.
 */
import { limit, limiterState } from './limiter.js';
import { READ, betweenSamples } from './weights.js';

export const BLOCK = 128; // samples that are made at a time
const QUIET = 1e-6; // of its loudest, at which a body falls asleep
const GONE = 1e-200; // a smaller state is 0: numbers near the least there are cost fifty times more

/** What makes sound without WebAssembly; see `WasmKit`. */
export class PlainKit {
  kind = 'javascript';

  /** @param {{sampleRate: number, channels: number}} session */
  constructor(session) {
    this.session = session;
    this.mix = new Float64Array(session.channels * BLOCK);
    this.heard = new Float32Array(session.channels * BLOCK);
    this.limited = limiterState(session);
  }

  bank(count, voices) {
    return new PlainBank(count, voices, this.session.sampleRate);
  }

  line(taps, half, ears, before) {
    return new PlainLine(this, taps, half, ears, before);
  }

  limit(opened) {
    limit(this.limited, this.mix, BLOCK, opened);
  }
}

/** The modes of one body. */
export class PlainBank {
  constructor(count, voices, sampleRate) {
    this.count = count;
    this.rate = sampleRate;
    this.logRe = new Float64Array(count);
    this.logIm = new Float64Array(count);
    this.turnRe = new Float64Array(count);
    this.turnIm = new Float64Array(count);
    this.holdRe = new Float64Array(count);
    this.holdIm = new Float64Array(count);
    this.re = new Float64Array(count);
    this.im = new Float64Array(count);
    this.outRe = new Float64Array(count);
    this.outIm = new Float64Array(count);
    this.targetRe = new Float64Array(count);
    this.targetIm = new Float64Array(count);
    this.still = new Float64Array(count);
    this.sound = new Float64Array(BLOCK);
    this.voices = Array.from({ length: voices }, () => ({
      active: 0,
      moved: false,
      begin: 0,
      end: 0,
      force: new Float64Array(BLOCK),
      drive: new Float64Array(count),
    }));
    /** @type {typeof this.voices} */
    this.pushing = [];
    this.moved = true;
    this.first = true;
    this.asleep = false;
    this.slept = 0;
    this.loudest = 0;
  }

  force(voice) {
    return this.voices[voice].force;
  }

  /** Take logarithms of the factors of a sample, real parts then imaginary ones; states stay. */
  setPoles(words, at) {
    this.#wake();
    for (let n = 0; n < this.count; n++) {
      const [re, im] = [words[at + n], words[at + this.count + n]];
      const size = Math.exp(re);
      [this.logRe[n], this.logIm[n]] = [re, im];
      this.turnRe[n] = size * Math.cos(im);
      this.turnIm[n] = size * Math.sin(im);
      if (!im) this.re[n] = this.im[n] = 0;
      const away = 1 - this.turnRe[n];
      const square = away * away + this.turnIm[n] * this.turnIm[n];
      this.holdRe[n] = im ? away / square / this.rate : 0;
      this.holdIm[n] = im ? this.turnIm[n] / square / this.rate : 0;
    }
    this.moved = true;
    for (const voice of this.voices) voice.moved = true;
  }

  /** Take the gains toward the listener, real parts then imaginary ones. */
  setOutputs(words, at) {
    this.targetRe.set(words.subarray(at, at + this.count));
    this.targetIm.set(words.subarray(at + this.count, at + 2 * this.count));
    if (this.first) this.#arrive();
    this.first = false;
    this.moved = true;
  }

  /** Begin a push whose drive stands at a place of some words. */
  start(voice, words, at) {
    const it = this.voices[voice];
    it.drive.set(words.subarray(at, at + this.count));
    [it.active, it.moved] = [2, true];
  }

  go(voice) {
    this.voices[voice].active = 1;
  }

  stop(voice) {
    this.voices[voice].active = 0;
  }

  /** Return real and imaginary part of the state of a mode. */
  state(n) {
    return [this.re[n], this.im[n]];
  }

  /** Make the next block in `sound`. */
  make() {
    this.sound.fill(0);
    const pushing = this.pushing;
    pushing.length = 0;
    for (const voice of this.voices) if (voice.active) pushing.push(voice);
    if (!pushing.length && !this.moved && this.asleep) {
      this.slept += BLOCK;
      return;
    }
    this.#wake();
    const ramped = this.moved || pushing.some((voice) => voice.active > 1 || voice.moved);
    for (const voice of pushing)
      if (voice.active > 1 || voice.moved) voice.begin = this.#direct(voice.drive);
    for (let n = 0; n < this.count; n++) this.#ring(n, pushing);
    if (this.moved) this.#arrive();
    this.moved = false;
    for (const voice of pushing) {
      voice.moved = false;
      voice.end = ramped ? this.#direct(voice.drive) : voice.begin;
      const step = (voice.end - voice.begin) / BLOCK;
      for (let k = 0; k < BLOCK; k++)
        this.sound[k] += (voice.begin + step * (k + 1)) * voice.force[k];
      voice.begin = voice.end;
    }
    if (!pushing.length) this.asleep = this.#maySleep();
  }

  /** Let one mode ring for a block; a place without a pole stays silent. */
  #ring(n, pushing) {
    if (!this.logIm[n]) return;
    const [turnRe, turnIm, sound] = [this.turnRe[n], this.turnIm[n], this.sound];
    let [re, im, outRe, outIm] = [this.re[n], this.im[n], this.outRe[n], this.outIm[n]];
    if (!pushing.length && Math.abs(re) + Math.abs(im) <= GONE) {
      this.re[n] = this.im[n] = 0;
      return;
    }
    const stepRe = (this.targetRe[n] - outRe) / BLOCK;
    const stepIm = (this.targetIm[n] - outIm) / BLOCK;
    for (let k = 0; k < BLOCK; k++) {
      const before = re;
      re = turnRe * re - turnIm * im;
      im = turnRe * im + turnIm * before;
      for (let v = 0; v < pushing.length; v++)
        re += (pushing[v].drive[n] / this.rate) * pushing[v].force[k];
      outRe += stepRe;
      outIm += stepIm;
      sound[k] += outRe * im + outIm * re;
    }
    [this.re[n], this.im[n]] = [re, im];
  }

  /** Return minus the steady output under a unit force. */
  #direct(drive) {
    let total = 0;
    for (let n = 0; n < this.count; n++) total += drive[n] * this.still[n];
    return total;
  }

  /** Arrive at the gains that outputs moved to. */
  #arrive() {
    this.outRe.set(this.targetRe);
    this.outIm.set(this.targetIm);
    for (let n = 0; n < this.count; n++)
      this.still[n] = -(this.outRe[n] * this.holdIm[n] + this.outIm[n] * this.holdRe[n]);
  }

  #maySleep() {
    let total = 0;
    for (let n = 0; n < this.count; n++)
      total +=
        (Math.abs(this.outRe[n]) + Math.abs(this.outIm[n])) *
        (Math.abs(this.re[n]) + Math.abs(this.im[n]));
    this.loudest = Math.max(this.loudest, total);
    return total <= QUIET * this.loudest;
  }

  /** Advance a sleeping body to the present. */
  #wake() {
    if (this.asleep)
      for (let n = 0; n < this.count; n++) {
        const size = Math.exp(this.logRe[n] * this.slept);
        const [c, s] = [Math.cos(this.logIm[n] * this.slept), Math.sin(this.logIm[n] * this.slept)];
        const [re, im] = [this.re[n], this.im[n]];
        this.re[n] = size * (re * c - im * s);
        this.im[n] = size * (re * s + im * c);
      }
    this.asleep = false;
    this.slept = 0;
  }
}

/** The sound of one body on its way to the ears: the twin of `hear_plainly`. */
export class PlainLine {
  constructor(kit, taps, half, ears = kit.session.channels, before = undefined) {
    this.kit = kit;
    this.taps = taps;
    this.half = half;
    this.ears = ears;
    this.now = before?.now ?? 0;
    this.samples = before?.samples ?? new Float32Array(half);
    this.delays = new Float64Array(3 * ears);
    this.gains = new Float64Array(3 * ears);
    this.before = new Float32Array(ears * taps);
    this.after = new Float32Array(ears * taps);
    this.history = Array.from({ length: ears }, () => new Float32Array(taps - 1 + BLOCK));
    this.between = betweenSamples();
  }

  /** Write a block of sound and add what the ears hear of it to `kit.heard`. */
  hear(sound, since, stretch) {
    for (let k = 0; k < BLOCK; k++) this.samples[(this.now + k) & (this.half - 1)] = sound[k];
    for (let ear = 0; ear < this.ears; ear++) {
      const room = this.history[ear];
      for (let k = 0; k < BLOCK; k++) {
        const u = (since + k + 1) / stretch;
        const place = this.now + k - parabola(this.delays, 3 * ear, u);
        room[this.taps - 1 + k] = parabola(this.gains, 3 * ear, u) * this.#read(place);
      }
      this.#convolve(room, ear, since, stretch);
      room.copyWithin(0, BLOCK);
    }
    this.now += BLOCK;
  }

  #read(place) {
    const whole = Math.floor(place);
    const row = (place - whole) * (this.between.length / READ - 1);
    const low = Math.floor(row);
    const share = row - low;
    let total = 0;
    for (let n = 0; n < READ; n++) {
      const [begin, end] = [this.between[low * READ + n], this.between[(low + 1) * READ + n]];
      const sample = this.samples[(whole - READ / 2 + 1 + n) & (this.half - 1)];
      total += (begin + share * (end - begin)) * sample;
    }
    return total;
  }

  #convolve(room, ear, since, stretch) {
    const { before, after, taps } = this;
    for (let k = 0; k < BLOCK; k++) {
      let [first, last] = [0, 0];
      for (let t = 0; t < taps; t++) {
        const sample = room[taps - 1 + k - t];
        first += before[ear * taps + t] * sample;
        last += after[ear * taps + t] * sample;
      }
      this.kit.heard[ear * BLOCK + k] += first + ((since + k + 1) / stretch) * (last - first);
    }
  }
}

/** Return the parabola through three values at 0, 1/2 and 1. */
export function parabola(values, at, u) {
  return (
    (1 - u) * (1 - 2 * u) * values[at] +
    4 * u * (1 - u) * values[at + 1] +
    u * (2 * u - 1) * values[at + 2]
  );
}
