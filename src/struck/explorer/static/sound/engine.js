/**
 * The sound of the page: models, strikes, hands and the listener in; an audio node out.
 * Everything that depends on a contact is computed here; the worklet gets numbers.
 */
import { resolved } from '../excitation/hertz.js';
import { LEAD, sampledPulse } from '../excitation/pulse.js';
import { KINDS, Ring, command, logarithms } from './commands.js';
import { readContainer } from '../model/container.js';
import { PlainKit } from './plain.js';
import { LONGEST_FORCE, REPORT, latencyOf } from './synthesis.js';

const RING_WORDS = 2 ** 18;
const STRIKE_PEAK = 10 ** (-12 / 20); // of full scale: peak of a default strike
const LISTENED = 0.25; // s of the strike that sets the loudness
const CHANNELS = 2;
// s after a blow in which another model takes it over, by judgement: two so close are heard as one
const JUST = 0.03;
const HEADS = { mono: null, stereo: 'exact', binaural: 'kemar' };

// Whether a browser has vectors in WebAssembly: a function that returns the sum of one.
const VECTORS = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15,
  253, 98, 11,
]);

/**
 * @typedef {import('../model/model.js').Model} Model
 * @typedef {import('../model/model.js').Contact} Contact
 * @typedef {import('../excitation/hertz.js').Striker} Striker
 * @typedef {{position: number[], forward: number[], up?: number[]}} Pose
 */

/**
 * Return what sounds in an audio context; its `node` is not connected yet.
 * @param {BaseAudioContext} context
 * @param {{ears?: 'mono' | 'stereo' | 'binaural', voices?: number, forcePlain?: boolean,
 *   coreUrl?: string | URL, headUrl?: (name: string, sampleRate: number) => string | URL}} options
 * @returns {Promise<Engine>}
 */
export async function createEngine(context, options = {}) {
  const base = new URL('..', import.meta.url);
  const {
    ears = 'mono',
    voices = 16,
    forcePlain = false,
    coreUrl = new URL('core.wasm', base),
    headUrl = (name, rate) => new URL(`heads/${name}-${rate}.bin`, base),
  } = options;
  if (!(ears in HEADS)) throw new RangeError(`ears are '${ears}': give mono, stereo or binaural`);
  if (!context.audioWorklet)
    throw new Error(
      'this browser has no AudioWorklet here: open the page by https or 127.0.0.1 in a browser of ' +
        '2021 or newer',
    );
  const notes = [];
  const core = forcePlain ? null : await coreOf(coreUrl, notes);
  const head = HEADS[ears]
    ? await headTables(headUrl(HEADS[ears], context.sampleRate), notes)
    : null;
  await context.audioWorklet.addModule(new URL('processor.js', import.meta.url));
  return new Engine(context, { core, head, headUrl, voices, ears: head ? ears : 'mono', notes });
}

/** Return the compiled core, or null and a note where the browser cannot run it. */
async function coreOf(url, notes) {
  try {
    if (!WebAssembly.validate(VECTORS)) throw new Error('it has no WebAssembly with vectors');
    const answer = await fetch(url);
    if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
    return await WebAssembly.compile(await answer.arrayBuffer());
  } catch (error) {
    notes.push(
      `The fast core is out of reach (${error.message}): sound is made in JavaScript, for fewer ` +
        'objects at a time.',
    );
    return null;
  }
}

/** Return the tables of a head, or null and a note. */
async function headTables(url, notes) {
  try {
    const answer = await fetch(url);
    if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
    const buffer = await answer.arrayBuffer();
    const { metadata, tensors } = await readContainer(buffer, { kind: 'struck-head' });
    return { text: JSON.parse(metadata.json), tensors };
  } catch (error) {
    notes.push(`The ears are out of reach (${error.message}): you hear with one.`);
    return null;
  }
}

/** What sounds. Bodies are numbers, contacts come from their models. */
export class Engine {
  /**
   * @type {Map<number, {model: Model, place: {position?: number[], rotation?: number[][]},
   *   holds: Map<number, {contact: Contact, grip: number}>}>}
   */
  #bodies = new Map();
  #next = 0;
  #adding = 0; // bodies that the worklet does not have yet
  /** @type {Map<number, () => void>} */
  #asked = new Map();
  #fullScale = 1;
  #volume = 0;
  #wished = ''; // ears that are on their way
  /** @type {((report: Report) => void)[]} */
  #listening = [];

  constructor(context, { core, head, headUrl, voices, ears, notes }) {
    this.context = context;
    this.ears = ears;
    this.headUrl = headUrl;
    this.kind = core ? 'wasm' : 'javascript';
    this.note = notes.join(' ');
    this.sampleRate = context.sampleRate;
    const shared = globalThis.crossOriginIsolated && typeof SharedArrayBuffer !== 'undefined';
    this.ring = shared ? Ring.ofWords(RING_WORDS) : null;
    this.node = new AudioWorkletNode(context, 'struck', {
      numberOfInputs: 0,
      outputChannelCount: [CHANNELS],
      processorOptions: {
        core,
        head,
        voices,
        ring: this.ring?.memory,
        realTime: !(context instanceof OfflineAudioContext),
      },
    });
    this.node.port.onmessage = ({ data }) => this.#receive(data);
    /** @type {Report} */
    this.last = reportOf(new Float64Array(REPORT.SIZE));
  }

  /** Tell the worklet something now, by memory that both share where it fits, else by a message. */
  #send(words, timed) {
    // Memory would overtake the message that brings a body.
    const fits = this.ring && !timed && !this.#adding && words.length < RING_WORDS / 4;
    if (fits && this.ring.write(words)) return;
    this.node.port.postMessage(words, [words.buffer]);
  }

  #receive(data) {
    if (data === 'added') this.#adding--;
    else if (typeof data === 'number') this.#asked.get(data)?.();
    else this.#hear(data);
  }

  /** Return when the worklet has taken all that was said so far: before an offline rendering. */
  settled() {
    const number = ++this.#next;
    return new Promise((done) => {
      this.#asked.set(number, () => done(this.#asked.delete(number)));
      this.node.port.postMessage({ ask: number });
    });
  }

  #hear(data) {
    this.last = reportOf(data);
    for (const listener of this.#listening) listener(this.last);
  }

  #body(number) {
    const body = this.#bodies.get(number);
    if (!body) throw new RangeError(`there is no body ${number}: add a model first`);
    return body;
  }

  /**
   * Add a body and return its number.
   * @param {Model} model
   * @param {{position?: number[], rotation?: number[][]}} place from the body's coordinates to
   *   the scene's: rows of a rotation, then the place of the origin, m
   */
  addModel(model, place = {}) {
    const number = this.#next++;
    this.#add(number, model, place);
    return number;
  }

  #add(number, model, place) {
    const { position = [0, 0, 0], rotation } = place;
    const { re, im } = model.aside(this.sampleRate);
    const centre = model.centre.map(
      (each, axis) =>
        position[axis] +
        (rotation ? rotation[axis].reduce((sum, r, k) => sum + r * model.centre[k], 0) : each),
    );
    const poles = logarithms(model, null, this.sampleRate);
    const outputs = Float64Array.from([...re, ...im]);
    const add = { count: re.length, modes: model.count, poles, outputs, centre, radius: model.radius };
    this.#adding++;
    this.node.port.postMessage({ number, add });
    this.#bodies.set(number, { model, place, holds: new Map(), blow: null });
  }

  /**
   * Let a body go on with another model of as many modes, from the states that it has.
   * @param {number} number of the body
   * @param {Model} model
   * @param {number} [time] of the context, s; left out: now
   */
  changeModel(number, model, time) {
    const body = this.#body(number);
    if (model.count !== body.model.count || !model.recoil !== !body.model.recoil)
      throw new RangeError(
        `the changed model has ${told(model)}, the body ${told(body.model)}: replace it`,
      );
    const { re, im } = model.aside(this.sampleRate);
    body.model = model;
    const poles = logarithms(model, this.#raised(body), this.sampleRate);
    this.#tell(time, KINDS.MODEL, number, re.length, poles, re, im);
  }

  /** Put another model in the place of a body, which fades; it takes over a blow of just now. */
  replaceModel(number, model) {
    const { place, blow, model: before } = this.#body(number);
    this.#add(number, model, place);
    if (!blow || this.context.currentTime - blow.time > JUST) return;
    const growth = (model.size ?? 1) / (before.size ?? 1);
    const point = blow.said.contact.point.map((each) => each * growth);
    this.strike({ ...blow.said, contact: { ...blow.said.contact, point } });
  }

  /**
   * Hear by other ears once their tables are there: what rings goes on, by a crossfade.
   * @param {'mono' | 'stereo' | 'binaural'} ears
   * @returns {Promise<string>} what falls short, in a sentence, or nothing
   */
  async setEars(ears) {
    if (!(ears in HEADS)) throw new RangeError(`ears are '${ears}': give mono, stereo or binaural`);
    this.#wished = ears;
    const notes = [];
    const name = HEADS[ears];
    const head = name ? await headTables(this.headUrl(name, this.sampleRate), notes) : null;
    if (this.#wished !== ears) return ''; // others were chosen meanwhile
    this.ears = head ? ears : 'mono';
    const buffers = new Set(Object.values(head?.tensors ?? {}).map(({ data }) => data.buffer));
    this.node.port.postMessage({ head }, [...buffers]);
    return notes.join(' ');
  }

  /** Let a body fade and go. */
  removeModel(number) {
    this.#body(number);
    this.#bodies.delete(number);
    this.#tell(undefined, KINDS.FADE, number);
  }

  /**
   * Strike a body.
   * @param {{body: number, contact: Contact, striker?: Striker, speed?: number, impulse?: number,
   *   duration?: number, drive?: ArrayLike<number>, time?: number}} strike `time` of the context,
   *   s, left out: now; `drive` of the modes as the file has them, where the server computed it
   * @returns {{impulse: number, duration: number, sample: number}} N s, s, and the first sample
   */
  strike({ body: number, contact, drive, time, ...said }) {
    const body = this.#body(number);
    const { model } = body;
    const blow = resolved(model, contact, said);
    const pulse = sampledPulse({ ...blow, onset: time ?? 0, sampleRate: this.sampleRate });
    const pushed = model.drive(contact, drive);
    const first = time === undefined ? undefined : pulse.first;
    const { force } = pulse;
    const words = command(
      KINDS.STRIKE,
      number,
      first === undefined ? undefined : Math.max(first, 0),
      force.length,
      pushed.length,
      force,
      pushed,
    );
    this.#send(words, first !== undefined || force.length > LONGEST_FORCE);
    if (time === undefined)
      body.blow = {
        said: { body: number, contact, drive, ...said },
        time: this.context.currentTime,
      };
    const soonest = Math.ceil(this.context.currentTime * this.sampleRate);
    return { ...blow, sample: first ?? soonest + LEAD };
  }

  /**
   * Hold a body somewhere with a soft grip, N s/m; return what lets go.
   * @param {{body: number, contact: Contact, grip?: number, time?: number}} grip
   */
  hold({ body: number, contact, grip = 10, time }) {
    const body = this.#body(number);
    const key = this.#next++;
    body.holds.set(key, { contact, grip });
    this.#damp(number, body, time);
    return { body: number, key };
  }

  /** Let go of what `hold` returned. */
  release({ body: number, key }, time) {
    const body = this.#bodies.get(number);
    if (body?.holds.delete(key)) this.#damp(number, body, time);
  }

  #raised({ model, holds }) {
    const raised = new Float64Array(model.count);
    for (const { contact, grip } of holds.values())
      model.raised(contact, grip).forEach((each, n) => (raised[n] += each));
    return raised;
  }

  #damp(number, body, time) {
    const poles = logarithms(body.model, this.#raised(body), this.sampleRate);
    this.#tell(time, KINDS.POLES, number, poles.length / 2, poles);
  }

  /** Send a command that takes effect at a time of the context, s, or now. */
  #tell(time, kind, number, ...brought) {
    const sample = time === undefined ? undefined : Math.round(time * this.sampleRate);
    this.#send(command(kind, number, sample, ...brought), sample !== undefined);
  }

  /**
   * Move the listener: to a pose at a time of the context, s, or as soon as may be.
   * @param {Pose} pose
   * @param {number} [time]
   */
  moveListener({ position, forward, up = [0, 0, 1] }, time) {
    this.#tell(time, KINDS.POSE, 0, time ?? NaN, position, forward, up);
  }

  /** Set the volume, dB; 0 is as calibrated. */
  setVolume(decibels) {
    this.#volume = decibels;
    this.#level();
  }

  /** Set which share of full scale a pressure of 1 Pa is. */
  setFullScale(fullScale) {
    this.#fullScale = fullScale;
    this.#level();
  }

  #level() {
    const gain = this.#fullScale * 10 ** (this.#volume / 20);
    this.#tell(undefined, KINDS.LEVEL, 0, gain);
  }

  /**
   * Set full scale so that a default strike of the loudest body peaks at -12 dB at 1 m.
   * @param {Striker} striker
   */
  calibrate(striker) {
    const peaks = [...this.#bodies.values()].map(({ model }) =>
      peakOf(model, striker, this.sampleRate),
    );
    const peak = Math.max(0, ...peaks);
    if (peak > 0) this.setFullScale(STRIKE_PEAK / peak);
    return this.#fullScale;
  }

  /** Call a function with each report of the worklet, about 20 a second. */
  onReport(listener) {
    this.#listening.push(listener);
  }

  /** Return the last report. */
  counts() {
    return this.last;
  }

  /** Time from a strike to its sound but for the way through the air and the device, s. */
  get latency() {
    return latencyOf(this.sampleRate) / this.sampleRate;
  }

  /** End all sound; the engine cannot be used any more. */
  close() {
    this.node.port.postMessage({ close: true });
    this.node.disconnect();
  }
}

const told = ({ count, recoil }) => `${count} modes${recoil ? ' and recoil' : ''}`;

/**
 * What the worklet tells.
 * @typedef {{time: number, peak: number, reduction: number, ringing: number, modes: number,
 *   voices: number, dropped: number, late: number, replaced: number, underruns: number,
 *   load: number, struck: number}} Report `struck`: when the first sample of the last
 *   strike was made, ms of `Date.now()`
 */

/** @returns {Report} */
function reportOf(words) {
  return {
    time: words[REPORT.TIME],
    peak: words[REPORT.PEAK],
    reduction: 20 * Math.log10(words[REPORT.LEAST_GAIN] || 1),
    ringing: words[REPORT.RINGING],
    modes: words[REPORT.MODES],
    voices: words[REPORT.VOICES],
    dropped: words[REPORT.DROPPED],
    late: words[REPORT.LATE],
    replaced: words[REPORT.REPLACED],
    underruns: words[REPORT.UNDERRUNS],
    load: words[REPORT.LOAD],
    struck: words[REPORT.STRUCK],
  };
}

/** Return the peak of a strike at a body's loudest place, at 1 m, Pa. */
export function peakOf(model, striker, sampleRate) {
  const contact = model.loudest();
  const blow = resolved(model, contact, { striker });
  const pulse = sampledPulse({ ...blow, onset: 0, sampleRate });
  const drive = model.drive(contact);
  const bank = new PlainKit({ sampleRate, channels: 1 }).bank(drive.length, 1);
  const { re, im } = model.aside(sampleRate);
  bank.setPoles(logarithms(model, null, sampleRate), 0);
  bank.setOutputs(Float64Array.from([...re, ...im]), 0);
  bank.start(0, drive, 0);
  let peak = 0;
  for (let first = 0; first < LISTENED * sampleRate; first += bank.sound.length) {
    const part = pulse.force.subarray(first, first + bank.sound.length);
    bank.force(0).fill(0);
    bank.force(0).set(part);
    if (!part.length) bank.stop(0);
    else if (first) bank.go(0);
    bank.make();
    peak = bank.sound.reduce((most, each) => Math.max(most, Math.abs(each)), peak);
  }
  return peak;
}
