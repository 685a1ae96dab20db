/**
 * Resonators, delay lines and limiter by WebAssembly, compiled from the same C files as Python's
 * core. Each body has a memory of its own, laid out as `struck/synth/memory.py` says.
 */
import { BLOCK } from './plain.js';
import { limiterState } from './limiter.js';
import { FINE, READ, betweenSamples } from './weights.js';

// Rows and columns as in `struck/core/memory.h`.
const MODE_ROWS = 18;
const OUTPUT_LAYERS = 11;
const DRIVE_LAYERS = 4;
const [LOG_RE, LOG_IM, STATE_RE, STATE_IM] = [0, 1, 12, 13];
const [OUT_RE, OUT_IM, TARGET_RE, TARGET_IM] = [0, 1, 2, 3];
const [NOW, TARGET] = [0, 1];
const HEADER = 7;
const BODY_COLUMNS = 7;
const VOICE_COLUMNS = 4;
const [LAST, ASLEEP, BODY_MOVED] = [1, 2, 4];
const [ACTIVE, VOICE_MOVED] = [1, 2];
const QUIET = 1e-6; // of its loudest, at which a body falls asleep
const PAGE = 65536;

const lines = (count) => 8 * Math.ceil(count / 8);

/** Length of rows of which no two begin at the same place of the first cache. */
function row(count) {
  const some = Math.ceil(count / 8);
  return 8 * (some + ((((3 - some) % 8) + 8) % 8));
}

/** What makes sound: banks of modes, delay lines, and the limiter of their mix. */
export class WasmKit {
  kind = 'wasm';
  /** @type {Set<{view: () => void}>} whose arrays lie in the memory */
  #users = new Set();
  /** @type {{place: number, size: number}[]} */
  #free = [];

  /**
   * @param {WebAssembly.Module} module `core.wasm`
   * @param {{sampleRate: number, channels: number}} session
   */
  constructor(module, session) {
    this.session = session;
    this.calls = /** @type {any} */ (new WebAssembly.Instance(module, {}).exports);
    this.#end = this.calls.memory.buffer.byteLength;
    this.between = this.take(4 * (FINE + 1) * READ);
    const state = limiterState(session);
    this.sizes = { limited: state.length, mix: session.channels * BLOCK };
    this.places = {
      limited: this.take(8 * state.length),
      mix: this.take(8 * this.sizes.mix),
      heard: this.take(4 * this.sizes.mix),
    };
    this.view();
    this.limited.set(state);
    new Float32Array(this.buffer, this.between, (FINE + 1) * READ).set(betweenSamples());
    this.#users.add(this);
    this.wide = { size: BigInt(state.length), channels: BigInt(session.channels) };
  }

  #end = 0;

  get buffer() {
    return this.calls.memory.buffer;
  }

  view() {
    this.limited = new Float64Array(this.buffer, this.places.limited, this.sizes.limited);
    this.mix = new Float64Array(this.buffer, this.places.mix, this.sizes.mix);
    this.heard = new Float32Array(this.buffer, this.places.heard, this.sizes.mix);
  }

  /** Return the place of some bytes of the memory, all zero. */
  take(bytes) {
    const size = 64 * Math.ceil(bytes / 64);
    const old = this.#free.findIndex((each) => each.size === size);
    if (old >= 0) {
      const [{ place }] = this.#free.splice(old, 1);
      new Uint8Array(this.buffer, place, size).fill(0);
      return place;
    }
    const place = this.#end;
    this.#end += size;
    const missing = this.#end - this.buffer.byteLength;
    if (missing > 0) {
      this.calls.memory.grow(Math.ceil(missing / PAGE) + 16);
      for (const user of this.#users) user.view();
    }
    return place;
  }

  /** Give bytes back. */
  give(place, bytes) {
    this.#free.push({ place, size: 64 * Math.ceil(bytes / 64) });
  }

  keep(user) {
    this.#users.add(user);
  }

  drop(user) {
    this.#users.delete(user);
  }

  bank(count, voices) {
    return new WasmBank(this, count, voices);
  }

  line(taps, half, ears, before) {
    return new WasmLine(this, taps, half, ears, before);
  }

  /** Limit `mix` in place. */
  limit(opened) {
    const { limited, mix } = this.places;
    this.calls.limiter_limit(
      limited,
      this.wide.size,
      mix,
      this.wide.channels,
      WIDE_BLOCK,
      opened ? 1n : 0n,
    );
  }
}

const WIDE_BLOCK = BigInt(BLOCK);

/** The modes of one body; see `PlainBank`, which has the same calls. */
export class WasmBank {
  constructor(kit, count, voices) {
    this.kit = kit;
    this.count = count;
    this.modes = row(lines(count));
    this.slots = voices + 1;
    const { modes, slots } = this;
    this.drives = (MODE_ROWS + OUTPUT_LAYERS) * modes;
    this.forces = this.drives + DRIVE_LAYERS * slots * modes;
    const feeds = this.forces + lines(slots * BLOCK);
    this.sounds = feeds + lines(2 * slots);
    const levels = this.sounds + lines(BLOCK);
    this.bytes = [8 * (levels + 3), 8 * (HEADER + BODY_COLUMNS + slots * VOICE_COLUMNS)];
    this.places = this.bytes.map((each) => kit.take(each));
    kit.keep(this);
    this.view();
    this.#put(0, [1, modes, 1, slots, modes, BLOCK, 1]);
    this.#put(HEADER + LAST, [lines(count)]);
    this.reals.set([kit.session.sampleRate, QUIET], levels);
    this.first = true;
  }

  view() {
    const [reals, wholes] = this.places;
    this.reals = new Float64Array(this.kit.buffer, reals, this.bytes[0] / 8);
    // Lower halves of whole numbers of 64 bits; what is written is never below zero.
    this.wholes = new Int32Array(this.kit.buffer, wholes, this.bytes[1] / 4);
    const at = (place) => this.reals.subarray(place, place + BLOCK);
    this.sound = at(this.sounds);
    this.pushes = Array.from({ length: this.slots }, (_, slot) => at(this.forces + slot * BLOCK));
  }

  #put(first, values) {
    for (let k = 0; k < values.length; k++) this.wholes[2 * (first + k)] = values[k];
  }

  #voice(voice, column, value) {
    this.wholes[2 * (HEADER + BODY_COLUMNS + voice * VOICE_COLUMNS + column)] = value;
  }

  #body(column, value) {
    this.wholes[2 * (HEADER + column)] = value;
  }

  get asleep() {
    return this.wholes[2 * (HEADER + ASLEEP)] !== 0;
  }

  force(voice) {
    return this.pushes[voice];
  }

  #copy(to, words, at) {
    for (let n = 0; n < this.count; n++) this.reals[to + n] = words[at + n];
  }

  /** Take logarithms of the factors of a sample, real parts then imaginary ones; states stay. */
  setPoles(words, at) {
    const { modes, count, reals, kit } = this;
    kit.calls.bank_settle(...this.places, 0n);
    this.#copy(LOG_RE * modes, words, at);
    this.#copy(LOG_IM * modes, words, at + count);
    for (let n = 0; n < count; n++)
      if (!words[at + count + n]) reals[STATE_RE * modes + n] = reals[STATE_IM * modes + n] = 0;
    kit.calls.bank_refresh(...this.places, 0n);
    this.#body(BODY_MOVED, 1);
    for (let voice = 0; voice < this.slots; voice++) this.#voice(voice, VOICE_MOVED, 1);
  }

  /** Take the gains toward the listener, real parts then imaginary ones. */
  setOutputs(words, at) {
    const layer = (number) => (MODE_ROWS + number) * this.modes;
    this.#copy(layer(TARGET_RE), words, at);
    this.#copy(layer(TARGET_IM), words, at + this.count);
    if (this.first) {
      this.#copy(layer(OUT_RE), words, at);
      this.#copy(layer(OUT_IM), words, at + this.count);
      this.kit.calls.bank_stand(...this.places, 0n);
    }
    this.first = false;
    this.#body(BODY_MOVED, 1);
  }

  start(voice, words, at) {
    this.#copy(this.drives + (NOW * this.slots + voice) * this.modes, words, at);
    this.#copy(this.drives + (TARGET * this.slots + voice) * this.modes, words, at);
    this.#voice(voice, ACTIVE, 2);
    this.#voice(voice, VOICE_MOVED, 1);
  }

  go(voice) {
    this.#voice(voice, ACTIVE, 1);
  }

  stop(voice) {
    this.#voice(voice, ACTIVE, 0);
  }

  /** Return real and imaginary part of the state of a mode that nothing pushes. */
  state(n) {
    return [STATE_RE, STATE_IM].map((each) => this.reals[each * this.modes + n]);
  }

  /** Make the next block in `sound`. */
  make() {
    this.kit.calls.bank_make_block(this.places[0], this.places[1]);
  }

  free() {
    this.kit.drop(this);
    this.places.forEach((place, k) => this.kit.give(place, this.bytes[k]));
  }
}

/** The sound of one body on its way to the ears. */
export class WasmLine {
  /**
   * @param {WasmKit} kit
   * @param {number} taps of responses
   * @param {number} half samples that it holds
   * @param {number} [ears]
   * @param {WasmLine} [before] the line of other ears on the way of the same sound, whose samples
   *   it takes over: both write the same into them
   */
  constructor(kit, taps, half, ears = kit.session.channels, before = undefined) {
    this.kit = kit;
    this.taps = taps;
    this.half = half;
    this.ears = ears;
    this.now = before?.now ?? 0;
    this.lent = false; // its samples, to a line that frees them
    const room = taps - 1 + BLOCK;
    this.sizes = [8 * half, 48 * ears, 8 * ears * taps, 4 * ears * room, 16 * ears];
    this.places = this.sizes.map((each, k) => (before && !k ? before.line : kit.take(each)));
    if (before) before.lent = true;
    const [line, ways, responses, history, numbers] = this.places;
    this.line = line;
    this.ways = ways;
    this.responses = responses;
    this.history = history;
    this.numbers = numbers;
    kit.keep(this);
    this.view();
    const table = new Int32Array(kit.buffer, numbers, 4 * ears); // lines, then ears
    for (let ear = 0; ear < ears; ear++) table[2 * (ears + ear)] = ear;
    // Whole numbers of 64 bits are made once: each would else be an object more.
    this.wide = {
      half: BigInt(half),
      fine: BigInt(FINE),
      ears: BigInt(ears),
      taps: BigInt(taps),
      room: BigInt(room),
    };
    // Delays count from the block's begin, so that its number matters modulo the line alone.
    this.times = Array.from({ length: half / BLOCK }, (_, k) => BigInt(k * BLOCK));
    this.since = Array.from({ length: 64 }, (_, k) => BigInt(k * BLOCK));
  }

  view() {
    const { ears, taps, half, line, ways, responses } = this;
    this.samples = new Float32Array(this.kit.buffer, line, 2 * half);
    this.delays = new Float64Array(this.kit.buffer, ways, 3 * ears);
    this.gains = new Float64Array(this.kit.buffer, ways + 24 * ears, 3 * ears);
    this.before = new Float32Array(this.kit.buffer, responses, ears * taps);
    this.after = new Float32Array(this.kit.buffer, responses + 4 * ears * taps, ears * taps);
  }

  /** Write a block of sound and add what the ears hear of it to `kit.heard`. */
  hear(sound, since, stretch) {
    const { samples, half, now, wide } = this;
    for (let k = 0; k < BLOCK; k++) samples[now + k] = samples[now + k + half] = sound[k];
    this.kit.calls.ears_hear(
      this.line,
      wide.half,
      this.times[now / BLOCK],
      this.kit.between,
      wide.fine,
      wide.ears,
      this.numbers,
      this.numbers + 8 * this.ears,
      this.ways,
      this.ways + 24 * this.ears,
      wide.taps,
      this.responses,
      this.responses + 4 * this.ears * this.taps,
      this.since[since / BLOCK],
      this.since[stretch / BLOCK],
      WIDE_BLOCK,
      this.history,
      wide.room,
      this.kit.places.heard,
    );
    this.now = (now + BLOCK) % half;
  }

  free() {
    this.kit.drop(this);
    this.places.forEach((place, k) => {
      if (k || !this.lent) this.kit.give(place, this.sizes[k]);
    });
  }
}
