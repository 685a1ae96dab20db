/**
 * All that sounds: bodies, what pushes them, the listener and the limiter, block after block.
 * It knows nothing of the browser: the worklet calls it, and so do tests.
 */
import { AT_ONCE, BODY, BROUGHT, KIND, KINDS, SAMPLE } from './commands.js';
import { limiterDelay, places } from './limiter.js';
import { BLOCK } from './plain.js';
import { Propagation, STRETCH, leadOf } from './propagation.js';
import { READ } from './weights.js';

const HALF = 16384; // samples that a delay line holds: 117 m at 48 kHz
export const LONGEST_FORCE = 4096; // samples of a strike that fit into a voice
const FADE_BLOCKS = 8; // in which a body that leaves falls silent: 21 ms at 48 kHz
const CROSSFADE = 2 * STRETCH; // samples from one head to another: 21 ms at 48 kHz

/** Entries of a report. */
export const REPORT = {
  TIME: 0,
  PEAK: 1,
  LEAST_GAIN: 2,
  RINGING: 3,
  MODES: 4,
  VOICES: 5,
  DROPPED: 6,
  LATE: 7,
  REPLACED: 8,
  UNDERRUNS: 9,
  LOAD: 10,
  STRUCK: 11,
  SIZE: 12,
};

/** Return by how many samples all that is heard is late, but for its way through the air. */
export const latencyOf = (sampleRate) => leadOf(sampleRate) + limiterDelay(sampleRate);

/** A push under way: where the samples of its force stand, and when they begin. */
class Voice {
  active = false;
  begun = false;
  first = 0; // sample of the context
  count = 0;
  at = 0;
  own = new Float64Array(LONGEST_FORCE);
  force = this.own;

  /** Write the part of the force that falls in a block. */
  write(into, now) {
    for (let k = 0; k < BLOCK; k++) {
      const place = now + k - this.first;
      into[k] = place >= 0 && place < this.count ? this.force[this.at + place] : 0;
    }
  }
}

/** A body that sounds: its modes and its voices. */
class Body {
  silent = 0; // samples since it fell asleep
  left = Infinity; // blocks for which it is heard

  constructor(kit, voices, { count, modes = count, poles, outputs, centre, radius }) {
    this.count = count; // of modes, and of the terms of recoil behind them
    this.modes = modes;
    this.bank = kit.bank(count, voices);
    this.bank.setPoles(poles, 0);
    this.bank.setOutputs(outputs, 0);
    this.centre = centre;
    this.radius = radius;
    this.voices = Array.from({ length: voices }, () => new Voice());
  }

  /** Number of the first voice that is free, or -1. */
  get spare() {
    for (let number = 0; number < this.voices.length; number++)
      if (!this.voices[number].active) return number;
    return -1;
  }

  /** Whether its line may hold sound: after a longer sleep it holds zeros alone. */
  get sounds() {
    return this.silent < 2 * HALF;
  }

  /** Make the block that begins at a sample; return how many voices push it. */
  make(now) {
    let pushed = 0;
    for (let number = 0; number < this.voices.length; number++)
      pushed += this.#push(number, now) ? 1 : 0;
    if (this.left > 0) this.bank.make();
    this.silent = this.bank.asleep || !(this.left > 0) ? this.silent + BLOCK : 0;
    if (this.left < Infinity) this.#fade();
    return pushed;
  }

  #push(number, now) {
    const voice = this.voices[number];
    if (!voice.active) return false;
    if (voice.first + voice.count <= now) {
      voice.active = false;
      voice.force = voice.own; // of a message, which may go
      this.bank.stop(number);
      return false;
    }
    voice.write(this.bank.force(number), now);
    if (voice.begun) this.bank.go(number);
    voice.begun = true;
    return true;
  }

  #fade() {
    const { sound } = this.bank;
    const begin = Math.max(this.left, 0);
    const end = Math.max(this.left - 1, 0);
    for (let k = 0; k < BLOCK; k++)
      sound[k] *= (begin + ((end - begin) * (k + 1)) / BLOCK) / FADE_BLOCKS;
    this.left = end;
  }

  free() {
    this.bank.free?.();
  }
}

/** What the ears of one head hear: a line and a way from each body, in the order of the bodies. */
class Hearing {
  #lines = [];
  #ways = [];

  constructor(kit, head, before) {
    this.kit = kit;
    this.propagation = new Propagation(head, kit.session.sampleRate, before?.propagation);
    for (const line of before?.lines ?? []) this.#lines.push(this.#line(line));
  }

  get lines() {
    return this.#lines;
  }

  #line(before) {
    const { taps, ears } = this.propagation.head;
    const line = this.kit.line(taps, HALF, ears, before);
    line.longest = HALF - BLOCK - READ;
    return line;
  }

  /** Add a body, or begin the way of one whose line was taken over. */
  add({ centre, radius }) {
    const number = this.#ways.length;
    this.#lines[number] ??= this.#line();
    this.#ways.push(this.propagation.way(this.#lines[number], centre, radius));
  }

  /** Go on with all ways to the next stretch. */
  goOn() {
    this.propagation.goOn(this.#ways);
  }

  /** Let the ears hear a block of all bodies, into `kit.heard`. */
  hear(bodies, since) {
    this.kit.heard.fill(0);
    for (let k = 0; k < bodies.length; k++)
      if (bodies[k].sounds) this.#lines[k].hear(bodies[k].bank.sound, since, STRETCH);
  }

  /** Free the line of a body. */
  drop(number) {
    this.#lines[number].free?.();
    this.#lines.splice(number, 1);
    this.#ways.splice(number, 1);
  }

  free() {
    for (const line of this.#lines) line.free?.();
  }
}

/** Everything that is heard. */
export class Synthesis {
  /** @type {Map<number, Body>} */
  #bodies = new Map();
  /** @type {Body[]} */
  #list = [];
  /** @type {Hearing[]} the head that hears, and one that takes its place */
  #hearings = [];
  /** @type {import('./head.js').Head | null} that shall hear next */
  #next = null;
  #faded = 0; // samples of the crossfade to the second hearing; below 0: its responses fill
  /** @type {{sample: number, words: Float64Array}[]} that wait for their time, the last first */
  #waiting = [];

  /**
   * @param {any} kit `WasmKit` or `PlainKit`
   * @param {import('./head.js').Head} head
   * @param {{voices?: number, start?: number}} session `start`: first sample of the context
   */
  constructor(kit, head, { voices = 16, start = 0 } = {}) {
    this.kit = kit;
    this.voices = voices;
    this.now = start;
    this.start = start;
    this.channels = kit.session.channels;
    this.#hearings = [new Hearing(kit, head)];
    this.propagation.start += start / kit.session.sampleRate;
    this.since = STRETCH;
    this.opened = true;
    this.ready = BLOCK; // `ready`: read of the block
    this.gain = 1;
    this.wanted = 1;
    this.struck = false; // whether a strike has begun, for whoever has a clock
    this.report = new Float64Array(REPORT.SIZE);
    this.take = (words, at) => this.#run(words, at, true);
  }

  /** Add a body, or put another in the place of one, which fades. */
  add(number, given) {
    this.#leave(number);
    const body = new Body(this.kit, this.voices, given);
    this.#bodies.set(number, body);
    this.#list.push(body);
    for (const hearing of this.#hearings) hearing.add(body);
  }

  /** The ways of sound to the head that hears now. */
  get propagation() {
    return this.#hearings[0].propagation;
  }

  /** Hear by another head from the next stretch on: what rings goes on, by a crossfade. */
  setHead(head) {
    this.#next = head;
  }

  /** At the begin of a stretch: end a crossfade that is over, and begin one that is asked for. */
  #changeHeads() {
    if (this.#hearings.length > 1 && this.#faded >= CROSSFADE) this.#hearings.shift().free();
    if (this.#hearings.length > 1 || !this.#next) return;
    const hearing = new Hearing(this.kit, this.#next, this.#hearings[0]);
    for (const body of this.#list) hearing.add(body);
    this.#hearings.push(hearing);
    this.#faded = -STRETCH * Math.ceil(this.#next.taps / STRETCH);
    this.#next = null;
  }

  #leave(number) {
    const body = this.#bodies.get(number);
    if (body) body.left = FADE_BLOCKS;
    this.#bodies.delete(number);
  }

  /** Take a command now, or let it wait for its sample. */
  post(words) {
    if (words[SAMPLE] === AT_ONCE || words[KIND] === KINDS.POSE) {
      this.#run(words, 0, false);
      return;
    }
    let place = 0;
    while (place < this.#waiting.length && this.#waiting[place].sample > words[SAMPLE]) place++;
    this.#waiting.splice(place, 0, { sample: words[SAMPLE], words });
  }

  /** Run what begins in the next block; of what is no strike, what begins with it. */
  #runWaiting() {
    for (let place = this.#waiting.length - 1; place >= 0; place--) {
      const { sample, words } = this.#waiting[place];
      if (sample >= this.now + BLOCK) return;
      if (words[KIND] !== KINDS.STRIKE && sample > this.now) continue;
      this.#waiting.splice(place, 1);
      this.#run(words, 0, false);
    }
  }

  /** Run a command; `passing` says that its words will change soon. */
  #run(words, at, passing) {
    const kind = words[at + KIND];
    if (kind === KINDS.POSE) this.#pose(words, at);
    else if (kind === KINDS.LEVEL) this.wanted = words[at + BROUGHT];
    else if (kind === KINDS.FADE) this.#leave(words[at + BODY]);
    else {
      const body = this.#bodies.get(words[at + BODY]);
      const count = words[at + BROUGHT + (kind === KINDS.STRIKE ? 1 : 0)];
      if (!body || count !== body.count) this.report[REPORT.DROPPED]++;
      else if (kind === KINDS.STRIKE) this.#strike(body, words, at, passing);
      else {
        body.bank.setPoles(words, at + BROUGHT + 1);
        if (kind === KINDS.MODEL) body.bank.setOutputs(words, at + BROUGHT + 1 + 2 * count);
        body.silent = 0;
      }
    }
  }

  #pose(words, at) {
    const time = words[at + BROUGHT];
    if (Number.isNaN(time)) this.propagation.follow(words, at + BROUGHT + 1);
    else this.propagation.course.set(time, words, at + BROUGHT + 1);
  }

  #strike(body, words, at, passing) {
    const number = body.spare;
    const count = words[at + BROUGHT];
    if (number < 0 || (passing && count > LONGEST_FORCE)) {
      this.report[REPORT.DROPPED]++;
      return;
    }
    const voice = body.voices[number];
    const sample = words[at + SAMPLE];
    if (sample !== AT_ONCE && sample < this.now - BLOCK) this.report[REPORT.LATE]++;
    voice.active = true;
    voice.begun = false;
    voice.count = count;
    voice.first = Math.max(sample, this.now);
    this.struck = true;
    voice.at = at + BROUGHT + 2;
    voice.force = words;
    if (passing) {
      for (let k = 0; k < count; k++) voice.own[k] = words[voice.at + k];
      voice.force = voice.own;
      voice.at = 0;
    }
    body.bank.start(number, words, at + BROUGHT + 2 + count);
  }

  /** Make the next block of all bodies in `kit.mix`. */
  #make() {
    this.#runWaiting();
    const { kit } = this;
    if (this.since === STRETCH) {
      this.#changeHeads();
      for (const hearing of this.#hearings) hearing.goOn();
      this.since = 0;
    }
    this.report[REPORT.VOICES] = 0;
    for (const body of this.#list) this.report[REPORT.VOICES] += body.make(this.now);
    this.#hear();
    this.since += BLOCK;
    this.now += BLOCK;
    this.#level();
    kit.limit(this.opened);
    if (this.since === STRETCH) this.#forget();
  }

  /** Let all heads hear the block, into `kit.mix`; of two the second fades in. */
  #hear() {
    const { kit } = this;
    kit.mix.fill(0);
    const changing = this.#hearings.length > 1;
    for (const hearing of this.#hearings) {
      hearing.hear(this.#list, this.since);
      const incoming = changing && hearing === this.#hearings[1];
      for (let channel = 0; channel < this.channels; channel++) {
        const row = Math.min(channel, hearing.propagation.head.ears - 1) * BLOCK;
        for (let k = 0; k < BLOCK; k++) {
          let weight = 1;
          if (changing) {
            const done = Math.min(Math.max((this.#faded + k + 1) / CROSSFADE, 0), 1);
            weight = Math.sin((Math.PI / 2) * (incoming ? done : 1 - done)) ** 2;
          }
          kit.mix[channel * BLOCK + k] += weight * kit.heard[row + k];
        }
      }
    }
    if (changing) this.#faded += BLOCK;
  }

  /** Go from the last block's gain to the wanted one, and note the loudest sample. */
  #level() {
    const { mix } = this.kit;
    const step = (this.wanted - this.gain) / BLOCK;
    let peak = this.report[REPORT.PEAK];
    for (let channel = 0; channel < this.channels; channel++) {
      for (let k = 0; k < BLOCK; k++) {
        const place = channel * BLOCK + k;
        mix[place] *= this.gain + step * (k + 1);
        peak = Math.max(peak, Math.abs(mix[place]));
      }
    }
    this.report[REPORT.PEAK] = peak;
    this.gain = this.wanted;
  }

  /** Free bodies that have left, when the last of them has been heard. */
  #forget() {
    for (let place = this.#list.length - 1; place >= 0; place--) {
      const body = this.#list[place];
      if (body.left > 0 || body.sounds) continue;
      this.#list.splice(place, 1);
      for (const hearing of this.#hearings) hearing.drop(place);
      body.free();
    }
  }

  /**
   * Fill channels of any length with the next samples.
   * @param {Float32Array[]} outputs
   * @param {number} [frame] number in the context of their first one; it may have gone on alone
   */
  process(outputs, frame = this.now - BLOCK + this.ready) {
    const gone = frame - (this.now - BLOCK + this.ready);
    if (gone) this.#jump(gone);
    this.#fill(outputs);
  }

  /** Call the present by another number: the context went on while nobody asked for samples. */
  #jump(by) {
    this.now += by;
    for (const { propagation } of this.#hearings)
      propagation.start += by / this.kit.session.sampleRate;
    for (const body of this.#list) for (const voice of body.voices) voice.first += by;
  }

  #fill(outputs) {
    const frames = outputs[0].length;
    for (let done = 0; done < frames;) {
      if (this.ready === BLOCK) {
        this.#make();
        this.ready = 0;
      }
      const count = Math.min(frames - done, BLOCK - this.ready);
      for (let channel = 0; channel < outputs.length; channel++) {
        const from = Math.min(channel, this.channels - 1) * BLOCK + this.ready;
        for (let k = 0; k < count; k++) outputs[channel][done + k] = this.kit.mix[from + k];
      }
      this.ready += count;
      done += count;
    }
  }

  /** Return what there is to tell, and begin to note peaks anew. */
  told() {
    const { report, kit } = this;
    report[REPORT.RINGING] = report[REPORT.MODES] = 0;
    for (const body of this.#list) {
      if (body.bank.asleep) continue;
      report[REPORT.RINGING]++;
      report[REPORT.MODES] += body.modes;
    }
    report[REPORT.TIME] = this.now / kit.session.sampleRate;
    report[REPORT.LEAST_GAIN] = kit.limited[places.LEAST_GAIN];
    report[REPORT.REPLACED] = kit.limited[places.REPLACED];
    return report;
  }
}
