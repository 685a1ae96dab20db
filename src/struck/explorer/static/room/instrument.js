/** The bodies as an instrument: the engine of sound, once a gesture has allowed it to sound. */

import { ChangedModel } from '../model/changed.js';
import { createEngine } from '../sound/engine.js';

const FULL = 10 ** (-12 / 20); // of full scale: the peak of the usual blow, heard at AWAY
const AWAY = 2.5; // m
const USUAL = 1; // Pa at 1 m: the peak that all bodies are given under the usual blow
const SOFTEST = 1e-4; // Pa: a body that is softer still is not raised further
const GRIP = 12; // N s/m, of a fingertip that damps
const STARTED = 3000; // ms in which a device begins to play
const SILENT = 'the audio device does not start: connect one, choose another in the system or let this page play sound in the browser, then click again. Pictures and modes still work';
const GESTURES = ['pointerdown', 'pointerup', 'keydown', 'touchend'];

export class Instrument {
  /**
   * @param {Record<string, object>} strikers by name, as in strikers.toml
   * @param {(text: string | null, id: string) => void} say tells a person what falls short, or
   *   null: that it no longer does
   */
  constructor(strikers, say) {
    this.strikers = strikers;
    this.say = say;
    this.bodies = new Map(); // by object: {told, model, place, body: number of the engine}
    this.engine = null;
    this.context = null;
    this.settings = { ears: 'binaural', volume: -6, even: true };
    this.onReport = () => {};
    this.onReady = () => {};
    this.queued = null;
    this.failed = false; // the engine cannot be had
    this.stuck = false; // the audio device does not start
    this.waiting = false; // for the ears that were chosen, while others hear
    this.awake = this.#gesture.bind(this);
    for (const name of GESTURES) addEventListener(name, this.awake, { capture: true });
  }

  /** Whether it can sound by now. */
  get ready() {
    return this.engine !== null && this.context.state === 'running';
  }

  /** Whether it was asked to sound and cannot yet. */
  get pending() {
    return Boolean(this.starting) && !this.failed && !this.stuck && !this.ready;
  }

  #gesture() {
    this.context ??= this.#open();
    if (!this.context) return;
    if (this.context.state !== 'running') {
      const silent = () => {
        this.stuck = this.context.state !== 'running';
        if (this.stuck) this.say(SILENT, 'device');
        this.onReady();
      };
      this.context.resume().catch(silent);
      clearTimeout(this.late); // some browsers leave the promise open where there is no device
      this.late = setTimeout(silent, STARTED);
    }
    this.starting ??= this.#start().catch((error) => {
      this.failed = true;
      this.say(`there is no sound: ${error.message}. Pictures and modes still work; another browser may help`, 'engine');
    });
    this.onReady();
  }

  #open() {
    try {
      const context = new AudioContext({ latencyHint: 'interactive' });
      context.onstatechange = () => {
        this.stuck &&= context.state !== 'running';
        if (context.state === 'running') this.say(null, 'device');
        this.onReady();
      };
      context.onerror = () => this.say(SILENT, 'device');
      return context;
    } catch (error) {
      this.say(`there is no sound: this browser opens no audio device (${error.message})`, 'device');
      return null;
    }
  }

  async #start() {
    this.engine = await this.#engine();
    for (const entry of this.bodies.values()) this.#enter(entry);
    this.onReady();
    if (this.queued) this.strike(...this.queued);
    this.queued = null;
    await this.setEars(this.settings.ears);
  }

  async #engine() {
    const engine = await createEngine(this.context); // one ear, which needs no tables
    if (engine.note) this.say(engine.note, 'engine');
    this.analyser = this.context.createAnalyser();
    Object.assign(this.analyser, { fftSize: 8192, smoothingTimeConstant: 0.55, minDecibels: -110, maxDecibels: -10 });
    engine.node.connect(this.context.destination);
    engine.node.connect(this.analyser);
    engine.setFullScale((FULL * AWAY) / USUAL);
    engine.setVolume(this.settings.volume);
    engine.onReport((report) => this.onReport(report));
    if (this.head) engine.moveListener(this.head);
    return engine;
  }

  #enter(entry) {
    entry.body = this.engine.addModel(this.#sounding(entry), entry.place);
  }

  /** Return the model that the engine is given: as loud as the others where that is asked for. */
  #sounding({ told, model, change }) {
    const peak = Math.max(told.facts.peak, SOFTEST);
    const even = this.settings.even || !told.facts.calibrated;
    return new ChangedModel(model, change, even ? USUAL / peak : 1);
  }

  /** Add an object that has been read. */
  add(told, model) {
    const entry = { told, model, now: model, change: null, place: { position: told.position, rotation: told.rotation } };
    this.bodies.set(told.id, entry);
    if (this.engine) this.#enter(entry);
  }

  /** Return the model of an object as it is now. */
  model(id) {
    return this.bodies.get(id)?.now;
  }

  /** Make an object of another material, size or damping, while it rings. */
  change(id, change) {
    const entry = this.bodies.get(id);
    const { count } = entry.now;
    entry.change = change;
    entry.now = change ? new ChangedModel(entry.model, change) : entry.model;
    if (entry.body === undefined) return;
    const after = this.#sounding(entry);
    if (after.count === count) this.engine.changeModel(entry.body, after);
    else this.engine.replaceModel(entry.body, after);
  }

  /**
   * Strike an object; the last blow before sound has started is heard once it has.
   * @param {string} id
   * @param {import('../model/model.js').Contact} contact
   * @param {{striker: string, speed: number, drive?: number[]}} how `drive` of the server, if any
   * @returns {{impulse: number, duration: number} | null}
   */
  strike(id, contact, { striker, speed, drive }) {
    const entry = this.bodies.get(id);
    if (!this.engine) {
      this.queued = [id, contact, { striker, speed, drive }];
      return null;
    }
    const blow = { body: entry.body, contact, drive };
    // A recorded gain holds its own blow: an impulse of 1 is that, and speed makes it more.
    const given = this.model(id).recorded ? { impulse: speed, duration: 0 } : { striker: this.strikers[striker], speed };
    return this.engine.strike({ ...blow, ...given });
  }

  /** Damp an object where it is touched, until `release`. */
  hold(id, contact) {
    if (!this.engine) return;
    this.release(id);
    const entry = this.bodies.get(id);
    entry.held = this.engine.hold({ body: entry.body, contact, grip: GRIP });
  }

  release(id) {
    const entry = this.bodies.get(id);
    if (entry?.held === undefined) return;
    this.engine.release(entry.held);
    entry.held = undefined;
  }

  /** Put the listener's head somewhere. */
  listen(head) {
    this.head = head;
    this.engine?.moveListener(head);
  }

  setVolume(decibels) {
    this.settings.volume = decibels;
    this.engine?.setVolume(decibels);
  }

  setEven(even) {
    this.settings.even = even;
    if (!this.engine) return;
    for (const entry of this.bodies.values()) this.engine.changeModel(entry.body, this.#sounding(entry));
  }

  /** Hear by other ears as soon as their tables are there; what rings goes on. */
  async setEars(ears) {
    this.settings.ears = ears;
    if (!this.engine) return;
    this.waiting = ears !== 'mono';
    this.onReady();
    const note = await this.engine.setEars(ears);
    if (this.settings.ears !== ears) return;
    this.waiting = false;
    this.say(note || null, 'ears');
    this.onReady();
  }
}
